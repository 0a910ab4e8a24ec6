/* ---- The model as the optimization sees it --------------------------------------------------- */

@EITHER@#if PINC_ND > 0
/* Where the disturbances enter: inputs, or quantities that are measured, or states; of quantities,
   states come first, then outputs. */
@PLACES@
#endif
/* The state and the arguments of the model itself: in the plant's units, with disturbances, and
   with the parameters after the inputs. */
static void pinc_arguments(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                           PINC_REAL *inner_x, PINC_REAL *inner_u)
{
    int i;
    for (i = 0; i < PINC_NX; i++) {
        inner_x[i] = x[i] * PINC_X_UNIT(i);
    }
    for (i = 0; i < PINC_NU; i++) {
        inner_u[i] = u[i] * PINC_U_UNIT(i);
    }
#if PINC_DISTURBED_INPUTS
    for (i = 0; i < PINC_ND; i++) {
        inner_u[pinc_place[i]] += m->unknown[i];
    }
#elif PINC_DISTURBED_OUTPUTS
    for (i = 0; i < PINC_ND; i++) {
        if (pinc_place[i] < PINC_NX) {
            inner_x[pinc_place[i]] -= m->unknown[i];
        }
    }
#endif
#if PINC_NP > 0
    for (i = 0; i < PINC_NP; i++) {
        inner_u[PINC_NU + i] = m->unknown[PINC_ND + i];
    }
#endif
#if !PINC_DISTURBED_INPUTS && !PINC_DISTURBED_OUTPUTS && (PINC_NP == 0)
    (void)m;
#endif
}

/* What is left to do with the next state. */
static void pinc_finish(const pinc_mpc *m, PINC_REAL *next)
{
    int i;
#if PINC_DISTURBED_STATES || PINC_DISTURBED_OUTPUTS
    for (i = 0; i < PINC_ND; i++) {
        if (pinc_place[i] < PINC_NX) {
            next[pinc_place[i]] += m->unknown[i];
        }
    }
#else
    (void)m;
#endif
    for (i = 0; i < PINC_NX; i++) {
        next[i] /= PINC_X_UNIT(i);
    }
}

#if PINC_DELAY > 0
static void pinc_seen_step(const pinc_mpc *m, const PINC_REAL *x, const PINC_REAL *u,
                           PINC_REAL *next)
{
    PINC_REAL inner_x[PINC_NX];
    PINC_REAL inner_u[PINC_NU + PINC_NP];
    pinc_arguments(m, x, u, inner_x, inner_u);
    @MODEL_STEP@inner_x, inner_u, next);
    pinc_finish(m, next);
}
#endif

static void pinc_seen_linearize_all(const pinc_mpc *m, int points, const PINC_REAL *x,
                                    const PINC_REAL *u, PINC_REAL *next, PINC_REAL *a, PINC_REAL *b)
{
    PINC_REAL inner_x[PINC_BATCH * PINC_NX];
    PINC_REAL inner_u[PINC_BATCH * (PINC_NU + PINC_NP)];
    PINC_REAL inner_b[PINC_BATCH * PINC_NX * (PINC_NU + PINC_NP)];
    int c;
    int k;
    for (c = 0; c < points; c++) {
        pinc_arguments(m, x + (c * PINC_NX), u + (c * PINC_NU), inner_x + (c * PINC_NX),
                       inner_u + (c * (PINC_NU + PINC_NP)));
    }
    @MODEL_LINEARIZE@points, inner_x, inner_u, next, a, inner_b);
    for (c = 0; c < points; c++) {
        pinc_finish(m, next + (c * PINC_NX));
    }
    for (c = 0; c < points * PINC_NX; c++) {
        for (k = 0; k < PINC_NX; k++) {
            a[(c * PINC_NX) + k] *= PINC_X_UNIT(k) / PINC_X_UNIT(c % PINC_NX);
        }
        for (k = 0; k < PINC_NU; k++) {
            b[(c * PINC_NU) + k] = inner_b[(c * (PINC_NU + PINC_NP)) + k] *
                                   (PINC_U_UNIT(k) / PINC_X_UNIT(c % PINC_NX));
        }
    }
}
