@BANNER@
#include "pinc_feedback.h"
@INCLUDE@
#include <math.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "this estimator tests for infinity and NaN: compile it without -ffast-math"
#endif

/* A pivot below this part of its diagonal entry counts as 0: what is left of it is rounding. */
#define PINC_ROUNDING PINC_PICK(1e-14, 1e-6)
/* A pivot that is negative by more than this part of its diagonal entry is no rounding. */
#define PINC_INDEFINITE PINC_PICK(1e-9, 1e-4)
/* The bound on the normalized innovation squared of a reading; how many more rejections than passes
   there are before a reading is judged by a wider covariance, and how often its standard deviations
   double. */
#define PINC_GATE @GATE@
#define PINC_PATIENCE_OF_GATE 5
#define PINC_DOUBLINGS 5
/* Whether outputs are measured, not states alone. */
#define PINC_MEASURES_OUTPUTS @MEASURES_OUTPUTS@
/* Whether predictions leave no variance beyond what the range of a state allows. */
#define PINC_HAS_RANGES @HAS_RANGES@

@TABLES@
/* The input given before the first step. */
@INITIAL_INPUT@
@VECTORS@/* Makes a matrix symmetric. */
static void pinc_mirror(PINC_REAL *p)
{
    int i;
    int j;
    for (i = 0; i < PINC_NZ; i++) {
        for (j = 0; j < i; j++) {
            const PINC_REAL mean =
                PINC_N(0.5) * (p[(i * PINC_NZ) + j] + p[(j * PINC_NZ) + i]);
            p[(i * PINC_NZ) + j] = mean;
            p[(j * PINC_NZ) + i] = mean;
        }
    }
}

/* P = L L' for a positive semidefinite P of size n; 0 if it is indefinite or not finite. */
static int pinc_factor(const PINC_REAL *p, int n, PINC_REAL *l)
{
    int i;
    int j;
    pinc_fill(l, PINC_N(0), n * n);
    for (j = 0; j < n; j++) {
        PINC_REAL *row = l + (j * n);
        const PINC_REAL diagonal = p[(j * n) + j];
        PINC_REAL pivot;
        for (i = 0; i < j; i++) {
            const PINC_REAL *other = l + (i * n);
            const PINC_REAL rest = p[(j * n) + i] - pinc_dot(row, other, i);
            row[i] = (other[i] > PINC_N(0)) ? (rest / other[i]) : PINC_N(0);
        }
        pivot = diagonal - pinc_dot(row, row, j);
        if ((pinc_finite(pivot) == 0) || (diagonal < PINC_N(0)) ||
            (pivot < (-PINC_INDEFINITE * PINC_MATH(fabs)(diagonal)))) {
            return 0;
        }
        row[j] = (pivot > (PINC_ROUNDING * diagonal)) ? PINC_MATH(sqrt)(pivot) : PINC_N(0);
    }
    return 1;
}

/* ---- What is estimated: z, the state, disturbances and parameters --------------------------- */

/* The arguments of the model: inputs with their disturbances, then parameters. */
static void pinc_believed(const PINC_REAL *z, const PINC_REAL *u, PINC_REAL *inner)
{
    int i;
    for (i = 0; i < PINC_NU; i++) {
        inner[i] = u[i];
#if PINC_DISTURBED_INPUTS
        inner[i] += z[PINC_NX + i];
#endif
    }
#if PINC_NP > 0
    for (i = 0; i < PINC_NP; i++) {
        inner[PINC_NU + i] = z[PINC_NX + PINC_ND + i];
    }
#endif
#if !PINC_DISTURBED_INPUTS && (PINC_NP == 0)
    (void)z;
#endif
}

/* What is not of the model: disturbances of states, and that disturbances and parameters stay. */
static void pinc_stay(const PINC_REAL *z, PINC_REAL *next)
{
    int i;
#if PINC_DISTURBED_STATES
    for (i = 0; i < PINC_ND; i++) {
        next[pinc_place[i]] += z[PINC_NX + i];
    }
#endif
    for (i = PINC_NX; i < PINC_NZ; i++) {
        next[i] = z[i];
    }
}

#if PINC_HAS_BOUNDS
/* Moves an estimate into its bounds. */
static void pinc_clip(PINC_REAL *z)
{
    int i;
    for (i = 0; i < PINC_NZ; i++) {
        if (z[i] < pinc_low[i]) {
            z[i] = pinc_low[i];
        }
        if (z[i] > pinc_high[i]) {
            z[i] = pinc_high[i];
        }
    }
}
#endif

#if PINC_HAS_RANGES
/* Scales a covariance so that no variance is beyond its limit. */
static void pinc_limit(PINC_REAL *p)
{
    int i;
    int k;
    for (k = 0; k < PINC_NZ; k++) {
        const PINC_REAL variance = p[(k * PINC_NZ) + k];
        if (variance > pinc_most_variance[k]) {
            const PINC_REAL factor = PINC_MATH(sqrt)(pinc_most_variance[k] / variance);
            for (i = 0; i < PINC_NZ; i++) {
                p[(k * PINC_NZ) + i] *= factor;
            }
            for (i = 0; i < PINC_NZ; i++) {
                p[(i * PINC_NZ) + k] *= factor;
            }
        }
    }
}
#endif

/* ---- The innovation gate -------------------------------------------------------------------- */

/* Whether an innovation of this variance passes; an infinite square is beyond any bound. */
static int pinc_passes(PINC_REAL innovation, PINC_REAL variance)
{
    return ((innovation * innovation) > (PINC_GATE * variance)) ? 0 : 1;
}

/* Takes note of whether the reading of quantity i passed. */
static void pinc_note(pinc_estimator *e, int i, int passed)
{
    const int most = PINC_PATIENCE_OF_GATE * (PINC_DOUBLINGS + 2);
    const int in_vain = e->reacquired[i];
    e->reacquired[i] = 0;
    e->rejections[i] = (passed != 0) ? 0 : (e->rejections[i] + 1);
    if (e->rejections[i] > most) {
        e->rejections[i] -= PINC_PATIENCE_OF_GATE;
    }
    if (passed != 0) {
        e->doubt[i] -= (e->doubt[i] > 0) ? 1 : 0;
    } else if (e->doubt[i] == most) {
        /* The widest covariance stays due as often as the others. */
        e->doubt[i] -= PINC_PATIENCE_OF_GATE - 1;
    } else {
        e->doubt[i] += 1 + ((in_vain != 0) ? PINC_PATIENCE_OF_GATE : 0);
        e->doubt[i] = (e->doubt[i] < most) ? e->doubt[i] : most;
    }
}

/* Takes note that the rejected reading of quantity i passed with a widened covariance: if the next
   one is rejected too, it is widened further at once. */
static void pinc_note_reacquired(pinc_estimator *e, int i)
{
    pinc_note(e, i, 1);
    e->reacquired[i] = 1;
}

/* How often the standard deviations are doubled to judge quantity i again, whose last reading was
   rejected; -1 if that is not due. */
static int pinc_widening(const pinc_estimator *e, int i)
{
    const int times = e->doubt[i] / PINC_PATIENCE_OF_GATE;
    if ((e->rejections[i] == 0) || (times == 0) ||
        ((e->doubt[i] % PINC_PATIENCE_OF_GATE) != 0)) {
        return -1;
    }
    return (times > PINC_DOUBLINGS) ? PINC_DOUBLINGS : (times - 1);
}

/* The variance of entry k of z, widened. */
static PINC_REAL pinc_wide(const pinc_estimator *e, int k, int doublings)
{
    const PINC_REAL least = (PINC_REAL)(1L << (2 * doublings)) * pinc_widened[k];
    const PINC_REAL own = e->p[(k * PINC_NZ) + k];
    return (own > least) ? own : least;
}

/* Widens the covariance. */
static void pinc_widen(pinc_estimator *e, int doublings)
{
    int k;
    for (k = 0; k < PINC_NZ; k++) {
        const PINC_REAL variance = pinc_wide(e, k, doublings);
        pinc_fill(e->p + (k * PINC_NZ), PINC_N(0), PINC_NZ);
        e->p[(k * PINC_NZ) + k] = variance;
    }
}

/* How a correction ends that would have ended with this status without the gate. */
static pinc_estimate_status pinc_judged(const pinc_estimator *e, int rejected,
                                        pinc_estimate_status status)
{
    if (e->widened != 0) {
        return PINC_REACQUIRED;
    }
    return (rejected > 0) ? PINC_READING_REJECTED : status;
}

@KALMAN@
/* ---- The estimator -------------------------------------------------------------------------- */

static void pinc_estimator_init(pinc_estimator *e)
{
    int i;
    memset(e, 0, sizeof(*e));
    pinc_copy(e->z, pinc_initial, PINC_NZ);
    for (i = 0; i < PINC_NZ; i++) {
        e->p[(i * PINC_NZ) + i] = pinc_initial_variance[i];
    }
@BEGIN@}

/* Corrects the estimate, and moves it into its bounds. */
static pinc_estimate_status pinc_estimate(pinc_estimator *e, const PINC_REAL *y)
{
    const pinc_estimate_status status = pinc_@ESTIMATE@_correct(e, y);
#if PINC_HAS_BOUNDS
    pinc_clip(e->z);
#endif
    return status;
}

/* ---- With the controller -------------------------------------------------------------------- */

/* Takes the input u for the one that was given so far, under which the first measurement is read. */
static void pinc_hold_inputs(pinc_feedback *f, const PINC_REAL *u)
{
    int i;
    pinc_copy(f->estimator.u, u, PINC_NU);
    for (i = 0; i <= PINC_DELAY; i++) {
        pinc_copy(f->inputs + (i * PINC_NU), u, PINC_NU);
    }
}

/* Begins with the first estimate and the initial input. */
static void pinc_begin(pinc_feedback *f)
{
    pinc_estimator_init(&f->estimator);
    f->estimate_status = PINC_NOTHING_MEASURED;
    pinc_copy(f->x, f->estimator.z, PINC_NX);
    pinc_hold_inputs(f, pinc_initial_input);
    f->begun = 0;
    f->mark = PINC_MARK;
}

void pinc_feedback_init(pinc_feedback *f)
{
    memset(f, 0, sizeof(*f));
    pinc_mpc_init(&f->controller);
    pinc_begin(f);
}

void pinc_feedback_reset(pinc_feedback *f)
{
    if (f->mark != PINC_MARK) {
        pinc_feedback_init(f);
    } else {
        pinc_mpc_reset(&f->controller);
        pinc_begin(f);
    }
}

void pinc_feedback_reset_to(pinc_feedback *f, const PINC_REAL u[PINC_NU])
{
    pinc_feedback_reset(f);
    if (pinc_all_finite(u, PINC_NU) != 0) {
        pinc_mpc_reset_input(&f->controller, u);
        pinc_hold_inputs(f, u);
    }
}

pinc_status pinc_feedback_set_applied(pinc_feedback *f, const PINC_REAL u[PINC_NU])
{
    pinc_status status = PINC_NOT_INITIALIZED;
    if (f->mark == PINC_MARK) {
        status = pinc_mpc_set_applied(&f->controller, u);
    }
    if (status == PINC_CONVERGED) {
        pinc_copy(f->inputs + (PINC_DELAY * PINC_NU), u, PINC_NU);
    }
    return status;
}

pinc_status pinc_feedback_step(pinc_feedback *f, const PINC_REAL y[PINC_NM],
                               const PINC_REAL reference[PINC_N2 * PINC_NY],
                               PINC_REAL u[PINC_NU])
{
    pinc_status status;
    int i;
    if (f->mark != PINC_MARK) {
        /* The controller answers for both. */
        f->controller.mark = 0UL;
        return pinc_mpc_step(&f->controller, f->x, reference, u);
    }
    pinc_mpc_start_clock(&f->controller);
    if (f->begun != 0) {
        /* By the input that acted since; it is known only now. */
        pinc_@ESTIMATE@_predict(&f->estimator, f->inputs);
        for (i = 0; i < PINC_DELAY * PINC_NU; i++) {
            f->inputs[i] = f->inputs[i + PINC_NU];
        }
    }
    f->estimate_status = pinc_estimate(&f->estimator, y);
    pinc_copy(f->x, f->estimator.z, PINC_NX);
#if PINC_DISTURBED_OUTPUTS
    for (i = 0; i < PINC_NM; i++) {
        if (pinc_measured[i] < PINC_NX) {
            f->x[pinc_measured[i]] += f->estimator.z[PINC_NX + i];
        }
    }
#endif
#if PINC_NW > 0
    pinc_copy(f->controller.unknown, f->estimator.z + PINC_NX, PINC_NW);
#endif
    status = pinc_mpc_step(&f->controller, f->x, reference, u);
    pinc_copy(f->inputs + (PINC_DELAY * PINC_NU), u, PINC_NU);
    f->begun = 1;
    return status;
}
