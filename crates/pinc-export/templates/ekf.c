/* ---- The extended Kalman filter ------------------------------------------------------------- */

/* What is to be measured at z, after the input u, and its Jacobian, row by row. */
static void pinc_expect(const PINC_REAL *z, const PINC_REAL *u, PINC_REAL *expected,
                        PINC_REAL *jacobian)
{
#if PINC_MEASURES_OUTPUTS
    PINC_REAL inner[PINC_NU + PINC_NP];
    PINC_REAL y[PINC_NO];
    PINC_REAL c[PINC_NO * PINC_NX];
    PINC_REAL d[PINC_NO * (PINC_NU + PINC_NP)];
#endif
    int i;
    pinc_fill(jacobian, PINC_N(0), PINC_NM * PINC_NZ);
#if PINC_MEASURES_OUTPUTS
    pinc_believed(z, u, inner);
    pinc_outputs_linearize(z, inner, y, c, d);
#else
    (void)u;
#endif
    for (i = 0; i < PINC_NM; i++) {
        PINC_REAL *h = jacobian + (i * PINC_NZ);
#if PINC_MEASURES_OUTPUTS
        const int o = pinc_measured[i] - PINC_NX;
        if (o >= 0) {
            const PINC_REAL *by_u = d + (o * (PINC_NU + PINC_NP));
            expected[i] = y[o];
            pinc_copy(h, c + (o * PINC_NX), PINC_NX);
#if PINC_DISTURBED_INPUTS
            pinc_copy(h + PINC_NX, by_u, PINC_NU);
#endif
            pinc_copy(h + (PINC_NX + PINC_ND), by_u + PINC_NU, PINC_NP);
        } else {
            expected[i] = z[pinc_measured[i]];
            h[pinc_measured[i]] = PINC_N(1);
        }
#else
        expected[i] = z[pinc_measured[i]];
        h[pinc_measured[i]] = PINC_N(1);
#endif
#if PINC_DISTURBED_OUTPUTS
        expected[i] += z[PINC_NX + i];
        h[PINC_NX + i] = PINC_N(1);
#endif
    }
}

/* Corrects P and the change of the estimate with measurement i, in the form of Joseph. */
static void pinc_correct_by(pinc_estimator *e, int i, PINC_REAL innovation)
{
    const PINC_REAL *h = e->h + (i * PINC_NZ);
    const PINC_REAL r = pinc_noise_variance[i];
    PINC_REAL s;
    PINC_REAL rest;
    int k;
    for (k = 0; k < PINC_NZ; k++) {
        e->product[k] = pinc_dot(e->p + (k * PINC_NZ), h, PINC_NZ);
    }
    s = pinc_dot(h, e->product, PINC_NZ) + r;
    rest = innovation - pinc_dot(h, e->change, PINC_NZ);
    for (k = 0; k < PINC_NZ; k++) {
        e->gain[k] = e->product[k] / s;
    }
    pinc_add_scaled(e->change, rest, e->gain, PINC_NZ);
    for (k = 0; k < PINC_NZ; k++) {
        PINC_REAL *row = e->p + (k * PINC_NZ);
        pinc_add_scaled(row, -e->gain[k], e->product, PINC_NZ);
        pinc_add_scaled(row, (r * e->gain[k]) - pinc_dot(row, h, PINC_NZ), e->gain, PINC_NZ);
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

/* The variance of the innovation of quantity i. */
static PINC_REAL pinc_variance(const pinc_estimator *e, int i)
{
    const PINC_REAL *h = e->h + (i * PINC_NZ);
    PINC_REAL sum = PINC_N(0);
    int k;
    for (k = 0; k < PINC_NZ; k++) {
        sum += h[k] * pinc_dot(e->p + (k * PINC_NZ), h, PINC_NZ);
    }
    return sum + pinc_noise_variance[i];
}

/* The same with the covariance widened. */
static PINC_REAL pinc_wide_variance(const pinc_estimator *e, int i, int doublings)
{
    const PINC_REAL *h = e->h + (i * PINC_NZ);
    PINC_REAL sum = PINC_N(0);
    int k;
    for (k = 0; k < PINC_NZ; k++) {
        sum += h[k] * h[k] * pinc_wide(e, k, doublings);
    }
    return sum + pinc_noise_variance[i];
}

/* Judges the readings, and widens the covariance if one passes only then; the number rejected. */
static int pinc_admit(pinc_estimator *e, const PINC_REAL *y)
{
    int rejected = 0;
    int doublings = -1;
    int i;
    e->widened = 0;
    for (i = 0; i < PINC_NM; i++) {
        const PINC_REAL innovation = y[i] - e->expected[i];
        int passed = pinc_passes(innovation, pinc_noise_variance[i]);
        int due;
        if (pinc_finite(y[i]) == 0) {
            continue;
        }
        if (passed == 0) {
            passed = pinc_passes(innovation, pinc_variance(e, i));
        }
        pinc_note(e, i, passed);
        rejected += (e->rejections[i] > 0) ? 1 : 0;
        due = pinc_widening(e, i);
        if ((due > doublings) && (pinc_passes(innovation, pinc_wide_variance(e, i, due)) != 0)) {
            doublings = due;
        }
    }
    if (doublings < 0) {
        return rejected;
    }
    e->widened = 1;
    pinc_widen(e, doublings);
    pinc_copy(e->before, e->p, PINC_NZ * PINC_NZ);
    for (i = 0; i < PINC_NM; i++) {
        if ((pinc_finite(y[i]) != 0) && (e->rejections[i] > 0) &&
            (pinc_passes(y[i] - e->expected[i], pinc_variance(e, i)) != 0)) {
            pinc_note_reacquired(e, i);
            rejected--;
        }
    }
    return rejected;
}

static pinc_estimate_status pinc_filter_correct(pinc_estimator *e, const PINC_REAL *y)
{
    pinc_estimate_status status = PINC_NOT_FINITE;
    int count = 0;
    int rejected;
    int i;
    pinc_copy(e->before, e->p, PINC_NZ * PINC_NZ);
    pinc_fill(e->change, PINC_N(0), PINC_NZ);
    pinc_expect(e->z, e->u, e->expected, e->h);
    if ((pinc_all_finite(e->expected, PINC_NM) & pinc_all_finite(e->h, PINC_NM * PINC_NZ)) == 0) {
        return PINC_NOT_FINITE;
    }
    rejected = pinc_admit(e, y);
    for (i = 0; i < PINC_NM; i++) {
        if ((pinc_finite(y[i]) != 0) && (e->rejections[i] == 0)) {
            pinc_correct_by(e, i, y[i] - e->expected[i]);
            count++;
        }
    }
    if (count == 0) {
        return pinc_judged(e, rejected, PINC_NOTHING_MEASURED);
    }
    if (pinc_all_finite(e->change, PINC_NZ) != 0) {
        status = pinc_accept(e);
    } else {
        pinc_copy(e->p, e->before, PINC_NZ * PINC_NZ);
    }
    if (status == PINC_UPDATED) {
        pinc_add_scaled(e->z, PINC_N(1), e->change, PINC_NZ);
        status = pinc_judged(e, rejected, status);
    }
    return status;
}

/* The Jacobian of the step of z, from the model's Jacobians. */
static void pinc_augment(pinc_estimator *e)
{
    int i;
    int k;
    pinc_fill(e->augmented, PINC_N(0), PINC_NZ * PINC_NZ);
    for (i = 0; i < PINC_NX; i++) {
        PINC_REAL *row = e->augmented + (i * PINC_NZ);
        pinc_copy(row, e->a + (i * PINC_NX), PINC_NX);
#if PINC_DISTURBED_INPUTS
        pinc_copy(row + PINC_NX, e->b + (i * (PINC_NU + PINC_NP)), PINC_NU);
#endif
#if PINC_NP > 0
        pinc_copy(row + (PINC_NX + PINC_ND), e->b + ((i * (PINC_NU + PINC_NP)) + PINC_NU), PINC_NP);
#endif
    }
    for (k = PINC_NX; k < PINC_NZ; k++) {
        e->augmented[(k * PINC_NZ) + k] = PINC_N(1);
    }
#if PINC_DISTURBED_STATES
    for (k = 0; k < PINC_ND; k++) {
        e->augmented[(pinc_place[k] * PINC_NZ) + PINC_NX + k] = PINC_N(1);
    }
#endif
}

/* What z becomes by a step under the input u, and the Jacobian of that. */
static void pinc_move_on(pinc_estimator *e, const PINC_REAL *z, const PINC_REAL *u)
{
    PINC_REAL inner[PINC_NU + PINC_NP];
    pinc_believed(z, u, inner);
    pinc_@MODEL@_linearize(z, inner, e->next, e->a, e->b);
    pinc_stay(z, e->next);
    pinc_augment(e);
}

/* Moves the estimate on by a step under the input u, if what it becomes is finite. */
static void pinc_filter_predict(pinc_estimator *e, const PINC_REAL *u)
{
    int i;
    int k;
    pinc_copy(e->u, u, PINC_NU);
    pinc_move_on(e, e->z, u);
    if (pinc_all_finite(e->next, PINC_NZ) == 0) {
        return;
    }
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
#if PINC_HAS_RANGES
    pinc_limit(e->p);
#endif
    (void)pinc_accept(e);
    pinc_copy(e->z, e->next, PINC_NZ);
}
