/* ---- The unscented Kalman filter ------------------------------------------------------------ */

/* How far the points are, squared and per entry of z: alpha^2. A mean takes rounding of the model
   over alpha^2, for which single precision has no digits: there the points are farther away. */
#define PINC_ALPHA_2 PINC_PICK(@ALPHA_2@, @ALPHA_2_SINGLE@)
#define PINC_SPREAD_2 (PINC_ALPHA_2 * PINC_N(@NZ@))
/* The weights of the outer points, and of the middle one in covariances (beta = 2). */
#define PINC_PAIR (PINC_N(0.5) / PINC_SPREAD_2)
#define PINC_MIDDLE                                                                                \
    (((PINC_SPREAD_2 - PINC_N(@NZ@)) / PINC_SPREAD_2) + PINC_N(1) - PINC_ALPHA_2 + PINC_N(2))

/* Sign of the outer point k. */
static PINC_REAL pinc_sign(int k)
{
    return (k < PINC_NZ) ? PINC_N(1) : PINC_N(-1);
}

/* What is to be measured at z, under the input u. */
static void pinc_expect(const PINC_REAL *z, const PINC_REAL *u, PINC_REAL *y)
{
#if PINC_MEASURES_OUTPUTS
    PINC_REAL inner[PINC_NU + PINC_NP];
    PINC_REAL all[PINC_NO];
#endif
    int i;
#if PINC_MEASURES_OUTPUTS
    pinc_believed(z, u, inner);
    pinc_outputs(z, inner, all);
#else
    (void)u;
#endif
    for (i = 0; i < PINC_NM; i++) {
#if PINC_MEASURES_OUTPUTS
        const int o = pinc_measured[i] - PINC_NX;
        y[i] = (o >= 0) ? all[(o >= 0) ? o : 0] : z[pinc_measured[i]];
#else
        y[i] = z[pinc_measured[i]];
#endif
#if PINC_DISTURBED_OUTPUTS
        y[i] += z[PINC_NX + i];
#endif
    }
}

/* Where z goes under the input u, or what is to be measured there. */
static void pinc_image(const PINC_REAL *z, const PINC_REAL *u, int moves, PINC_REAL *to)
{
    if (moves != 0) {
        PINC_REAL inner[PINC_NU + PINC_NP];
        pinc_believed(z, u, inner);
        pinc_@MODEL@_step(z, inner, to);
        pinc_stay(z, to);
    } else {
        pinc_expect(z, u, to);
    }
}

/* Sends the points of the estimate on. Leaves the mean less the image of the middle point in mean,
   and the differences of the others from the mean in outer. */
static pinc_estimate_status pinc_transform(pinc_estimator *e, int moves)
{
    const int width = (moves != 0) ? PINC_NZ : PINC_NM;
    const PINC_REAL spread = PINC_MATH(sqrt)(PINC_SPREAD_2);
    int finite;
    int k;
    int i;
    if (pinc_factor(e->p, PINC_NZ, e->root) == 0) {
        return PINC_INDEFINITE_COVARIANCE;
    }
    pinc_image(e->z, e->u, moves, e->middle);
    for (k = 0; k < 2 * PINC_NZ; k++) {
        PINC_REAL *to = e->outer + (k * width);
        for (i = 0; i < PINC_NZ; i++) {
            const PINC_REAL along = e->root[(i * PINC_NZ) + (k % PINC_NZ)];
            e->point[i] = e->z[i] + (pinc_sign(k) * spread * along);
        }
        pinc_image(e->point, e->u, moves, to);
        pinc_add_scaled(to, PINC_N(-1), e->middle, width);
    }
    pinc_fill(e->mean, PINC_N(0), width);
    for (k = 0; k < 2 * PINC_NZ; k++) {
        pinc_add_scaled(e->mean, PINC_PAIR, e->outer + (k * width), width);
    }
    for (k = 0; k < 2 * PINC_NZ; k++) {
        pinc_add_scaled(e->outer + (k * width), PINC_N(-1), e->mean, width);
    }
    finite = pinc_all_finite(e->middle, width) & pinc_all_finite(e->outer, 2 * PINC_NZ * width);
    return (finite != 0) ? PINC_UPDATED : PINC_NOT_FINITE;
}

/* new_p += weight point point' */
static void pinc_add_outer(PINC_REAL *p, PINC_REAL weight, const PINC_REAL *point)
{
    int i;
    for (i = 0; i < PINC_NZ; i++) {
        pinc_add_scaled(p + (i * PINC_NZ), weight * point[i], point, PINC_NZ);
    }
}

/* Takes the new mean and covariance, if they are any. */
static pinc_estimate_status pinc_accept(pinc_estimator *e)
{
    if ((pinc_all_finite(e->new_z, PINC_NZ) & pinc_all_finite(e->new_p, PINC_NZ * PINC_NZ)) == 0) {
        return PINC_NOT_FINITE;
    }
    pinc_mirror(e->new_p);
    if (pinc_factor(e->new_p, PINC_NZ, e->root) == 0) {
        return PINC_INDEFINITE_COVARIANCE;
    }
    pinc_copy(e->z, e->new_z, PINC_NZ);
    pinc_copy(e->p, e->new_p, PINC_NZ * PINC_NZ);
    return PINC_UPDATED;
}

/* The covariances of the measurements that are there, with themselves and with z. */
static void pinc_covariances(pinc_estimator *e)
{
    const PINC_REAL spread = PINC_MATH(sqrt)(PINC_SPREAD_2);
    int i;
    int j;
    int k;
    int row;
    for (i = 0; i < e->count; i++) {
        const int a = e->present[i];
        PINC_REAL *cross = e->cross + (i * PINC_NZ);
        for (j = 0; j < e->count; j++) {
            const int b = e->present[j];
            PINC_REAL sum = PINC_N(0);
            for (k = 0; k < 2 * PINC_NZ; k++) {
                sum += e->outer[(k * PINC_NM) + a] * e->outer[(k * PINC_NM) + b];
            }
            e->s[(i * e->count) + j] = (PINC_PAIR * sum) + (PINC_MIDDLE * e->mean[a] * e->mean[b]) +
                                       ((i == j) ? pinc_noise_variance[a] : PINC_N(0));
        }
        pinc_fill(cross, PINC_N(0), PINC_NZ);
        for (k = 0; k < 2 * PINC_NZ; k++) {
            const PINC_REAL factor =
                PINC_PAIR * pinc_sign(k) * spread * e->outer[(k * PINC_NM) + a];
            for (row = 0; row < PINC_NZ; row++) {
                cross[row] += factor * e->root[(row * PINC_NZ) + (k % PINC_NZ)];
            }
        }
    }
}

/* From the covariances to the gain, which takes the place of cross, and the new mean. */
static pinc_estimate_status pinc_gain(pinc_estimator *e, const PINC_REAL *y)
{
    int i;
    int k;
    if (pinc_factor(e->s, e->count, e->s_root) == 0) {
        return PINC_INDEFINITE_COVARIANCE;
    }
    pinc_copy(e->new_z, e->z, PINC_NZ);
    for (i = 0; i < e->count; i++) {
        const PINC_REAL *l = e->s_root + (i * e->count);
        PINC_REAL *own = e->cross + (i * PINC_NZ);
        const int a = e->present[i];
        if (!(l[i] > PINC_N(0))) {
            return PINC_INDEFINITE_COVARIANCE;
        }
        e->residual[i] = y[a] - (e->middle[a] + e->mean[a]);
        for (k = 0; k < i; k++) {
            e->residual[i] -= l[k] * e->residual[k];
            pinc_add_scaled(own, -l[k], e->cross + (k * PINC_NZ), PINC_NZ);
        }
        e->residual[i] /= l[i];
        for (k = 0; k < PINC_NZ; k++) {
            own[k] /= l[i];
        }
        pinc_add_scaled(e->new_z, e->residual[i], own, PINC_NZ);
    }
    for (i = e->count - 1; i >= 0; i--) {
        PINC_REAL *own = e->cross + (i * PINC_NZ);
        for (k = i + 1; k < e->count; k++) {
            pinc_add_scaled(own, -e->s_root[(k * e->count) + i], e->cross + (k * PINC_NZ),
                            PINC_NZ);
        }
        for (k = 0; k < PINC_NZ; k++) {
            own[k] /= e->s_root[(i * e->count) + i];
        }
    }
    return PINC_UPDATED;
}

/* The covariance after the correction: of the points less the gain times what is measured at
   them, plus K R K'. */
static void pinc_corrected_covariance(pinc_estimator *e)
{
    const PINC_REAL spread = PINC_MATH(sqrt)(PINC_SPREAD_2);
    int i;
    int k;
    int row;
    pinc_fill(e->new_p, PINC_N(0), PINC_NZ * PINC_NZ);
    pinc_fill(e->point, PINC_N(0), PINC_NZ);
    for (i = 0; i < e->count; i++) {
        pinc_add_scaled(e->point, e->mean[e->present[i]], e->cross + (i * PINC_NZ), PINC_NZ);
    }
    pinc_add_outer(e->new_p, PINC_MIDDLE, e->point);
    for (k = 0; k < 2 * PINC_NZ; k++) {
        for (row = 0; row < PINC_NZ; row++) {
            e->point[row] = pinc_sign(k) * spread * e->root[(row * PINC_NZ) + (k % PINC_NZ)];
        }
        for (i = 0; i < e->count; i++) {
            const PINC_REAL seen = e->outer[(k * PINC_NM) + e->present[i]];
            pinc_add_scaled(e->point, -seen, e->cross + (i * PINC_NZ), PINC_NZ);
        }
        pinc_add_outer(e->new_p, PINC_PAIR, e->point);
    }
    for (i = 0; i < e->count; i++) {
        pinc_add_outer(e->new_p, pinc_noise_variance[e->present[i]], e->cross + (i * PINC_NZ));
    }
}

/* Whether the reading of quantity i passes the gate. */
static int pinc_reading_passes(const pinc_estimator *e, const PINC_REAL *y, int i)
{
    PINC_REAL sum = PINC_N(0);
    int k;
    for (k = 0; k < 2 * PINC_NZ; k++) {
        sum += e->outer[(k * PINC_NM) + i] * e->outer[(k * PINC_NM) + i];
    }
    return pinc_passes(y[i] - (e->middle[i] + e->mean[i]),
                       (PINC_PAIR * sum) + (PINC_MIDDLE * e->mean[i] * e->mean[i]) +
                           pinc_noise_variance[i]);
}

/* Judges the readings that are there by a wider covariance, and keeps it if one that is due passes;
   the number of those that pass besides. */
static int pinc_admit_widely(pinc_estimator *e, const PINC_REAL *y, int doublings)
{
    int passed = 0;
    int finite;
    int k;
    pinc_copy(e->before, e->p, PINC_NZ * PINC_NZ);
    pinc_widen(e, doublings);
    finite = (pinc_transform(e, 0) == PINC_UPDATED) ? 1 : 0;
    for (k = 0; k < e->count; k++) {
        const int i = e->present[k];
        if ((finite != 0) && (pinc_widening(e, i) >= 0) && (pinc_reading_passes(e, y, i) != 0)) {
            e->widened = 1;
        }
    }
    if (e->widened == 0) {
        pinc_copy(e->p, e->before, PINC_NZ * PINC_NZ);
        (void)pinc_transform(e, 0);
        return 0;
    }
    for (k = 0; k < e->count; k++) {
        const int i = e->present[k];
        if ((e->rejections[i] > 0) && (pinc_reading_passes(e, y, i) != 0)) {
            pinc_note_reacquired(e, i);
            passed++;
        }
    }
    return passed;
}

/* Judges the readings that are there; those rejected are no longer. Their number. */
static int pinc_admit(pinc_estimator *e, const PINC_REAL *y)
{
    int rejected = 0;
    int doublings = -1;
    int count = 0;
    int k;
    e->widened = 0;
    for (k = 0; k < e->count; k++) {
        const int i = e->present[k];
        pinc_note(e, i, pinc_reading_passes(e, y, i));
        rejected += (e->rejections[i] > 0) ? 1 : 0;
        doublings = (pinc_widening(e, i) > doublings) ? pinc_widening(e, i) : doublings;
    }
    if (doublings >= 0) {
        rejected -= pinc_admit_widely(e, y, doublings);
    }
    for (k = 0; k < e->count; k++) {
        if (e->rejections[e->present[k]] == 0) {
            e->present[count] = e->present[k];
            count++;
        }
    }
    e->count = count;
    return rejected;
}

static pinc_estimate_status pinc_filter_correct(pinc_estimator *e, const PINC_REAL *y)
{
    pinc_estimate_status status;
    int rejected;
    int i;
    e->count = 0;
    for (i = 0; i < PINC_NM; i++) {
        if (pinc_finite(y[i]) != 0) {
            e->present[e->count] = i;
            e->count++;
        }
    }
    if (e->count == 0) {
        return PINC_NOTHING_MEASURED;
    }
    status = pinc_transform(e, 0);
    if (status != PINC_UPDATED) {
        return status;
    }
    rejected = pinc_admit(e, y);
    if (e->count == 0) {
        return pinc_judged(e, rejected, PINC_NOTHING_MEASURED);
    }
    pinc_covariances(e);
    status = pinc_gain(e, y);
    if (status != PINC_UPDATED) {
        return status;
    }
    pinc_corrected_covariance(e);
    status = pinc_accept(e);
    return (status == PINC_UPDATED) ? pinc_judged(e, rejected, status) : status;
}

/* Moves the estimate on by a step under the input u. */
static void pinc_filter_predict(pinc_estimator *e, const PINC_REAL *u)
{
    int i;
    int k;
    pinc_copy(e->u, u, PINC_NU);
    if (pinc_transform(e, 1) != PINC_UPDATED) {
        return;
    }
    pinc_fill(e->new_p, PINC_N(0), PINC_NZ * PINC_NZ);
    pinc_add_outer(e->new_p, PINC_MIDDLE, e->mean);
    for (k = 0; k < 2 * PINC_NZ; k++) {
        pinc_add_outer(e->new_p, PINC_PAIR, e->outer + (k * PINC_NZ));
    }
    for (i = 0; i < PINC_NZ; i++) {
        e->new_p[(i * PINC_NZ) + i] += pinc_process_variance[i];
        e->new_z[i] = e->mean[i] + e->middle[i];
    }
#if PINC_HAS_RANGES
    pinc_limit(e->new_p);
#endif
    (void)pinc_accept(e);
}
