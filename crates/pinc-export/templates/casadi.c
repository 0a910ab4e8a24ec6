@BANNER@
/*
 * The net as an external function of CasADi, with exact Jacobian and Hessian:
 *
 *     cc -O2 -shared -fPIC pinc_casadi.c -lm -o @name@.so
 *     f = casadi.external("@name@", "./@name@.so")    x_next = f(x, u)
 */
#include "pinc_net.c"

/* Tangents: one per state and input. */
#define PINC_TANGENTS (PINC_NX + PINC_NU)
#define PINC_SQUARE (PINC_TANGENTS * PINC_TANGENTS)

typedef long long pinc_int;

/* First and second derivatives of the outputs of a layer, whose values are known. */
static void pinc_seconds(const pinc_layer *layer, int hidden, const double *values,
                         const double *in_first, const double *in, double *out_first, double *out)
{
    int i;
    int k;
    int p;
    int q;
    for (i = 0; i < layer->outputs; i++) {
        const double *row = layer->weights + (i * layer->inputs);
        const double slope = (hidden != 0) ? (1.0 - (values[i] * values[i])) : 1.0;
        const double bend = (hidden != 0) ? (-2.0 * values[i] * slope) : 0.0;
        double *sums = out + (i * PINC_SQUARE);
        double first[PINC_TANGENTS];
        for (p = 0; p < PINC_TANGENTS; p++) {
            first[p] = 0.0;
        }
        for (p = 0; p < PINC_SQUARE; p++) {
            sums[p] = 0.0;
        }
        for (k = 0; k < layer->inputs; k++) {
            for (p = 0; p < PINC_TANGENTS; p++) {
                first[p] += row[k] * in_first[(k * PINC_TANGENTS) + p];
            }
            for (p = 0; p < PINC_SQUARE; p++) {
                sums[p] += row[k] * in[(k * PINC_SQUARE) + p];
            }
        }
        for (p = 0; p < PINC_TANGENTS; p++) {
            out_first[(i * PINC_TANGENTS) + p] = slope * first[p];
            for (q = 0; q < PINC_TANGENTS; q++) {
                const int at = (p * PINC_TANGENTS) + q;
                sums[at] = (slope * sums[at]) + (bend * first[p] * first[q]);
            }
        }
    }
}

/* Second derivatives of x_next by (x, u): h[i][p][q]. */
static void pinc_hessian(const double *x, const double *u, double *h)
{
    pinc_vector v[2][PINC_ROW];
    double d[2][PINC_WIDEST * PINC_TANGENTS];
    double s[2][PINC_WIDEST * PINC_SQUARE];
    int from = 0;
    int l;
    int i;
    int k;
    pinc_begin(x, u, v[0], 1);
    for (i = 0; i < PINC_TANGENTS; i++) {
        for (k = 0; k < PINC_TANGENTS; k++) {
            d[0][(i * PINC_TANGENTS) + k] = (i == k) ? 1.0 : 0.0;
        }
        for (k = 0; k < PINC_SQUARE; k++) {
            s[0][(i * PINC_SQUARE) + k] = 0.0;
        }
    }
    for (l = 0; l < PINC_LAYERS; l++) {
        const int hidden = (l + 1 < PINC_LAYERS) ? 1 : 0;
        pinc_values(&pinc_layers[l], pinc_layers[l].bias, hidden, v[from], v[1 - from], 1);
        pinc_seconds(&pinc_layers[l], hidden, (const double *)v[1 - from], d[from], s[from],
                     d[1 - from], s[1 - from]);
        from = 1 - from;
    }
    for (i = 0; i < PINC_NX * PINC_SQUARE; i++) {
        h[i] = s[from][i];
    }
}

/* An argument may be a null pointer, which stands for zeros. */
static void pinc_take(const double *arg, double *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = (arg != 0) ? arg[i] : 0.0;
    }
}

/* Sparsities: rows, columns, 1 for dense; or the (no) entries of empty ones. */
static const pinc_int pinc_sparsity_x[3] = {PINC_NX, 1, 1};
static const pinc_int pinc_sparsity_u[3] = {PINC_NU, 1, 1};
static const pinc_int pinc_sparsity_xx[3] = {PINC_NX, PINC_NX, 1};
static const pinc_int pinc_sparsity_xu[3] = {PINC_NX, PINC_NU, 1};
static const pinc_int pinc_sparsity_xxx[3] = {PINC_NX * PINC_NX, PINC_NX, 1};
static const pinc_int pinc_sparsity_xxu[3] = {PINC_NX * PINC_NX, PINC_NU, 1};
static const pinc_int pinc_sparsity_xux[3] = {PINC_NX * PINC_NU, PINC_NX, 1};
static const pinc_int pinc_sparsity_xuu[3] = {PINC_NX * PINC_NU, PINC_NU, 1};
static const pinc_int pinc_empty_x[4] = {PINC_NX, 1, 0, 0};
static const pinc_int pinc_empty_xx[3 + PINC_NX] = {PINC_NX, PINC_NX};
static const pinc_int pinc_empty_xu[3 + PINC_NU] = {PINC_NX, PINC_NU};
static const pinc_int pinc_empty_xxx[3 + PINC_NX] = {PINC_NX * PINC_NX, PINC_NX};
static const pinc_int pinc_empty_xux[3 + PINC_NX] = {PINC_NX * PINC_NU, PINC_NX};

static const char *const pinc_in[5] = {"x", "u", "out_x_next", "out_jac_x_next_x",
                                       "out_jac_x_next_u"};
static const char *const pinc_jac_out[2] = {"jac_x_next_x", "jac_x_next_u"};
static const char *const pinc_jac_jac_out[6] = {
    "jac_jac_x_next_x_x", "jac_jac_x_next_x_u", "jac_jac_x_next_x_out_x_next",
    "jac_jac_x_next_u_x", "jac_jac_x_next_u_u", "jac_jac_x_next_u_out_x_next"};

/* What CasADi asks of each function besides its values. */
#define PINC_ABOUT(function, inputs, outputs)                                                      \
    pinc_int function##_n_in(void)                                                                 \
    {                                                                                              \
        return inputs;                                                                             \
    }                                                                                              \
    pinc_int function##_n_out(void)                                                                \
    {                                                                                              \
        return outputs;                                                                            \
    }                                                                                              \
    int function##_work(pinc_int *sz_arg, pinc_int *sz_res, pinc_int *sz_iw, pinc_int *sz_w)       \
    {                                                                                              \
        if (sz_arg != 0) {                                                                         \
            *sz_arg = inputs;                                                                      \
        }                                                                                          \
        if (sz_res != 0) {                                                                         \
            *sz_res = outputs;                                                                     \
        }                                                                                          \
        if (sz_iw != 0) {                                                                          \
            *sz_iw = 0;                                                                            \
        }                                                                                          \
        if (sz_w != 0) {                                                                           \
            *sz_w = 0;                                                                             \
        }                                                                                          \
        return 0;                                                                                  \
    }                                                                                              \
    const char *function##_name_in(pinc_int i)                                                     \
    {                                                                                              \
        return ((i >= 0) && (i < inputs)) ? pinc_in[i] : 0;                                        \
    }                                                                                              \
    const pinc_int *function##_sparsity_in(pinc_int i)                                             \
    {                                                                                              \
        static const pinc_int *const all[5] = {pinc_sparsity_x, pinc_sparsity_u, pinc_empty_x,     \
                                               pinc_empty_xx, pinc_empty_xu};                      \
        return ((i >= 0) && (i < inputs)) ? all[i] : 0;                                            \
    }

#ifdef __cplusplus
extern "C" {
#endif

PINC_ABOUT(@name@, 2, 1)
PINC_ABOUT(jac_@name@, 3, 2)
PINC_ABOUT(jac_jac_@name@, 5, 6)

const char *pinc_name_out(pinc_int i)
{
    return (i == 0) ? "x_next" : 0;
}

const pinc_int *pinc_sparsity_out(pinc_int i)
{
    return (i == 0) ? pinc_sparsity_x : 0;
}

const char *jac_pinc_name_out(pinc_int i)
{
    return ((i >= 0) && (i < 2)) ? pinc_jac_out[i] : 0;
}

const pinc_int *jac_pinc_sparsity_out(pinc_int i)
{
    static const pinc_int *const all[2] = {pinc_sparsity_xx, pinc_sparsity_xu};
    return ((i >= 0) && (i < 2)) ? all[i] : 0;
}

const char *jac_jac_pinc_name_out(pinc_int i)
{
    return ((i >= 0) && (i < 6)) ? pinc_jac_jac_out[i] : 0;
}

const pinc_int *jac_jac_pinc_sparsity_out(pinc_int i)
{
    static const pinc_int *const all[6] = {pinc_sparsity_xxx, pinc_sparsity_xxu, pinc_empty_xxx,
                                           pinc_sparsity_xux, pinc_sparsity_xuu, pinc_empty_xux};
    return ((i >= 0) && (i < 6)) ? all[i] : 0;
}

int @name@(const double **arg, double **res, pinc_int *iw, double *w, int mem)
{
    double x[PINC_NX];
    double u[PINC_NU];
    (void)iw;
    (void)w;
    (void)mem;
    if (res[0] != 0) {
        pinc_take(arg[0], x, PINC_NX);
        pinc_take(arg[1], u, PINC_NU);
        pinc_net_step(x, u, res[0]);
    }
    return 0;
}

/* Blocks column by column. */
int jac_@name@(const double **arg, double **res, pinc_int *iw, double *w, int mem)
{
    double x[PINC_NX];
    double u[PINC_NU];
    double next[PINC_NX];
    double a[PINC_NX * PINC_NX];
    double b[PINC_NX * PINC_NU];
    int i;
    int k;
    (void)iw;
    (void)w;
    (void)mem;
    pinc_take(arg[0], x, PINC_NX);
    pinc_take(arg[1], u, PINC_NU);
    pinc_net_linearize(x, u, next, a, b);
    for (i = 0; i < PINC_NX; i++) {
        for (k = 0; (k < PINC_NX) && (res[0] != 0); k++) {
            res[0][(k * PINC_NX) + i] = a[(i * PINC_NX) + k];
        }
        for (k = 0; (k < PINC_NU) && (res[1] != 0); k++) {
            res[1][(k * PINC_NX) + i] = b[(i * PINC_NU) + k];
        }
    }
    return 0;
}

/* The derivatives of the Jacobian's blocks, stacked column by column, by x and u. */
int jac_jac_@name@(const double **arg, double **res, pinc_int *iw, double *w, int mem)
{
    double x[PINC_NX];
    double u[PINC_NU];
    double h[PINC_NX * PINC_SQUARE];
    int i;
    int p;
    int q;
    (void)iw;
    (void)w;
    (void)mem;
    pinc_take(arg[0], x, PINC_NX);
    pinc_take(arg[1], u, PINC_NU);
    pinc_hessian(x, u, h);
    for (p = 0; p < PINC_TANGENTS; p++) {
        for (q = 0; q < PINC_TANGENTS; q++) {
            const int of_x = (p < PINC_NX) ? 1 : 0;
            const int by_x = (q < PINC_NX) ? 1 : 0;
            double *to = res[((of_x != 0) ? 0 : 3) + ((by_x != 0) ? 0 : 1)];
            const int rows = PINC_NX * ((of_x != 0) ? PINC_NX : PINC_NU);
            const int row = PINC_NX * ((of_x != 0) ? p : (p - PINC_NX));
            const int column = (by_x != 0) ? q : (q - PINC_NX);
            for (i = 0; (i < PINC_NX) && (to != 0); i++) {
                to[(column * rows) + row + i] =
                    h[(i * PINC_SQUARE) + (p * PINC_TANGENTS) + q];
            }
        }
    }
    return 0;
}

#ifdef __cplusplus
}
#endif
