@BANNER@
#ifndef PINC_FEEDBACK_H
#define PINC_FEEDBACK_H

#include "pinc_mpc.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Number of measured quantities. */
#define PINC_NM @NM@
/** Number of all that is estimated: states, disturbances, parameters. */
#define PINC_NZ (PINC_NX + PINC_NW)
/* Whether the estimate has bounds. */
#define PINC_HAS_BOUNDS @HAS_BOUNDS@
/* The larger of the two sizes. */
#define PINC_WIDEST_POINT ((PINC_NM > PINC_NZ) ? PINC_NM : PINC_NZ)

/** How a correction by what was measured ended. */
typedef enum {
    /** As it should. */
    PINC_UPDATED = 0,
    /** Nothing was measured: the prediction is the estimate. */
    PINC_NOTHING_MEASURED = 1,
    /** The covariance would have lost its definiteness: the last one was kept. */
    PINC_INDEFINITE_COVARIANCE = 2,
    /** The new estimate would not have been finite: the last one was kept. */
    PINC_NOT_FINITE = 3,
    /** The innovation gate rejected readings; the others were used. */
    PINC_READING_REJECTED = 6,
    /** After too many rejections in a row the covariance was widened, and the reading used. */
    PINC_REACQUIRED = 7@MORE_STATUSES@
} pinc_estimate_status;

@TYPES@/** The estimator: @FILTER@. */
typedef struct {
    /** The estimate: states, disturbances, parameters. */
    PINC_REAL z[PINC_NZ];
    /** Its covariance, row by row. */
    PINC_REAL p[PINC_NZ * PINC_NZ];
    /** How often the readings of each quantity were rejected in a row (35 is followed by 31); 0 if
        the last one was used. */
    int rejections[PINC_NM];

    /* The rest is private: how many more rejections than passes each quantity has had, whether its
       last reading passed with a widened covariance only, the input that acted last, whether the
       covariance was widened, and memory. */
    int doubt[PINC_NM];
    int reacquired[PINC_NM];
    PINC_REAL u[PINC_NU];
    int widened;
@MEMORY@} pinc_estimator;

/**
 * A controller with its estimator: all of their memory. Set up by pinc_feedback_init. A copy saves
 * their state, as a copy of a pinc_mpc saves the controller's.
 */
typedef struct {
    /** The controller, with its budget, and what its last step did. */
    pinc_mpc controller;
    /** The estimator. */
    pinc_estimator estimator;
    /** How its last correction ended. */
    pinc_estimate_status estimate_status;
    /** The state that the controller took the plant to be in. */
    PINC_REAL x[PINC_NX];

    /* The rest is private: inputs under way, the next to act first; the input until now. */
    PINC_REAL inputs[(PINC_DELAY + 1) * PINC_NU];
    int begun;
    unsigned long mark;
} pinc_feedback;

/**
 * Sets controller and estimator up for a plant that has been given @INITIAL_INPUT_TEXT@ so far.
 * Nothing else has to be done before the first step.
 */
void pinc_feedback_init(pinc_feedback *f);

/** Begins as after pinc_feedback_init, with the controller's limits and its clock as they are. */
void pinc_feedback_reset(pinc_feedback *f);

/** Begins anew at a plant that has been given the input u so far. */
void pinc_feedback_reset_to(pinc_feedback *f, const PINC_REAL u[PINC_NU]);

/**
 * Says which input was sent to the plant in place of the last one chosen; with a delay of d steps it
 * acts d steps later, as that one would have. An input that is
 * beyond the controller's bounds or not finite is refused with PINC_BAD_ARGUMENT and changes
 * nothing, as a struct that was not set up is with PINC_NOT_INITIALIZED; the status is PINC_CONVERGED
 * otherwise.
 */
pinc_status pinc_feedback_set_applied(pinc_feedback *f, const PINC_REAL u[PINC_NU]);

/**
 * Chooses the input u for a plant of which y was measured; missing values of y are NaN. The
 * reference has the form that pinc_mpc_step takes. The estimator makes its step even if the
 * reference is not finite; its time is part of the step's budget.
 */
pinc_status pinc_feedback_step(pinc_feedback *f, const PINC_REAL y[PINC_NM],
                               const PINC_REAL reference[PINC_N2 * PINC_NY],
                               PINC_REAL u[PINC_NU]);

#ifdef __cplusplus
}
#endif

#endif
