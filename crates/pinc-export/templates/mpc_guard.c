
/* ---- The guard ------------------------------------------------------------------------------ */

/* The tolerances of the net's estimated error, in the states' units. */
@TOLERANCE@
/* Estimates the net's error in the first step of the plan: whether it is within the tolerances. */
static int pinc_trusts(pinc_mpc *m)
{
    PINC_REAL x[PINC_NX];
    PINC_REAL u[PINC_NU + PINC_NP];
    int within = 1;
    int i;
    pinc_arguments(m, m->start, m->plan.z + PINC_STATES, x, u);
    pinc_error(x, u, m->model_error);
    for (i = 0; i < PINC_NX; i++) {
        /* NaN is beyond a tolerance. */
        if ((pinc_finite(pinc_tolerance[i]) != 0) &&
            !(pinc_abs(m->model_error[i]) <= pinc_tolerance[i])) {
            within = 0;
        }
    }
    return within;
}

#if PINC_REPEATS
static void pinc_keep_origin(pinc_mpc *m)
{
    m->origin.plan = m->plan;
    m->origin.fallback = m->fallback;
    m->origin.warm = m->warm;
    m->origin.unplaced = m->unplaced;
    m->origin.tentative = m->tentative;
    m->origin.waited = m->waited;
    m->origin.unjudged = m->unjudged;
    m->origin.has_fallback = m->has_fallback;
}

static void pinc_go_back(pinc_mpc *m)
{
    m->plan = m->origin.plan;
    m->fallback = m->origin.fallback;
    m->warm = m->origin.warm;
    m->unplaced = m->origin.unplaced;
    m->tentative = m->origin.tentative;
    m->waited = m->origin.waited;
    m->unjudged = m->origin.unjudged;
    m->has_fallback = m->origin.has_fallback;
}
#endif

/* Chooses a plan, and judges its first step. */
static pinc_status pinc_guarded_plan(pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *reference)
{
    pinc_status status;
#if PINC_REPEATS
    pinc_keep_origin(m);
#endif
    status = pinc_choose_plan(m, x, reference);
    if (m->followed != 0) {
        m->trust = (pinc_trusts(m) != 0) ? PINC_TRUSTED : PINC_DOUBTED;
    }
#if PINC_REPEATS
    else if (status != PINC_DEADLINE) {
        /* No plan was found, although there was time. */
        (void)pinc_trusts(m);
        m->trust = PINC_DOUBTED;
    } else {
        /* There is no time for another. */
    }
    if (m->trust == PINC_DOUBTED) {
        m->trust = PINC_SUBSTITUTED;
        pinc_go_back(m);
        status = pinc_choose_plan(m, x, reference);
    }
#endif
    return status;
}
