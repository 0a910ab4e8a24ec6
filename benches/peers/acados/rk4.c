/* RK4 in SUBSTEPS substeps of T = STEP_S, with forward sensitivities by states and inputs. */
#include <string.h>

#include "model.h"

/* The rates f of a plant and their derivatives df/dx s + df/du along the columns of s. */
static inline void rates(const double *x, const double *u, double s[NX][PADDED], double *f,
                         double df[NX][PADDED]);

#include PLANT

static inline void advance(const double *x, double s[NX][PADDED], double h, const double *f,
                           double df[NX][PADDED], double *to, double s_to[NX][PADDED]) {
    for (int i = 0; i < NX; i++) {
        to[i] = x[i] + h * f[i];
        for (int j = 0; j < PADDED; j++) s_to[i][j] = s[i][j] + h * df[i][j];
    }
}

void model_step(const double *x0, const double *u, double *next, double s[NX][PADDED]) {
    const double h = (double)STEP_S / SUBSTEPS;
    double f[4][NX], df[4][NX][PADDED], x[NX], at[NX], s_at[NX][PADDED];
    memcpy(x, x0, sizeof x);
    memset(s, 0, sizeof(double[NX][PADDED]));
    for (int i = 0; i < NX; i++) s[i][i] = 1.0;
    for (int substep = 0; substep < SUBSTEPS; substep++) {
        rates(x, u, s, f[0], df[0]);
        advance(x, s, h / 2, f[0], df[0], at, s_at);
        rates(at, u, s_at, f[1], df[1]);
        advance(x, s, h / 2, f[1], df[1], at, s_at);
        rates(at, u, s_at, f[2], df[2]);
        advance(x, s, h, f[2], df[2], at, s_at);
        rates(at, u, s_at, f[3], df[3]);
        for (int i = 0; i < NX; i++) {
            x[i] += h / 6 * (f[0][i] + 2 * f[1][i] + 2 * f[2][i] + f[3][i]);
            for (int j = 0; j < PADDED; j++) {
                s[i][j] += h / 6 * (df[0][i][j] + 2 * df[1][i][j] + 2 * df[2][i][j] + df[3][i][j]);
            }
        }
    }
    memcpy(next, x, sizeof x);
}
