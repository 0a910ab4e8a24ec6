
void pinc_net_path(PINC_REAL t, const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                   PINC_REAL next[PINC_NX], PINC_REAL rate[PINC_NX])
{
    pinc_vector v[2 * PINC_ROW];
    PINC_REAL d[2][PINC_WIDEST];
    PINC_REAL bias[@FIRST@ + PINC_SLACK] = {0};
    const PINC_REAL *out;
    const PINC_REAL *slope;
    int from = 0;
    int l;
    int i;
    int k;
    for (i = 0; i < @FIRST@; i++) {
        bias[i] = pinc_layers[0].bias[i] + (pinc_time[i] * (t - PINC_N(PINC_SAMPLE_TIME_S)));
    }
    pinc_begin(x, u, v, 1);
    for (l = 0; l < PINC_LAYERS; l++) {
        const pinc_layer *layer = &pinc_layers[l];
        const int hidden = (l + 1 < PINC_LAYERS) ? 1 : 0;
        const int to = 1 - from;
        pinc_values(layer, (l == 0) ? bias : layer->bias, hidden, v + (from * PINC_ROW),
                    v + (to * PINC_ROW), 1);
        out = (const PINC_REAL *)(v + (to * PINC_ROW));
        for (i = 0; i < layer->outputs; i++) {
            PINC_REAL sum = PINC_N(0);
            if (l == 0) {
                sum = pinc_time[i];
            } else {
                for (k = 0; k < layer->inputs; k++) {
                    sum += layer->weights[(i * layer->inputs) + k] * d[from][k];
                }
            }
            d[to][i] = (hidden != 0) ? ((PINC_N(1) - (out[i] * out[i])) * sum) : sum;
        }
        from = to;
    }
    out = (const PINC_REAL *)(v + (from * PINC_ROW));
    slope = d[from];
    for (i = 0; i < PINC_NX; i++) {
        next[i] = @AT_VALUE@;
        rate[i] = @AT_RATE@;
    }
}
