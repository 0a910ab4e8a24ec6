/* A net in place of a model predictive controller, and the check of its plans by the model. */
#include "pinc_policy.h"

#include <string.h>

/* A plan breaks its bounds if it is outside by more than this part of their size. */
#define TOLERANCE PINC_N(1e-6)

/* Tried parts of the way from the shifted plan to the net's, in quarters. */
static const int quarters[3] = {1, 2, 4};

static const int widths[@LAYERS@] = {@WIDTHS@};

@TABLES@
static PINC_REAL larger(PINC_REAL a, PINC_REAL b)
{
    return (a > b) ? a : b;
}

static PINC_REAL smaller(PINC_REAL a, PINC_REAL b)
{
    return (a < b) ? a : b;
}

/* tanh z: the continued fraction of tanh (z/4), doubled twice. */
static PINC_REAL tanh_of(PINC_REAL z)
{
    const PINC_REAL y = smaller(larger(z, PINC_N(-20)), PINC_N(20)) * PINC_N(0.25);
    const PINC_REAL s = y * y;
    PINC_REAL p = (s * PINC_N(1.0 / 34459425.0)) + PINC_N(2.0 / 69615.0);
    PINC_REAL q = (s * PINC_N(1.0 / 765765.0)) + PINC_N(4.0 / 9945.0);
    PINC_REAL product;
    p = (p * s) + PINC_N(1.0 / 255.0);
    q = (q * s) + PINC_N(7.0 / 255.0);
    p = (p * s) + PINC_N(7.0 / 51.0);
    q = (q * s) + PINC_N(8.0 / 17.0);
    p = ((p * s) + PINC_N(1)) * y;
    q = (q * s) + PINC_N(1);
    product = p * q;
    q = (q * q) + (p * p);
    p = product + product;
    product = p * q;
    q = (q * q) + (p * p);
    return (product + product) / q;
}

/* Moves a plan into the bounds of inputs and increments. */
static void project(const PINC_REAL u_before[PINC_NU], PINC_REAL plan[PINC_POLICY_INPUTS])
{
    int v;
    for (v = 0; v < PINC_POLICY_INPUTS; v++) {
        const PINC_REAL before = (v < PINC_NU) ? u_before[v] : plan[v - PINC_NU];
        const PINC_REAL low = smaller(before + increment_low[v], input_high[v]);
        const PINC_REAL high = larger(before + increment_high[v], input_low[v]);
        const PINC_REAL near = smaller(larger(plan[v], low), high);
        plan[v] = smaller(larger(near, input_low[v]), input_high[v]);
    }
}

void pinc_policy_plan(const PINC_REAL x[PINC_NX], const PINC_REAL reference[PINC_POLICY_TRACKED],
                      const PINC_REAL u_before[PINC_NU], PINC_REAL plan[PINC_POLICY_INPUTS])
{
    PINC_REAL values[2][@WIDEST@];
    const PINC_REAL *weight = weights;
    int i;
    int k;
    int layer;
    for (i = 0; i < widths[0]; i++) {
        PINC_REAL value;
        if (i < PINC_NX) {
            value = x[i];
        } else if (i < PINC_NX + PINC_POLICY_TRACKED) {
            value = reference[i - PINC_NX];
        } else {
            value = u_before[i - PINC_NX - PINC_POLICY_TRACKED];
        }
        values[0][i] = (value - in_middle[i]) / in_half[i];
    }
    for (layer = 1; layer < @LAYERS@; layer++) {
        const int n = widths[layer - 1];
        const int m = widths[layer];
        const PINC_REAL *below = values[(layer - 1) % 2];
        PINC_REAL *above = values[layer % 2];
        const PINC_REAL *bias = weight + (n * m);
        for (i = 0; i < m; i++) {
            PINC_REAL sum = bias[i];
            for (k = 0; k < n; k++) {
                sum += weight[(i * n) + k] * below[k];
            }
            above[i] = (layer + 1 < @LAYERS@) ? tanh_of(sum) : sum;
        }
        weight = bias + m;
    }
    for (i = 0; i < PINC_POLICY_INPUTS; i++) {
        plan[i] = out_middle[i] + (out_half[i] * values[(@LAYERS@ - 1) % 2][i]);
    }
    project(u_before, plan);
}

/* The cost of a plan by a rollout of the model, and by how much it breaks the bounds. */
static void rate(const PINC_REAL start[PINC_NX], const PINC_REAL reference[PINC_POLICY_TRACKED],
                 const PINC_REAL u_before[PINC_NU], const PINC_REAL plan[PINC_POLICY_INPUTS],
                 PINC_REAL *cost, PINC_REAL *violation)
{
    PINC_REAL x[PINC_NX];
    PINC_REAL next[PINC_NX];
    PINC_REAL error[PINC_POLICY_TRACKED];
    int i;
    int j;
    int k;
    *cost = PINC_N(0);
    *violation = PINC_N(0);
    memcpy(x, start, sizeof(x));
    for (j = 0; j < @CONTROLS@; j++) {
        const PINC_REAL *u = plan + (j * PINC_NU);
        const PINC_REAL *before = (j == 0) ? u_before : u - PINC_NU;
        for (i = 0; i < PINC_NU; i++) {
            for (k = 0; k < PINC_NU; k++) {
                *cost += (u[i] - before[i]) * r[(((j * PINC_NU) + i) * PINC_NU) + k] *
                         (u[k] - before[k]);
            }
        }
    }
    for (j = 0; j < @HORIZON@; j++) {
        const int acting = (j < @CONTROLS@) ? j : @CONTROLS@ - 1;
        const PINC_REAL *u = plan + (acting * PINC_NU);
        pinc_@MODEL@_step(x, u, next);
        memcpy(x, next, sizeof(x));
        for (i = 0; i < PINC_NX; i++) {
            const int at = (j * PINC_NX) + i;
            const PINC_REAL outside = larger(state_low[at] - x[i], x[i] - state_high[at]);
            /* A state that is no number breaks all bounds. */
            const PINC_REAL number = (x[i] - x[i] == PINC_N(0)) ? outside : PINC_N(1e30);
            *violation = larger(*violation, number / state_size[at]);
        }
@VALUES@
        for (i = 0; i < PINC_POLICY_TRACKED; i++) {
            for (k = 0; k < PINC_POLICY_TRACKED; k++) {
                const int at = (((j * PINC_POLICY_TRACKED) + i) * PINC_POLICY_TRACKED) + k;
                *cost += error[i] * q[at] * error[k];
            }
        }
    }
}

void pinc_policy_reset(pinc_policy *policy, const PINC_REAL u[PINC_NU])
{
    int i;
    for (i = 0; i < PINC_POLICY_INPUTS; i++) {
        policy->plan[i] = u[i % PINC_NU];
    }
    memcpy(policy->u, u, sizeof(policy->u));
    policy->planned = 0;
}

/* A plan between the one in use and another. */
static void between(const pinc_policy *policy, const PINC_REAL other[PINC_POLICY_INPUTS], int part,
                    PINC_REAL plan[PINC_POLICY_INPUTS])
{
    const PINC_REAL weight = PINC_N(0.25) * (PINC_REAL)part;
    int i;
    for (i = 0; i < PINC_POLICY_INPUTS; i++) {
        plan[i] = ((PINC_N(1) - weight) * policy->plan[i]) + (weight * other[i]);
    }
    project(policy->u, plan);
}

int pinc_policy_step(pinc_policy *policy, const PINC_REAL x[PINC_NX],
                     const PINC_REAL reference[PINC_POLICY_TRACKED], PINC_REAL u[PINC_NU])
{
    PINC_REAL candidate[PINC_POLICY_INPUTS];
    PINC_REAL trial[PINC_POLICY_INPUTS];
    PINC_REAL cost[2];
    PINC_REAL violation[2];
    const int shift = policy->planned ? PINC_NU : 0;
    int taken = 0;
    int i;
    int k;
    /* The last input stays where it is, and is held. */
    for (i = 0; i + PINC_NU < PINC_POLICY_INPUTS; i++) {
        policy->plan[i] = policy->plan[i + shift];
    }
    policy->planned = 1;
    project(policy->u, policy->plan);
    pinc_policy_plan(x, reference, policy->u, candidate);
    rate(x, reference, policy->u, policy->plan, &cost[1], &violation[1]);
    for (k = 0; k < 3; k++) {
        int better;
        between(policy, candidate, quarters[k], trial);
        rate(x, reference, policy->u, trial, &cost[0], &violation[0]);
        better = (violation[0] < larger(violation[1], TOLERANCE)) &
                 ((violation[1] >= TOLERANCE) | (cost[0] <= cost[1]));
        taken = better ? quarters[k] : taken;
    }
    between(policy, candidate, taken, policy->plan);
    for (i = 0; i < PINC_NU; i++) {
        policy->u[i] = policy->plan[i];
        u[i] = policy->plan[i];
    }
    return taken;
}
