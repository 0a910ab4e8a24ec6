@BANNER@
/* The functions against golden vectors: exit 0 if all agree. */
#include "pinc_@MODEL@.h"
@ERROR_INCLUDE@
#include <math.h>
#include <stdio.h>

#define PINC_CASES @CASES@
/* What a number may differ by, relative to its size plus half the width of its domain; a derivative, relative
   to its size plus the ratio of these. */
#define PINC_TOLERANCE ((sizeof(PINC_REAL) == sizeof(float)) ? @FLOAT@ : @DOUBLE@)

@TABLES@
/* The largest difference of states, or of their derivatives by columns numbers of these widths; not a number
   counts as 1. */
static double pinc_difference(const PINC_REAL *found, const double *expected, int columns,
                              const PINC_REAL *by)
{
    double worst = 0.0;
    int i;
    for (i = 0; i < (PINC_NX * columns); i++) {
        const double width = (double)pinc_width[i / columns];
        const double size = (by != NULL) ? (width / (double)by[i % columns]) : width;
        const double off = fabs((double)found[i] - expected[i]) / (size + fabs(expected[i]));
        if (!(off <= worst)) {
            worst = (off > worst) ? off : 1.0;
        }
    }
    return worst;
}

static double pinc_larger(double a, double b)
{
    return (a > b) ? a : b;
}
@ERROR_TEST@
int main(void)
{
    double worst = 0.0;
    int c;
    int i;
    for (c = 0; c < PINC_CASES; c++) {
        PINC_REAL x[PINC_NX];
        PINC_REAL u[PINC_NU];
        PINC_REAL next[PINC_NX];
        PINC_REAL a[PINC_NX * PINC_NX];
        PINC_REAL b[PINC_NX * PINC_NU];
        for (i = 0; i < PINC_NX; i++) {
            x[i] = PINC_N(pinc_x[c][i]);
        }
        for (i = 0; i < PINC_NU; i++) {
            u[i] = PINC_N(pinc_u[c][i]);
        }
        pinc_@MODEL@_step(x, u, next);
        worst = pinc_larger(worst, pinc_difference(next, pinc_next[c], 1, NULL));
        pinc_@MODEL@_linearize(x, u, next, a, b);
        worst = pinc_larger(worst, pinc_difference(next, pinc_next[c], 1, NULL));
        worst = pinc_larger(worst, pinc_difference(a, pinc_a[c], PINC_NX, pinc_width));
        worst = pinc_larger(worst, pinc_difference(b, pinc_b[c], PINC_NU, pinc_width + PINC_NX));
@AT@    }
@ERROR_CALL@    printf("@name@: %d cases, largest difference %.2e, allowed %.2e\n", PINC_CASES, worst,
           PINC_TOLERANCE);
    return (worst <= PINC_TOLERANCE) ? 0 : 1;
}
