
void pinc_net_path(PINC_REAL t, const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                   PINC_REAL next[PINC_NX], PINC_REAL rate[PINC_NX])
{
    PINC_REAL v[2][PINC_WIDEST];
    PINC_REAL d[2][PINC_WIDEST];
    const PINC_REAL *out;
    const PINC_REAL *slope;
    int from = 1;
    int l;
    int i;
    int k;
    pinc_begin(x, u, v[0]);
    pinc_values(&pinc_layers[0], 0, v[0], v[1]);
    for (i = 0; i < @FIRST@; i++) {
        const PINC_REAL z = v[1][i] + (pinc_time[i] * (t - PINC_N(PINC_SAMPLE_TIME_S)));
        v[1][i] = @FIRST_HIDDEN@;
        d[1][i] = @FIRST_SLOPE@;
    }
    for (l = 1; l < PINC_LAYERS; l++) {
        const pinc_layer *layer = &pinc_layers[l];
        const int hidden = (l + 1 < PINC_LAYERS) ? 1 : 0;
        pinc_values(layer, hidden, v[from], v[1 - from]);
        for (i = 0; i < layer->outputs; i++) {
            const PINC_REAL value = v[1 - from][i];
            PINC_REAL sum = PINC_N(0);
            for (k = 0; k < layer->inputs; k++) {
                sum += layer->weights[(i * layer->inputs) + k] * d[from][k];
            }
            d[1 - from][i] = (hidden != 0) ? ((PINC_N(1) - (value * value)) * sum) : sum;
        }
        from = 1 - from;
    }
    out = v[from];
    slope = d[from];
    for (i = 0; i < PINC_NX; i++) {
        next[i] = @AT_VALUE@;
        rate[i] = @AT_RATE@;
    }
}
