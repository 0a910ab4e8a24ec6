@BANNER@
/* The controller against golden vectors, step by step: exit 0 if all inputs agree. */
#include "pinc_mpc.h"
@ERROR_INCLUDE@@BESIDE_INCLUDE@
#include <math.h>
#include <stdio.h>

#define PINC_STEPS @STEPS@
@JUDGE@
@TABLES@
static pinc_mpc pinc_controller;
@ERROR_TEST@
int main(void)
{
    int k;
    int i;
    PINC_REAL first[PINC_NU];
    PINC_REAL none[PINC_NX + (PINC_N2 * PINC_NY)] = {0};
    /* A struct of zeros is no controller. */
    pinc_require((pinc_mpc_step(&pinc_controller, none, none + PINC_NX, first) ==
                  PINC_NOT_INITIALIZED) ? 1 : 0, -1, "a struct of zeros took a step");
    pinc_mpc_init(&pinc_controller);
    for (k = 0; k < PINC_STEPS; k++) {
        PINC_REAL x[PINC_NX];
        PINC_REAL reference[PINC_N2 * PINC_NY];
        PINC_REAL u[PINC_NU];
        pinc_status status;
        for (i = 0; i < PINC_NX; i++) {
            x[i] = PINC_N(pinc_x[k][i]);
        }
        /* The config's references, by time. */
        pinc_reference(PINC_SAMPLE_TIME_S * (double)k, reference);
        for (i = 0; i < PINC_N2 * PINC_NY; i++) {
            const PINC_REAL wanted = PINC_N(pinc_rows[k][i]);
            pinc_require(((reference[i] < wanted) || (reference[i] > wanted)) ? 0 : 1, k,
                         "pinc_reference differs from the config's references");
        }
        status = pinc_mpc_step(&pinc_controller, x, reference, u);
        pinc_require_step(k, status);
        for (i = 0; i < PINC_NU; i++) {
            pinc_compare(k, u[i], pinc_u[k][i], pinc_unit_of_u[i]);
        }
    }
@ERROR_CALL@@BESIDE_CALL@    return pinc_judge();
}
