/* ---- Outputs of the plant ------------------------------------------------------------------- */

/* The outputs, in their units, and their Jacobians by state and input. */
static void pinc_seen_outputs(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                              PINC_REAL *y, PINC_REAL *c, PINC_REAL *d)
{
    PINC_REAL inner_x[PINC_NX];
    PINC_REAL inner_u[PINC_NU + PINC_NP];
    PINC_REAL inner_d[PINC_NO * (PINC_NU + PINC_NP)];
    int i;
    int k;
    pinc_arguments(m, x, u, inner_x, inner_u);
    pinc_outputs_linearize(inner_x, inner_u, y, c, inner_d);
#if PINC_DISTURBED_OUTPUTS
    for (i = 0; i < PINC_ND; i++) {
        if (pinc_place[i] >= PINC_NX) {
            y[pinc_place[i] - PINC_NX] += m->unknown[i];
        }
    }
#endif
    for (i = 0; i < PINC_NO; i++) {
        for (k = 0; k < PINC_NX; k++) {
            c[(i * PINC_NX) + k] *= PINC_X_UNIT(k);
        }
        for (k = 0; k < PINC_NU; k++) {
            d[(i * PINC_NU) + k] = inner_d[(i * (PINC_NU + PINC_NP)) + k] * PINC_U_UNIT(k);
        }
    }
}

#if PINC_OUTPUT_STARTS
/* Where an output at the measured state does not change with the input after all, hard bounds admit its
   value. What soft ones cost stays: the derivative may vanish at one input only. */
static void pinc_admit_given(const pinc_mpc *m, pinc_qp *qp)
{
    int i;
    int k;
    for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
        const int measured = ((pinc_output_interval[i] == 0) && (pinc_output_start[i] != 0)) ? 1 : 0;
        PINC_REAL reach = PINC_N(0);
        for (k = 0; k < PINC_NU; k++) {
            reach = pinc_max(reach, pinc_abs(qp->output_u[(i * PINC_NU) + k]));
        }
        if ((measured != 0) && (reach <= PINC_N(0)) && !(m->output_penalty[i] < PINC_INFINITY)) {
            qp->output_low[i] = pinc_min(qp->output_low[i], PINC_N(0));
            qp->output_high[i] = pinc_max(qp->output_high[i], PINC_N(0));
        }
    }
}
#endif

#if PINC_OUTPUT_ROWS > 0
/* What is left of the bounds on outputs at the end of interval j, or at its start, and their
   rows. The measured state does not move. */
static void pinc_limit_outputs(const pinc_mpc *m, pinc_qp *qp, int j, int start, const PINC_REAL *y,
                               const PINC_REAL *c, const PINC_REAL *d)
{
    const int measured = ((start != 0) && (j == 0)) ? 1 : 0;
    int i;
    int k;
    (void)m;
    for (i = 0; i < PINC_OUTPUT_ROWS; i++) {
        const int o = pinc_output_number[i];
        const PINC_REAL unit = pinc_output_unit[i];
        if ((pinc_output_interval[i] != j) || (pinc_output_start[i] != start)) {
            continue;
        }
        qp->output_low[i] = (PINC_OUTPUT_LOW(m)[i] - y[o]) / unit;
        qp->output_high[i] = (PINC_OUTPUT_HIGH(m)[i] - y[o]) / unit;
        for (k = 0; k < PINC_NX; k++) {
            const PINC_REAL slope = c[(o * PINC_NX) + k] / unit;
            qp->output_x[(i * PINC_NX) + k] = (measured != 0) ? PINC_N(0) : slope;
        }
        for (k = 0; k < PINC_NU; k++) {
            qp->output_u[(i * PINC_NU) + k] = d[(o * PINC_NU) + k] / unit;
        }
    }
}
#endif

#if PINC_TRACKS_OUTPUTS
/* Tracking at the end of interval j, after Gauss and Newton: with the Jacobian (C D) of what is tracked, adds
   (C D)'Q(C D) to the Hessian and (C D)'Q e to the gradient. Gives its part of the cost, twice. */
static PINC_REAL pinc_track_outputs(const pinc_mpc *m, const PINC_REAL *x,
                                    const PINC_REAL *reference, int j, const PINC_REAL *y,
                                    const PINC_REAL *c, const PINC_REAL *d, pinc_qp *qp)
{
    const PINC_REAL *weight = m->q + (j * PINC_NY * PINC_NY);
    const int acting = pinc_acting(j);
    PINC_REAL row[PINC_NY][PINC_NX + PINC_NU];
    PINC_REAL weighted[PINC_NX + PINC_NU];
    PINC_REAL error[PINC_NY];
    PINC_REAL twice = PINC_N(0);
    int i;
    int k;
    int v;
    for (i = 0; i < PINC_NY; i++) {
        const int o = pinc_tracked[i] - PINC_NX;
        if (o < 0) {
            pinc_fill(row[i], PINC_N(0), PINC_NX + PINC_NU);
            row[i][pinc_tracked[i]] = PINC_X_UNIT(pinc_tracked[i]);
            error[i] = (x[pinc_tracked[i]] * PINC_X_UNIT(pinc_tracked[i])) - reference[i];
        } else {
            pinc_copy(row[i], c + (o * PINC_NX), PINC_NX);
            pinc_copy(row[i] + PINC_NX, d + (o * PINC_NU), PINC_NU);
            error[i] = y[o] - reference[i];
        }
    }
    for (i = 0; i < PINC_NY; i++) {
        PINC_REAL force = PINC_N(0);
        pinc_fill(weighted, PINC_N(0), PINC_NX + PINC_NU);
        for (k = 0; k < PINC_NY; k++) {
            pinc_add_scaled(weighted, weight[(i * PINC_NY) + k], row[k], PINC_NX + PINC_NU);
            force += weight[(i * PINC_NY) + k] * error[k];
        }
        twice += force * error[i];
        pinc_add_scaled(qp->gradient + (j * PINC_NX), error[i], weighted, PINC_NX);
        pinc_add_scaled(qp->gradient + (PINC_STATES + (acting * PINC_NU)), error[i],
                        weighted + PINC_NX, PINC_NU);
        for (v = 0; v < PINC_NX; v++) {
            pinc_add_scaled(qp->q + (((j * PINC_NX) + v) * PINC_NX), row[i][v], weighted, PINC_NX);
        }
        for (v = 0; v < PINC_NU; v++) {
            const PINC_REAL factor = row[i][PINC_NX + v];
            pinc_add_scaled(qp->s + (((j * PINC_NU) + v) * PINC_NX), factor, weighted, PINC_NX);
            pinc_add_scaled(qp->t + (((acting * PINC_NU) + v) * PINC_NU), factor,
                            weighted + PINC_NX, PINC_NU);
        }
    }
    return twice;
}
#endif

/* All of this along a plan, with the input of each interval; gives the part of the cost, twice. */
static PINC_REAL pinc_follow_outputs(const pinc_mpc *m, const PINC_REAL *z,
                                     const PINC_REAL *reference, pinc_qp *qp)
{
    PINC_REAL twice = PINC_N(0);
    int j;
#if PINC_TRACKS_OUTPUTS
    pinc_fill(qp->q, PINC_N(0), PINC_STATES * PINC_NX);
    pinc_fill(qp->s, PINC_N(0), PINC_N2 * PINC_NU * PINC_NX);
    pinc_fill(qp->t, PINC_N(0), PINC_INPUTS * PINC_NU);
#else
    (void)reference;
#endif
    for (j = 0; j < PINC_N2; j++) {
        const PINC_REAL *x = z + (j * PINC_NX);
        const PINC_REAL *u = z + (PINC_STATES + (pinc_acting(j) * PINC_NU));
        PINC_REAL y[PINC_NO];
        PINC_REAL c[PINC_NO * PINC_NX];
        PINC_REAL d[PINC_NO * PINC_NU];
        pinc_seen_outputs(m, x, u, y, c, d);
#if PINC_OUTPUT_ROWS > 0
        pinc_limit_outputs(m, qp, j, 0, y, c, d);
#endif
#if PINC_TRACKS_OUTPUTS
        twice += pinc_track_outputs(m, x, reference + (j * PINC_NY), j, y, c, d, qp);
#endif
#if PINC_OUTPUT_STARTS
        pinc_seen_outputs(m, (j == 0) ? m->start : (x - PINC_NX), u, y, c, d);
        pinc_limit_outputs(m, qp, j, 1, y, c, d);
#endif
    }
#if PINC_OUTPUT_STARTS
    pinc_admit_given(m, qp);
#endif
    return twice;
}

