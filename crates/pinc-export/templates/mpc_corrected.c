/* The model of a step: the net, in a step that is repeated less its estimated error. */
static void pinc_correct(const pinc_mpc *m, PINC_REAL *next)
{
    int i;
    for (i = 0; (m->trust == PINC_SUBSTITUTED) && (i < PINC_NX); i++) {
        next[i] -= (pinc_finite(m->model_error[i]) != 0) ? m->model_error[i] : PINC_N(0);
    }
}

#if PINC_DELAY > 0
static void pinc_either_step(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                             PINC_REAL *next)
{
    pinc_net_step(x, u, next);
    pinc_correct(m, next);
}
#endif

static void pinc_either_linearize_all(const pinc_mpc *m, int points, const PINC_REAL *x,
                                      const PINC_REAL *u, PINC_REAL *next, PINC_REAL *a,
                                      PINC_REAL *b)
{
    int c;
    pinc_net_linearize_all(points, x, u, next, a, b);
    for (c = 0; c < points; c++) {
        pinc_correct(m, next + (c * PINC_NX));
    }
}

