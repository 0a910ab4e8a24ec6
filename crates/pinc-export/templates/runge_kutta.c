@BANNER@
#include "pinc_@RK@.h"

#include <math.h>

/* Substeps of a step, and their length in s. */
#define PINC_SUBSTEPS @SUBSTEPS@
#define PINC_SUBSTEP_S PINC_N(@H@)
/* Tangents: one per state and argument u; the Jacobian by both. */
#define PINC_TANGENTS (PINC_NX + @WIDTH@)
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
    int k;
    int i;
    for (i = 0; i < width; i++) {
        to[i] = from[i];
    }
    for (k = 0; k < count; k++) {
        const PINC_REAL factor = PINC_SUBSTEP_S * row[k];
        if ((factor > PINC_N(0)) || (factor < PINC_N(0))) {
            for (i = 0; i < width; i++) {
                to[i] = (factor * slopes[(k * width) + i]) + to[i];
            }
        }
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
    /* Values and tangents. */
    PINC_REAL begin[PINC_NX];
    PINC_REAL stage[PINC_NX];
    PINC_REAL slopes[PINC_STAGES * PINC_NX];
    PINC_REAL f[PINC_NX][PINC_TANGENTS];
    PINC_REAL d_begin[PINC_NX * PINC_TANGENTS];
    PINC_REAL d_stage[PINC_NX * PINC_TANGENTS];
    PINC_REAL d_next[PINC_NX * PINC_TANGENTS];
    PINC_REAL d_slopes[PINC_STAGES * PINC_NX * PINC_TANGENTS];
    int substep;
    int s;
    int i;
    int t;
    for (i = 0; i < PINC_NX; i++) {
        next[i] = x[i];
        for (t = 0; t < PINC_TANGENTS; t++) {
            d_next[(i * PINC_TANGENTS) + t] = (i == t) ? PINC_N(1) : PINC_N(0);
        }
    }
    for (substep = 0; substep < PINC_SUBSTEPS; substep++) {
        for (i = 0; i < PINC_NX; i++) {
            begin[i] = next[i];
        }
        for (i = 0; i < PINC_NX * PINC_TANGENTS; i++) {
            d_begin[i] = d_next[i];
        }
        for (s = 0; s < PINC_STAGES; s++) {
            pinc_combine(s, begin, slopes, stage, PINC_NX);
            pinc_combine(s, d_begin, d_slopes, d_stage, PINC_NX * PINC_TANGENTS);
            pinc_jacobian(stage, u, slopes + (s * PINC_NX), f);
            pinc_slopes(f, d_stage, d_slopes + (s * PINC_NX * PINC_TANGENTS));
        }
        pinc_combine(PINC_STAGES, begin, slopes, next, PINC_NX);
        pinc_combine(PINC_STAGES, d_begin, d_slopes, d_next, PINC_NX * PINC_TANGENTS);
    }
    for (i = 0; i < PINC_NX; i++) {
        for (t = 0; t < PINC_NX; t++) {
            a[(i * PINC_NX) + t] = d_next[(i * PINC_TANGENTS) + t];
        }
        for (t = 0; t < @WIDTH@; t++) {
            b[(i * @WIDTH@) + t] = d_next[(i * PINC_TANGENTS) + PINC_NX + t];
        }
    }
}
