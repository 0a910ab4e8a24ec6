@BANNER@
/* The controller against golden vectors, step by step: exit 0 if all inputs agree. */
#include "pinc_mpc.h"
@ERROR_INCLUDE@
#include <math.h>
#include <stdio.h>

#define PINC_STEPS @STEPS@
/* The number of steps whose inputs are compared: later inputs depend on rounding. */
#define PINC_COMPARED ((sizeof(PINC_REAL) == sizeof(float)) ? @FLOAT_STEPS@ : @DOUBLE_STEPS@)
/* What an input may differ by, relative to 1 + its size. */
#define PINC_TOLERANCE ((sizeof(PINC_REAL) == sizeof(float)) ? @FLOAT@ : @DOUBLE@)

@TABLES@
static pinc_mpc pinc_controller;
@ERROR_TEST@
int main(void)
{
    double worst = 0.0;
    int failed = 0;
    int k;
    int i;
    PINC_REAL first[PINC_NU];
    PINC_REAL none[PINC_NX + (PINC_N2 * PINC_NY)] = {0};
    /* A struct of zeros is no controller. */
    failed += (pinc_mpc_step(&pinc_controller, none, none + PINC_NX, first) !=
               PINC_NOT_INITIALIZED) ? 1 : 0;
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
            failed += ((reference[i] < wanted) || (reference[i] > wanted)) ? 1 : 0;
        }
        status = pinc_mpc_step(&pinc_controller, x, reference, u);
        failed += ((status == PINC_NUMERICAL_TROUBLE) || (status == PINC_BAD_ARGUMENT)) ? 1 : 0;
        for (i = 0; (k < PINC_COMPARED) && (i < PINC_NU); i++) {
            const double off = fabs((double)u[i] - pinc_u[k][i]) / (1.0 + fabs(pinc_u[k][i]));
            if (!(off <= worst)) {
                worst = (off > worst) ? off : 1.0;
            }
        }
    }
@ERROR_CALL@    printf("@name@: %d steps, largest difference %.2e, allowed %.2e\n", PINC_STEPS, worst,
           PINC_TOLERANCE);
    if (PINC_COMPARED < PINC_STEPS) {
        printf("@name@: inputs from step %d on depend on rounding and are not compared\n",
               PINC_COMPARED);
    }
    return ((worst <= PINC_TOLERANCE) && (failed == 0)) ? 0 : 1;
}
