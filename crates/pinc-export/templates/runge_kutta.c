@BANNER@
#include "pinc_@RK@.h"

#include <math.h>

/* Substeps of a step, and their length in s. */
#define PINC_SUBSTEPS @SUBSTEPS@
#define PINC_SUBSTEP_S PINC_N(@H@)
/* Tangents: one per state and argument u; the Jacobian by both. */
#define PINC_TANGENTS (PINC_NX + @WIDTH@)
/* Vectors of the states, of their tangents, and of both. */
#define PINC_VALUES ((PINC_NX + PINC_LANES - 1) / PINC_LANES)
#define PINC_ROW ((PINC_TANGENTS + PINC_LANES - 1) / PINC_LANES)
#define PINC_ALL (PINC_VALUES + (PINC_NX * PINC_ROW))
#define PINC_STAGES @STAGES@

/* The method: how far each stage lies along the slopes before it, and in the last row, what the
   slopes weigh in the result; in substeps. */
static const PINC_REAL pinc_tableau[(PINC_STAGES + 1) * PINC_STAGES] = {
@TABLEAU@};

void pinc_@RK@_derivative(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                         PINC_REAL dx[PINC_NX])
{
@VALUES@}

/* The same with its Jacobian, by (x, u), row by row, of which zeros are not written. */
static void pinc_jacobian(const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *dx,
                          PINC_REAL f[PINC_NX][PINC_TANGENTS])
{
@JACOBIAN@}

/* to = from + a substep along the slopes, by row s of the tableau, of so many vectors each. */
static void pinc_combine(int s, const pinc_vector *from, const pinc_vector *slopes, pinc_vector *to,
                         int width)
{
    const PINC_REAL *row = pinc_tableau + (s * PINC_STAGES);
    const int count = (s < PINC_STAGES) ? s : PINC_STAGES;
    const pinc_vector *sum = from;
    int k;
    int i;
    for (k = 0; k < count; k++) {
        const PINC_REAL factor = PINC_SUBSTEP_S * row[k];
        if ((factor > PINC_N(0)) || (factor < PINC_N(0))) {
            const pinc_vector *slope = slopes + (k * width);
            for (i = 0; i < width; i++) {
                to[i] = (slope[i] * factor) + sum[i];
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
    pinc_vector begin[PINC_VALUES];
    pinc_vector stage[PINC_VALUES];
    pinc_vector end[PINC_VALUES] = {0};
    pinc_vector slopes[PINC_STAGES * PINC_VALUES] = {0};
    int substep;
    int s;
    int i;
    for (i = 0; i < PINC_NX; i++) {
        ((PINC_REAL *)end)[i] = x[i];
    }
    for (substep = 0; substep < PINC_SUBSTEPS; substep++) {
        for (i = 0; i < PINC_VALUES; i++) {
            begin[i] = end[i];
        }
        for (s = 0; s < PINC_STAGES; s++) {
            pinc_combine(s, begin, slopes, stage, PINC_VALUES);
            pinc_@RK@_derivative((const PINC_REAL *)stage, u,
                                (PINC_REAL *)(slopes + (s * PINC_VALUES)));
        }
        pinc_combine(PINC_STAGES, begin, slopes, end, PINC_VALUES);
    }
    for (i = 0; i < PINC_NX; i++) {
        next[i] = ((const PINC_REAL *)end)[i];
    }
}

@UNITS@/* slope = F (stage, units), of tangents. */
static void pinc_slopes(PINC_REAL f[PINC_NX][PINC_TANGENTS], const pinc_vector *stage,
                        pinc_vector *slope)
{
    int v;
    for (v = 0; v < PINC_ROW; v++) {
@SLOPES@    }
}

void pinc_@RK@_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                        PINC_REAL next[PINC_NX], PINC_REAL a[PINC_NX * PINC_NX],
                        PINC_REAL b[PINC_NX * @WIDTH@])
{
    /* States, and behind them their tangents. */
    pinc_vector begin[PINC_ALL];
    pinc_vector stage[PINC_ALL];
    pinc_vector end[PINC_ALL] = {0};
    pinc_vector slopes[PINC_STAGES * PINC_ALL];
    PINC_REAL f[PINC_NX][PINC_TANGENTS];
    const pinc_vector zero = {0};
    int substep;
    int s;
    int i;
    int t;
    for (i = 0; i < PINC_NX; i++) {
        ((PINC_REAL *)end)[i] = x[i];
        ((PINC_REAL *)(end + (PINC_VALUES + (i * PINC_ROW))))[i] = PINC_N(1);
    }
    /* What of a vector is no state stays 0. */
    for (s = 0; s < PINC_STAGES; s++) {
        slopes[(s * PINC_ALL) + PINC_VALUES - 1] = zero;
    }
    for (substep = 0; substep < PINC_SUBSTEPS; substep++) {
        for (i = 0; i < PINC_ALL; i++) {
            begin[i] = end[i];
        }
        for (s = 0; s < PINC_STAGES; s++) {
            pinc_vector *slope = slopes + (s * PINC_ALL);
            pinc_combine(s, begin, slopes, stage, PINC_ALL);
            pinc_jacobian((const PINC_REAL *)stage, u, (PINC_REAL *)slope, f);
            pinc_slopes(f, stage + PINC_VALUES, slope + PINC_VALUES);
        }
        pinc_combine(PINC_STAGES, begin, slopes, end, PINC_ALL);
    }
    for (i = 0; i < PINC_NX; i++) {
        const PINC_REAL *row = (const PINC_REAL *)(end + (PINC_VALUES + (i * PINC_ROW)));
        next[i] = ((const PINC_REAL *)end)[i];
        for (t = 0; t < PINC_NX; t++) {
            a[(i * PINC_NX) + t] = row[t];
        }
        for (t = 0; t < @WIDTH@; t++) {
            b[(i * @WIDTH@) + t] = row[PINC_NX + t];
        }
    }
}

void pinc_@RK@_linearize_all(int points, const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *next,
                            PINC_REAL *a, PINC_REAL *b)
{
    int c;
    for (c = 0; c < points; c++) {
        pinc_@RK@_linearize(x + (c * PINC_NX), u + (c * @WIDTH@), next + (c * PINC_NX),
                           a + (c * PINC_NX * PINC_NX), b + (c * PINC_NX * @WIDTH@));
    }
}
