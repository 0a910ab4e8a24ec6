/* ---- Moving horizon estimation: the problem of the window, linearized ------------------------ */

#define PINC_INFINITY ((PINC_REAL)INFINITY)

static PINC_REAL pinc_abs(PINC_REAL v)
{
    return PINC_MATH(fabs)(v);
}

static PINC_REAL pinc_max(PINC_REAL a, PINC_REAL b)
{
    return (a > b) ? a : b;
}

static PINC_REAL pinc_largest(const PINC_REAL *v, int count)
{
    PINC_REAL largest = PINC_N(0);
    int i;
    for (i = 0; i < count; i++) {
        largest = pinc_max(largest, pinc_abs(v[i]));
    }
    return largest;
}

static PINC_REAL pinc_sum(const PINC_REAL *v, int count)
{
    PINC_REAL sum = PINC_N(0);
    int i;
    for (i = 0; i < count; i++) {
        sum += pinc_abs(v[i]);
    }
    return sum;
}

/* How many numbers the states of the window are now. */
static int pinc_staged(const pinc_estimator *e)
{
    return (e->steps + 1) * PINC_NZ;
}

/* Takes the covariance of what was expected of the first state; 0 if it is none. */
static int pinc_arrive(pinc_estimator *e)
{
    int i;
    int k;
    if (pinc_factor(e->prior_p, PINC_NZ, e->root) == 0) {
        return 0;
    }
    for (i = 0; i < PINC_NZ; i++) {
        for (k = 0; k <= i; k++) {
            e->root[(i * PINC_NZ) + k] /= pinc_unit[i];
        }
    }
    return 1;
}

/* The equations of stage j, whose state is to be the one reached, and its bounds. */
static void pinc_write_stage(pinc_estimator *e, int j, const PINC_REAL *reached)
{
    int i;
    for (i = 0; i < PINC_NZ; i++) {
        const int at = (j * PINC_NZ) + i;
        const PINC_REAL noise =
            (j == 0) ? pinc_dot(e->root + (i * PINC_NZ), e->now.v, PINC_NZ)
                     : (pinc_noise[i] * e->now.v[at]);
        e->defects[at] = (reached[i] - e->now.x[at]) / pinc_unit[i];
        e->c[at] = e->defects[at] + noise;
#if PINC_HAS_BOUNDS
        e->below[at] = (pinc_low[i] - e->now.x[at]) / pinc_unit[i];
        e->above[at] = (pinc_high[i] - e->now.x[at]) / pinc_unit[i];
#endif
    }
}

/* What was measured at stage j, and its share of the cost and of the slope. */
static void pinc_write_measured(pinc_estimator *e, int j)
{
    /* Before the input changed: with the one that led there. */
    const PINC_REAL *before = (j > 0) ? (e->applied + ((j - 1) * PINC_NU)) : e->u_before;
    const PINC_REAL *u = (j < e->steps) ? before : e->u;
    PINC_REAL *slope = e->slope + (j * PINC_NZ);
    int i;
    int k;
    pinc_fill(slope, PINC_N(0), PINC_NZ);
    pinc_expect(e->now.x + (j * PINC_NZ), u, e->expected, e->stage_h + (j * PINC_NM * PINC_NZ));
    for (i = 0; i < PINC_NM; i++) {
        const int at = (j * PINC_NM) + i;
        PINC_REAL *h = e->stage_h + (at * PINC_NZ);
        for (k = 0; k < PINC_NZ; k++) {
            h[k] *= pinc_unit[k];
        }
        e->errors[at] = e->measured[at];
        if (pinc_finite(e->measured[at]) != 0) {
            const PINC_REAL error = e->expected[i] - e->measured[at];
            const PINC_REAL weight = PINC_N(1) / pinc_noise_variance[i];
            e->errors[at] = error;
            e->cost += PINC_N(0.5) * weight * error * error;
            pinc_add_scaled(slope, weight * error, h, PINC_NZ);
        }
    }
}

/* The Jacobian of the step that leads to stage j, in units of the states. */
static void pinc_write_jacobian(pinc_estimator *e, int j)
{
    PINC_REAL *a = e->stage_a + (j * PINC_NZ * PINC_NZ);
    int i;
    int k;
    for (i = 0; i < PINC_NZ; i++) {
        for (k = 0; k < PINC_NZ; k++) {
            a[(i * PINC_NZ) + k] =
                e->augmented[(i * PINC_NZ) + k] * (pinc_unit[k] / pinc_unit[i]);
        }
    }
}

/* The largest slope of the Lagrangian. */
static PINC_REAL pinc_stationarity(const pinc_estimator *e)
{
    PINC_REAL largest = PINC_N(0);
    int j;
    int i;
    int k;
    for (j = 0; j <= e->steps; j++) {
        const int first = j * PINC_NZ;
        const PINC_REAL *a = e->stage_a + ((first + PINC_NZ) * PINC_NZ);
        for (i = 0; i < PINC_NZ; i++) {
            const int at = first + i;
            PINC_REAL by_x = e->slope[at] + e->now.bounds[at] - e->now.dynamics[at];
            PINC_REAL by_v = e->now.v[at];
            for (k = 0; k < PINC_NZ; k++) {
                if (j < e->steps) {
                    by_x += a[(k * PINC_NZ) + i] * e->now.dynamics[first + PINC_NZ + k];
                }
                if (j == 0) {
                    by_v += e->root[(k * PINC_NZ) + i] * e->now.dynamics[k];
                }
            }
            if (j > 0) {
                by_v += pinc_noise[i] * e->now.dynamics[at];
            }
            largest = pinc_max(largest, pinc_max(pinc_abs(by_x), pinc_abs(by_v)));
            if (pinc_finite(by_x + by_v) == 0) {
                return PINC_INFINITY;
            }
        }
    }
    return largest;
}

/* The residual of the optimality conditions, of which what grows with the multipliers is counted by
   the size of these; and the violation of equations and bounds. */
static void pinc_judge(pinc_estimator *e)
{
    const int count = pinc_staged(e);
    const PINC_REAL stationarity = pinc_stationarity(e);
    const PINC_REAL mean =
        (pinc_sum(e->now.dynamics, count) + pinc_sum(e->now.bounds, count)) /
        (PINC_N(3) * PINC_N(count));
    const PINC_REAL scale = pinc_max(mean / PINC_N(100), PINC_N(1));
    PINC_REAL outside = PINC_N(0);
    PINC_REAL product = PINC_N(0);
    e->violation = pinc_sum(e->c, count);
#if PINC_HAS_BOUNDS
    {
        int i;
        for (i = 0; i < count; i++) {
            const PINC_REAL mu = e->now.bounds[i];
            const PINC_REAL beyond =
                pinc_max(pinc_max(e->below[i], -e->above[i]), PINC_N(0));
            outside = pinc_max(outside, beyond);
            e->violation += beyond;
            if (mu > PINC_N(0)) {
                product = pinc_max(product, mu * pinc_max(e->above[i], PINC_N(0)));
            } else if (mu < PINC_N(0)) {
                product = pinc_max(product, -mu * pinc_max(-e->below[i], PINC_N(0)));
            } else {
                /* Not held. */
            }
        }
    }
#endif
    e->kkt = pinc_max(pinc_max(stationarity / scale, product / scale),
                      pinc_max(pinc_largest(e->c, count), outside));
    if (pinc_finite(e->cost + e->violation + e->kkt) == 0) {
        e->kkt = PINC_INFINITY;
    }
}

/* Linearizes at the states of the window. */
static void pinc_linearize_window(pinc_estimator *e)
{
    const PINC_REAL *reached = e->prior;
    int j;
    e->cost = PINC_N(0.5) * pinc_dot(e->now.v, e->now.v, pinc_staged(e));
    for (j = 0; j <= e->steps; j++) {
        pinc_write_stage(e, j, reached);
        pinc_write_measured(e, j);
        if (j < e->steps) {
            pinc_move_on(e, e->now.x + (j * PINC_NZ), e->applied + (j * PINC_NU));
            pinc_write_jacobian(e, j + 1);
            reached = e->next;
        }
    }
    pinc_judge(e);
}
