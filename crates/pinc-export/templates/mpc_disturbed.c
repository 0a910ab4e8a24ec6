/* ---- The model with its disturbances -------------------------------------------------------- */

/* Where they enter: inputs, measured states, or states. */
@PLACES@
/* The state and the input that the model sees. */
static void pinc_arguments(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                           PINC_REAL *inner_x, PINC_REAL *inner_u)
{
    int i;
    pinc_copy(inner_x, x, PINC_NX);
    pinc_copy(inner_u, u, PINC_NU);
    for (i = 0; i < PINC_NW; i++) {
#if PINC_DISTURBED_INPUTS
        inner_u[pinc_place[i]] += m->disturbance[i];
#elif PINC_DISTURBED_OUTPUTS
        inner_x[pinc_place[i]] -= m->disturbance[i];
#else
        (void)m;
#endif
    }
}

/* What they make of the next state. */
static void pinc_disturb(const pinc_mpc *m, PINC_REAL *next)
{
#if PINC_DISTURBED_INPUTS
    (void)m;
    (void)next;
#else
    int i;
    for (i = 0; i < PINC_NW; i++) {
        next[pinc_place[i]] += m->disturbance[i];
    }
#endif
}

#if PINC_DELAY > 0
static void pinc_disturbed_step(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                                PINC_REAL *next)
{
    PINC_REAL inner_x[PINC_NX];
    PINC_REAL inner_u[PINC_NU];
    pinc_arguments(m, x, u, inner_x, inner_u);
    pinc_@MODEL@_step(inner_x, inner_u, next);
    pinc_disturb(m, next);
}
#endif

static void pinc_disturbed_linearize(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                                     PINC_REAL *next, PINC_REAL *a, PINC_REAL *b)
{
    PINC_REAL inner_x[PINC_NX];
    PINC_REAL inner_u[PINC_NU];
    pinc_arguments(m, x, u, inner_x, inner_u);
    pinc_@MODEL@_linearize(inner_x, inner_u, next, a, b);
    pinc_disturb(m, next);
}
