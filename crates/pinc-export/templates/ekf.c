/* ---- The extended Kalman filter ------------------------------------------------------------- */

/* Corrects P and the change of the estimate with measurement i, in the form of Joseph. */
static void pinc_correct_by(pinc_estimator *e, int i, PINC_REAL innovation)
{
    const PINC_REAL r = pinc_noise_variance[i];
    PINC_REAL s;
    PINC_REAL rest;
    int k;
    for (k = 0; k < PINC_NZ; k++) {
        e->product[k] = pinc_measure(e->p + (k * PINC_NZ), i);
    }
    s = pinc_measure(e->product, i) + r;
    rest = innovation - pinc_measure(e->change, i);
    for (k = 0; k < PINC_NZ; k++) {
        e->gain[k] = e->product[k] / s;
    }
    pinc_add_scaled(e->change, rest, e->gain, PINC_NZ);
    for (k = 0; k < PINC_NZ; k++) {
        PINC_REAL *row = e->p + (k * PINC_NZ);
        pinc_add_scaled(row, -e->gain[k], e->product, PINC_NZ);
        pinc_add_scaled(row, (r * e->gain[k]) - pinc_measure(row, i), e->gain, PINC_NZ);
    }
    pinc_mirror(e->p);
}

/* Takes the covariance, or goes back to the one before. */
static pinc_estimate_status pinc_accept(pinc_estimator *e)
{
    pinc_estimate_status status = PINC_UPDATED;
    if (pinc_all_finite(e->p, PINC_NZ * PINC_NZ) == 0) {
        status = PINC_NOT_FINITE;
    } else if (pinc_factor(e->p, PINC_NZ, e->work) == 0) {
        status = PINC_INDEFINITE_COVARIANCE;
    } else {
        return status;
    }
    pinc_copy(e->p, e->before, PINC_NZ * PINC_NZ);
    return status;
}

static pinc_estimate_status pinc_correct(pinc_estimator *e, const PINC_REAL *y)
{
    pinc_estimate_status status = PINC_NOT_FINITE;
    int count = 0;
    int i;
    pinc_copy(e->before, e->p, PINC_NZ * PINC_NZ);
    pinc_fill(e->change, PINC_N(0), PINC_NZ);
    for (i = 0; i < PINC_NM; i++) {
        if (pinc_finite(y[i]) != 0) {
            pinc_correct_by(e, i, y[i] - pinc_measure(e->z, i));
            count++;
        }
    }
    if (count == 0) {
        return PINC_NOTHING_MEASURED;
    }
    if (pinc_all_finite(e->change, PINC_NZ) != 0) {
        status = pinc_accept(e);
    } else {
        pinc_copy(e->p, e->before, PINC_NZ * PINC_NZ);
    }
    if (status == PINC_UPDATED) {
        pinc_add_scaled(e->z, PINC_N(1), e->change, PINC_NZ);
    }
    return status;
}

/* The Jacobian of the step of z, from those of the model. */
static void pinc_augment(pinc_estimator *e)
{
    int i;
    int k;
    pinc_fill(e->augmented, PINC_N(0), PINC_NZ * PINC_NZ);
    for (i = 0; i < PINC_NX; i++) {
        PINC_REAL *row = e->augmented + (i * PINC_NZ);
        pinc_copy(row, e->a + (i * PINC_NX), PINC_NX);
#if PINC_DISTURBED_INPUTS
        pinc_copy(row + PINC_NX, e->b + (i * PINC_NU), PINC_NU);
#endif
    }
    for (k = PINC_NX; k < PINC_NZ; k++) {
        e->augmented[(k * PINC_NZ) + k] = PINC_N(1);
#if PINC_DISTURBED_STATES
        e->augmented[(pinc_place[k - PINC_NX] * PINC_NZ) + k] = PINC_N(1);
#endif
    }
}

/* Moves the estimate on by a step under the input u. */
static void pinc_predict(pinc_estimator *e, const PINC_REAL *u)
{
    PINC_REAL inner[PINC_NU];
    int i;
    int k;
    pinc_input(e->z, u, inner);
    pinc_@MODEL@_linearize(e->z, inner, e->next, e->a, e->b);
    pinc_stay(e->z, e->next);
    if (pinc_all_finite(e->next, PINC_NZ) == 0) {
        return;
    }
    pinc_augment(e);
    pinc_copy(e->before, e->p, PINC_NZ * PINC_NZ);
    pinc_fill(e->work, PINC_N(0), PINC_NZ * PINC_NZ);
    for (i = 0; i < PINC_NZ; i++) {
        for (k = 0; k < PINC_NZ; k++) {
            pinc_add_scaled(e->work + (i * PINC_NZ), e->augmented[(i * PINC_NZ) + k],
                            e->p + (k * PINC_NZ), PINC_NZ);
        }
    }
    for (i = 0; i < PINC_NZ; i++) {
        for (k = 0; k <= i; k++) {
            const PINC_REAL entry =
                pinc_dot(e->work + (i * PINC_NZ), e->augmented + (k * PINC_NZ), PINC_NZ);
            e->p[(i * PINC_NZ) + k] = entry;
            e->p[(k * PINC_NZ) + i] = entry;
        }
        e->p[(i * PINC_NZ) + i] += pinc_process_variance[i];
    }
    (void)pinc_accept(e);
    pinc_copy(e->z, e->next, PINC_NZ);
}
