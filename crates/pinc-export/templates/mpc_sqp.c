/* ---- The control problem along a plan ------------------------------------------------------- */

/* The input before number v of all inputs. */
static PINC_REAL pinc_before(const pinc_mpc *m, const PINC_REAL *z, int v)
{
    return (v < PINC_NU) ? m->previous[v] : z[PINC_STATES + v - PINC_NU];
}

/* Moves the plan's inputs into the bounds of inputs and increments. */
static void pinc_project(const pinc_mpc *m, PINC_REAL *z)
{
    int v;
    for (v = 0; v < PINC_INPUTS; v++) {
        const PINC_REAL before = pinc_before(m, z, v);
        const PINC_REAL least = PINC_LOW(m)[PINC_STATES + v];
        const PINC_REAL most = PINC_HIGH(m)[PINC_STATES + v];
        const PINC_REAL low = pinc_min(before + pinc_increment_low[v], most);
        const PINC_REAL high = pinc_max(before + pinc_increment_high[v], least);
        PINC_REAL *input = z + (PINC_STATES + v);
        const PINC_REAL wanted = (pinc_finite(*input) != 0) ? *input : before;
        *input = pinc_min(pinc_max(pinc_min(pinc_max(wanted, low), high), least), most);
    }
}

/* Linearizes the model along z, from the state at the start; 0 if the budget was spent before the
   end. */
static int pinc_linearize(pinc_mpc *m, const PINC_REAL *z, pinc_qp *qp)
{
    PINC_REAL x[PINC_BATCH * PINC_NX];
    PINC_REAL u[PINC_BATCH * PINC_NU];
    int j;
    int i;
    for (j = 0; j < PINC_N2; j += PINC_BATCH) {
        const int points = ((PINC_N2 - j) < PINC_BATCH) ? (PINC_N2 - j) : PINC_BATCH;
        if ((j > 0) && ((j % PINC_UNASKED_STAGES) == 0) && (pinc_expired(m) != 0)) {
            return 0;
        }
        for (i = 0; i < points; i++) {
            pinc_copy(x + (i * PINC_NX),
                      (j + i == 0) ? m->start : (z + ((j + i - 1) * PINC_NX)), PINC_NX);
            pinc_copy(u + (i * PINC_NU), z + (PINC_STATES + (pinc_acting(j + i) * PINC_NU)),
                      PINC_NU);
        }
        @LINEARIZE@points, x, u, qp->c + (j * PINC_NX), PINC_A(qp, j), PINC_B(qp, j));
    }
    for (i = 0; i < PINC_STATES; i++) {
        qp->c[i] -= z[i];
    }
    return 1;
}

/* What is left of bounds and increments at z. */
static void pinc_limit(const pinc_mpc *m, const PINC_REAL *z, pinc_qp *qp)
{
    int v;
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        qp->low[v] = PINC_LOW(m)[v] - z[v];
        qp->high[v] = PINC_HIGH(m)[v] - z[v];
    }
    for (v = 0; v < PINC_INPUTS; v++) {
        const PINC_REAL before = pinc_before(m, z, v);
        const PINC_REAL increment = z[PINC_STATES + v] - before;
        PINC_REAL up = PINC_N(0);
        PINC_REAL down = PINC_N(0);
        if (v < PINC_NU) {
            /* The first input may always go as far as to its nearest bound. */
            up = PINC_HIGH(m)[PINC_STATES + v] - before;
            down = PINC_LOW(m)[PINC_STATES + v] - before;
        }
        qp->increment_low[v] = pinc_min(pinc_increment_low[v], up) - increment;
        qp->increment_high[v] = pinc_max(pinc_increment_high[v], down) - increment;
    }
}

/* The part of the cost, twice, that increments make, and its gradient. */
static PINC_REAL pinc_move_inputs(const pinc_mpc *m, const PINC_REAL *z, PINC_REAL *gradient)
{
    PINC_REAL twice = PINC_N(0);
    int v;
    int k;
    for (v = 0; v < PINC_INPUTS; v++) {
        const int first = v - (v % PINC_NU);
        PINC_REAL force = PINC_N(0);
        for (k = 0; k < PINC_NU; k++) {
            const PINC_REAL change = z[PINC_STATES + first + k] - pinc_before(m, z, first + k);
            force += m->r[(v * PINC_NU) + k] * change;
        }
        gradient[PINC_STATES + v] += force;
        if (v >= PINC_NU) {
            gradient[PINC_STATES + v - PINC_NU] -= force;
        }
        twice += force * (z[PINC_STATES + v] - pinc_before(m, z, v));
    }
    return twice;
}

#if !PINC_TRACKS_OUTPUTS
/* The same of tracking. */
static PINC_REAL pinc_track(const pinc_mpc *m, const PINC_REAL *z, const PINC_REAL *reference,
                            PINC_REAL *gradient)
{
    PINC_REAL twice = PINC_N(0);
    int j;
    int i;
    int k;
    for (j = 0; j < PINC_N2; j++) {
        const PINC_REAL *x = z + (j * PINC_NX);
        const PINC_REAL *y = reference + (j * PINC_NY);
        for (i = 0; i < PINC_NY; i++) {
            const int row = pinc_tracked[i];
            PINC_REAL force = PINC_N(0);
            for (k = 0; k < PINC_NY; k++) {
                const int column = pinc_tracked[k];
                const PINC_REAL error = x[column] - (y[k] / PINC_X_UNIT(column));
                force += PINC_Q(m, 0, j)[(row * PINC_NX) + column] * error;
            }
            gradient[(j * PINC_NX) + row] = force;
            twice += force * (x[row] - (y[i] / PINC_X_UNIT(row)));
        }
    }
    return twice;
}
#endif

#if PINC_HAS_W
/* The same of the weighted sequence of inputs. */
static PINC_REAL pinc_weigh_inputs(const pinc_mpc *m, const PINC_REAL *z, PINC_REAL *gradient)
{
    const int width = PINC_INPUTS + PINC_NU;
    PINC_REAL twice = PINC_N(0);
    int i;
    int k;
    for (i = 0; i < width; i++) {
        PINC_REAL force = PINC_N(0);
        for (k = 0; k < width; k++) {
            force += pinc_w[(i * width) + k] * pinc_before(m, z, k);
        }
        twice += force * pinc_before(m, z, i);
        if (i >= PINC_NU) {
            gradient[PINC_STATES + i - PINC_NU] += force;
        }
    }
    return twice;
}
#endif

/* Linearizes at z and writes the cost; 0 if the budget was spent before that. */
static int pinc_evaluate(pinc_mpc *m, const PINC_REAL *z, const PINC_REAL *reference, pinc_qp *qp,
                         PINC_REAL *cost)
{
    PINC_REAL twice;
    if (pinc_linearize(m, z, qp) == 0) {
        return 0;
    }
    pinc_limit(m, z, qp);
    pinc_fill(qp->gradient, PINC_N(0), PINC_UNKNOWNS);
    twice = pinc_move_inputs(m, z, qp->gradient);
#if PINC_TRACKS_OUTPUTS || (PINC_OUTPUT_ROWS > 0)
    twice += pinc_follow_outputs(m, z, reference, qp);
#endif
#if !PINC_TRACKS_OUTPUTS
    twice += pinc_track(m, z, reference, qp->gradient);
#endif
#if PINC_HAS_W
    twice += pinc_weigh_inputs(m, z, qp->gradient);
#endif
    *cost = twice / PINC_N(2);
    return 1;
}

/* ---- How far a plan is from optimal --------------------------------------------------------- */

/* The larger of two numbers; infinity if the second is NaN. */
static PINC_REAL pinc_worse(PINC_REAL largest, PINC_REAL v)
{
    if (v <= largest) {
        return largest;
    }
    return (v > largest) ? v : PINC_INFINITY;
}

static PINC_REAL pinc_largest(const PINC_REAL *v, int count)
{
    PINC_REAL largest = PINC_N(0);
    int i;
    for (i = 0; i < count; i++) {
        largest = pinc_worse(largest, pinc_abs(v[i]));
    }
    return largest;
}

static PINC_REAL pinc_size(const PINC_REAL *v, int count)
{
    PINC_REAL sum = PINC_N(0);
    int i;
    for (i = 0; i < count; i++) {
        sum += pinc_abs(v[i]);
    }
    return sum;
}

/* What rounding leaves of distances to limits. */
#define PINC_ROUNDED PINC_N(1e-11)

/* The residuals of rows with limits: stationarity, violation, product. */
typedef struct {
    PINC_REAL stationarity;
    PINC_REAL violation;
    PINC_REAL product;
} pinc_residuals;

static void pinc_see(pinc_residuals *worst, PINC_REAL low, PINC_REAL high, PINC_REAL penalty,
                     PINC_REAL mu)
{
    const PINC_REAL outside = pinc_max(pinc_max(low, -high), PINC_N(0));
    const PINC_REAL size = pinc_abs(mu);
    const PINC_REAL room =
        (mu > PINC_N(0)) ? pinc_max(high, PINC_N(0)) : pinc_max(-low, PINC_N(0));
    if ((size > PINC_N(0)) && (room > PINC_ROUNDED)) {
        worst->product = pinc_worse(worst->product, size * room);
    }
    if (penalty < PINC_INFINITY) {
        const PINC_REAL lacking = pinc_max(penalty - size, PINC_N(0));
        worst->product = pinc_worse(
            worst->product, (outside > PINC_ROUNDED) ? (outside * lacking) : PINC_N(0));
        worst->stationarity = pinc_worse(worst->stationarity, size - penalty);
    } else {
        worst->violation = pinc_worse(worst->violation, outside);
    }
}

/* The gradient of the Lagrangian. */
static void pinc_lagrangian(const pinc_qp *qp, const pinc_multipliers *at, PINC_REAL *gradient)
{
    PINC_REAL *inputs = gradient + PINC_STATES;
    int v;
    int j;
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        gradient[v] = qp->gradient[v] + at->bounds[v];
    }
    for (j = 0; j < PINC_N2; j++) {
        const PINC_REAL *lambda = at->dynamics + (j * PINC_NX);
        for (v = 0; v < PINC_NX; v++) {
            gradient[(j * PINC_NX) + v] -= lambda[v];
        }
        if (j > 0) {
            pinc_add_transposed(PINC_A(qp, j), lambda, gradient + ((j - 1) * PINC_NX), PINC_NX,
                                PINC_NX);
        }
        pinc_add_transposed(PINC_B(qp, j), lambda, inputs + (pinc_acting(j) * PINC_NU), PINC_NX,
                            PINC_NU);
    }
    for (v = 0; v < PINC_OUTPUT_ROWS; v++) {
        pinc_add_scaled(gradient + (pinc_output_state[v] * PINC_NX), at->outputs[v],
                        qp->output_x + (v * PINC_NX), PINC_NX);
        pinc_add_scaled(inputs + (pinc_acting(pinc_output_interval[v]) * PINC_NU), at->outputs[v],
                        qp->output_u + (v * PINC_NU), PINC_NU);
    }
    for (v = 0; v < PINC_INPUTS; v++) {
        inputs[v] += at->increments[v];
        if (v >= PINC_NU) {
            inputs[v - PINC_NU] -= at->increments[v];
        }
    }
}

/* The KKT residual where the program at hand is linearized, with these multipliers. */
static PINC_REAL pinc_residual(pinc_mpc *m, const pinc_qp *qp, const pinc_multipliers *at)
{
    const PINC_REAL count =
        PINC_N(PINC_STATES + PINC_UNKNOWNS + PINC_INPUTS + PINC_ALL_OUTPUT_ROWS);
    pinc_residuals worst;
    PINC_REAL scale;
    int v;
    pinc_lagrangian(qp, at, m->work);
    worst.stationarity = pinc_largest(m->work, PINC_UNKNOWNS);
    worst.violation = PINC_N(0);
    worst.product = PINC_N(0);
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        const PINC_REAL penalty = (v < PINC_STATES) ? m->penalty[v] : PINC_INFINITY;
        pinc_see(&worst, qp->low[v], qp->high[v], penalty, at->bounds[v]);
    }
    for (v = 0; v < PINC_INPUTS; v++) {
        pinc_see(&worst, qp->increment_low[v], qp->increment_high[v], PINC_INFINITY,
                 at->increments[v]);
    }
    for (v = 0; v < PINC_OUTPUT_ROWS; v++) {
        pinc_see(&worst, qp->output_low[v], qp->output_high[v], m->output_penalty[v],
                 at->outputs[v]);
    }
    scale = pinc_size(at->dynamics, PINC_STATES);
    scale += pinc_size(at->bounds, PINC_UNKNOWNS);
    scale += pinc_size(at->increments, PINC_INPUTS);
    scale += pinc_size(at->outputs, PINC_OUTPUT_ROWS);
    scale = pinc_max(scale / count / PINC_N(100), PINC_N(1));
    m->bounds_residual = worst.violation;
    m->dynamics_residual = pinc_largest(qp->c, PINC_STATES);
    m->kkt = pinc_worse(pinc_worse(pinc_worse(pinc_worse(PINC_N(0), worst.stationarity / scale),
                                              m->dynamics_residual),
                                   worst.violation),
                        worst.product / scale);
    return m->kkt;
}

/* ---- The merit function --------------------------------------------------------------------- */

static void pinc_update_weights(PINC_REAL *weights, const PINC_REAL *multipliers, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        const PINC_REAL least = pinc_abs(multipliers[i]);
        weights[i] = pinc_max(least, PINC_N(0.5) * (weights[i] + least));
    }
}

static PINC_REAL pinc_violation(PINC_REAL low, PINC_REAL high, PINC_REAL penalty, PINC_REAL weight)
{
    const PINC_REAL outside = pinc_max(pinc_max(low, -high), PINC_N(0));
    if (outside > PINC_N(0)) {
        return outside * ((penalty < PINC_INFINITY) ? penalty : weight);
    }
    return PINC_N(0);
}

/* The exact L1 merit function. */
static PINC_REAL pinc_merit(const pinc_mpc *m, const pinc_qp *qp, PINC_REAL cost)
{
    PINC_REAL defects = PINC_N(0);
    PINC_REAL bounds = PINC_N(0);
    PINC_REAL increments = PINC_N(0);
    PINC_REAL outputs = PINC_N(0);
    int v;
    for (v = 0; v < PINC_STATES; v++) {
        defects += m->weights.dynamics[v] * pinc_abs(qp->c[v]);
    }
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        const PINC_REAL penalty = (v < PINC_STATES) ? m->penalty[v] : PINC_INFINITY;
        bounds += pinc_violation(qp->low[v], qp->high[v], penalty, m->weights.bounds[v]);
    }
    for (v = 0; v < PINC_INPUTS; v++) {
        increments += pinc_violation(qp->increment_low[v], qp->increment_high[v], PINC_INFINITY,
                                     m->weights.increments[v]);
    }
    for (v = 0; v < PINC_OUTPUT_ROWS; v++) {
        outputs += pinc_violation(qp->output_low[v], qp->output_high[v], m->output_penalty[v],
                                  m->weights.outputs[v]);
    }
    return cost + defects + (bounds + increments + outputs);
}

/* At most this is the merit function's slope along the step. */
static PINC_REAL pinc_slope(const pinc_mpc *m, const pinc_qp *qp)
{
    PINC_REAL along = PINC_N(0);
    PINC_REAL left = PINC_N(0);
    int v;
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        along += qp->gradient[v] * m->d[v];
    }
    for (v = 0; v < PINC_STATES; v++) {
        if (m->penalty[v] < PINC_INFINITY) {
            const PINC_REAL off = pinc_max(qp->low[v] - m->d[v], m->d[v] - qp->high[v]);
            left += m->penalty[v] * pinc_max(off, PINC_N(0));
        }
    }
    for (v = 0; v < PINC_OUTPUT_ROWS; v++) {
        if (m->output_penalty[v] < PINC_INFINITY) {
            const int input = pinc_acting(pinc_output_interval[v]);
            const PINC_REAL *u = m->d + (PINC_STATES + (input * PINC_NU));
            const PINC_REAL *x = m->d + (pinc_output_state[v] * PINC_NX);
            const PINC_REAL at =
                pinc_dot(qp->output_x + (v * PINC_NX), x, PINC_NX) +
                pinc_dot(qp->output_u + (v * PINC_NU), u, PINC_NU);
            const PINC_REAL off = pinc_max(qp->output_low[v] - at, at - qp->output_high[v]);
            left += m->output_penalty[v] * pinc_max(off, PINC_N(0));
        }
    }
    return along - (pinc_merit(m, qp, PINC_N(0)) - left);
}

/* ---- Sequential quadratic programming ------------------------------------------------------- */

#if PINC_STATES_EXACT != PINC_OUTPUTS_EXACT
static int pinc_has_hard(const PINC_REAL *low, const PINC_REAL *high, const PINC_REAL *penalty,
                         int count)
{
    int v;
    for (v = 0; v < count; v++) {
        if (!(penalty[v] < PINC_INFINITY) &&
            ((low[v] > -PINC_INFINITY) || (high[v] < PINC_INFINITY))) {
            return 1;
        }
    }
    return 0;
}

/* Whether bounds on states and on outputs are hard, of which one kind stays soft. */
static int pinc_softens_in_turn(const pinc_mpc *m, const pinc_qp *qp)
{
    return ((pinc_has_hard(qp->low, qp->high, m->penalty, PINC_STATES) != 0) &&
            (pinc_has_hard(qp->output_low, qp->output_high, m->output_penalty, PINC_OUTPUT_ROWS) !=
             0))
               ? 1
               : 0;
}
#endif

static void pinc_weigh_hard(PINC_REAL *penalty, const PINC_REAL *own, int count, PINC_REAL weight)
{
    int v;
    for (v = 0; v < count; v++) {
        if (!(own[v] < PINC_INFINITY)) {
            penalty[v] = weight;
        }
    }
}

/* More of the hard constraints on states become soft, at a weight above their multipliers: those first that
   stay soft where they have to be. 0 if all are soft. */
static int pinc_enter_elastic(pinc_mpc *m)
{
    const pinc_qp *qp = &m->qp[m->at];
#if PINC_TRACKS_OUTPUTS
    const PINC_REAL changing = pinc_largest(qp->q, PINC_STATES * PINC_NX) +
                               pinc_largest(qp->t, PINC_INPUTS * PINC_NU);
#else
    const PINC_REAL changing = pinc_largest(m->q, PINC_WEIGHTS);
#endif
    const PINC_REAL sizes = pinc_largest(qp->gradient, PINC_UNKNOWNS) + changing +
                            pinc_largest(m->r, PINC_INPUTS * PINC_NU) + PINC_LARGEST_W;
    const PINC_REAL weight = PINC_ELASTIC_WEIGHT * pinc_max(sizes, PINC_N(1));
    if (m->elastic == PINC_ALL_SOFT) {
        return 0;
    }
#if PINC_STATES_EXACT != PINC_OUTPUTS_EXACT
    m->elastic = ((m->elastic == PINC_AS_STATED) && (pinc_softens_in_turn(m, qp) != 0))
                     ? PINC_EXACT_SOFT
                     : PINC_ALL_SOFT;
#else
    m->elastic = PINC_ALL_SOFT;
#endif
    m->count = 0;
    if ((m->elastic == PINC_ALL_SOFT) || (PINC_STATES_EXACT != 0)) {
        pinc_weigh_hard(m->penalty, pinc_penalty, PINC_STATES, weight);
    }
    if ((m->elastic == PINC_ALL_SOFT) || (PINC_OUTPUTS_EXACT != 0)) {
        pinc_weigh_hard(m->output_penalty, pinc_output_penalty, PINC_OUTPUT_ROWS, weight);
    }
    return 1;
}

static void pinc_move_part(PINC_REAL *to, const PINC_REAL *from, const PINC_REAL *step, int count,
                           PINC_REAL length)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = from[i] + (length * (step[i] - from[i]));
    }
}

/* Sets the plan so much of the step away from the base. */
static void pinc_set_trial(pinc_mpc *m, PINC_REAL length)
{
    int v;
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        m->plan.z[v] = m->base.z[v] + (length * m->d[v]);
    }
    pinc_move_part(m->plan.m.dynamics, m->base.m.dynamics, m->step.dynamics, PINC_STATES, length);
    pinc_move_part(m->plan.m.bounds, m->base.m.bounds, m->step.bounds, PINC_UNKNOWNS, length);
    pinc_move_part(m->plan.m.increments, m->base.m.increments, m->step.increments, PINC_INPUTS,
                   length);
    pinc_move_part(m->plan.m.outputs, m->base.m.outputs, m->step.outputs, PINC_OUTPUT_ROWS, length);
    pinc_project(m, m->plan.z);
}

/* Does so and linearizes there; writes the cost. 0 if the budget was spent before that. */
static int pinc_try(pinc_mpc *m, const PINC_REAL *reference, PINC_REAL length, PINC_REAL *cost)
{
    pinc_qp *trial = &m->qp[1 - m->at];
    pinc_set_trial(m, length);
    if (pinc_evaluate(m, m->plan.z, reference, trial, cost) == 0) {
        return 0;
    }
    (void)pinc_residual(m, trial, &m->plan.m);
    return 1;
}

static void pinc_accept(pinc_mpc *m, PINC_REAL length)
{
    int i;
    for (i = 0; i <= PINC_DEPTH; i++) {
        pinc_add_scaled(m->past[i].end.z, -length, m->d, PINC_UNKNOWNS);
    }
    m->at = 1 - m->at;
}

/* The limit at which a row with this multiplier stays; infinite if it is not active, or violated. */
static PINC_REAL pinc_held_at(PINC_REAL multiplier, PINC_REAL low, PINC_REAL high,
                              PINC_REAL penalty)
{
    const PINC_REAL size = pinc_abs(multiplier);
    if ((size > PINC_ACTIVE) && (size < (penalty - PINC_ACTIVE))) {
        return (multiplier > PINC_N(0)) ? high : low;
    }
    return PINC_INFINITY;
}

/* Whether rows are held at the same limits by the multipliers of the plan and of the step. Without
   penalties they are hard. */
static int pinc_hold_alike(const PINC_REAL *plan, const PINC_REAL *step, const PINC_REAL *low,
                           const PINC_REAL *high, const PINC_REAL *penalty, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        const PINC_REAL hardness = (penalty != NULL) ? penalty[i] : PINC_INFINITY;
        if (pinc_held_at(plan[i], low[i], high[i], hardness) !=
            pinc_held_at(step[i], low[i], high[i], hardness)) {
            return 0;
        }
    }
    return 1;
}

static int pinc_same_active(const pinc_mpc *m)
{
    const pinc_qp *qp = &m->qp[m->at];
    const pinc_multipliers *plan = &m->plan.m;
    const pinc_multipliers *step = &m->step;
    return pinc_hold_alike(plan->bounds, step->bounds, qp->low, qp->high, m->penalty,
                           PINC_STATES) &&
           pinc_hold_alike(plan->bounds + PINC_STATES, step->bounds + PINC_STATES,
                           qp->low + PINC_STATES, qp->high + PINC_STATES, NULL, PINC_INPUTS) &&
           pinc_hold_alike(plan->increments, step->increments, qp->increment_low,
                           qp->increment_high, NULL, PINC_INPUTS) &&
           pinc_hold_alike(plan->outputs, step->outputs, qp->output_low, qp->output_high,
                           m->output_penalty, PINC_OUTPUT_ROWS);
}

/* Writes the gammas for which |d - gamma[0] (d - d_1) - gamma[1] (d - d_2)| is least; 0 if there are none. */
static int pinc_gammas(const PINC_REAL *d, const PINC_REAL *one, const PINC_REAL *two,
                       PINC_REAL *gamma)
{
    PINC_REAL aa = PINC_N(0);
    PINC_REAL ab = PINC_N(0);
    PINC_REAL bb = PINC_N(0);
    PINC_REAL ad = PINC_N(0);
    PINC_REAL bd = PINC_N(0);
    PINC_REAL along;
    PINC_REAL left;
    int v;
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        const PINC_REAL a = d[v] - one[v];
        const PINC_REAL b = d[v] - two[v];
        aa += a * a;
        ab += a * b;
        bb += b * b;
        ad += a * d[v];
        bd += b * d[v];
    }
    /* The part of b that is orthogonal to a. */
    along = ab / aa;
    left = bb - (along * ab);
    gamma[1] =
        (left > (PINC_INDEPENDENT * bb)) ? ((bd - (along * ad)) / left) : PINC_N(0);
    gamma[0] = (ad / aa) - (along * gamma[1]);
    return pinc_finite(gamma[0]) && pinc_finite(gamma[1]);
}

/* Moves parts of the way from a step to the two before it. */
static void pinc_move_back(PINC_REAL *to, const PINC_REAL *now, const PINC_REAL *one,
                           const PINC_REAL *two, const PINC_REAL *gamma, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] += (gamma[0] * (one[i] - now[i])) + (gamma[1] * (two[i] - now[i]));
    }
}

static void pinc_move_step_back(pinc_mpc *m, const pinc_plan *now, const pinc_plan *one,
                                const pinc_plan *two, const PINC_REAL *gamma)
{
    pinc_move_back(m->d, now->z, one->z, two->z, gamma, PINC_UNKNOWNS);
    pinc_move_back(m->step.dynamics, now->m.dynamics, one->m.dynamics, two->m.dynamics, gamma,
                   PINC_STATES);
    pinc_move_back(m->step.bounds, now->m.bounds, one->m.bounds, two->m.bounds, gamma,
                   PINC_UNKNOWNS);
    pinc_move_back(m->step.increments, now->m.increments, one->m.increments, two->m.increments,
                   gamma, PINC_INPUTS);
    pinc_move_back(m->step.outputs, now->m.outputs, one->m.outputs, two->m.outputs, gamma,
                   PINC_OUTPUT_ROWS);
}

/* Accelerates the step by the ones before it that had the same active rows (Anderson). Returns the step as
   it was, or NULL if it was not accelerated. */
static const pinc_past *pinc_accelerate(pinc_mpc *m)
{
    const pinc_past *one;
    const pinc_past *two;
    pinc_past *now;
    PINC_REAL gamma[2];
    int known;
    if (pinc_same_active(m) == 0) {
        m->count = 0;
    }
    known = m->count;
    now = &m->past[known % (PINC_DEPTH + 1)];
    one = &m->past[(known + 2) % (PINC_DEPTH + 1)];
    two = (known > 1) ? &m->past[(known + 1) % (PINC_DEPTH + 1)] : one;
    m->count++;
    pinc_copy(now->d, m->d, PINC_UNKNOWNS);
    pinc_copy(now->end.z, m->d, PINC_UNKNOWNS);
    now->end.m = m->step;
    if ((known == 0) || (pinc_gammas(now->d, one->d, two->d, gamma) == 0)) {
        return NULL;
    }
    pinc_move_step_back(m, &now->end, &one->end, &two->end, gamma);
    return now;
}

/* How the search along a step ended: with a plan; without; with the budget spent and the plan where
   the step starts; or before the end of the step could be judged, with the plan there. */
typedef enum { PINC_FOUND, PINC_NO_DESCENT, PINC_LATE, PINC_UNJUDGED } pinc_found;

/* Halves the step until the merit function decreases, from the whole step at the cost given. */
static pinc_found pinc_backtrack(pinc_mpc *m, const PINC_REAL *reference, PINC_REAL *cost,
                                 PINC_REAL whole)
{
    PINC_REAL length = PINC_N(1);
    PINC_REAL now = whole;
    PINC_REAL start;
    PINC_REAL slope;
    int halving;
    pinc_update_weights(m->weights.dynamics, m->step.dynamics, PINC_STATES);
    pinc_update_weights(m->weights.bounds, m->step.bounds, PINC_UNKNOWNS);
    pinc_update_weights(m->weights.increments, m->step.increments, PINC_INPUTS);
    pinc_update_weights(m->weights.outputs, m->step.outputs, PINC_OUTPUT_ROWS);
    start = pinc_merit(m, &m->qp[m->at], *cost);
    slope = pinc_min(pinc_slope(m, &m->qp[m->at]), PINC_N(0));
    for (halving = 0; halving < PINC_HALVINGS; halving++) {
        const PINC_REAL merit = pinc_merit(m, &m->qp[1 - m->at], now);
        const PINC_REAL most = start + (PINC_SUFFICIENT * length * slope);
        if (merit <= most + (PINC_NOISE * pinc_abs(start))) {
            pinc_accept(m, length);
            *cost = now;
            return PINC_FOUND;
        }
        length *= PINC_N(0.5);
        if ((pinc_expired(m) != 0) || (pinc_try(m, reference, length, &now) == 0)) {
            m->plan = m->base;
            return PINC_LATE;
        }
    }
    m->plan = m->base;
    return PINC_NO_DESCENT;
}

/* Goes along the step as far as is good. */
static pinc_found pinc_search(pinc_mpc *m, const PINC_REAL *reference, PINC_REAL *cost,
                              PINC_REAL least)
{
    const PINC_REAL good = PINC_CONTRACTION * least;
    const pinc_past *plain = pinc_accelerate(m);
    PINC_REAL now = PINC_N(0);
    m->base = m->plan;
    if (plain != NULL) {
        if (pinc_try(m, reference, PINC_N(1), &now) == 0) {
            return PINC_UNJUDGED;
        }
        if (m->kkt <= good) {
            pinc_accept(m, PINC_N(1));
            *cost = now;
            return PINC_FOUND;
        }
        if (pinc_expired(m) != 0) {
            m->plan = m->base;
            return PINC_LATE;
        }
        pinc_copy(m->d, plain->d, PINC_UNKNOWNS);
        m->step = plain->end.m;
    }
    if (pinc_try(m, reference, PINC_N(1), &now) == 0) {
        return PINC_UNJUDGED;
    }
    if (m->kkt <= good) {
        pinc_accept(m, PINC_N(1));
        *cost = now;
        return PINC_FOUND;
    }
    return pinc_backtrack(m, reference, cost, now);
}

/* Goes as far towards the solution of a program as it came before the budget was spent. */
static void pinc_step_on_the_way(pinc_mpc *m)
{
    m->base = m->plan;
    if (pinc_step_is_finite(m) != 0) {
        pinc_set_trial(m, PINC_N(1));
    }
    m->standing = PINC_UNDERWAY;
}

/* Makes more hard constraints soft, with the limits that the program at the plan has then. Gives how the
   iteration ends if none is left (`otherwise`) or the budget is spent; PINC_CONVERGED if it goes on. */
static pinc_status pinc_soften(pinc_mpc *m, const PINC_REAL *reference, PINC_REAL *cost,
                               pinc_status otherwise)
{
    if (pinc_enter_elastic(m) == 0) {
        return otherwise;
    }
#if PINC_OUTPUT_STARTS
    if (pinc_evaluate(m, m->plan.z, reference, &m->qp[1 - m->at], cost) == 0) {
        return PINC_DEADLINE;
    }
    m->at = 1 - m->at;
#else
    (void)reference;
    (void)cost;
#endif
    return PINC_CONVERGED;
}

/* Improves the plan, at which the problem is linearized; gives how that ended. */
static pinc_status pinc_iterate(pinc_mpc *m, const PINC_REAL *reference, PINC_REAL cost)
{
    PINC_REAL kkt = pinc_residual(m, &m->qp[m->at], &m->plan.m);
    PINC_REAL least = kkt;
    for (;;) {
        pinc_qp_status solved;
        pinc_found found;
        if (pinc_finite(kkt) == 0) {
            return PINC_NUMERICAL_TROUBLE;
        }
        if (kkt <= PINC_KKT_TOLERANCE) {
            return PINC_CONVERGED;
        }
        if (m->iterations >= m->max_iterations) {
            return PINC_ITERATION_LIMIT;
        }
        if (pinc_expired(m) != 0) {
            return PINC_DEADLINE;
        }
        m->iterations++;
        m->step = m->plan.m;
        solved = pinc_solve_qp(m);
        if (solved == PINC_QP_EXPIRED) {
            pinc_step_on_the_way(m);
            return PINC_DEADLINE;
        }
        if ((solved == PINC_QP_INFEASIBLE) ||
            ((solved != PINC_QP_SOLVED) && (m->elastic == PINC_EXACT_SOFT))) {
            /* A program in between is none that the plan gains by. */
            m->iterations -= (m->elastic == PINC_EXACT_SOFT) ? 1 : 0;
            const pinc_status status = pinc_soften(m, reference, &cost, PINC_INFEASIBLE_QP);
            if (status != PINC_CONVERGED) {
                return status;
            }
            continue;
        }
        if (solved != PINC_QP_SOLVED) {
            return PINC_NUMERICAL_TROUBLE;
        }
        found = pinc_search(m, reference, &cost, least);
        if ((found == PINC_LATE) || (found == PINC_UNJUDGED)) {
            m->standing = (found == PINC_LATE) ? PINC_JUDGED : PINC_STEPPED;
            return PINC_DEADLINE;
        }
        if (found == PINC_FOUND) {
            kkt = m->kkt;
        } else {
            const pinc_status status = pinc_soften(m, reference, &cost, PINC_STALLED);
            if (status != PINC_CONVERGED) {
                return status;
            }
            kkt = pinc_residual(m, &m->qp[m->at], &m->plan.m);
        }
        least = pinc_min(least, kkt);
    }
}

/* Judges the end by the problem's own hard constraints; a plan that is not linearized at, by the
   one before. */
static pinc_status pinc_judge(pinc_mpc *m, pinc_status status)
{
    const pinc_plan *judged = (m->standing == PINC_JUDGED) ? &m->plan : &m->base;
    if (m->elastic != PINC_AS_STATED) {
        if (PINC_STATES_EXACT == 0) {
            pinc_copy(m->penalty, pinc_penalty, PINC_STATES);
        }
        if (PINC_OUTPUTS_EXACT == 0) {
            pinc_copy(m->output_penalty, pinc_output_penalty, PINC_OUTPUT_ROWS);
        }
#if PINC_OUTPUT_STARTS
        pinc_admit_given(m, &m->qp[m->at]);
#endif
    }
    (void)pinc_residual(m, &m->qp[m->at], &judged->m);
    if ((m->elastic != PINC_AS_STATED) && (m->bounds_residual > PINC_KKT_TOLERANCE) &&
        ((status == PINC_CONVERGED) || (status == PINC_STALLED))) {
        status = PINC_INFEASIBLE_QP;
    }
    return (pinc_finite(m->kkt) != 0) ? status : PINC_NUMERICAL_TROUBLE;
}

static void pinc_restore_penalties(pinc_mpc *m)
{
    pinc_copy(m->penalty, pinc_penalty, PINC_STATES);
    pinc_copy(m->output_penalty, pinc_output_penalty, PINC_OUTPUT_ROWS);
}

/* Optimizes from the plan at hand, with hard constraints hard; gives how that ended. */
static pinc_status pinc_optimize(pinc_mpc *m, const PINC_REAL *reference)
{
    PINC_REAL cost = PINC_N(0);
    m->elastic = PINC_AS_STATED;
    pinc_restore_penalties(m);
    memset(&m->weights, 0, sizeof(m->weights));
    m->count = 0;
    m->iterations = 0;
    m->standing = PINC_JUDGED;
    if (pinc_evaluate(m, m->plan.z, reference, &m->qp[m->at], &cost) == 0) {
        m->kkt = PINC_INFINITY;
        m->dynamics_residual = PINC_INFINITY;
        return PINC_DEADLINE;
    }
    return pinc_judge(m, pinc_iterate(m, reference, cost));
}

@TUBE@/* ---- The controller ------------------------------------------------------------------------- */

static void pinc_shift(PINC_REAL *v, int width, int count)
{
    int i;
    for (i = 0; i + width < count; i++) {
        v[i] = v[i + width];
    }
}

/* Plans to stay at a state; all multipliers are 0. */
static void pinc_stay_at(pinc_plan *plan, const PINC_REAL *x)
{
    int j;
    for (j = 0; j < PINC_N2; j++) {
        pinc_copy(plan->z + (j * PINC_NX), x, PINC_NX);
    }
    memset(&plan->m, 0, sizeof(plan->m));
}

/* Moves a plan on by a step. */
static void pinc_shift_plan(pinc_plan *plan)
{
    pinc_shift(plan->z, PINC_NX, PINC_STATES);
    pinc_shift(plan->z + PINC_STATES, PINC_NU, PINC_INPUTS);
    pinc_shift(plan->m.dynamics, PINC_NX, PINC_STATES);
    pinc_shift(plan->m.bounds, PINC_NX, PINC_STATES);
    pinc_shift(plan->m.bounds + PINC_STATES, PINC_NU, PINC_INPUTS);
    pinc_shift(plan->m.increments, PINC_NU, PINC_INPUTS);
    pinc_shift(plan->m.outputs, PINC_OUTPUT_WIDTH, PINC_OUTPUT_ROWS);
}

/* Makes the last plan the first guess of the next. */
static void pinc_shift_warm_start(pinc_mpc *m)
{
    pinc_plan *plan = &m->plan;
    pinc_shift_plan(plan);
    if (m->warm == 0) {
        if (pinc_all_finite(m->start, PINC_NX) != 0) {
            pinc_stay_at(plan, m->start);
        } else {
            memset(&plan->m, 0, sizeof(plan->m));
        }
    }
    pinc_project(m, plan->z);
    if (m->tentative != 0) {
        pinc_shift_plan(&m->fallback);
        pinc_project(m, m->fallback.z);
    } else {
        m->fallback = *plan;
    }
}

static int pinc_differ(const PINC_REAL *a, const PINC_REAL *b, int count)
{
    int differ = 0;
    int i;
    for (i = 0; i < count; i++) {
        differ |= (pinc_abs(a[i] - b[i]) > PINC_N(0)) ? 1 : 0;
    }
    return differ;
}

static int pinc_plans_differ(const pinc_plan *a, const pinc_plan *b)
{
    return pinc_differ(a->z, b->z, PINC_UNKNOWNS) |
           pinc_differ(a->m.dynamics, b->m.dynamics, PINC_STATES) |
           pinc_differ(a->m.bounds, b->m.bounds, PINC_UNKNOWNS) |
           pinc_differ(a->m.increments, b->m.increments, PINC_INPUTS) |
           pinc_differ(a->m.outputs, b->m.outputs, PINC_OUTPUT_ROWS);
}

/* Whether the new plan is to be followed, optimal or not. */
static int pinc_is_good(const pinc_mpc *m, pinc_status status, int credible)
{
    int good = 0;
    if (m->standing == PINC_JUDGED) {
        good = (status == PINC_CONVERGED) ? 1 : credible;
    } else if (m->standing == PINC_STEPPED) {
        /* As a real-time iteration, if that started from a good plan. */
        good = (m->tentative != 0) ? credible : (credible | m->has_fallback);
    } else {
        /* It is only on the way. */
    }
    return good;
}

/* Keeps the new plan if it is worth following, or if only the budget was spent as a guess for the
   next step; or else takes the first guess. */
static void pinc_keep_plan(pinc_mpc *m, pinc_status status, int finite)
{
    /* Whether what was judged is true to the model. */
    const int credible = (m->dynamics_residual <= PINC_CREDIBLE) ? 1 : 0;
    int good;
    int guess = 0;
    if ((credible != 0) && (m->standing == PINC_UNDERWAY)) {
        /* That is the plan before. */
        m->fallback = m->base;
        m->has_fallback = 1;
        m->waited = 0;
    }
    good = finite & pinc_is_good(m, status, credible);
    if ((finite != 0) && (good == 0) && (status == PINC_DEADLINE)) {
        guess = m->warm | pinc_plans_differ(&m->plan, &m->fallback);
    }
    m->tentative = (m->waited < PINC_MOST_WAITING) ? (guess & m->has_fallback) : 0;
    m->waited = (m->tentative != 0) ? (m->waited + 1) : 0;
    /* With nothing to fall back on, a plan on its way is better than none. */
    m->followed = (m->tentative != 0) ? 0 : (good | guess);
    m->unjudged = (m->standing != PINC_JUDGED) ? 1 : 0;
    m->has_fallback = good | m->tentative;
    m->warm = m->followed | m->tentative;
    if (m->tentative != 0) {
        pinc_copy(m->plan.z + PINC_STATES, m->fallback.z + PINC_STATES, PINC_NU);
    } else if (m->followed == 0) {
        m->plan = m->fallback;
    } else {
        /* The plan is followed. */
    }
}

/* From the plant's units to the optimization's. */
static void pinc_take_state(PINC_REAL *to, const PINC_REAL *x)
{
    int i;
    for (i = 0; i < PINC_NX; i++) {
        to[i] = x[i] / PINC_X_UNIT(i);
    }
}

static void pinc_take_input(PINC_REAL *to, const PINC_REAL *u)
{
    int i;
    for (i = 0; i < PINC_NU; i++) {
        to[i] = u[i] / PINC_U_UNIT(i);
    }
}

/* Back to the plant's units. */
static void pinc_give_input(PINC_REAL *u)
{
    int i;
    for (i = 0; i < PINC_NU; i++) {
        u[i] *= PINC_U_UNIT(i);
    }
}

/* Predicts the state in which the input that is chosen now will act. */
static void pinc_predict_delay(pinc_mpc *m, const PINC_REAL *x)
{
#if PINC_DELAY > 0
    int d;
#endif
    pinc_take_state(m->start, x);
#if PINC_DELAY > 0
    for (d = 0; d < PINC_DELAY; d++) {
        PINC_REAL next[PINC_NX];
        @STEP@m->start, m->pending + (d * PINC_NU), next);
        pinc_copy(m->start, next, PINC_NX);
    }
#endif
}

static int pinc_plan_is_finite(const pinc_plan *plan)
{
    return pinc_all_finite(plan->z, PINC_UNKNOWNS) &
           pinc_all_finite(plan->m.dynamics, PINC_STATES) &
           pinc_all_finite(plan->m.bounds, PINC_UNKNOWNS) &
           pinc_all_finite(plan->m.increments, PINC_INPUTS) &
           pinc_all_finite(plan->m.outputs, PINC_OUTPUT_ROWS);
}

/* Hands out the input of this step, which is under way from now on. */
static void pinc_push(pinc_mpc *m, PINC_REAL *u)
{
#if PINC_DELAY > 0
    pinc_shift(m->pending, PINC_NU, PINC_DELAY * PINC_NU);
    pinc_copy(m->pending + ((PINC_DELAY - 1) * PINC_NU), m->previous, PINC_NU);
#endif
    pinc_copy(u, m->previous, PINC_NU);
    pinc_give_input(u);
}

/* Moves an input into its bounds. */
static void pinc_clamp_input(PINC_REAL *input, const PINC_REAL *low, const PINC_REAL *high)
{
    int v;
    for (v = 0; v < PINC_NU; v++) {
        input[v] = pinc_clamp(input[v], low[PINC_STATES + v], high[PINC_STATES + v]);
    }
}

/* Takes an input, in the units of the optimization, for the one that was given so far. */
static void pinc_hold_input(pinc_mpc *m, const PINC_REAL *input)
{
    int i;
    pinc_copy(m->previous, input, PINC_NU);
    for (i = 0; i < PINC_DELAY; i++) {
        pinc_copy(m->pending + (i * PINC_NU), input, PINC_NU);
    }
    for (i = 0; i < PINC_NC; i++) {
        pinc_copy(m->plan.z + (PINC_STATES + (i * PINC_NU)), input, PINC_NU);
    }
    m->unplaced = 1;
}

/* Begins the first plan at a state. */
static void pinc_place_plan(pinc_mpc *m, const PINC_REAL *x)
{
    pinc_take_state(m->start, x);
    pinc_stay_at(&m->plan, m->start);
    m->unplaced = 0;
    m->warm = 1;
}

/* Begins anew, with the limits, the clock, weights and bounds as they are. */
static void pinc_begin(pinc_mpc *m)
{
    const size_t kept = offsetof(pinc_mpc, iterations);
    memset((unsigned char *)m + kept, 0, sizeof(*m) - kept);
    pinc_init_rows(&m->dense);
    pinc_restore_penalties(m);
@INIT_UNKNOWN@@BEGIN_TUBE@    m->mark = PINC_MARK;
#if PINC_HAS_INITIAL_INPUT
    pinc_hold_input(m, pinc_initial_input);
#endif
}

void pinc_mpc_init(pinc_mpc *m)
{
    m->budget = 0;
    m->max_iterations = PINC_MAX_ITERATIONS;
    m->clock_us = NULL;
    m->budget_us = PINC_BUDGET_US;
    pinc_copy(m->low, pinc_low, PINC_UNKNOWNS);
    pinc_copy(m->high, pinc_high, PINC_UNKNOWNS);
    pinc_copy(m->q, pinc_q, PINC_WEIGHTS);
    pinc_copy(m->r, pinc_r, PINC_INPUTS * PINC_NU);
    pinc_begin(m);
}

void pinc_mpc_reset(pinc_mpc *m)
{
    if (m->mark != PINC_MARK) {
        pinc_mpc_init(m);
    } else {
        pinc_begin(m);
    }
}

void pinc_mpc_reset_input(pinc_mpc *m, const PINC_REAL u[PINC_NU])
{
    PINC_REAL input[PINC_NU];
    pinc_mpc_reset(m);
    if (pinc_all_finite(u, PINC_NU) != 0) {
        pinc_take_input(input, u);
        pinc_hold_input(m, input);
    }
}

void pinc_mpc_reset_to(pinc_mpc *m, const PINC_REAL x[PINC_NX], const PINC_REAL u[PINC_NU])
{
    pinc_mpc_reset_input(m, u);
    pinc_place_plan(m, x);
}

void pinc_mpc_start_clock(pinc_mpc *m)
{
    if (m->clock_us != NULL) {
        m->begun_us = m->clock_us();
    }
    m->timed = 1;
}

void pinc_reference(double t_s, PINC_REAL rows[PINC_N2 * PINC_NY])
{
    const double step = floor((t_s / PINC_SAMPLE_TIME_S) + 1e-6);
    int segment = 0;
    int j;
    for (j = 0; j < PINC_N2; j++) {
        const double at = step + (PINC_PREVIEW * (double)(PINC_DELAY + j));
        while ((segment + 1 < PINC_SEGMENTS) && (at >= pinc_segment_step[segment + 1])) {
            segment++;
        }
        pinc_copy(rows + (j * PINC_NY), pinc_segment_value + (segment * PINC_NY), PINC_NY);
    }
}

/* How far beyond its bounds an applied input may be, relative to 1 + |bound|. */
#define PINC_ROUNDED_INPUT PINC_N(1e-6)

/* Whether an input can have been applied: finite, and within its bounds but for rounding. */
static int pinc_is_input(const pinc_mpc *m, const PINC_REAL u[PINC_NU])
{
    int v;
    for (v = 0; v < PINC_NU; v++) {
        const PINC_REAL low = PINC_U_UNIT(v) * m->low[PINC_STATES + v];
        const PINC_REAL high = PINC_U_UNIT(v) * m->high[PINC_STATES + v];
        if ((pinc_finite(u[v]) == 0) ||
            (u[v] < (low - (PINC_ROUNDED_INPUT * (PINC_N(1) + pinc_abs(low))))) ||
            (u[v] > (high + (PINC_ROUNDED_INPUT * (PINC_N(1) + pinc_abs(high)))))) {
            return 0;
        }
    }
    return 1;
}

pinc_status pinc_mpc_set_applied(pinc_mpc *m, const PINC_REAL u[PINC_NU])
{
    if (m->mark != PINC_MARK) {
        return PINC_NOT_INITIALIZED;
    }
    if (pinc_is_input(m, u) == 0) {
        return PINC_BAD_ARGUMENT;
    }
    pinc_take_input(m->previous, u);
#if PINC_DELAY > 0
    pinc_copy(m->pending + ((PINC_DELAY - 1) * PINC_NU), m->previous, PINC_NU);
#endif
    return PINC_CONVERGED;
}

/* Counts steps in a row that did not converge. */
static void pinc_count(pinc_mpc *m, pinc_status status)
{
    if (status == PINC_CONVERGED) {
        m->missed = 0U;
    } else if (m->missed < UINT_MAX) {
        m->missed++;
    } else {
        /* There are too many to count. */
    }
}

/* Chooses the plan of a step from the state x. */
static pinc_status pinc_choose_plan(pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *reference)
{
    pinc_status status;
    int finite;
    if (m->unplaced != 0) {
        pinc_place_plan(m, x);
    }
    pinc_predict_delay(m, x);
    pinc_shift_warm_start(m);
@TIGHTEN@    status = pinc_optimize(m, reference);
    if ((status == PINC_NUMERICAL_TROUBLE) && (m->unjudged != 0)) {
        /* From a plan at which the model says nothing. */
        pinc_stay_at(&m->plan, m->start);
        pinc_project(m, m->plan.z);
        status = pinc_optimize(m, reference);
    }
    finite = pinc_plan_is_finite(&m->plan);
    if (finite == 0) {
        status = PINC_NUMERICAL_TROUBLE;
    }
@FIT@    pinc_keep_plan(m, status, finite);
    pinc_project(m, m->plan.z);
    return status;
}
@GUARD@
pinc_status pinc_mpc_step(pinc_mpc *m, const PINC_REAL x[PINC_NX],
                          const PINC_REAL reference[PINC_N2 * PINC_NY], PINC_REAL u[PINC_NU])
{
    pinc_status status;
    if (m->mark != PINC_MARK) {
        pinc_copy(u, pinc_initial_input, PINC_NU);
        pinc_clamp_input(u, pinc_low, pinc_high);
        pinc_give_input(u);
        return PINC_NOT_INITIALIZED;
    }
    if (m->timed == 0) {
        pinc_mpc_start_clock(m);
    }
    m->timed = 0;
@FORGET_TRUST@    if ((pinc_all_finite(x, PINC_NX) & pinc_all_finite(reference, PINC_N2 * PINC_NY)) == 0) {
        m->iterations = 0;
        m->kkt = PINC_INFINITY;
        m->followed = 0;
        pinc_clamp_input(m->previous, m->low, m->high);
        pinc_push(m, u);
        pinc_count(m, PINC_BAD_ARGUMENT);
        return PINC_BAD_ARGUMENT;
    }
    m->spent = 0;
    status = pinc_@CHOOSE@_plan(m, x, reference);
    pinc_copy(m->previous, m->plan.z + PINC_STATES, PINC_NU);
    pinc_push(m, u);
    pinc_count(m, status);
    return status;
}

const char *pinc_status_name(pinc_status status)
{
    switch (status) {
    case PINC_CONVERGED:
        return "converged";
    case PINC_ITERATION_LIMIT:
        return "iteration-limit";
    case PINC_DEADLINE:
        return "deadline";
    case PINC_INFEASIBLE_QP:
        return "infeasible-qp";
    case PINC_STALLED:
        return "stalled";
    case PINC_NUMERICAL_TROUBLE:
        return "numerical-trouble";
    case PINC_NOT_INITIALIZED:
        return "not-initialized";
    case PINC_BAD_ARGUMENT:
    default:
        return "bad-argument";
    }
}
