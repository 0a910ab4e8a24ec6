@BANNER@
#include "pinc_rk4.h"

#include <math.h>

/* Substeps of a step, and their length in s. */
#define PINC_SUBSTEPS @SUBSTEPS@
#define PINC_SUBSTEP_S PINC_N(@H@)
/* Tangents: one per state and input. */
#define PINC_TANGENTS (PINC_NX + PINC_NU)

/* The classical method of order 4: for each stage's slope how far the next stage goes along it,
   and its weight in the result, in substeps. */
static const PINC_REAL pinc_reach[4] = {PINC_N(0.5), PINC_N(0.5), PINC_N(1), PINC_N(0)};
static const PINC_REAL pinc_weight[4] = {PINC_N(1.0 / 6.0), PINC_N(1.0 / 3.0), PINC_N(1.0 / 3.0),
                                         PINC_N(1.0 / 6.0)};

void pinc_rk4_derivative(const PINC_REAL x[PINC_NX], const PINC_REAL u[PINC_NU],
                         PINC_REAL dx[PINC_NX])
{
@VALUES@}

/* The same with its Jacobian, by (x, u), row by row. */
static void pinc_jacobian(const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *dx,
                          PINC_REAL f[PINC_NX][PINC_TANGENTS])
{
@JACOBIAN@}

void pinc_rk4_step(const PINC_REAL x[PINC_NX], const PINC_REAL u[PINC_NU], PINC_REAL next[PINC_NX])
{
    PINC_REAL begin[PINC_NX];
    PINC_REAL stage[PINC_NX];
    PINC_REAL k[PINC_NX];
    int substep;
    int s;
    int i;
    for (i = 0; i < PINC_NX; i++) {
        next[i] = x[i];
    }
    for (substep = 0; substep < PINC_SUBSTEPS; substep++) {
        for (i = 0; i < PINC_NX; i++) {
            begin[i] = next[i];
            stage[i] = next[i];
        }
        for (s = 0; s < 4; s++) {
            pinc_rk4_derivative(stage, u, k);
            for (i = 0; i < PINC_NX; i++) {
                stage[i] = (k[i] * (PINC_SUBSTEP_S * pinc_reach[s])) + begin[i];
                next[i] = (k[i] * (PINC_SUBSTEP_S * pinc_weight[s])) + next[i];
            }
        }
    }
}

/* k = F stage, in which the tangents of the inputs are unit vectors. */
static void pinc_slopes(PINC_REAL f[PINC_NX][PINC_TANGENTS], PINC_REAL stage[PINC_NX][PINC_TANGENTS],
                        PINC_REAL k[PINC_NX][PINC_TANGENTS])
{
    int i;
    int j;
    int t;
    for (i = 0; i < PINC_NX; i++) {
        for (t = 0; t < PINC_TANGENTS; t++) {
            k[i][t] = (t < PINC_NX) ? PINC_N(0) : f[i][t];
        }
        for (j = 0; j < PINC_NX; j++) {
            for (t = 0; t < PINC_TANGENTS; t++) {
                k[i][t] += f[i][j] * stage[j][t];
            }
        }
    }
}

void pinc_rk4_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[PINC_NU],
                        PINC_REAL next[PINC_NX], PINC_REAL a[PINC_NX * PINC_NX],
                        PINC_REAL b[PINC_NX * PINC_NU])
{
    PINC_REAL begin[PINC_NX];
    PINC_REAL stage[PINC_NX];
    PINC_REAL k[PINC_NX];
    PINC_REAL f[PINC_NX][PINC_TANGENTS];
    PINC_REAL d_begin[PINC_NX][PINC_TANGENTS];
    PINC_REAL d_stage[PINC_NX][PINC_TANGENTS];
    PINC_REAL d_next[PINC_NX][PINC_TANGENTS];
    PINC_REAL d_k[PINC_NX][PINC_TANGENTS];
    int substep;
    int s;
    int i;
    int t;
    for (i = 0; i < PINC_NX; i++) {
        next[i] = x[i];
        for (t = 0; t < PINC_TANGENTS; t++) {
            d_next[i][t] = (i == t) ? PINC_N(1) : PINC_N(0);
        }
    }
    for (substep = 0; substep < PINC_SUBSTEPS; substep++) {
        for (i = 0; i < PINC_NX; i++) {
            begin[i] = next[i];
            stage[i] = next[i];
            for (t = 0; t < PINC_TANGENTS; t++) {
                d_begin[i][t] = d_next[i][t];
                d_stage[i][t] = d_next[i][t];
            }
        }
        for (s = 0; s < 4; s++) {
            const PINC_REAL reach = PINC_SUBSTEP_S * pinc_reach[s];
            const PINC_REAL weight = PINC_SUBSTEP_S * pinc_weight[s];
            pinc_jacobian(stage, u, k, f);
            pinc_slopes(f, d_stage, d_k);
            for (i = 0; i < PINC_NX; i++) {
                stage[i] = (k[i] * reach) + begin[i];
                next[i] = (k[i] * weight) + next[i];
                for (t = 0; t < PINC_TANGENTS; t++) {
                    d_stage[i][t] = (d_k[i][t] * reach) + d_begin[i][t];
                    d_next[i][t] = (d_k[i][t] * weight) + d_next[i][t];
                }
            }
        }
    }
    for (i = 0; i < PINC_NX; i++) {
        for (t = 0; t < PINC_NX; t++) {
            a[(i * PINC_NX) + t] = d_next[i][t];
        }
        for (t = 0; t < PINC_NU; t++) {
            b[(i * PINC_NU) + t] = d_next[i][PINC_NX + t];
        }
    }
}
