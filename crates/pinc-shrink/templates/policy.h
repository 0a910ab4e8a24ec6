/* A net in place of a model predictive controller, and the check of its plans by the model. */
#ifndef PINC_POLICY_H
#define PINC_POLICY_H

#include "pinc_@MODEL@.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Number of quantities to follow. */
#define PINC_POLICY_TRACKED @TRACKED@
/** Number of planned inputs, all steps together. */
#define PINC_POLICY_INPUTS @INPUTS@

/** The memory of the check. Set up by pinc_policy_reset. */
typedef struct {
    PINC_REAL plan[PINC_POLICY_INPUTS];
    PINC_REAL u[PINC_NU];
    int planned;
} pinc_policy;

/** Begins with `u`, the input applied last, and a plan that holds it. */
void pinc_policy_reset(pinc_policy *policy, const PINC_REAL u[PINC_NU]);

/** Gives the first step after a reset another plan to start from, as the controller's, step by step. */
void pinc_policy_begin(pinc_policy *policy, const PINC_REAL plan[PINC_POLICY_INPUTS]);

/** Writes the net's plan, moved into the bounds of the inputs. */
void pinc_policy_plan(const PINC_REAL x[PINC_NX], const PINC_REAL reference[PINC_POLICY_TRACKED],
                      const PINC_REAL u_before[PINC_NU], PINC_REAL plan[PINC_POLICY_INPUTS]);

/**
 * Writes the input to apply to `u`: the first of the plan that, by the model, stays within the bounds
 * and costs least, or, if none stays within them, breaks them least. Returns which that is: 3, the
 * net's; 0, the plan before, shifted, which holds its last input; 1, the same with the last input of
 * the net's; 2, the one halfway between that and the net's. If it breaks bounds, or a number of the
 * state or the reference is not finite, 4 more: a plan of
 * another controller may then take its place, in `plan`, with its first input in `u` of `policy`. The
 * time does not depend on the numbers.
 */
int pinc_policy_step(pinc_policy *policy, const PINC_REAL x[PINC_NX],
                     const PINC_REAL reference[PINC_POLICY_TRACKED], PINC_REAL u[PINC_NU]);

#ifdef __cplusplus
}
#endif

#endif
