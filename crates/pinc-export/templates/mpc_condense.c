/* ---- Condensing: from the program in states and inputs to one in the inputs ---------------- */

/* Where the blocks of a stage are. */
#define PINC_A(qp, j) ((qp)->a + ((j) * PINC_NX * PINC_NX))
#define PINC_B(qp, j) ((qp)->b + ((j) * PINC_NX * PINC_NU))
#if PINC_TRACKS_OUTPUTS
#define PINC_Q(m, qp, j) ((qp)->q + ((j) * PINC_NX * PINC_NX))
#define PINC_S(qp, j) ((qp)->s + ((j) * PINC_NU * PINC_NX))
#else
#define PINC_Q(m, qp, j) ((m)->q + ((j) * PINC_NX * PINC_NX))
#endif

/* What the states are where no input changes. */
static void pinc_condense_offset(pinc_dense *s, const pinc_qp *qp)
{
    int j;
    pinc_copy(s->offset, qp->c, PINC_STATES);
    for (j = 1; j < PINC_N2; j++) {
        PINC_REAL *now = s->offset + (j * PINC_NX);
        pinc_add_product(PINC_A(qp, j), now - PINC_NX, now, PINC_NX, PINC_NX);
    }
}

/* One step of the products backwards: into = from_now + A' last + Q v. */
static void pinc_adjoint(const pinc_mpc *m, const pinc_qp *qp, int j, const PINC_REAL *last,
                         const PINC_REAL *v, PINC_REAL *into)
{
#if PINC_TRACKS_OUTPUTS
    (void)m;
#endif
    if (j + 1 < PINC_N2) {
        pinc_add_transposed(PINC_A(qp, j + 1), last, into, PINC_NX, PINC_NX);
    }
    pinc_add_product(PINC_Q(m, qp, j), v, into, PINC_NX, PINC_NX);
}

static void pinc_condense_gradient(pinc_mpc *m, const pinc_qp *qp)
{
    pinc_dense *s = &m->dense;
    int last = 0;
    int j;
    pinc_copy(s->gradient, qp->gradient + PINC_STATES, PINC_INPUTS);
    for (j = PINC_N2 - 1; j >= 0; j--) {
        PINC_REAL *now = s->adjoint[1 - last];
        pinc_copy(now, qp->gradient + (j * PINC_NX), PINC_NX);
        pinc_adjoint(m, qp, j, s->adjoint[last], s->offset + (j * PINC_NX), now);
#if PINC_TRACKS_OUTPUTS
        pinc_add_product(PINC_S(qp, j), s->offset + (j * PINC_NX),
                         s->gradient + (pinc_acting(j) * PINC_NU), PINC_NU, PINC_NX);
#endif
        pinc_add_transposed(PINC_B(qp, j), now, s->gradient + (pinc_acting(j) * PINC_NU), PINC_NX,
                            PINC_NU);
        last = 1 - last;
    }
}

/* What a number of an input does to the states, from the stage on at which it begins to act. */
static void pinc_respond(pinc_dense *s, const pinc_qp *qp, int input, int k)
{
    int j;
    int i;
    for (j = input; j < PINC_N2; j++) {
        PINC_REAL *now = s->response + (j * PINC_NX);
        for (i = 0; i < PINC_NX; i++) {
            now[i] = (pinc_acting(j) == input) ? PINC_B(qp, j)[(i * PINC_NU) + k] : PINC_N(0);
        }
        if (j > input) {
            pinc_add_product(PINC_A(qp, j), now - PINC_NX, now, PINC_NX, PINC_NX);
        }
    }
}

/* A column of the Hessian, on and below the diagonal, for number k of an input. */
static void pinc_condense_hessian(pinc_mpc *m, const pinc_qp *qp, int input, int k,
                                  PINC_REAL *column)
{
    pinc_dense *s = &m->dense;
    int last = 0;
    int j;
    pinc_fill(column, PINC_N(0), PINC_INPUTS);
    for (j = PINC_N2 - 1; j >= input; j--) {
        PINC_REAL *now = s->adjoint[1 - last];
        pinc_fill(now, PINC_N(0), PINC_NX);
        pinc_adjoint(m, qp, j, s->adjoint[last], s->response + (j * PINC_NX), now);
#if PINC_TRACKS_OUTPUTS
        if (pinc_acting(j) == input) {
            pinc_add_scaled(now, PINC_N(1), PINC_S(qp, j) + (k * PINC_NX), PINC_NX);
        }
        pinc_add_product(PINC_S(qp, j), s->response + (j * PINC_NX),
                         column + (pinc_acting(j) * PINC_NU), PINC_NU, PINC_NX);
#else
        (void)k;
#endif
        pinc_add_transposed(PINC_B(qp, j), now, column + (pinc_acting(j) * PINC_NU), PINC_NX,
                            PINC_NU);
        last = 1 - last;
    }
}

/* The weights of increments and of inputs. */
static void pinc_add_increments(pinc_mpc *m, const pinc_qp *qp)
{
    pinc_dense *s = &m->dense;
    int i;
    int k;
    for (i = 0; i < PINC_NC; i++) {
        for (k = 0; k < PINC_NU; k++) {
            const PINC_REAL *r = m->r + (((i * PINC_NU) + k) * PINC_NU);
            PINC_REAL *column = s->hessian + (((i * PINC_NU) + k) * PINC_INPUTS);
#if PINC_TRACKS_OUTPUTS
            pinc_add_scaled(column + (i * PINC_NU), PINC_N(1),
                            qp->t + (((i * PINC_NU) + k) * PINC_NU), PINC_NU);
#else
            (void)qp;
#endif
            pinc_add_scaled(column + (i * PINC_NU), PINC_N(1), r, PINC_NU);
            if (i > 0) {
                PINC_REAL *before = column - (PINC_NU * PINC_INPUTS);
                pinc_add_scaled(before + ((i - 1) * PINC_NU), PINC_N(1), r, PINC_NU);
                pinc_add_scaled(before + (i * PINC_NU), PINC_N(-1), r, PINC_NU);
            }
        }
    }
#if PINC_HAS_W
    for (i = 0; i < PINC_INPUTS; i++) {
        const PINC_REAL *row = pinc_w + (((i + PINC_NU) * (PINC_INPUTS + PINC_NU)) + PINC_NU);
        pinc_add_scaled(s->hessian + (i * PINC_INPUTS), PINC_N(1), row, PINC_INPUTS);
    }
#endif
}

/* The limits of inputs, of increments, and of states and outputs less what they are without
   changes. */
static void pinc_condense_limits(pinc_mpc *m, const pinc_qp *qp)
{
    pinc_dense *s = &m->dense;
    int i;
    pinc_copy(s->low, qp->low + PINC_STATES, PINC_INPUTS);
    pinc_copy(s->high, qp->high + PINC_STATES, PINC_INPUTS);
    pinc_fill(s->penalty, PINC_INFINITY, PINC_LIMITS);
    for (i = 0; i < PINC_STATE_ROWS; i++) {
        const int v = pinc_state_rows[i];
        s->low[PINC_INPUTS + i] = qp->low[v] - s->offset[v];
        s->high[PINC_INPUTS + i] = qp->high[v] - s->offset[v];
        s->penalty[PINC_INPUTS + i] = m->penalty[v];
    }
    for (i = 0; i < PINC_INCREMENT_ROWS; i++) {
        const int v = pinc_increment_rows[i];
        s->low[PINC_INPUTS + PINC_STATE_ROWS + i] = qp->increment_low[v];
        s->high[PINC_INPUTS + PINC_STATE_ROWS + i] = qp->increment_high[v];
    }
    for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
        const int row = PINC_INPUTS + PINC_STATE_ROWS + PINC_INCREMENT_ROWS + i;
        const PINC_REAL *state = s->offset + (pinc_output_state[i] * PINC_NX);
        const PINC_REAL at = pinc_dot(qp->output_x + (i * PINC_NX), state, PINC_NX);
        s->low[row] = qp->output_low[i] - at;
        s->high[row] = qp->output_high[i] - at;
        s->penalty[row] = m->output_penalty[i];
    }
}

/* A column of the outputs' rows, for number v of all inputs. */
static void pinc_condense_outputs(const pinc_dense *s, const pinc_qp *qp, int v, PINC_REAL *column)
{
    const int input = v / PINC_NU;
    int i;
    for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
        const int j = pinc_output_state[i];
        column[i] = (pinc_acting(pinc_output_interval[i]) == input)
                        ? qp->output_u[(i * PINC_NU) + (v % PINC_NU)]
                        : PINC_N(0);
        if (j >= input) {
            column[i] += pinc_dot(qp->output_x + (i * PINC_NX), s->response + (j * PINC_NX),
                                  PINC_NX);
        }
    }
}

/* Condenses the program; 0 if the budget was spent before the end. */
static int pinc_condense(pinc_mpc *m, const pinc_qp *qp)
{
    pinc_dense *s = &m->dense;
    int v;
    int i;
    pinc_condense_offset(s, qp);
    pinc_condense_gradient(m, qp);
    for (v = 0; v < PINC_INPUTS; v++) {
        const int input = v / PINC_NU;
        PINC_REAL *column = s->matrix + (v * PINC_ROWS);
        if ((v > 0) && ((v % (PINC_NU * PINC_UNASKED_INPUTS)) == 0) && (pinc_expired(m) != 0)) {
            return 0;
        }
        pinc_respond(s, qp, input, v % PINC_NU);
        pinc_condense_hessian(m, qp, input, v % PINC_NU, s->hessian + (v * PINC_INPUTS));
        /* States before the input acts keep the 0 that they have from the beginning. */
        for (i = 0; i < PINC_STATE_ROWS; i++) {
            if (pinc_state_rows[i] >= input * PINC_NX) {
                column[i] = s->response[pinc_state_rows[i]];
            }
        }
        pinc_condense_outputs(s, qp, v, column + (PINC_STATE_ROWS + PINC_INCREMENT_ROWS));
    }
    pinc_add_increments(m, qp);
    pinc_condense_limits(m, qp);
    return 1;
}

/* The increments' rows of the matrix, which stay. */
static void pinc_init_rows(pinc_dense *s)
{
    int i;
    for (i = 0; i < PINC_INCREMENT_ROWS; i++) {
        const int v = pinc_increment_rows[i];
        s->matrix[(v * PINC_ROWS) + PINC_STATE_ROWS + i] = PINC_N(1);
        if (v >= PINC_NU) {
            s->matrix[((v - PINC_NU) * PINC_ROWS) + PINC_STATE_ROWS + i] = PINC_N(-1);
        }
    }
}

/* Hands the multipliers of the step to the active-set method. */
static void pinc_guess(pinc_mpc *m)
{
    PINC_REAL *mu = m->dense.mu;
    int i;
    pinc_copy(mu, m->step.bounds + PINC_STATES, PINC_INPUTS);
    for (i = 0; i < PINC_STATE_ROWS; i++) {
        mu[PINC_INPUTS + i] = m->step.bounds[pinc_state_rows[i]];
    }
    for (i = 0; i < PINC_INCREMENT_ROWS; i++) {
        mu[PINC_INPUTS + PINC_STATE_ROWS + i] = m->step.increments[pinc_increment_rows[i]];
    }
    pinc_copy(mu + (PINC_INPUTS + PINC_STATE_ROWS + PINC_INCREMENT_ROWS), m->step.outputs,
              PINC_OUTPUT_ROWS);
}

/* Writes the multipliers of the limits. */
static void pinc_read_multipliers(pinc_mpc *m)
{
    const pinc_dense *s = &m->dense;
    int i;
    pinc_fill(m->step.bounds, PINC_N(0), PINC_STATES);
    pinc_fill(m->step.increments, PINC_N(0), PINC_INPUTS);
    pinc_copy(m->step.bounds + PINC_STATES, s->mu, PINC_INPUTS);
    for (i = 0; i < PINC_STATE_ROWS; i++) {
        m->step.bounds[pinc_state_rows[i]] = s->mu[PINC_INPUTS + i];
    }
    for (i = 0; i < PINC_INCREMENT_ROWS; i++) {
        m->step.increments[pinc_increment_rows[i]] = s->mu[PINC_INPUTS + PINC_STATE_ROWS + i];
    }
    pinc_copy(m->step.outputs, s->mu + (PINC_INPUTS + PINC_STATE_ROWS + PINC_INCREMENT_ROWS),
              PINC_OUTPUT_ROWS);
}

/* Writes states, inputs and multipliers of the step. */
static void pinc_expand(pinc_mpc *m, const pinc_qp *qp)
{
    PINC_REAL *inputs = m->d + PINC_STATES;
    int i;
    int j;
    pinc_read_multipliers(m);
    pinc_copy(inputs, m->dense.x, PINC_INPUTS);
    pinc_copy(m->d, qp->c, PINC_STATES);
    for (j = 0; j < PINC_N2; j++) {
        PINC_REAL *now = m->d + (j * PINC_NX);
        pinc_add_product(PINC_B(qp, j), inputs + (pinc_acting(j) * PINC_NU), now, PINC_NX, PINC_NU);
        if (j > 0) {
            pinc_add_product(PINC_A(qp, j), now - PINC_NX, now, PINC_NX, PINC_NX);
        }
    }
    for (j = PINC_N2 - 1; j >= 0; j--) {
        PINC_REAL *lambda = m->step.dynamics + (j * PINC_NX);
        pinc_copy(lambda, qp->gradient + (j * PINC_NX), PINC_NX);
        pinc_add_scaled(lambda, PINC_N(1), m->step.bounds + (j * PINC_NX), PINC_NX);
        pinc_add_product(PINC_Q(m, qp, j), m->d + (j * PINC_NX), lambda, PINC_NX, PINC_NX);
#if PINC_TRACKS_OUTPUTS
        pinc_add_transposed(PINC_S(qp, j), inputs + (pinc_acting(j) * PINC_NU), lambda, PINC_NU,
                            PINC_NX);
#endif
        for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
            if (pinc_output_state[i] == j) {
                pinc_add_scaled(lambda, m->step.outputs[i], qp->output_x + (i * PINC_NX), PINC_NX);
            }
        }
        if (j + 1 < PINC_N2) {
            pinc_add_transposed(PINC_A(qp, j + 1), lambda + PINC_NX, lambda, PINC_NX, PINC_NX);
        }
    }
}

static int pinc_step_is_finite(const pinc_mpc *m)
{
    return pinc_all_finite(m->d, PINC_UNKNOWNS) &
           pinc_all_finite(m->step.dynamics, PINC_STATES) &
           pinc_all_finite(m->step.bounds, PINC_UNKNOWNS) &
           pinc_all_finite(m->step.increments, PINC_INPUTS) &
           pinc_all_finite(m->step.outputs, PINC_OUTPUT_ROWS);
}

/* Solves the program at the plan, from the multipliers in the step. If the budget is spent within
   it, the step is that to the point on the way. */
static pinc_qp_status pinc_solve_qp(pinc_mpc *m)
{
    const pinc_qp *qp = &m->qp[m->at];
    pinc_qp_status status = PINC_QP_EXPIRED_EARLY;
    if (pinc_condense(m, qp) != 0) {
        pinc_guess(m);
        status = pinc_dense_solve(m);
    }
    if ((status == PINC_QP_SOLVED) || (status == PINC_QP_EXPIRED)) {
        pinc_expand(m, qp);
        if ((status == PINC_QP_SOLVED) && (pinc_step_is_finite(m) == 0)) {
            status = PINC_QP_FAILED;
        }
    } else if (status == PINC_QP_EXPIRED_EARLY) {
        pinc_fill(m->d, PINC_N(0), PINC_UNKNOWNS);
        status = PINC_QP_EXPIRED;
    } else {
        /* There is no step. */
    }
    return status;
}
