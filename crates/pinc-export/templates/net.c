@BANNER@
#include "pinc_net.h"

#include <math.h>

/* Numbers that a layer takes and gives, at most. */
#define PINC_WIDEST @WIDEST@
/* Tangents: one per state and input. */
#define PINC_TANGENTS (PINC_NX + @WIDTH@)
/* Hidden layers, and the output layer. */
#define PINC_LAYERS @LAYERS@

typedef struct {
    const PINC_REAL *weights; /* [outputs][inputs] */
    const PINC_REAL *bias;    /* [outputs] */
    int inputs;
    int outputs;
} pinc_layer;

@TABLES@
/* z = W v + b, followed by tanh in hidden layers. */
static void pinc_values(const pinc_layer *layer, int hidden, const PINC_REAL *in, PINC_REAL *out)
{
    int i;
    int k;
    for (i = 0; i < layer->outputs; i++) {
        const PINC_REAL *row = layer->weights + (i * layer->inputs);
        PINC_REAL z = layer->bias[i];
        for (k = 0; k < layer->inputs; k++) {
            z += row[k] * in[k];
        }
        out[i] = (hidden != 0) ? PINC_MATH(tanh)(z) : z;
    }
}

/* Tangents of the outputs, whose values are known: (1 - tanh^2 z) W dv. */
static void pinc_tangents(const pinc_layer *layer, int hidden, const PINC_REAL *values,
                          const PINC_REAL *in, PINC_REAL *out)
{
    int i;
    int k;
    int j;
    for (i = 0; i < layer->outputs; i++) {
        const PINC_REAL *row = layer->weights + (i * layer->inputs);
        PINC_REAL *sums = out + (i * PINC_TANGENTS);
        const PINC_REAL slope = (hidden != 0) ? (PINC_N(1) - (values[i] * values[i])) : PINC_N(1);
        for (j = 0; j < PINC_TANGENTS; j++) {
            sums[j] = PINC_N(0);
        }
        for (k = 0; k < layer->inputs; k++) {
            const PINC_REAL *tangents = in + (k * PINC_TANGENTS);
            for (j = 0; j < PINC_TANGENTS; j++) {
                sums[j] += row[k] * tangents[j];
            }
        }
        for (j = 0; j < PINC_TANGENTS; j++) {
            sums[j] *= slope;
        }
    }
}

/* Writes (x, u). */
static void pinc_begin(const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *values)
{
    int i;
    for (i = 0; i < PINC_NX; i++) {
        values[i] = x[i];
    }
    for (i = 0; i < @WIDTH@; i++) {
        values[PINC_NX + i] = u[i];
    }
}

/* From the first layer on; gives where the output is. */
static const PINC_REAL *pinc_run(PINC_REAL v[2][PINC_WIDEST], int first)
{
    int l;
    int from = first % 2;
    for (l = first; l < PINC_LAYERS; l++) {
        pinc_values(&pinc_layers[l], (l + 1 < PINC_LAYERS) ? 1 : 0, v[from], v[1 - from]);
        from = 1 - from;
    }
    return v[from];
}

void pinc_net_step(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL next[PINC_NX])
{
    PINC_REAL v[2][PINC_WIDEST];
    const PINC_REAL *out;
    int i;
    pinc_begin(x, u, v[0]);
    out = pinc_run(v, 0);
    for (i = 0; i < PINC_NX; i++) {
        next[i] = @PLUS_X@out[i];
    }
}

void pinc_net_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                        PINC_REAL next[PINC_NX], PINC_REAL a[PINC_NX * PINC_NX],
                        PINC_REAL b[PINC_NX * @WIDTH@])
{
    PINC_REAL v[2][PINC_WIDEST];
    PINC_REAL d[2][PINC_WIDEST * PINC_TANGENTS];
    const PINC_REAL *out;
    int from = 0;
    int l;
    int i;
    int k;
    pinc_begin(x, u, v[0]);
    for (i = 0; i < PINC_TANGENTS; i++) {
        for (k = 0; k < PINC_TANGENTS; k++) {
            d[0][(i * PINC_TANGENTS) + k] = (i == k) ? PINC_N(1) : PINC_N(0);
        }
    }
    for (l = 0; l < PINC_LAYERS; l++) {
        const int hidden = (l + 1 < PINC_LAYERS) ? 1 : 0;
        pinc_values(&pinc_layers[l], hidden, v[from], v[1 - from]);
        pinc_tangents(&pinc_layers[l], hidden, v[1 - from], d[from], d[1 - from]);
        from = 1 - from;
    }
    out = v[from];
    for (i = 0; i < PINC_NX; i++) {
        next[i] = @PLUS_X@out[i];
        for (k = 0; k < PINC_NX; k++) {
            a[(i * PINC_NX) + k] = d[from][(i * PINC_TANGENTS) + k]@PLUS_I@;
        }
        for (k = 0; k < @WIDTH@; k++) {
            b[(i * @WIDTH@) + k] = d[from][(i * PINC_TANGENTS) + PINC_NX + k];
        }
    }
}
@AT@
