@BANNER@
#ifndef PINC_OUTPUTS_H
#define PINC_OUTPUTS_H

#include "pinc_@MODEL@.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Number of outputs. */
#define PINC_NO @NO@

/** The outputs at the state x under the input u. */
void pinc_outputs(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL y[PINC_NO]);

/**
 * The same with their Jacobians, row by row: c[i * PINC_NX + k] is the derivative of y[i] by x[k],
 * d[i * @WIDTH@ + k] that by u[k].
 */
void pinc_outputs_linearize(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@],
                            PINC_REAL y[PINC_NO], PINC_REAL c[PINC_NO * PINC_NX],
                            PINC_REAL d[PINC_NO * @WIDTH@]);

#ifdef __cplusplus
}
#endif

#endif
