@BANNER@
#include "pinc_@RK@.h"

#include <math.h>

/* Substeps of a step, and their length in s. */
#define PINC_SUBSTEPS @SUBSTEPS@
#define PINC_SUBSTEP_S PINC_N(@H@)
/* Tangents: one per state and argument u; the Jacobian by both. */
#define PINC_TANGENTS (PINC_NX + @WIDTH@)
/* States with their tangents. */
#define PINC_ALL (PINC_NX * (1 + PINC_TANGENTS))
#define PINC_STAGES @STAGES@

/* The method: how far each stage lies along the slopes before it, and in the last row, what the
   slopes weigh in the result; in substeps. */
static const PINC_REAL pinc_tableau[(PINC_STAGES + 1) * PINC_STAGES] = {
@TABLEAU@};

void pinc_@RK@_derivative(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                         PINC_REAL dx[PINC_NX])
{
@VALUES@}

/* The same with its Jacobian, by (x, u), row by row. */
static void pinc_jacobian(const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *dx,
                          PINC_REAL f[PINC_NX][PINC_TANGENTS])
{
@JACOBIAN@}

/* to = from + a substep along the slopes, by row s of the tableau, all of this width. */
static void pinc_combine(int s, const PINC_REAL *from, const PINC_REAL *slopes, PINC_REAL *to,
                         int width)
{
    const PINC_REAL *row = pinc_tableau + (s * PINC_STAGES);
    const int count = (s < PINC_STAGES) ? s : PINC_STAGES;
    const PINC_REAL *sum = from;
    int k;
    int i;
    for (k = 0; k < count; k++) {
        const PINC_REAL factor = PINC_SUBSTEP_S * row[k];
        if ((factor > PINC_N(0)) || (factor < PINC_N(0))) {
            const PINC_REAL *slope = slopes + (k * width);
            for (i = 0; i < width; i++) {
                to[i] = (factor * slope[i]) + sum[i];
            }
            sum = to;
        }
    }
    for (i = 0; (sum == from) && (i < width); i++) {
        to[i] = from[i];
    }
}

void pinc_@RK@_step(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL next[PINC_NX])
{
    PINC_REAL begin[PINC_NX];
    PINC_REAL stage[PINC_NX];
    PINC_REAL slopes[PINC_STAGES * PINC_NX];
    int substep;
    int s;
    int i;
    for (i = 0; i < PINC_NX; i++) {
        next[i] = x[i];
    }
    for (substep = 0; substep < PINC_SUBSTEPS; substep++) {
        for (i = 0; i < PINC_NX; i++) {
            begin[i] = next[i];
        }
        for (s = 0; s < PINC_STAGES; s++) {
            pinc_combine(s, begin, slopes, stage, PINC_NX);
            pinc_@RK@_derivative(stage, u, slopes + (s * PINC_NX));
        }
        pinc_combine(PINC_STAGES, begin, slopes, next, PINC_NX);
    }
}

/* slope = F stage, row by row, in which the tangents of the arguments u are unit vectors. */
static void pinc_slopes(PINC_REAL f[PINC_NX][PINC_TANGENTS], const PINC_REAL *stage,
                        PINC_REAL *slope)
{
    int i;
    int j;
    int t;
    for (i = 0; i < PINC_NX; i++) {
        PINC_REAL *row = slope + (i * PINC_TANGENTS);
        for (t = 0; t < PINC_TANGENTS; t++) {
            row[t] = (t < PINC_NX) ? PINC_N(0) : f[i][t];
        }
        for (j = 0; j < PINC_NX; j++) {
            for (t = 0; t < PINC_TANGENTS; t++) {
                row[t] += f[i][j] * stage[(j * PINC_TANGENTS) + t];
            }
        }
    }
}

void pinc_@RK@_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                        PINC_REAL next[PINC_NX], PINC_REAL a[PINC_NX * PINC_NX],
                        PINC_REAL b[PINC_NX * @WIDTH@])
{
    /* States, and behind them their tangents. */
    PINC_REAL begin[PINC_ALL];
    PINC_REAL stage[PINC_ALL];
    PINC_REAL end[PINC_ALL];
    PINC_REAL slopes[PINC_STAGES * PINC_ALL];
    PINC_REAL f[PINC_NX][PINC_TANGENTS];
    int substep;
    int s;
    int i;
    int t;
    for (i = 0; i < PINC_NX; i++) {
        end[i] = x[i];
        for (t = 0; t < PINC_TANGENTS; t++) {
            end[PINC_NX + (i * PINC_TANGENTS) + t] = (i == t) ? PINC_N(1) : PINC_N(0);
        }
    }
    for (substep = 0; substep < PINC_SUBSTEPS; substep++) {
        for (i = 0; i < PINC_ALL; i++) {
            begin[i] = end[i];
        }
        for (s = 0; s < PINC_STAGES; s++) {
            PINC_REAL *slope = slopes + (s * PINC_ALL);
            pinc_combine(s, begin, slopes, stage, PINC_ALL);
            pinc_jacobian(stage, u, slope, f);
            pinc_slopes(f, stage + PINC_NX, slope + PINC_NX);
        }
        pinc_combine(PINC_STAGES, begin, slopes, end, PINC_ALL);
    }
    for (i = 0; i < PINC_NX; i++) {
        const PINC_REAL *row = end + (PINC_NX + (i * PINC_TANGENTS));
        next[i] = end[i];
        for (t = 0; t < PINC_NX; t++) {
            a[(i * PINC_NX) + t] = row[t];
        }
        for (t = 0; t < @WIDTH@; t++) {
            b[(i * @WIDTH@) + t] = row[PINC_NX + t];
        }
    }
}
