
/* What the first layer's outputs change by, per second of t. */
static const PINC_REAL pinc_time[@FIRST@] = {
@TIME@};

void pinc_net_at(PINC_REAL t, const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                 PINC_REAL next[PINC_NX])
{
    pinc_vector v[2 * PINC_ROW];
    PINC_REAL bias[@FIRST@ + PINC_SLACK] = {0};
    const PINC_REAL *out;
    int i;
    for (i = 0; i < @FIRST@; i++) {
        bias[i] = pinc_layers[0].bias[i] + (pinc_time[i] * (t - PINC_N(PINC_SAMPLE_TIME_S)));
    }
    pinc_begin(x, u, v, 1);
    out = (const PINC_REAL *)pinc_run(v, PINC_ROW, 2, bias, 1);
    for (i = 0; i < PINC_NX; i++) {
        next[i] = @AT_VALUE@;
    }
}
