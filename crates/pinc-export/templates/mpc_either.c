/* The model of a step: the net, or in a step that is repeated the integrator. */
#ifdef __cplusplus
extern "C" {
#endif
/* Of pinc_@RK@.h, whose sizes of batches are other ones than those of pinc_net.h. */
void pinc_@RK@_step(const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *next);
void pinc_@RK@_linearize_all(int points, const PINC_REAL *x, const PINC_REAL *u, PINC_REAL *next,
                            PINC_REAL *a, PINC_REAL *b);
#ifdef __cplusplus
}
#endif

#if PINC_DELAY > 0
static void pinc_either_step(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                             PINC_REAL *next)
{
    if (m->trust == PINC_SUBSTITUTED) {
        pinc_@RK@_step(x, u, next);
    } else {
        pinc_net_step(x, u, next);
    }
}
#endif

static void pinc_either_linearize_all(const pinc_mpc *m, int points, const PINC_REAL *x,
                                      const PINC_REAL *u, PINC_REAL *next, PINC_REAL *a,
                                      PINC_REAL *b)
{
    if (m->trust == PINC_SUBSTITUTED) {
        pinc_@RK@_linearize_all(points, x, u, next, a, b);
    } else {
        pinc_net_linearize_all(points, x, u, next, a, b);
    }
}

