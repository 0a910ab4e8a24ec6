
/* What the first layer's outputs change by, per second of t. */
static const PINC_REAL pinc_time[@FIRST@] = {
@TIME@};

void pinc_net_at(PINC_REAL t, const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                 PINC_REAL next[PINC_NX])
{
    PINC_REAL v[2][PINC_WIDEST];
    const PINC_REAL *out;
    int i;
    pinc_begin(x, u, v[0]);
    pinc_values(&pinc_layers[0], 0, v[0], v[1]);
    for (i = 0; i < @FIRST@; i++) {
        const PINC_REAL z = v[1][i] + (pinc_time[i] * (t - PINC_N(PINC_SAMPLE_TIME_S)));
        v[1][i] = @FIRST_HIDDEN@;
    }
    out = pinc_run(v, 1);
    for (i = 0; i < PINC_NX; i++) {
        next[i] = @AT_VALUE@;
    }
}
