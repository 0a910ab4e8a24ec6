@BANNER@
#include "pinc_outputs.h"

#include <math.h>

void pinc_outputs(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL y[PINC_NO])
{
@VALUES@}

/* The same with its Jacobian, by (x, u), row by row, of which zeros are not written. */
static void pinc_jacobian(const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *y,
                          PINC_REAL f[PINC_NO][PINC_NX + @WIDTH@])
{
@JACOBIAN@}

void pinc_outputs_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                            PINC_REAL y[PINC_NO], PINC_REAL c[PINC_NO * PINC_NX],
                            PINC_REAL d[PINC_NO * @WIDTH@])
{
    PINC_REAL f[PINC_NO][PINC_NX + @WIDTH@] = {{PINC_N(0)}};
    int i;
    int k;
    pinc_jacobian(x, u, y, f);
    for (i = 0; i < PINC_NO; i++) {
        for (k = 0; k < PINC_NX; k++) {
            c[(i * PINC_NX) + k] = f[i][k];
        }
        for (k = 0; k < @WIDTH@; k++) {
            d[(i * @WIDTH@) + k] = f[i][PINC_NX + k];
        }
    }
}
