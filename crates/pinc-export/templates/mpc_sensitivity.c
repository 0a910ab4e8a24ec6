
#ifdef PINC_SENSITIVITY
/* ---- Derivatives of the input --------------------------------------------------------------- */

#if PINC_HAS_TUBE
#error "the derivatives of a plan in a tube are not known: compile without PINC_SENSITIVITY"
#endif

/* Steps of the central differences, as a part of a quantity's size, which is at least this part of
   its bound. */
#define PINC_DIFFERENCE PINC_PICK(1e-4, 1e-2)
#define PINC_LEAST_SIZE PINC_N(0.1)
/* A row is about to become active or inactive if its room and its multiplier are both below this
   many tolerances; a plan with a residual above so many is not optimal. */
#define PINC_MARGIN PINC_N(100)
#define PINC_OPTIMAL PINC_N(10)
/* Numbers that the input is differentiated in by forward products. */
#define PINC_GIVEN (PINC_NX + PINC_NU)
#define PINC_COLUMNS (PINC_GIVEN + PINC_NU)
#define PINC_NAN ((PINC_REAL)NAN)

/* The place of an unknown's size: states come before inputs. */
static int pinc_size_of(int v)
{
    return (v < PINC_STATES) ? (v % PINC_NX) : (PINC_NX + ((v - PINC_STATES) % PINC_NU));
}

static void pinc_see_size(PINC_REAL *size, PINC_REAL v)
{
    if (pinc_finite(v) != 0) {
        *size = pinc_max(*size, pinc_abs(v));
    }
}

/* How large states and inputs are along the plan. */
static void pinc_find_sizes(const pinc_mpc *m, pinc_sensitivity *s)
{
    int v;
    pinc_fill(s->size, PINC_N(0), PINC_GIVEN);
    for (v = 0; v < PINC_NX; v++) {
        pinc_see_size(s->size + v, m->start[v]);
    }
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        PINC_REAL *size = s->size + pinc_size_of(v);
        pinc_see_size(size, m->plan.z[v]);
        pinc_see_size(size, PINC_LEAST_SIZE * m->low[v]);
        pinc_see_size(size, PINC_LEAST_SIZE * m->high[v]);
    }
    for (v = 0; v < PINC_GIVEN; v++) {
        s->size[v] = (s->size[v] > PINC_N(0)) ? s->size[v] : PINC_N(1);
    }
}

/* A limit of a row of the condensed program, seen from its value. */
static PINC_REAL pinc_room_at(const pinc_qp *qp, int row, int upper)
{
    int i = row;
    if (i < PINC_INPUTS) {
        return (upper != 0) ? qp->high[PINC_STATES + i] : qp->low[PINC_STATES + i];
    }
    i -= PINC_INPUTS;
    if (i < PINC_STATE_ROWS) {
        const int v = pinc_state_rows[i];
        return (upper != 0) ? qp->high[v] : qp->low[v];
    }
    i -= PINC_STATE_ROWS;
    if (i < PINC_INCREMENT_ROWS) {
        const int v = pinc_increment_rows[i];
        return (upper != 0) ? qp->increment_high[v] : qp->increment_low[v];
    }
    i -= PINC_INCREMENT_ROWS;
    return (upper != 0) ? qp->output_high[i] : qp->output_low[i];
}

#if PINC_OUTPUT_ROWS > 0
/* Where an input is held, an output that depends on it is the same before and after a control step: the
   other row of output row i, or -1. */
static int pinc_twin(int i)
{
    const int start = pinc_output_start[i];
    const int other = pinc_output_interval[i] + ((start != 0) ? -1 : 1);
    int k;
    if ((other < 0) || (other == PINC_N2) ||
        (pinc_acting(other) != pinc_acting(pinc_output_interval[i]))) {
        return -1;
    }
    for (k = 0; k < PINC_OUTPUT_ROWS; k++) {
        if ((pinc_output_number[k] == pinc_output_number[i]) && (pinc_output_start[k] != start) &&
            (pinc_output_interval[k] == other)) {
            return k;
        }
    }
    return -1;
}

static int pinc_near(PINC_REAL a, PINC_REAL b, PINC_REAL margin)
{
    return (((a <= b) && (a >= b)) || (pinc_abs(a - b) <= margin)) ? 1 : 0;
}

/* Whether a row is one with another that has the same limits: the first of them gets the multipliers
   and penalties of both, the second is left out (-1). */
static int pinc_join_twins(const pinc_dense *dense, const pinc_qp *qp, int row, PINC_REAL margin,
                           PINC_REAL *mu, PINC_REAL *penalty)
{
    const int first = PINC_LIMITS - PINC_OUTPUT_ROWS;
    const int twin = (row < first) ? -1 : pinc_twin(row - first);
    if ((twin < 0) ||
        (pinc_near(qp->output_low[row - first], qp->output_low[twin], margin) == 0) ||
        (pinc_near(qp->output_high[row - first], qp->output_high[twin], margin) == 0)) {
        return 0;
    }
    *mu += dense->mu[first + twin];
    *penalty += dense->penalty[first + twin];
    return (pinc_output_start[row - first] != 0) ? -1 : 1;
}
#endif

/* Finds the active rows; whether their number is possible. */
static int pinc_find_active(pinc_mpc *m, const pinc_qp *qp, pinc_sensitivity *s, int *kink)
{
    pinc_dense *dense = &m->dense;
    const PINC_REAL margin = PINC_MARGIN * PINC_KKT_TOLERANCE;
    int row;
    s->active = 0;
    for (row = 0; row < PINC_LIMITS; row++) {
        const PINC_REAL low = pinc_room_at(qp, row, 0);
        const PINC_REAL high = pinc_room_at(qp, row, 1);
        PINC_REAL mu = dense->mu[row];
        PINC_REAL penalty = dense->penalty[row];
        PINC_REAL size;
        PINC_REAL lacking;
        PINC_REAL room;
        PINC_REAL clear;
        int upper;
        int held = 0;
#if PINC_OUTPUT_ROWS > 0
        if (pinc_join_twins(dense, qp, row, margin, &mu, &penalty) < 0) {
            continue;
        }
#endif
        size = pinc_abs(mu);
        lacking = penalty - size;
        upper = ((mu > PINC_N(0)) || ((mu >= PINC_N(0)) && (high < -low))) ? 1 : 0;
        room = (upper != 0) ? high : -low;
        clear = room;
        pinc_normal(dense, row, dense->z);
        if (!(pinc_largest(dense->z, PINC_INPUTS) > PINC_N(0))) {
            continue;
        }
        if (high <= low) {
            held = 1;
            clear = PINC_INFINITY;
        } else if ((lacking < size) && (-room > lacking)) {
            /* Violated, at the multiplier that is the weight of this. */
            clear = -room;
        } else if (size > room) {
            held = 1;
            clear = pinc_min(size, lacking);
        } else {
            /* The row is away from its limit. */
        }
        if (clear < margin) {
            *kink = 1;
        }
        if (held != 0) {
            if (s->active == PINC_INPUTS) {
                return 0;
            }
            s->rows[s->active] = row;
            s->upper[s->active] = upper;
            s->active++;
        }
    }
    return 1;
}

/* How the plan moves with these changes of the inputs, and of one number of the measured state or
   none (-1). */
static void pinc_follow(const pinc_qp *qp, const PINC_REAL *inputs, int state, PINC_REAL *direction)
{
    int j;
    int i;
    pinc_fill(direction, PINC_N(0), PINC_STATES);
    pinc_copy(direction + PINC_STATES, inputs, PINC_INPUTS);
    for (j = 0; j < PINC_N2; j++) {
        PINC_REAL *now = direction + (j * PINC_NX);
        pinc_add_product(PINC_B(qp, j), inputs + (pinc_acting(j) * PINC_NU), now, PINC_NX, PINC_NU);
        if (j > 0) {
            pinc_add_product(PINC_A(qp, j), now - PINC_NX, now, PINC_NX, PINC_NX);
        } else if (state >= 0) {
            for (i = 0; i < PINC_NX; i++) {
                now[i] += PINC_A(qp, 0)[(i * PINC_NX) + state];
            }
        } else {
            /* The measured state stays. */
        }
    }
}

/* The derivative of the Lagrangian's gradient and of the active rows' values along the direction, to
   which a number of the state or of the last input belongs: first of these, or -1. */
static void pinc_differentiate(pinc_mpc *m, const PINC_REAL *reference, pinc_sensitivity *s,
                               int given)
{
    pinc_qp *trial = &m->qp[1 - m->at];
    PINC_REAL *moved = NULL;
    PINC_REAL at = PINC_N(0);
    PINC_REAL largest = PINC_N(0);
    PINC_REAL step;
    int side;
    int v;
    for (v = 0; v < PINC_UNKNOWNS; v++) {
        largest = pinc_max(largest, pinc_abs(s->direction[v]) / s->size[pinc_size_of(v)]);
    }
    if (given >= 0) {
        moved = (given < PINC_NX) ? (m->start + given) : (m->previous + (given - PINC_NX));
        at = *moved;
        largest = pinc_max(largest, PINC_N(1) / s->size[given]);
    }
    step = PINC_DIFFERENCE / largest;
    pinc_fill(s->change, PINC_N(0), PINC_UNKNOWNS);
    pinc_fill(s->values, PINC_N(0), PINC_INPUTS);
    for (side = -1; side <= 1; side += 2) {
        const PINC_REAL length = (side > 0) ? step : -step;
        const PINC_REAL weight = PINC_N(0.5) / length;
        PINC_REAL cost;
        for (v = 0; v < PINC_UNKNOWNS; v++) {
            s->z[v] = m->plan.z[v] + (length * s->direction[v]);
        }
        if (moved != NULL) {
            *moved = at + length;
        }
        (void)pinc_evaluate(m, s->z, reference, trial, &cost);
        pinc_lagrangian(trial, &m->plan.m, m->work);
        pinc_add_scaled(s->change, weight, m->work, PINC_UNKNOWNS);
        for (v = 0; v < s->active; v++) {
            s->values[v] -= weight * pinc_room_at(trial, s->rows[v], s->upper[v]);
        }
    }
    if (moved != NULL) {
        *moved = at;
    }
}

/* What the change of the gradient is in the inputs alone. */
static void pinc_reduce(pinc_dense *dense, const pinc_qp *qp, const PINC_REAL *change,
                        PINC_REAL *inputs)
{
    int last = 0;
    int j;
    pinc_copy(inputs, change + PINC_STATES, PINC_INPUTS);
    for (j = PINC_N2 - 1; j >= 0; j--) {
        PINC_REAL *now = dense->adjoint[1 - last];
        pinc_copy(now, change + (j * PINC_NX), PINC_NX);
        if (j + 1 < PINC_N2) {
            pinc_add_transposed(PINC_A(qp, j + 1), dense->adjoint[last], now, PINC_NX, PINC_NX);
        }
        pinc_add_transposed(PINC_B(qp, j), now, inputs + (pinc_acting(j) * PINC_NU), PINC_NX,
                            PINC_NU);
        last = 1 - last;
    }
}

static void pinc_swap(PINC_REAL *a, PINC_REAL *b, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        const PINC_REAL v = a[i];
        a[i] = b[i];
        b[i] = v;
    }
}

/* Solves K X = right by Gauss with the pivots that are largest in their rows; 0 if K is singular. */
static int pinc_eliminate(pinc_sensitivity *s, int n)
{
    int c;
    int r;
    for (r = 0; r < n; r++) {
        const PINC_REAL size = pinc_largest(s->matrix + (r * n), n);
        const PINC_REAL inverse = PINC_N(1) / size;
        if ((pinc_finite(inverse) == 0) || !(inverse > PINC_N(0))) {
            return 0;
        }
        for (c = 0; c < n; c++) {
            s->matrix[(r * n) + c] *= inverse;
        }
        for (c = 0; c < PINC_COLUMNS; c++) {
            s->right[(r * PINC_COLUMNS) + c] *= inverse;
        }
    }
    for (c = 0; c < n; c++) {
        int best = c;
        for (r = c + 1; r < n; r++) {
            if (pinc_abs(s->matrix[(r * n) + c]) > pinc_abs(s->matrix[(best * n) + c])) {
                best = r;
            }
        }
        if (!(pinc_abs(s->matrix[(best * n) + c]) > PINC_SMALLEST_PIVOT)) {
            return 0;
        }
        pinc_swap(s->matrix + (best * n), s->matrix + (c * n), n);
        pinc_swap(s->right + (best * PINC_COLUMNS), s->right + (c * PINC_COLUMNS), PINC_COLUMNS);
        for (r = 0; r < n; r++) {
            const PINC_REAL factor = s->matrix[(r * n) + c] / s->matrix[(c * n) + c];
            if (r != c) {
                pinc_add_scaled(s->matrix + ((r * n) + c), -factor, s->matrix + ((c * n) + c),
                                n - c);
                pinc_add_scaled(s->right + (r * PINC_COLUMNS), -factor,
                                s->right + (c * PINC_COLUMNS), PINC_COLUMNS);
            }
        }
    }
    for (r = 0; r < n; r++) {
        for (c = 0; c < PINC_COLUMNS; c++) {
            s->right[(r * PINC_COLUMNS) + c] /= s->matrix[(r * n) + r];
        }
    }
    return 1;
}

/* Writes the conditions of optimality, differentiated in the inputs and active multipliers, and, on the
   right, in what is given; then the first inputs' unit vectors. Whether they could be solved. */
static int pinc_solve_conditions(pinc_mpc *m, const pinc_qp *qp, const PINC_REAL *reference,
                                 pinc_sensitivity *s)
{
    const int n = PINC_INPUTS + s->active;
    PINC_REAL *column = m->dense.x;
    int v;
    int i;
    pinc_fill(s->matrix, PINC_N(0), n * n);
    pinc_fill(s->right, PINC_N(0), n * PINC_COLUMNS);
    for (v = 0; v < PINC_INPUTS; v++) {
        pinc_fill(m->dense.w, PINC_N(0), PINC_INPUTS);
        m->dense.w[v] = PINC_N(1);
        pinc_follow(qp, m->dense.w, -1, s->direction);
        pinc_differentiate(m, reference, s, -1);
        pinc_reduce(&m->dense, qp, s->change, column);
        for (i = 0; i < PINC_INPUTS; i++) {
            s->matrix[(i * n) + v] = column[i];
        }
    }
    for (i = 0; i < s->active; i++) {
        const int at = PINC_INPUTS + i;
        pinc_normal(&m->dense, s->rows[i], m->dense.z);
        for (v = 0; v < PINC_INPUTS; v++) {
            s->matrix[(at * n) + v] = m->dense.z[v];
            s->matrix[(v * n) + at] = m->dense.z[v];
        }
    }
    pinc_fill(m->dense.w, PINC_N(0), PINC_INPUTS);
    for (v = 0; v < PINC_GIVEN; v++) {
        pinc_follow(qp, m->dense.w, (v < PINC_NX) ? v : -1, s->direction);
        pinc_differentiate(m, reference, s, v);
        pinc_reduce(&m->dense, qp, s->change, column);
        for (i = 0; i < n; i++) {
            const PINC_REAL by = (i < PINC_INPUTS) ? column[i] : s->values[i - PINC_INPUTS];
            s->right[(i * PINC_COLUMNS) + v] = -by;
        }
    }
    for (v = 0; v < PINC_NU; v++) {
        s->right[(v * PINC_COLUMNS) + PINC_GIVEN + v] = PINC_N(1);
    }
    return pinc_eliminate(s, n);
}

/* The derivatives of number k of the input in the reference, from the plan's adjoint direction: the
   reference moves the gradient by -(C D)'Q. */
static void pinc_read_reference(pinc_mpc *m, pinc_sensitivity *s, int k)
{
    int j;
    int i;
    int o;
    for (j = 0; j < PINC_N2; j++) {
        const PINC_REAL *dx = s->direction + (j * PINC_NX);
        PINC_REAL *by = s->by_reference + (((k * PINC_N2) + j) * PINC_NY);
#if PINC_TRACKS_OUTPUTS
        const PINC_REAL *u = m->plan.z + (PINC_STATES + (pinc_acting(j) * PINC_NU));
        const PINC_REAL *du = s->direction + (PINC_STATES + (pinc_acting(j) * PINC_NU));
        PINC_REAL y[PINC_NO];
        PINC_REAL c[PINC_NO * PINC_NX];
        PINC_REAL d[PINC_NO * PINC_NU];
        pinc_seen_outputs(m, m->plan.z + (j * PINC_NX), u, y, c, d);
#endif
        pinc_fill(by, PINC_N(0), PINC_NY);
        for (o = 0; o < PINC_NY; o++) {
            const int row = pinc_tracked[o];
#if PINC_TRACKS_OUTPUTS
            const PINC_REAL moved =
                (row < PINC_NX) ? (dx[row] * PINC_X_UNIT(row))
                                : (pinc_dot(c + ((row - PINC_NX) * PINC_NX), dx, PINC_NX) +
                                   pinc_dot(d + ((row - PINC_NX) * PINC_NU), du, PINC_NU));
            const PINC_REAL *weight = m->q + (((j * PINC_NY) + o) * PINC_NY);
            for (i = 0; i < PINC_NY; i++) {
                by[i] += PINC_U_UNIT(k) * moved * weight[i];
            }
#else
            const PINC_REAL *weight = PINC_Q(m, 0, j) + (row * PINC_NX);
            for (i = 0; i < PINC_NY; i++) {
                by[i] += PINC_U_UNIT(k) * dx[row] * weight[pinc_tracked[i]] /
                         PINC_X_UNIT(pinc_tracked[i]);
            }
#endif
        }
    }
}

/* Writes the derivatives in the plant's units. */
static void pinc_read_derivatives(pinc_mpc *m, const pinc_qp *qp, pinc_sensitivity *s)
{
    int k;
    int v;
    for (k = 0; k < PINC_NU; k++) {
        const PINC_REAL *row = s->right + (k * PINC_COLUMNS);
        for (v = 0; v < PINC_NX; v++) {
            s->by_state[(k * PINC_NX) + v] = row[v] * (PINC_U_UNIT(k) / PINC_X_UNIT(v));
        }
        for (v = 0; v < PINC_NU; v++) {
            s->by_applied[(k * PINC_NU) + v] =
                row[PINC_NX + v] * (PINC_U_UNIT(k) / PINC_U_UNIT(v));
        }
        for (v = 0; v < PINC_INPUTS; v++) {
            m->dense.w[v] = s->right[(v * PINC_COLUMNS) + PINC_GIVEN + k];
        }
        pinc_follow(qp, m->dense.w, -1, s->direction);
        pinc_read_reference(m, s, k);
    }
}

/* The same at the plan of the last step, with no limit of time. */
static pinc_regularity pinc_differentiate_plan(pinc_mpc *m, const PINC_REAL *reference,
                                               pinc_sensitivity *s)
{
    const PINC_REAL most = PINC_OPTIMAL * PINC_KKT_TOLERANCE;
    pinc_qp *qp = &m->qp[m->at];
    PINC_REAL cost;
    int kink = 0;
    (void)pinc_evaluate(m, m->plan.z, reference, qp, &cost);
    (void)pinc_residual(m, qp, &m->plan.m);
    (void)pinc_condense(m, qp);
    m->step = m->plan.m;
    pinc_guess(m);
    pinc_find_sizes(m, s);
    if ((pinc_find_active(m, qp, s, &kink) == 0) ||
        (pinc_solve_conditions(m, qp, reference, s) == 0)) {
        return (m->kkt <= most) ? PINC_SINGULAR : PINC_NOT_OPTIMAL;
    }
    pinc_read_derivatives(m, qp, s);
    if (!(m->kkt <= most)) {
        return PINC_NOT_OPTIMAL;
    }
    return (kink != 0) ? PINC_KINK : PINC_REGULAR;
}

pinc_regularity pinc_mpc_sensitivity(pinc_mpc *m, const PINC_REAL reference[PINC_N2 * PINC_NY],
                                     const PINC_REAL u_before[PINC_NU], pinc_sensitivity *s)
{
    pinc_regularity regularity = PINC_NOT_OPTIMAL;
    pinc_fill(s->by_state, PINC_NAN, PINC_NU * PINC_NX);
    pinc_fill(s->by_applied, PINC_NAN, PINC_NU * PINC_NU);
    pinc_fill(s->by_reference, PINC_NAN, PINC_NU * PINC_N2 * PINC_NY);
    if ((m->mark == PINC_MARK) && ((pinc_all_finite(reference, PINC_N2 * PINC_NY) &
                                    pinc_all_finite(u_before, PINC_NU)) != 0)) {
        const long budget = m->budget;
        const unsigned long budget_us = m->budget_us;
        const PINC_REAL kkt = m->kkt;
        pinc_copy(s->previous, m->previous, PINC_NU);
        pinc_take_input(m->previous, u_before);
        m->budget = 0;
        m->budget_us = 0UL;
        regularity = pinc_differentiate_plan(m, reference, s);
        pinc_copy(m->previous, s->previous, PINC_NU);
        m->budget = budget;
        m->budget_us = budget_us;
        m->kkt = kkt;
    }
    return regularity;
}
#endif
