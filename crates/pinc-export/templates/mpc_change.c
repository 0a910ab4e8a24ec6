/* ---- Other weights and bounds than the config's --------------------------------------------- */

/* Whether all of these can be the diagonal of a weight. */
static int pinc_are_weights(const PINC_REAL *weights, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        if ((pinc_finite(weights[i]) == 0) || (weights[i] < PINC_N(0))) {
            return 0;
        }
    }
    return 1;
}

pinc_status pinc_mpc_set_weights(pinc_mpc *m, const PINC_REAL q[PINC_NY],
                                 const PINC_REAL r[PINC_NU])
{
    int j;
    int i;
    if ((m->mark != PINC_MARK) || (pinc_are_weights(q, PINC_NY) == 0) ||
        (pinc_are_weights(r, PINC_NU) == 0)) {
        return (m->mark == PINC_MARK) ? PINC_BAD_ARGUMENT : PINC_NOT_INITIALIZED;
    }
    for (j = PINC_N1 - 1; j < (PINC_N2 - PINC_HAS_TERMINAL); j++) {
        PINC_REAL *block = m->q + (j * PINC_Q_WIDTH * PINC_Q_WIDTH);
        pinc_fill(block, PINC_N(0), PINC_Q_WIDTH * PINC_Q_WIDTH);
        for (i = 0; i < PINC_NY; i++) {
#if PINC_TRACKS_OUTPUTS
            const int at = i;
            const PINC_REAL unit = PINC_N(1);
#else
            const int at = pinc_tracked[i];
            const PINC_REAL unit = PINC_X_UNIT(at);
#endif
            block[(at * PINC_Q_WIDTH) + at] = PINC_N(2) * q[i] * (unit * unit / PINC_COST_UNIT);
        }
    }
    pinc_fill(m->r, PINC_N(0), PINC_INPUTS * PINC_NU);
    for (j = 0; j < PINC_INPUTS; j++) {
        const int k = j % PINC_NU;
        const PINC_REAL unit = PINC_U_UNIT(k);
        m->r[(j * PINC_NU) + k] = PINC_N(2) * r[k] * (unit * unit / PINC_COST_UNIT);
    }
    return PINC_CONVERGED;
}

/* Whether a quantity is bounded. */
static int pinc_is_bounded(PINC_REAL low, PINC_REAL high)
{
    return ((low > -PINC_INFINITY) || (high < PINC_INFINITY)) ? 1 : 0;
}

pinc_status pinc_mpc_set_bounds(pinc_mpc *m, const PINC_REAL x_low[PINC_NX],
                                const PINC_REAL x_high[PINC_NX], const PINC_REAL u_low[PINC_NU],
                                const PINC_REAL u_high[PINC_NU])
{
    int good = (PINC_BOUNDS_VARY != 0) ? 0 : 1;
    int v;
    if (m->mark != PINC_MARK) {
        return PINC_NOT_INITIALIZED;
    }
    for (v = 0; v < PINC_NX; v++) {
        good &= (x_low[v] <= x_high[v]) ? 1 : 0;
        /* Only bounded states have rows. */
        good &= pinc_is_bounded(pinc_low[v], pinc_high[v]) |
                ((pinc_is_bounded(x_low[v], x_high[v]) == 0) ? 1 : 0);
    }
    for (v = 0; v < PINC_NU; v++) {
        good &= (u_low[v] <= u_high[v]) ? 1 : 0;
    }
    if (good == 0) {
        return PINC_BAD_ARGUMENT;
    }
    for (v = 0; v < PINC_STATES; v++) {
        const int i = v % PINC_NX;
        m->low[v] = x_low[i] / PINC_X_UNIT(i);
        m->high[v] = x_high[i] / PINC_X_UNIT(i);
    }
    for (v = 0; v < PINC_INPUTS; v++) {
        const int i = v % PINC_NU;
        m->low[PINC_STATES + v] = u_low[i] / PINC_U_UNIT(i);
        m->high[PINC_STATES + v] = u_high[i] / PINC_U_UNIT(i);
    }
    return PINC_CONVERGED;
}
