/* ---- Bounds that a tube tightens ------------------------------------------------------------ */

/* out = A P A' for a symmetric P. */
static void pinc_congruence(const PINC_REAL *a, const PINC_REAL *p, PINC_REAL *out)
{
    PINC_REAL row[PINC_NX];
    int i;
    int k;
    for (i = 0; i < PINC_NX; i++) {
        pinc_fill(row, PINC_N(0), PINC_NX);
        pinc_add_transposed(p, a + (i * PINC_NX), row, PINC_NX, PINC_NX);
        for (k = 0; k <= i; k++) {
            out[(i * PINC_NX) + k] = pinc_dot(row, a + (k * PINC_NX), PINC_NX);
            out[(k * PINC_NX) + i] = out[(i * PINC_NX) + k];
        }
    }
}

/* The root of h'P h. */
static PINC_REAL pinc_root(const PINC_REAL *h, const PINC_REAL *p)
{
    PINC_REAL sum = PINC_N(0);
    int i;
    for (i = 0; i < PINC_NX; i++) {
        sum += h[i] * pinc_dot(p + (i * PINC_NX), h, PINC_NX);
    }
    return PINC_MATH(sqrt)(pinc_max(sum, PINC_N(0)));
}

/* How far h'x can be from the plan: random deviations with covariance p, bounded ones in e. */
static PINC_REAL pinc_width(const PINC_REAL *h, const PINC_REAL *p, const PINC_REAL *e)
{
    return (PINC_QUANTILE * pinc_root(h, p)) + pinc_root(h, e);
}

/* The stage of the last linearization that stage j of a plan moved on by shift stages has. */
static int pinc_moved_on(int j, int shift)
{
    return ((j + shift) < PINC_N2) ? (j + shift) : (PINC_N2 - 1);
}

#if PINC_FEEDBACK == 2
/* The gains of the linear-quadratic regulator along the plan, with S = Q at the end:
   K = -(R + B'S B)^-1 B'S A, S <- Q + A'S A + A'S B K. The first is not used. */
static void pinc_regulate(pinc_mpc *m, const pinc_qp *qp, int shift)
{
    PINC_REAL s[PINC_NX * PINC_NX];
    PINC_REAL sa[PINC_NX * PINC_NX];
    PINC_REAL sb[PINC_NX * PINC_NU];
    PINC_REAL h[PINC_NU * PINC_NU];
    PINC_REAL l[PINC_NU * PINC_NX];
    int j;
    int i;
    int k;
    int v;
    pinc_fill(s, PINC_N(0), PINC_NX * PINC_NX);
    for (i = 0; i < PINC_NX; i++) {
        s[i * (PINC_NX + 1)] = pinc_state_weight[i];
    }
    for (j = PINC_N2 - 1; j > 0; j--) {
        const PINC_REAL *a = PINC_A(qp, pinc_moved_on(j, shift));
        const PINC_REAL *b = PINC_B(qp, pinc_moved_on(j, shift));
        PINC_REAL *gain = m->gains + (j * PINC_NU * PINC_NX);
        pinc_fill(sa, PINC_N(0), PINC_NX * PINC_NX);
        pinc_fill(sb, PINC_N(0), PINC_NX * PINC_NU);
        for (i = 0; i < PINC_NX; i++) {
            pinc_add_transposed(a, s + (i * PINC_NX), sa + (i * PINC_NX), PINC_NX, PINC_NX);
            pinc_add_transposed(b, s + (i * PINC_NX), sb + (i * PINC_NU), PINC_NX, PINC_NU);
        }
        pinc_fill(h, PINC_N(0), PINC_NU * PINC_NU);
        pinc_fill(l, PINC_N(0), PINC_NU * PINC_NX);
        for (v = 0; v < PINC_NX; v++) {
            for (i = 0; i < PINC_NU; i++) {
                pinc_add_scaled(h + (i * PINC_NU), b[(v * PINC_NU) + i], sb + (v * PINC_NU),
                                PINC_NU);
                pinc_add_scaled(l + (i * PINC_NX), sb[(v * PINC_NU) + i], a + (v * PINC_NX),
                                PINC_NX);
            }
        }
        for (i = 0; i < PINC_NU; i++) {
            h[i * (PINC_NU + 1)] += pinc_input_weight[i];
        }
        /* The Cholesky factor of h in its lower half. */
        for (i = 0; i < PINC_NU; i++) {
            for (k = 0; k <= i; k++) {
                const PINC_REAL rest = h[(i * PINC_NU) + k] -
                                       pinc_dot(h + (i * PINC_NU), h + (k * PINC_NU), k);
                h[(i * PINC_NU) + k] =
                    (i == k) ? PINC_MATH(sqrt)(rest) : (rest / h[k * (PINC_NU + 1)]);
            }
        }
        pinc_copy(gain, l, PINC_NU * PINC_NX);
        for (i = 0; i < PINC_NU; i++) {
            for (k = 0; k < i; k++) {
                pinc_add_scaled(gain + (i * PINC_NX), -h[(i * PINC_NU) + k], gain + (k * PINC_NX),
                                PINC_NX);
            }
            for (v = 0; v < PINC_NX; v++) {
                gain[(i * PINC_NX) + v] /= h[i * (PINC_NU + 1)];
            }
        }
        for (i = PINC_NU - 1; i >= 0; i--) {
            for (k = i + 1; k < PINC_NU; k++) {
                pinc_add_scaled(gain + (i * PINC_NX), -h[(k * PINC_NU) + i], gain + (k * PINC_NX),
                                PINC_NX);
            }
            for (v = 0; v < PINC_NX; v++) {
                gain[(i * PINC_NX) + v] /= h[i * (PINC_NU + 1)];
            }
        }
        for (i = 0; i < (PINC_NU * PINC_NX); i++) {
            gain[i] = -gain[i];
        }
        pinc_fill(s, PINC_N(0), PINC_NX * PINC_NX);
        for (i = 0; i < PINC_NX; i++) {
            for (v = 0; v < PINC_NX; v++) {
                pinc_add_scaled(s + (i * PINC_NX), a[(v * PINC_NX) + i], sa + (v * PINC_NX),
                                PINC_NX);
            }
            for (k = 0; k < PINC_NU; k++) {
                pinc_add_scaled(s + (i * PINC_NX), l[(k * PINC_NX) + i], gain + (k * PINC_NX),
                                PINC_NX);
            }
            s[i * (PINC_NX + 1)] += pinc_state_weight[i];
        }
    }
}
#endif

/* The feedback on deviations in stage j; NULL where there is none. */
static const PINC_REAL *pinc_gain(const pinc_mpc *m, int j)
{
#if PINC_FEEDBACK == 1
    (void)m;
    return (j > 0) ? pinc_feedback : NULL;
#elif PINC_FEEDBACK == 2
    return (j > 0) ? (m->gains + (j * PINC_NU * PINC_NX)) : NULL;
#else
    (void)m;
    (void)j;
    return NULL;
#endif
}

/* Deviations at the end of a stage from those at its beginning, with M = A + B K: P <- M P M' + W;
   e becomes the ellipsoid of least trace around M E M' and the largest errors, where state i counts
   in units of sqrt((M E M')_ii) + box_i. */
static void pinc_propagate(const PINC_REAL *a, const PINC_REAL *b, const PINC_REAL *gain,
                           PINC_REAL *p, PINC_REAL *e)
{
    PINC_REAL closed[PINC_NX * PINC_NX];
    PINC_REAL next[PINC_NX * PINC_NX];
    PINC_REAL far[PINC_NX];
    PINC_REAL trace = PINC_N(0);
    PINC_REAL sum = PINC_N(0);
    int i;
    pinc_copy(closed, a, PINC_NX * PINC_NX);
    for (i = 0; (gain != NULL) && (i < PINC_NX); i++) {
        pinc_add_transposed(gain, b + (i * PINC_NU), closed + (i * PINC_NX), PINC_NU, PINC_NX);
    }
    pinc_congruence(closed, p, next);
    pinc_copy(p, next, PINC_NX * PINC_NX);
    pinc_congruence(closed, e, next);
    for (i = 0; i < PINC_NX; i++) {
        p[i * (PINC_NX + 1)] += pinc_process_variance[i];
        far[i] = PINC_MATH(sqrt)(pinc_max(next[i * (PINC_NX + 1)], PINC_N(0)));
        if ((far[i] + pinc_box[i]) > PINC_N(0)) {
            const PINC_REAL part = far[i] / (far[i] + pinc_box[i]);
            trace += part * part;
            sum += PINC_N(1) - part;
        }
    }
    trace = PINC_MATH(sqrt)(trace);
    sum += trace;
    pinc_fill(e, PINC_N(0), PINC_NX * PINC_NX);
    if (trace > PINC_N(0)) {
        pinc_add_scaled(e, sum / trace, next, PINC_NX * PINC_NX);
    }
    for (i = 0; i < PINC_NX; i++) {
        e[i * (PINC_NX + 1)] += sum * pinc_box[i] * (far[i] + pinc_box[i]);
    }
}

/* Moves a lower and an upper bound inwards; where they would cross, both become the middle. They
   stay if there is no number to move them by. */
static void pinc_move_bounds(pinc_mpc *m, PINC_REAL low, PINC_REAL high, PINC_REAL by,
                             PINC_REAL *to_low, PINC_REAL *to_high)
{
    const int known = pinc_all_finite(&by, 1);
    *to_low = (known != 0) ? (low + by) : low;
    *to_high = (known != 0) ? (high - by) : high;
    if (*to_low > *to_high) {
        *to_low = PINC_N(0.5) * (low + high);
        *to_high = *to_low;
        m->crossed++;
    } else if ((known == 0) && ((pinc_all_finite(&low, 1) | pinc_all_finite(&high, 1)) != 0)) {
        m->crossed++;
    } else {
        /* There is room. */
    }
}

/* Tightens the bounds of a step whose first guess is the plan, along the points where the model was
   linearized last: the plan of the step before, moved on. */
static void pinc_tighten(pinc_mpc *m, const PINC_REAL *reference)
{
    pinc_qp *qp = &m->qp[m->at];
    const int shift = m->linearized;
    PINC_REAL by[PINC_UNKNOWNS];
    PINC_REAL by_output[PINC_ROOM(PINC_OUTPUT_ROWS)];
    PINC_REAL p[PINC_NX * PINC_NX];
    PINC_REAL e[PINC_NX * PINC_NX];
    PINC_REAL cost = PINC_N(0);
#if PINC_OUTPUT_ROWS > 0
    PINC_REAL y[PINC_NO];
    PINC_REAL c[PINC_NO * PINC_NX];
    PINC_REAL d[PINC_NO * PINC_NU];
#endif
    int j;
    int i;
    if (m->linearized == 0) {
        (void)pinc_evaluate(m, m->plan.z, reference, qp, &cost);
        m->linearized = 1;
    }
#if PINC_FEEDBACK == 2
    pinc_regulate(m, qp, shift);
#endif
    pinc_fill(by, PINC_N(0), PINC_UNKNOWNS);
    pinc_fill(by_output, PINC_N(0), PINC_OUTPUT_ROWS);
    pinc_fill(p, PINC_N(0), PINC_NX * PINC_NX);
    pinc_fill(e, PINC_N(0), PINC_NX * PINC_NX);
    for (j = 0; j < PINC_N2; j++) {
        const int stage = pinc_moved_on(j, shift);
        const PINC_REAL *gain = pinc_gain(m, j);
#if PINC_OUTPUT_ROWS > 0
        /* Where the outputs at the stage's end are linearized. */
        const int end = ((j + 1) < PINC_N2) ? (pinc_moved_on(j + 1, shift) - 1) : j;
#endif
        for (i = 0; (PINC_TIGHTENS_INPUTS != 0) && (gain != NULL) && (i < PINC_NU); i++) {
            /* The last free input acts in all stages that are left. */
            PINC_REAL *to = by + (PINC_STATES + (pinc_acting(j) * PINC_NU) + i);
            *to = pinc_max(*to, pinc_width(gain + (i * PINC_NX), p, e));
        }
        pinc_propagate(PINC_A(qp, stage), PINC_B(qp, stage), gain, p, e);
        for (i = 0; i < PINC_NX; i++) {
            by[(j * PINC_NX) + i] =
                (PINC_QUANTILE * PINC_MATH(sqrt)(pinc_max(p[i * (PINC_NX + 1)], PINC_N(0)))) +
                PINC_MATH(sqrt)(pinc_max(e[i * (PINC_NX + 1)], PINC_N(0)));
        }
#if PINC_OUTPUT_ROWS > 0
        if ((shift == 0) && (end == (PINC_N2 - 1))) {
            /* The first guess need not end where its last interval does. */
            PINC_REAL x[PINC_NX];
            for (i = 0; i < PINC_NX; i++) {
                x[i] = m->plan.z[(end * PINC_NX) + i] + qp->c[(end * PINC_NX) + i];
            }
            pinc_seen_outputs(m, x, m->plan.z + (PINC_STATES + (pinc_acting(end) * PINC_NU)), y, c,
                              d);
        }
        for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
            const int row = i + ((end - j) * PINC_OUTPUT_WIDTH);
            if (pinc_output_interval[i] != j) {
                continue;
            }
            if ((shift == 0) && (end == (PINC_N2 - 1))) {
                by_output[i] = pinc_width(c + (pinc_output_number[i] * PINC_NX), p, e);
            } else {
                by_output[i] =
                    pinc_output_unit[i] * pinc_width(qp->output_x + (row * PINC_NX), p, e);
            }
        }
#endif
    }
    m->crossed = 0;
    for (i = 0; i < PINC_UNKNOWNS; i++) {
        pinc_move_bounds(m, m->low[i], m->high[i], by[i], &m->tight_low[i], &m->tight_high[i]);
    }
#if PINC_OUTPUT_ROWS > 0
    for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
        pinc_move_bounds(m, pinc_output_low[i], pinc_output_high[i], by_output[i],
                         &m->tight_output_low[i], &m->tight_output_high[i]);
    }
#endif
    pinc_project(m, m->plan.z);
}

/* Whether the plan is within the tightened bounds, which leave room everywhere. */
static int pinc_fits(const pinc_mpc *m)
{
    const pinc_qp *qp = &m->qp[m->at];
    int good = (m->crossed == 0) ? 1 : 0;
    int i;
    for (i = 0; i < PINC_UNKNOWNS; i++) {
        const PINC_REAL z = m->plan.z[i];
        const PINC_REAL low = m->tight_low[i];
        const PINC_REAL high = m->tight_high[i];
        good &= (z >= (low - (PINC_FITTING * (PINC_N(1) + pinc_abs(low))))) ? 1 : 0;
        good &= (z <= (high + (PINC_FITTING * (PINC_N(1) + pinc_abs(high))))) ? 1 : 0;
    }
#if PINC_OUTPUT_ROWS > 0
    for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
        const PINC_REAL low = pinc_abs(m->tight_output_low[i]) + PINC_N(1);
        const PINC_REAL high = pinc_abs(m->tight_output_high[i]) + PINC_N(1);
        good &= ((qp->output_low[i] * pinc_output_unit[i]) <= (PINC_FITTING * low)) ? 1 : 0;
        good &= ((qp->output_high[i] * pinc_output_unit[i]) >= (-PINC_FITTING * high)) ? 1 : 0;
    }
#else
    (void)qp;
#endif
    return good;
}
