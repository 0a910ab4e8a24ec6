/* A net in place of a model predictive controller, and the check of its plans by the model. */
#include "pinc_policy.h"

#include <string.h>

/* A plan breaks its bounds if it is outside by more than this part of their size. */
#define TOLERANCE PINC_N(1e-6)

/* Plans are rated side by side: the shifted one, which holds its last input; the same with the last
   input of the net's; the one halfway between that and the net's; and the net's. */
#define PINC_POINTS 4
#define PINC_GROUPS ((PINC_POINTS + PINC_LANES - 1) / PINC_LANES)

/* States, inputs and outputs of a point. */
#define PINC_ROW (PINC_NX + PINC_NU + @OUTPUTS@)

@FUNCTIONS@
/* Rows of a layer's matrix that are summed at a time, and the numbers behind a layer that the last of
   these sums may write. */
#define PINC_BLOCK (4 * PINC_LANES)

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

/* out = W in + b for a layer; the weights of an input lie one behind the other. */
static void layer(const PINC_REAL *bias, const PINC_REAL *in, int inputs, int outputs, int hidden,
                  PINC_REAL *out)
{
    int first;
    int k;
    for (first = 0; first < outputs; first += PINC_BLOCK) {
        const PINC_REAL *row = bias + first;
        pinc_loose *to = (pinc_loose *)(out + first);
        pinc_vector a = *(const pinc_loose *)row;
        pinc_vector b = *(const pinc_loose *)(row + PINC_LANES);
        pinc_vector c = *(const pinc_loose *)(row + (2 * PINC_LANES));
        pinc_vector d = *(const pinc_loose *)(row + (3 * PINC_LANES));
        for (k = 0; k < inputs; k++) {
            row += outputs;
            a += *(const pinc_loose *)row * in[k];
            b += *(const pinc_loose *)(row + PINC_LANES) * in[k];
            c += *(const pinc_loose *)(row + (2 * PINC_LANES)) * in[k];
            d += *(const pinc_loose *)(row + (3 * PINC_LANES)) * in[k];
        }
        to[0] = hidden ? pinc_tanh(a) : a;
        to[1] = hidden ? pinc_tanh(b) : b;
        to[2] = hidden ? pinc_tanh(c) : c;
        to[3] = hidden ? pinc_tanh(d) : d;
    }
}

void pinc_policy_plan(const PINC_REAL x[PINC_NX], const PINC_REAL reference[PINC_POLICY_TRACKED],
                      const PINC_REAL u_before[PINC_NU], PINC_REAL plan[PINC_POLICY_INPUTS])
{
    PINC_REAL values[2][@WIDEST@ + PINC_BLOCK];
    const PINC_REAL *weight = weights;
    int i;
    int l;
    for (i = 0; i < PINC_NX; i++) {
        values[0][i] = x[i];
    }
    for (i = 0; i < PINC_POLICY_TRACKED; i++) {
        values[0][PINC_NX + i] = reference[i];
    }
    for (i = 0; i < PINC_NU; i++) {
        values[0][PINC_NX + PINC_POLICY_TRACKED + i] = u_before[i];
    }
    for (l = 1; l < @LAYERS@; l++) {
        layer(weight, values[(l - 1) % 2], widths[l - 1], widths[l], l + 1 < @LAYERS@,
              values[l % 2]);
        weight += (widths[l - 1] + 1) * widths[l];
    }
    memcpy(plan, values[(@LAYERS@ - 1) % 2], PINC_POLICY_INPUTS * sizeof(PINC_REAL));
    project(u_before, plan);
}

/* By how much points of interval j are outside the bounds from `from` to `to`; later ones count
   less. */
static void limit(pinc_vector z[PINC_GROUPS][PINC_ROW], int j, int first, int from, int to,
                  pinc_vector violation[PINC_GROUPS])
{
    int g;
    int n;
    for (g = first; g < PINC_GROUPS; g++) {
        for (n = from; n < to; n++) {
            const pinc_vector value = z[g][bounded[n]];
            const int at = (j * BOUNDED) + n;
            const pinc_vector outside = pinc_larger(bound_low[at] - value, value - bound_high[at]);
            violation[g] = pinc_larger(outside * bound_scale[at], violation[g]);
        }
    }
}

/* The costs of plans by rollouts of the model, and by how much they break the bounds. */
static void rate(const PINC_REAL start[PINC_NX], const PINC_REAL reference[PINC_POLICY_TRACKED],
                 const PINC_REAL u_before[PINC_NU],
                 pinc_vector plans[PINC_GROUPS][PINC_POLICY_INPUTS], pinc_vector cost[PINC_GROUPS],
                 pinc_vector violation[PINC_GROUPS])
{
    const pinc_vector zero = {0};
    const pinc_vector huge = zero + PINC_N(1e30);
    pinc_vector z[PINC_GROUPS][PINC_ROW];
    pinc_vector change[PINC_NU];
    pinc_vector error[PINC_POLICY_TRACKED];
    /* 0, or no number if something is not finite. */
    pinc_vector finite[PINC_GROUPS];
    int g;
    int i;
    int j;
    int n;
    for (g = 0; g < PINC_GROUPS; g++) {
        cost[g] = zero;
        violation[g] = zero;
        finite[g] = zero;
        for (i = 0; i < PINC_NX; i++) {
            z[g][i] = zero + start[i];
        }
        for (i = 0; i < PINC_NU; i++) {
            z[g][PINC_NX + i] = zero + u_before[i];
        }
        for (i = 0; i < PINC_POLICY_TRACKED; i++) {
            finite[g] += zero + (reference[i] - reference[i]);
        }
    }
    for (j = 0; j < @HORIZON@; j++) {
        /* The first two plans part with the last input: where each is a group of its own, the first
           goes on from the second there. */
        const int first = ((PINC_LANES == 1) && ((j + 1) < @CONTROLS@)) ? 1 : 0;
        if ((PINC_LANES == 1) && ((j + 1) == @CONTROLS@)) {
            memcpy(z[0], z[1], sizeof(z[0]));
            cost[0] = cost[1];
            violation[0] = violation[1];
            finite[0] = finite[1];
        }
        for (g = first; (j < @CONTROLS@) && (g < PINC_GROUPS); g++) {
            for (i = 0; i < PINC_NU; i++) {
                change[i] = plans[g][(j * PINC_NU) + i] - z[g][PINC_NX + i];
                z[g][PINC_NX + i] = plans[g][(j * PINC_NU) + i];
            }
            for (n = 0; n < R_ENTRIES; n++) {
                cost[g] += change[r_row[n]] * change[r_column[n]] * r[(j * R_ENTRIES) + n];
            }
        }
#if BOUNDED > BOUNDED_ENDS
        pinc_outputs_of(z, first);
        limit(z, j, first, BOUNDED_ENDS, BOUNDED, violation);
#endif
        pinc_advance(z, first);
#if @OUTPUTS@ > 0
        pinc_outputs_of(z, first);
#endif
        limit(z, j, first, 0, BOUNDED_ENDS, violation);
        for (g = first; g < PINC_GROUPS; g++) {
            for (i = 0; i < PINC_ROW; i++) {
                finite[g] += z[g][i] - z[g][i];
            }
            for (i = 0; i < PINC_POLICY_TRACKED; i++) {
                error[i] = z[g][tracked[i]] - reference[i];
            }
            for (n = 0; n < Q_ENTRIES; n++) {
                cost[g] += error[q_row[n]] * error[q_column[n]] * q[(j * Q_ENTRIES) + n];
            }
        }
    }
    for (g = 0; g < PINC_GROUPS; g++) {
        violation[g] = PINC_WHERE(finite[g] >= zero, violation[g], huge);
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

void pinc_policy_begin(pinc_policy *policy, const PINC_REAL plan[PINC_POLICY_INPUTS])
{
    memcpy(policy->plan, plan, sizeof(policy->plan));
    policy->planned = 0;
}

int pinc_policy_step(pinc_policy *policy, const PINC_REAL x[PINC_NX],
                     const PINC_REAL reference[PINC_POLICY_TRACKED], PINC_REAL u[PINC_NU])
{
    PINC_REAL candidate[PINC_POLICY_INPUTS];
    PINC_REAL trial[PINC_POLICY_INPUTS];
    pinc_vector plans[PINC_GROUPS][PINC_POLICY_INPUTS];
    pinc_vector costs[PINC_GROUPS];
    pinc_vector violations[PINC_GROUPS];
    const PINC_REAL *cost = (const PINC_REAL *)costs;
    const PINC_REAL *violation = (const PINC_REAL *)violations;
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
    for (k = 0; k < PINC_GROUPS * PINC_LANES; k++) {
        static const PINC_REAL parts[PINC_POINTS] = {PINC_N(0), PINC_N(0), PINC_N(0.5), PINC_N(1)};
        const int plan = k % PINC_POINTS;
        for (i = 0; i < PINC_POLICY_INPUTS; i++) {
            const int is_last = (plan > 0) & (i >= PINC_POLICY_INPUTS - PINC_NU);
            const PINC_REAL part = is_last ? PINC_N(1) : parts[plan];
            trial[i] = ((PINC_N(1) - part) * policy->plan[i]) + (part * candidate[i]);
        }
        /* The shifted plan and the net's are in their bounds. */
        if ((plan > 0) & (plan < PINC_POINTS - 1)) {
            project(policy->u, trial);
        }
        for (i = 0; i < PINC_POLICY_INPUTS; i++) {
            PINC_LANE(plans[k / PINC_LANES][i], k % PINC_LANES) = trial[i];
        }
    }
    rate(x, reference, policy->u, plans, costs, violations);
    for (k = 1; k < PINC_POINTS; k++) {
        const PINC_REAL own = larger(violation[k], TOLERANCE);
        const PINC_REAL best = larger(violation[taken], TOLERANCE);
        const int better = (own < best) | ((own <= best) & (cost[k] < cost[taken]));
        taken = better ? k : taken;
    }
    for (i = 0; i < PINC_POLICY_INPUTS; i++) {
        policy->plan[i] = PINC_LANE(plans[taken / PINC_LANES][i], taken % PINC_LANES);
    }
    for (i = 0; i < PINC_NU; i++) {
        policy->u[i] = policy->plan[i];
        u[i] = policy->plan[i];
    }
    return taken + ((larger(violation[taken], TOLERANCE) > TOLERANCE) ? PINC_POINTS : 0);
}
