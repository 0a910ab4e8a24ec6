/* ---- Moving horizon estimation: Gauss-Newton SQP over the window ----------------------------- */

/* The residual at which the iteration ends, the most programs that it solves, and a step that is
   mere rounding. */
#define PINC_ESTIMATED PINC_PICK(1e-8, 1e-3)
#define PINC_ESTIMATE_ITERATIONS 50
#define PINC_NO_STEP PINC_PICK(1e-13, 1e-6)
/* Of the line search; and what rounding makes of the merit function, relative to its value. */
#define PINC_CONTRACTION PINC_N(0.9)
#define PINC_SUFFICIENT PINC_N(1e-4)
#define PINC_HALVINGS 20
#define PINC_NOISE PINC_PICK(1e-14, 1e-6)
/* Of the length of steps. */
#define PINC_PATIENCE 4

/* Goes a part of the step from the base on. */
static void pinc_go(pinc_estimator *e, PINC_REAL part)
{
    int i;
    for (i = 0; i < pinc_staged(e); i++) {
        e->now.x[i] = e->base.x[i] + (part * e->step.x[i] * pinc_unit[i % PINC_NZ]);
        e->now.v[i] = e->base.v[i] + (part * e->step.v[i]);
        e->now.dynamics[i] =
            e->base.dynamics[i] + (part * (e->step.dynamics[i] - e->base.dynamics[i]));
        e->now.bounds[i] = e->base.bounds[i] + (part * (e->step.bounds[i] - e->base.bounds[i]));
    }
    pinc_linearize_window(e);
}

static int pinc_take(pinc_estimator *e, PINC_REAL length)
{
    pinc_copy(e->last_x, e->step.x, PINC_STAGED);
    pinc_copy(e->last_v, e->step.v, PINC_STAGED);
    e->last_length = length;
    e->taken++;
    return 1;
}

/* The length to try for the step after Barzilai and Borwein, or 0 for none. */
static PINC_REAL pinc_length(const pinc_estimator *e)
{
    const int count = pinc_staged(e);
    PINC_REAL ratio;
    PINC_REAL length;
    if (e->taken < PINC_PATIENCE) {
        return PINC_N(0);
    }
    ratio = (pinc_dot(e->step.x, e->last_x, count) + pinc_dot(e->step.v, e->last_v, count)) /
            (pinc_dot(e->last_x, e->last_x, count) + pinc_dot(e->last_v, e->last_v, count));
    if (!(ratio < PINC_N(1))) {
        return PINC_N(0);
    }
    length = e->last_length / (PINC_N(1) - ratio);
    return (length > PINC_N(50)) ? PINC_N(50) : pinc_max(length, PINC_N(0.05));
}

/* Goes along the step: the whole way if that is clearly the best so far, or else as far as the
   merit function decreases; 0, and nowhere, if it does not. */
static int pinc_search(pinc_estimator *e, PINC_REAL least)
{
    const int count = pinc_staged(e);
    const PINC_REAL good = PINC_CONTRACTION * least;
    const PINC_REAL weight =
        PINC_N(1.5) * pinc_max(pinc_max(pinc_largest(e->step.dynamics, count),
                                        pinc_largest(e->step.bounds, count)),
                               PINC_N(1));
    const PINC_REAL start = e->cost + (weight * e->violation);
    const PINC_REAL slope = pinc_dot(e->slope, e->step.x, count) +
                            pinc_dot(e->now.v, e->step.v, count) - (weight * e->violation);
    const PINC_REAL descent = (slope < PINC_N(0)) ? slope : PINC_N(0);
    PINC_REAL length = pinc_length(e);
    int halving;
    if (length > PINC_N(0)) {
        pinc_go(e, length);
        if (e->kkt < good) {
            return pinc_take(e, length);
        }
    }
    length = PINC_N(1);
    for (halving = 0; halving < PINC_HALVINGS; halving++) {
        const PINC_REAL most =
            start + (PINC_SUFFICIENT * length * descent) + (PINC_NOISE * pinc_abs(start));
        pinc_go(e, length);
        if ((e->kkt < good) || ((e->cost + (weight * e->violation)) <= most)) {
            return pinc_take(e, length);
        }
        length *= PINC_N(0.5);
    }
    e->now = e->base;
    return 0;
}

static pinc_estimate_status pinc_ended(const pinc_estimator *e)
{
    return (e->kkt <= PINC_ESTIMATED) ? PINC_UPDATED : PINC_ESTIMATE_ITERATION_LIMIT;
}

/* Solves the problem of the window from its states on. */
static pinc_estimate_status pinc_optimize(pinc_estimator *e)
{
    PINC_REAL least = PINC_INFINITY;
    int iteration;
    if (pinc_arrive(e) == 0) {
        return PINC_INDEFINITE_COVARIANCE;
    }
    e->taken = 0;
    pinc_linearize_window(e);
    for (iteration = 0; iteration < PINC_ESTIMATE_ITERATIONS; iteration++) {
        const int count = pinc_staged(e);
        if (e->kkt <= PINC_ESTIMATED) {
            return PINC_UPDATED;
        }
        if (pinc_finite(e->kkt) == 0) {
            return PINC_NOT_FINITE;
        }
        if (pinc_solve_window(e) == 0) {
            return PINC_ESTIMATE_QP_FAILED;
        }
        least = (e->kkt < least) ? e->kkt : least;
        e->base = e->now;
        if (pinc_max(pinc_largest(e->step.x, count), pinc_largest(e->step.v, count)) <=
            PINC_NO_STEP) {
            /* There is no better point nearby; the multipliers belong to the solution. */
            pinc_go(e, PINC_N(1));
            return pinc_ended(e);
        }
        if (pinc_search(e, least) == 0) {
            return PINC_ESTIMATE_ITERATION_LIMIT;
        }
    }
    return pinc_ended(e);
}

#if PINC_HAS_BOUNDS
/* Fills the window with the model's states without noise, from the first estimate with an offset
   in number i on. */
static void pinc_roll_out(pinc_estimator *e, int i, PINC_REAL offset)
{
    int j;
    memset(&e->now, 0, sizeof(e->now));
    pinc_copy(e->now.x, pinc_initial, PINC_NZ);
    e->now.x[i] += offset;
    for (j = 0; j <= e->steps; j++) {
        PINC_REAL *x = e->now.x + (j * PINC_NZ);
        pinc_clip(x);
        if (j < e->steps) {
            pinc_move_on(e, x, e->applied + (j * PINC_NU));
            pinc_copy(x + PINC_NZ, e->next, PINC_NZ);
        }
    }
}

/* Solves the problem of the window from other states too, and keeps the best solution: states at a
   bound are easily a local one where little is known yet. */
static void pinc_explore(pinc_estimator *e)
{
    PINC_REAL least = e->cost;
    int i;
    e->best = e->now;
    for (i = 0; i < 2 * PINC_NZ; i++) {
        const int k = i % PINC_NZ;
        pinc_roll_out(e, k, (i < PINC_NZ) ? pinc_initial_sd[k] : -pinc_initial_sd[k]);
        if ((pinc_optimize(e) == PINC_UPDATED) && (e->cost < least)) {
            least = e->cost;
            e->best = e->now;
        }
    }
    e->now = e->best;
}
#endif

/* Adds what is expected of the last state now to the window. */
static void pinc_begin_last(pinc_estimator *e)
{
    const int first = e->steps * PINC_NZ;
    int i;
    pinc_copy(e->now.x + first, e->z, PINC_NZ);
    pinc_fill(e->now.v + first, PINC_N(0), PINC_NZ);
    pinc_copy(e->prior + first, e->z, PINC_NZ);
    pinc_copy(e->prior_p + (first * PINC_NZ), e->p, PINC_NZ * PINC_NZ);
    for (i = 0; i < PINC_NM; i++) {
        e->measured[(e->steps * PINC_NM) + i] = (PINC_REAL)NAN;
    }
}

/* Drops the first of the blocks of a window; the last stays twice. */
static void pinc_drop_first(PINC_REAL *blocks, int width)
{
    pinc_copy(blocks, blocks + width, PINC_WINDOW * width);
}

/* Drops the window but for its last state, of which less is known than the window says. */
static void pinc_begin_anew(pinc_estimator *e)
{
    const int last = e->steps * PINC_NZ;
    memmove(e->now.x, e->now.x + last, PINC_NZ * sizeof(PINC_REAL));
    memmove(e->prior, e->prior + last, PINC_NZ * sizeof(PINC_REAL));
    memmove(e->measured, e->measured + (e->steps * PINC_NM), PINC_NM * sizeof(PINC_REAL));
    pinc_copy(e->prior_p, e->before, PINC_NZ * PINC_NZ);
    pinc_fill(e->now.v, PINC_N(0), PINC_NZ);
    pinc_fill(e->now.dynamics, PINC_N(0), PINC_STAGED);
    pinc_fill(e->now.bounds, PINC_N(0), PINC_STAGED);
    e->steps = 0;
    /* The first estimate is no guess of this state. */
    e->moved_on = 1;
}

/* Corrects the estimate with what is measured: first as the filter does, then over the window. */
static pinc_estimate_status pinc_horizon_correct(pinc_estimator *e, const PINC_REAL *y)
{
    PINC_REAL *last;
    pinc_estimate_status status;
    pinc_estimate_status filtered;
    int i;
    pinc_copy(e->measured + (e->steps * PINC_NM), y, PINC_NM);
    filtered = pinc_filter_correct(e, y);
    if (filtered == PINC_REACQUIRED) {
        pinc_begin_anew(e);
    }
    last = e->now.x + (e->steps * PINC_NZ);
    pinc_copy(last, e->z, PINC_NZ);
    for (i = 0; i < PINC_NM; i++) {
        if (e->rejections[i] > 0) {
            e->measured[(e->steps * PINC_NM) + i] = (PINC_REAL)NAN;
        }
    }
    if ((filtered == PINC_INDEFINITE_COVARIANCE) || (filtered == PINC_NOT_FINITE)) {
        return filtered;
    }
    status = pinc_optimize(e);
#if PINC_HAS_BOUNDS
    if ((status == PINC_UPDATED) && (e->moved_on == 0) &&
        (pinc_largest(e->now.bounds, pinc_staged(e)) > PINC_N(0))) {
        pinc_explore(e);
    }
#endif
    pinc_copy(e->z, last, PINC_NZ);
    return (status == PINC_UPDATED) ? filtered : status;
}

/* Moves the estimate on by a step under the input u, and the window with it. */
static void pinc_horizon_predict(pinc_estimator *e, const PINC_REAL *u)
{
    pinc_copy(e->now.x + (e->steps * PINC_NZ), e->z, PINC_NZ);
    if (e->steps == 0) {
        pinc_copy(e->u_before, e->u, PINC_NU);
    }
    pinc_filter_predict(e, u);
    if (pinc_all_finite(e->next, PINC_NZ) == 0) {
        return;
    }
    pinc_copy(e->applied + (e->steps * PINC_NU), u, PINC_NU);
    if (e->steps < PINC_WINDOW) {
        e->steps++;
        pinc_fill(e->now.dynamics, PINC_N(0), PINC_STAGED);
        pinc_fill(e->now.bounds, PINC_N(0), PINC_STAGED);
    } else {
        e->moved_on = 1;
        pinc_copy(e->u_before, e->applied, PINC_NU);
        pinc_drop_first(e->now.x, PINC_NZ);
        pinc_drop_first(e->now.v, PINC_NZ);
        pinc_drop_first(e->now.dynamics, PINC_NZ);
        pinc_drop_first(e->now.bounds, PINC_NZ);
        pinc_drop_first(e->applied, PINC_NU);
        pinc_drop_first(e->measured, PINC_NM);
        pinc_drop_first(e->prior, PINC_NZ);
        pinc_drop_first(e->prior_p, PINC_NZ * PINC_NZ);
    }
    pinc_begin_last(e);
}
