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

/** Begins with `u`, the input applied last. */
void pinc_policy_reset(pinc_policy *policy, const PINC_REAL u[PINC_NU]);

/** Writes the net's plan, moved into the bounds of the inputs. */
void pinc_policy_plan(const PINC_REAL x[PINC_NX], const PINC_REAL reference[PINC_POLICY_TRACKED],
                      const PINC_REAL u_before[PINC_NU], PINC_REAL plan[PINC_POLICY_INPUTS]);

/**
 * Writes the input to apply to `u`: the first of the net's plan if that stays within the bounds by
 * the model and costs no more than the plan before it, shifted; else the first of a plan half or a
 * quarter of the way from the shifted plan to the net's, if that does; else of the shifted plan.
 * Returns how many quarters of the way were taken: 4, 2, 1 or 0. The time does not depend on the
 * numbers.
 */
int pinc_policy_step(pinc_policy *policy, const PINC_REAL x[PINC_NX],
                     const PINC_REAL reference[PINC_POLICY_TRACKED], PINC_REAL u[PINC_NU]);

#ifdef __cplusplus
}
#endif

#endif
