@BANNER@
#ifndef PINC_ERROR_H
#define PINC_ERROR_H

#include "pinc_net.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * The estimated error of pinc_net_step from the state x under the input u: the net's state minus the
 * exact solution of the plant's equation, to first order in the error, in the states' units.
 * The arrays must not overlap.
 */
void pinc_error(const PINC_REAL x[PINC_NX], const PINC_REAL u[@WIDTH@], PINC_REAL error[PINC_NX]);

#ifdef __cplusplus
}
#endif

#endif
