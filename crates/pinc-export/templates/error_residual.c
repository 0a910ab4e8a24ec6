@BANNER@
#include "pinc_error.h"

#include <math.h>

/* Nodes of the quadrature. */
#define PINC_NODES @NODES@

/* Their places in a step, and their weights, in lengths of it. */
static const PINC_REAL pinc_nodes[PINC_NODES] = {
@PLACES@};
static const PINC_REAL pinc_node_weights[PINC_NODES] = {
@WEIGHTS@};

/* The rates of the plant's equation with the entries of their Jacobian by (x, u) that may differ
   from 0. */
static void pinc_jacobian(const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *dx,
                          PINC_REAL f[PINC_NX][PINC_NX + @WIDTH@])
{
@JACOBIAN@}

/* Solves m y = y by elimination with pivots; y is not finite if m is singular. */
static void pinc_solve(PINC_REAL m[PINC_NX][PINC_NX], PINC_REAL y[PINC_NX])
{
    int i;
    int j;
    int k;
    for (k = 0; k < PINC_NX; k++) {
        int pivot = k;
        for (i = k + 1; i < PINC_NX; i++) {
            if (PINC_MATH(fabs)(m[i][k]) > PINC_MATH(fabs)(m[pivot][k])) {
                pivot = i;
            }
        }
        for (j = k; (pivot != k) && (j < PINC_NX); j++) {
            const PINC_REAL kept = m[k][j];
            m[k][j] = m[pivot][j];
            m[pivot][j] = kept;
        }
        if (pivot != k) {
            const PINC_REAL kept = y[k];
            y[k] = y[pivot];
            y[pivot] = kept;
        }
        for (i = k + 1; i < PINC_NX; i++) {
            const PINC_REAL factor = m[i][k] / m[k][k];
            for (j = k + 1; j < PINC_NX; j++) {
                m[i][j] -= factor * m[k][j];
            }
            y[i] -= factor * y[k];
        }
    }
    for (i = PINC_NX - 1; i >= 0; i--) {
        for (j = i + 1; j < PINC_NX; j++) {
            y[i] -= m[i][j] * y[j];
        }
        y[i] /= m[i][i];
    }
}

/* Carries an error over some seconds by the trapezoidal rule, with the Jacobians at both ends. */
static void pinc_carry(PINC_REAL seconds, PINC_REAL before[PINC_NX][PINC_NX + @WIDTH@],
                       PINC_REAL after[PINC_NX][PINC_NX + @WIDTH@], PINC_REAL error[PINC_NX])
{
    const PINC_REAL half = PINC_N(0.5) * seconds;
    PINC_REAL m[PINC_NX][PINC_NX];
    PINC_REAL sum[PINC_NX];
    int i;
    int j;
    for (i = 0; i < PINC_NX; i++) {
        PINC_REAL slope = PINC_N(0);
        for (j = 0; j < PINC_NX; j++) {
            slope += before[i][j] * error[j];
            m[i][j] = ((i == j) ? PINC_N(1) : PINC_N(0)) - (half * after[i][j]);
        }
        sum[i] = error[i] + (half * slope);
    }
    pinc_solve(m, sum);
    for (i = 0; i < PINC_NX; i++) {
        error[i] = sum[i];
    }
}

/* The error e of the net's path y obeys e' = J e + r with its residual r = y' - f(y, u). */
void pinc_error(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL error[PINC_NX])
{
    const PINC_REAL length = PINC_N(PINC_SAMPLE_TIME_S);
    /* At this node and at the one before; what is always 0 is not written. */
    PINC_REAL f[2][PINC_NX][PINC_NX + @WIDTH@] = {{{PINC_N(0)}}};
    PINC_REAL y[PINC_NX];
    PINC_REAL rate[PINC_NX];
    PINC_REAL dx[PINC_NX];
    PINC_REAL begin = PINC_N(0);
    int i;
    int k;
    pinc_net_path(PINC_N(0), x, u, error, rate);
    for (i = 0; i < PINC_NX; i++) {
        error[i] -= x[i];
    }
    for (k = 0; k < PINC_NODES; k++) {
        const int here = k % 2;
        pinc_net_path(length * pinc_nodes[k], x, u, y, rate);
        pinc_jacobian(y, u, dx, f[here]);
        pinc_carry(length * (pinc_nodes[k] - begin), f[(k > 0) ? (1 - here) : here], f[here],
                   error);
        for (i = 0; i < PINC_NX; i++) {
            error[i] += length * pinc_node_weights[k] * (rate[i] - dx[i]);
        }
        begin = pinc_nodes[k];
    }
    pinc_carry(length * (PINC_N(1) - begin), f[(PINC_NODES - 1) % 2], f[(PINC_NODES - 1) % 2], error);
}
