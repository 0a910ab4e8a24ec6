@BANNER@
#include "pinc_net.h"

/* Numbers that a layer takes and gives, at most, and vectors of them. */
#define PINC_WIDEST @WIDEST@
#define PINC_ROW ((PINC_WIDEST + PINC_LANES - 1) / PINC_LANES)
/* Hidden layers, and the output layer. */
#define PINC_LAYERS @LAYERS@
/* Tables end with so many zeros, which the last vector of a row may reach into. */
#define PINC_SLACK (PINC_LANES - 1)

typedef struct {
    const PINC_REAL *weights; /* [outputs][inputs] */
#if PINC_VECTOR_BYTES > 0
    const PINC_REAL *transposed;
#endif
    const PINC_REAL *bias; /* [outputs] */
    int inputs;
    int outputs;
} pinc_layer;

@TABLES@
/* How many vectors hold so many numbers. */
static int pinc_vectors(int count)
{
    return (count + PINC_LANES - 1) / PINC_LANES;
}

/* A product with V vectors of each row of a matrix, for one column or two: the sums are in
   registers. */
#define PINC_EACH_1(m) m(0)
#define PINC_EACH_2(m) PINC_EACH_1(m) m(1)
#define PINC_EACH_3(m) PINC_EACH_2(m) m(2)
#define PINC_EACH_4(m) PINC_EACH_3(m) m(3)
#define PINC_EACH_5(m) PINC_EACH_4(m) m(4)
#define PINC_BEGIN_ONE(v) pinc_vector a##v = out[v];
#define PINC_ADD_ONE(v) a##v += *(const pinc_loose *)(row + ((v) * PINC_LANES)) * one;
#define PINC_END_ONE(v) out[v] = a##v;
#define PINC_BEGIN_TWO(v) pinc_vector a##v = out[v]; pinc_vector b##v = out[PINC_ROW + (v)];
#define PINC_ADD_TWO(v)                                                                            \
    {                                                                                              \
        const pinc_vector w = *(const pinc_loose *)(row + ((v) * PINC_LANES));                     \
        a##v += w * one;                                                                           \
        b##v += w * two;                                                                           \
    }
#define PINC_END_TWO(v) out[v] = a##v; out[PINC_ROW + (v)] = b##v;
#define PINC_BLOCK(V)                                                                              \
    static void pinc_one_##V(const PINC_REAL *row, int rows, int width, const PINC_REAL *in,       \
                             pinc_vector *out)                                                     \
    {                                                                                              \
        int k;                                                                                     \
        PINC_EACH_##V(PINC_BEGIN_ONE)                                                              \
        for (k = 0; k < rows; k++) {                                                               \
            const PINC_REAL one = in[k];                                                           \
            PINC_EACH_##V(PINC_ADD_ONE)                                                            \
            row += width;                                                                          \
        }                                                                                          \
        PINC_EACH_##V(PINC_END_ONE)                                                                \
    }                                                                                              \
    static void pinc_two_##V(const PINC_REAL *row, int rows, int width, const PINC_REAL *in,       \
                             pinc_vector *out)                                                     \
    {                                                                                              \
        int k;                                                                                     \
        PINC_EACH_##V(PINC_BEGIN_TWO)                                                              \
        for (k = 0; k < rows; k++) {                                                               \
            const PINC_REAL one = in[k];                                                           \
            const PINC_REAL two = in[(PINC_ROW * PINC_LANES) + k];                                 \
            PINC_EACH_##V(PINC_ADD_TWO)                                                            \
            row += width;                                                                          \
        }                                                                                          \
        PINC_EACH_##V(PINC_END_TWO)                                                                \
    }
PINC_BLOCK(1)
PINC_BLOCK(2)
PINC_BLOCK(3)
PINC_BLOCK(4)
PINC_BLOCK(5)

typedef void (*pinc_block)(const PINC_REAL *, int, int, const PINC_REAL *, pinc_vector *);
#define PINC_MOST_VECTORS 5
static const pinc_block pinc_one[PINC_MOST_VECTORS] = {pinc_one_1, pinc_one_2, pinc_one_3,
                                                       pinc_one_4, pinc_one_5};
static const pinc_block pinc_two[PINC_MOST_VECTORS] = {pinc_two_1, pinc_two_2, pinc_two_3,
                                                       pinc_two_4, pinc_two_5};

/* out += matrix' in, of so many columns; the matrix has rows of this width. */
static void pinc_add_columns(const PINC_REAL *matrix, int rows, int width, const pinc_vector *in,
                             pinc_vector *out, int columns)
{
    const int vectors = pinc_vectors(width);
    int c;
    int v;
    for (c = 0; c < columns; c += 2) {
        const pinc_block *blocks = (c + 1 < columns) ? pinc_two : pinc_one;
        for (v = 0; v < vectors; v += PINC_MOST_VECTORS) {
            const int left = vectors - v;
            const int most = (left < PINC_MOST_VECTORS) ? left : PINC_MOST_VECTORS;
            blocks[most - 1](matrix + (v * PINC_LANES), rows, width,
                             (const PINC_REAL *)(in + (c * PINC_ROW)), out + (c * PINC_ROW) + v);
        }
    }
}

@ARITHMETIC@/* z = W v + b of all points, followed by tanh in hidden layers. */
static void pinc_values(const pinc_layer *layer, const PINC_REAL *bias, int hidden,
                        const pinc_vector *in, pinc_vector *out, int points)
{
    const int vectors = pinc_vectors(layer->outputs);
    int c;
    int i;
    for (c = 0; c < points; c++) {
        for (i = 0; i < vectors; i++) {
            out[(c * PINC_ROW) + i] = *(const pinc_loose *)(bias + (i * PINC_LANES));
        }
    }
#if PINC_VECTOR_BYTES > 0
    pinc_add_columns(layer->transposed, layer->inputs, layer->outputs, in, out, points);
#else
    /* One point, and one matrix for both directions. */
    for (i = 0; i < layer->outputs; i++) {
        const PINC_REAL *row = layer->weights + (i * layer->inputs);
        PINC_REAL z = out[i];
        for (c = 0; c < layer->inputs; c++) {
            z += row[c] * in[c];
        }
        out[i] = z;
    }
#endif
    for (c = 0; (hidden != 0) && (c < points); c++) {
        for (i = 0; i < vectors; i++) {
            out[(c * PINC_ROW) + i] = pinc_tanh(out[(c * PINC_ROW) + i]);
        }
    }
}

/* Writes (x, u) of all points. */
static void pinc_begin(const PINC_REAL *x, const PINC_REAL *u, pinc_vector *values, int points)
{
    int c;
    int i;
    for (c = 0; c < points; c++) {
        PINC_REAL *to = (PINC_REAL *)(values + (c * PINC_ROW));
        for (i = 0; i < PINC_NX; i++) {
            to[i] = x[(c * PINC_NX) + i];
        }
        for (i = 0; i < @WIDTH@; i++) {
            to[PINC_NX + i] = u[(c * @WIDTH@) + i];
        }
    }
}

/* From (x, u) through all layers, each `size` vectors behind the one before, of `kept` that there
   is memory for; gives where the outputs are. */
static const pinc_vector *pinc_run(pinc_vector *values, int size, int kept, const PINC_REAL *bias,
                                   int points)
{
    int from = 0;
    int l;
    for (l = 0; l < PINC_LAYERS; l++) {
        const int to = (from + 1 < kept) ? (from + 1) : 0;
        pinc_values(&pinc_layers[l], (l == 0) ? bias : pinc_layers[l].bias,
                    (l + 1 < PINC_LAYERS) ? 1 : 0, values + (from * size), values + (to * size),
                    points);
        from = to;
    }
    return values + (from * size);
}

void pinc_net_step(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL next[PINC_NX])
{
    pinc_vector v[2 * PINC_ROW];
    const PINC_REAL *out;
    int i;
    pinc_begin(x, u, v, 1);
    out = (const PINC_REAL *)pinc_run(v, PINC_ROW, 2, pinc_layers[0].bias, 1);
    for (i = 0; i < PINC_NX; i++) {
        next[i] = @PLUS_X@out[i];
    }
}

/* The derivatives of all outputs, a column each, by (x, u), from the last layer to the first:
   d <- W' ((1 - tanh^2 z) d). Gives where they are. */
static const pinc_vector *pinc_derivatives(const pinc_vector *values, int size,
                                           pinc_vector d[2][PINC_BATCH * PINC_NX * PINC_ROW],
                                           int points)
{
    const pinc_vector zero = {0};
    const pinc_layer *layer = &pinc_layers[PINC_LAYERS - 1];
    int from = 0;
    int l;
    int c;
    int i;
    for (c = 0; c < points * PINC_NX; c++) {
        const PINC_REAL *row = layer->weights + ((c % PINC_NX) * layer->inputs);
        for (i = 0; i < pinc_vectors(layer->inputs); i++) {
            d[from][(c * PINC_ROW) + i] = *(const pinc_loose *)(row + (i * PINC_LANES));
        }
    }
    for (l = PINC_LAYERS - 2; l >= 0; l--) {
        layer = &pinc_layers[l];
        for (c = 0; c < points * PINC_NX; c++) {
            const pinc_vector *value = values + (((l + 1) * size) + ((c / PINC_NX) * PINC_ROW));
            pinc_vector *row = d[from] + (c * PINC_ROW);
            pinc_vector *next = d[1 - from] + (c * PINC_ROW);
            for (i = 0; i < pinc_vectors(layer->outputs); i++) {
                row[i] -= row[i] * (value[i] * value[i]);
            }
            for (i = 0; i < pinc_vectors(layer->inputs); i++) {
                next[i] = zero;
            }
        }
        pinc_add_columns(layer->weights, layer->outputs, layer->inputs, d[from], d[1 - from],
                         points * PINC_NX);
        from = 1 - from;
    }
    return d[from];
}

void pinc_net_linearize_all(int points, const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *next,
                            PINC_REAL *a, PINC_REAL *b)
{
    pinc_vector v[(PINC_LAYERS + 1) * PINC_BATCH * PINC_ROW];
    pinc_vector d[2][PINC_BATCH * PINC_NX * PINC_ROW];
    const int size = PINC_BATCH * PINC_ROW;
    const pinc_vector *out;
    const pinc_vector *columns;
    int c;
    int k;
    pinc_begin(x, u, v, points);
    out = pinc_run(v, size, PINC_LAYERS + 1, pinc_layers[0].bias, points);
    columns = pinc_derivatives(v, size, d, points);
    for (c = 0; c < points * PINC_NX; c++) {
        const int i = c % PINC_NX;
        const PINC_REAL *row = (const PINC_REAL *)(columns + (c * PINC_ROW));
        next[c] = @PLUS_C@((const PINC_REAL *)(out + ((c / PINC_NX) * PINC_ROW)))[i];
        for (k = 0; k < PINC_NX; k++) {
            a[(c * PINC_NX) + k] = row[k]@PLUS_I@;
        }
        for (k = 0; k < @WIDTH@; k++) {
            b[(c * @WIDTH@) + k] = row[PINC_NX + k];
        }
    }
}

void pinc_net_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                        PINC_REAL next[PINC_NX], PINC_REAL a[PINC_NX * PINC_NX],
                        PINC_REAL b[PINC_NX * @WIDTH@])
{
    pinc_net_linearize_all(1, x, u, next, a, b);
}
@AT@
