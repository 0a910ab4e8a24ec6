/* ---- Its solution -------------------------------------------------------------------------- */

/* A Kalman filter through the stages, and the smoother of Bryson and Frazier back. A state that is
   held at a bound is measured to be there, without noise: the multiplier of this row is the bound's.
   A dual active-set method says which states are held. */

/* What is left of a variance below this part of the largest is rounding. */
#define PINC_NOTHING_LEFT PINC_PICK(1e-14, 1e-6)
/* A bound counts as met when it is off by less than this, relative to 1 + its size. */
#define PINC_MET PINC_PICK(1e-11, 1e-5)
/* A rate below this part of the largest is rounding. */
#define PINC_DEPENDENT PINC_PICK(1e-10, 1e-4)
/* How often the rows that are held may change. */
#define PINC_CHANGES (20 + (10 * PINC_STAGED))

/* What is expected of stage j before its rows. */
static void pinc_expect_stage(pinc_estimator *e, int j)
{
    PINC_REAL *mean = e->mean + (j * PINC_NZ);
    PINC_REAL *p = e->covariance + (j * PINC_NZ * PINC_NZ);
    const PINC_REAL *left = e->root;
    const PINC_REAL *right = e->root;
    int i;
    int k;
    pinc_copy(mean, e->defects + (j * PINC_NZ), PINC_NZ);
    if (j > 0) {
        right = e->stage_a + (j * PINC_NZ * PINC_NZ);
        left = e->work;
        pinc_fill(e->work, PINC_N(0), PINC_NZ * PINC_NZ);
        for (i = 0; i < PINC_NZ; i++) {
            mean[i] += pinc_dot(right + (i * PINC_NZ), e->m, PINC_NZ);
            for (k = 0; k < PINC_NZ; k++) {
                pinc_add_scaled(e->work + (i * PINC_NZ), right[(i * PINC_NZ) + k],
                                e->m_p + (k * PINC_NZ), PINC_NZ);
            }
        }
    }
    for (i = 0; i < PINC_NZ; i++) {
        for (k = 0; k <= i; k++) {
            const PINC_REAL entry =
                pinc_dot(left + (i * PINC_NZ), right + (k * PINC_NZ), PINC_NZ);
            p[(i * PINC_NZ) + k] = entry;
            p[(k * PINC_NZ) + i] = entry;
        }
        if (j > 0) {
            p[(i * PINC_NZ) + i] += pinc_noise[i] * pinc_noise[i];
        }
    }
    pinc_copy(e->m, mean, PINC_NZ);
    pinc_copy(e->m_p, p, PINC_NZ * PINC_NZ);
}

/* Corrects with a row of variance r, of which more than this is expected than was found. Without
   uncertainty it says nothing: 0. */
static int pinc_use_row(pinc_estimator *e, int row, const PINC_REAL *h, PINC_REAL r,
                        PINC_REAL error)
{
    PINC_REAL *gain = e->gains + (row * PINC_NZ);
    PINC_REAL s;
    PINC_REAL most = PINC_N(1);
    int k;
    for (k = 0; k < PINC_NZ; k++) {
        gain[k] = pinc_dot(e->m_p + (k * PINC_NZ), h, PINC_NZ);
        most = pinc_max(most, e->m_p[(k * PINC_NZ) + k]);
    }
    s = pinc_dot(h, gain, PINC_NZ) + r;
    if (!(s > (PINC_NOTHING_LEFT * most)) && !(r > PINC_N(0))) {
        pinc_fill(gain, PINC_N(0), PINC_NZ);
        e->weighted[row] = PINC_N(0);
        return 0;
    }
    e->weighted[row] = -(error + pinc_dot(h, e->m, PINC_NZ)) / s;
    pinc_add_scaled(e->m, e->weighted[row], gain, PINC_NZ);
    for (k = 0; k < PINC_NZ; k++) {
        pinc_add_scaled(e->m_p + (k * PINC_NZ), -gain[k] / s, gain, PINC_NZ);
    }
    for (k = 0; k < PINC_NZ; k++) {
        gain[k] /= s;
    }
    return 1;
}

/* The share of a row in the adjoint variable; gives its multiplier. */
static PINC_REAL pinc_return_row(pinc_estimator *e, int row, const PINC_REAL *h)
{
    const PINC_REAL factor = pinc_dot(e->gains + (row * PINC_NZ), e->m, PINC_NZ) + e->weighted[row];
    pinc_add_scaled(e->m, -factor, h, PINC_NZ);
    return -factor;
}

#if PINC_HAS_BOUNDS
/* The bound that state number v of all is held at, in terms of the step. */
static PINC_REAL pinc_bound(const pinc_estimator *e, int v)
{
    return (e->held[v] > 0) ? e->above[v] : e->below[v];
}

static void pinc_set_row(pinc_estimator *e, int i)
{
    pinc_fill(e->row, PINC_N(0), PINC_NZ);
    e->row[i] = PINC_N(1);
}

/* Holds what is held of stage j, but `soft` only as by a spring that draws it to a place. Gives a
   row that follows from others, or -1. */
static int pinc_hold_stage(pinc_estimator *e, int j, int soft, PINC_REAL place)
{
    int follows = -1;
    int i;
    int k;
    for (i = 0; i < PINC_NZ; i++) {
        const int v = (j * PINC_NZ) + i;
        const int row = (j * PINC_STAGE_ROWS) + PINC_NM + i;
        const int yields = (v == soft) ? 1 : 0;
        if (e->held[v] == 0) {
            continue;
        }
        pinc_set_row(e, i);
        if (pinc_use_row(e, row, e->row, PINC_N(yields),
                         (yields != 0) ? -place : -pinc_bound(e, v)) == 0) {
            follows = v;
        } else if (yields == 0) {
            /* It is there, whatever rounding says. */
            e->m[i] = pinc_bound(e, v);
            for (k = 0; k < PINC_NZ; k++) {
                e->m_p[(i * PINC_NZ) + k] = PINC_N(0);
                e->m_p[(k * PINC_NZ) + i] = PINC_N(0);
            }
        } else {
            /* Nothing is certain. */
        }
    }
    return follows;
}
#endif

/* Filters through the stages; gives a row that follows from others, or -1. */
static int pinc_filter_stages(pinc_estimator *e, int soft, PINC_REAL place)
{
    int follows = -1;
    int j;
    int i;
    for (j = 0; j <= e->steps; j++) {
        pinc_expect_stage(e, j);
        for (i = 0; i < PINC_NM; i++) {
            const int at = (j * PINC_NM) + i;
            if (pinc_finite(e->errors[at]) != 0) {
                (void)pinc_use_row(e, (j * PINC_STAGE_ROWS) + i, e->stage_h + (at * PINC_NZ),
                                   pinc_noise_variance[i], e->errors[at]);
            }
        }
#if PINC_HAS_BOUNDS
        i = pinc_hold_stage(e, j, soft, place);
        follows = (i >= 0) ? i : follows;
#endif
    }
#if !PINC_HAS_BOUNDS
    (void)soft;
    (void)place;
#endif
    return follows;
}

/* Goes back through the stages: the states and multipliers of the step, and its noises. */
static void pinc_smooth_stages(pinc_estimator *e)
{
    int j;
    int i;
    pinc_fill(e->m, PINC_N(0), PINC_NZ);
    for (j = e->steps; j >= 0; j--) {
        const int first = j * PINC_NZ;
        const PINC_REAL *p = e->covariance + (first * PINC_NZ);
        const PINC_REAL *a = e->stage_a + (first * PINC_NZ);
        PINC_REAL *lambda = e->step.dynamics + first;
        PINC_REAL *v = e->step.v + first;
#if PINC_HAS_BOUNDS
        for (i = PINC_NZ - 1; i >= 0; i--) {
            e->step.bounds[first + i] = PINC_N(0);
            if (e->held[first + i] != 0) {
                pinc_set_row(e, i);
                e->step.bounds[first + i] =
                    pinc_return_row(e, (j * PINC_STAGE_ROWS) + PINC_NM + i, e->row);
            }
        }
#endif
        for (i = PINC_NM - 1; i >= 0; i--) {
            const int at = (j * PINC_NM) + i;
            if (pinc_finite(e->errors[at]) != 0) {
                (void)pinc_return_row(e, (j * PINC_STAGE_ROWS) + i, e->stage_h + (at * PINC_NZ));
            }
        }
        pinc_copy(lambda, e->m, PINC_NZ);
        pinc_copy(e->step.x + first, e->mean + first, PINC_NZ);
        pinc_fill(v, PINC_N(0), PINC_NZ);
        pinc_fill(e->m, PINC_N(0), PINC_NZ);
        for (i = 0; i < PINC_NZ; i++) {
            pinc_add_scaled(e->step.x + first, -lambda[i], p + (i * PINC_NZ), PINC_NZ);
            if (j == 0) {
                pinc_add_scaled(v, -lambda[i], e->root + (i * PINC_NZ), PINC_NZ);
            } else {
                v[i] = -lambda[i] * pinc_noise[i];
                pinc_add_scaled(e->m, lambda[i], a + (i * PINC_NZ), PINC_NZ);
            }
        }
    }
}

/* The step with what is held now; gives a row that follows from others, or -1. */
static int pinc_smooth(pinc_estimator *e, int soft, PINC_REAL place)
{
    const int follows = pinc_filter_stages(e, soft, place);
    pinc_smooth_stages(e);
    return follows;
}

#if PINC_HAS_BOUNDS
/* Whether a state has to be where it is held, as its bounds are one. */
static int pinc_is_fixed(const pinc_estimator *e, int v)
{
    return (e->below[v] >= e->above[v]) ? 1 : 0;
}

/* The row whose multiplier is furthest on the wrong side of 0, or -1. */
static int pinc_most_wrong(const pinc_estimator *e)
{
    PINC_REAL most = PINC_N(0);
    int wrong = -1;
    int v;
    for (v = 0; v < pinc_staged(e); v++) {
        const PINC_REAL off = -PINC_N(e->held[v]) * e->step.bounds[v];
        if ((off > most) && (pinc_is_fixed(e, v) == 0)) {
            wrong = v;
            most = off;
        }
    }
    return wrong;
}

/* Begins with what the multipliers say is held, less what they are wrong about. */
static void pinc_start(pinc_estimator *e)
{
    int wrong = 0;
    int v;
    for (v = 0; v < pinc_staged(e); v++) {
        const PINC_REAL mu = e->now.bounds[v];
        e->held[v] = (mu > PINC_N(0)) ? 1 : ((mu < PINC_N(0)) ? -1 : 0);
    }
    while (wrong >= 0) {
        wrong = pinc_smooth(e, -1, PINC_N(0));
        if (wrong < 0) {
            wrong = pinc_most_wrong(e);
        }
        if (wrong >= 0) {
            e->held[wrong] = 0;
        }
    }
}

/* The state that is furthest outside its bounds, or -1; writes on which side. */
static int pinc_furthest(const pinc_estimator *e, int *side)
{
    PINC_REAL most = PINC_N(0);
    int furthest = -1;
    int v;
    for (v = 0; v < pinc_staged(e); v++) {
        const PINC_REAL over = e->step.x[v] - e->above[v];
        const PINC_REAL under = e->below[v] - e->step.x[v];
        const PINC_REAL off = pinc_max(over, under);
        const PINC_REAL bound = (over > under) ? e->above[v] : e->below[v];
        if ((e->held[v] == 0) && (off > most) &&
            (off > (PINC_MET * (PINC_N(1) + pinc_abs(bound))))) {
            furthest = v;
            most = off;
            *side = (over > under) ? 1 : -1;
        }
    }
    return furthest;
}

/* The row whose multiplier is the first to become 0 on the way to the multipliers of the step, except
   the row that comes in; or -1. Writes the part of the way. */
static int pinc_first_at_zero(const pinc_estimator *e, int in, PINC_REAL *part)
{
    const int count = pinc_staged(e);
    PINC_REAL largest = PINC_N(0);
    int first = -1;
    int v;
    for (v = 0; v < count; v++) {
        largest = pinc_max(largest, pinc_abs(e->step.bounds[v] - e->mu[v]));
    }
    for (v = 0; v < count; v++) {
        const PINC_REAL rate = PINC_N(e->held[v]) * (e->step.bounds[v] - e->mu[v]);
        if ((v != in) && (rate < (-PINC_DEPENDENT * largest)) && (pinc_is_fixed(e, v) == 0)) {
            const PINC_REAL when = pinc_max(PINC_N(e->held[v]) * e->mu[v], PINC_N(0)) / -rate;
            if (when < *part) {
                *part = when;
                first = v;
            }
        }
    }
    return first;
}

/* Holds a state at its bound, and lets go of what that makes superfluous; 0 if it cannot be. */
static int pinc_bring_in(pinc_estimator *e, int in, int side, int *changes)
{
    PINC_REAL at = e->step.x[in];
    pinc_copy(e->mu, e->step.bounds, pinc_staged(e));
    e->held[in] = side;
    while (*changes < PINC_CHANGES) {
        const int follows = pinc_smooth(e, -1, PINC_N(0));
        PINC_REAL part = PINC_N(1);
        int out;
        int v;
        (*changes)++;
        if (follows >= 0) {
            /* Others hold it where it is: their multipliers move while its own grows. */
            const PINC_REAL pull = pinc_abs(e->mu[in]) + PINC_N(1);
            (void)pinc_smooth(e, in, at - (PINC_N(side) * pull));
            part = PINC_INFINITY;
        }
        out = pinc_first_at_zero(e, in, &part);
        if (out < 0) {
            return (follows < 0) ? 1 : 0;
        }
        for (v = 0; v < pinc_staged(e); v++) {
            e->mu[v] += part * (e->step.bounds[v] - e->mu[v]);
        }
        if (follows < 0) {
            at += part * (pinc_bound(e, in) - at);
        }
        e->mu[out] = PINC_N(0);
        e->held[out] = 0;
    }
    return 0;
}
#endif

/* Solves the program at the window; 0 if there is no solution. */
static int pinc_solve_window(pinc_estimator *e)
{
    const int count = pinc_staged(e);
#if PINC_HAS_BOUNDS
    int changes = 0;
    int side = 0;
    int in;
    pinc_start(e);
    in = pinc_furthest(e, &side);
    while (in >= 0) {
        if (pinc_bring_in(e, in, side, &changes) == 0) {
            return 0;
        }
        in = pinc_furthest(e, &side);
    }
#else
    (void)pinc_smooth(e, -1, PINC_N(0));
#endif
    pinc_add_scaled(e->step.v, PINC_N(-1), e->now.v, count);
    return pinc_all_finite(e->step.x, count) & pinc_all_finite(e->step.v, count);
}
