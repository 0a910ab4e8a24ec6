/* The net and its check against golden decisions, for the self-test. */
#include "pinc_policy.h"

#include <math.h>
#include <stdio.h>

@GOLDEN@
/* The largest difference of numbers, relative to 1 + their size, and at least worst; what is no number
   counts as 1. */
static double pinc_policy_off(const PINC_REAL *found, const double *expected, int count, double worst)
{
    int i;
    for (i = 0; i < count; i++) {
        const double off = fabs((double)found[i] - expected[i]) / (1.0 + fabs(expected[i]));
        if (!(off <= worst)) {
            worst = (off > worst) ? off : 1.0;
        }
    }
    return worst;
}

static void pinc_policy_load(PINC_REAL *to, const double *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = PINC_N(from[i]);
    }
}

/* Returns 0 if the net plans and its check decides as in the program. */
static int pinc_policy_selftest(void)
{
    const double allowed = (sizeof(PINC_REAL) == sizeof(float)) ? 1e-3 : 1e-8;
    double worst = 0.0;
    int decisions = 0;
    int others = 0;
    int k;
    for (k = 0; k < PINC_POLICY_CASES; k++) {
        const int at = k * PINC_POLICY_INPUTS;
        pinc_policy policy;
        PINC_REAL x[PINC_NX];
        PINC_REAL reference[PINC_POLICY_TRACKED];
        PINC_REAL u[PINC_NU];
        PINC_REAL plan[PINC_POLICY_INPUTS];
        pinc_policy_load(x, pinc_golden_x + (k * PINC_NX), PINC_NX);
        pinc_policy_load(reference, pinc_golden_reference + (k * PINC_POLICY_TRACKED),
                         PINC_POLICY_TRACKED);
        pinc_policy_load(u, pinc_golden_u + (k * PINC_NU), PINC_NU);
        pinc_policy_plan(x, reference, u, plan);
        worst = pinc_policy_off(plan, pinc_golden_net + at, PINC_POLICY_INPUTS, worst);
        /* Where rounding decides between two plans there is nothing to compare. */
        if (pinc_golden_taken[k] >= 0) {
            pinc_policy_load(plan, pinc_golden_before + at, PINC_POLICY_INPUTS);
            pinc_policy_reset(&policy, u);
            pinc_policy_begin(&policy, plan);
            decisions++;
            others += (pinc_policy_step(&policy, x, reference, u) != pinc_golden_taken[k]) ? 1 : 0;
            worst = pinc_policy_off(policy.plan, pinc_golden_plan + at, PINC_POLICY_INPUTS, worst);
            worst = pinc_policy_off(u, pinc_golden_plan + at, PINC_NU, worst);
        }
    }
    printf("pinc_policy: %d plans and %d decisions, %d of which differ; largest difference %.2e, "
           "allowed %.2e\n", PINC_POLICY_CASES, decisions, others, worst, allowed);
    return ((worst <= allowed) && (others == 0)) ? 0 : 1;
}
