@BANNER@
#ifndef PINC_MPC_H
#define PINC_MPC_H

#include "pinc_@MODEL@.h"

#ifdef __cplusplus
extern "C" {
#endif

/** N2, the prediction horizon in steps. */
#define PINC_N2 @N2@
/** Nu, the number of free inputs. */
#define PINC_NC @NC@
/** Number of controlled quantities. */
#define PINC_NY @NY@
/** How many whole steps pass until an input acts. */
#define PINC_DELAY @DELAY@
@UNKNOWNS@/** How many quadratic programs a step may solve. */
#define PINC_MAX_ITERATIONS @MAX_ITERATIONS@
/** The largest KKT residual that counts as converged. */
#define PINC_KKT_TOLERANCE PINC_PICK(@KKT_TOLERANCE@, @KKT_TOLERANCE_FLOAT@)

/** A constant by the type of all numbers. */
#define PINC_PICK_double(in_double, in_float) PINC_N(in_double)
#define PINC_PICK_float(in_double, in_float) PINC_N(in_float)
#define PINC_PICK(in_double, in_float) PINC_JOIN(PINC_PICK_, PINC_REAL)(in_double, in_float)

/* Lengths: all predicted states, all free inputs, all unknowns z = (x_1, .., u_0, ..). */
#define PINC_STATES (PINC_N2 * PINC_NX)
#define PINC_INPUTS (PINC_NC * PINC_NU)
#define PINC_UNKNOWNS (PINC_STATES + PINC_INPUTS)
/* Rows of the condensed program besides the bounds on inputs: bounded states, increments and
   outputs. */
#define PINC_STATE_ROWS @STATE_ROWS@
#define PINC_INCREMENT_ROWS @INCREMENT_ROWS@
#define PINC_OUTPUT_ROWS @OUTPUT_ROWS@
#define PINC_ROWS (PINC_STATE_ROWS + PINC_INCREMENT_ROWS + PINC_OUTPUT_ROWS)
#define PINC_LIMITS (PINC_INPUTS + PINC_ROWS)
/* Whether outputs are tracked. */
#define PINC_TRACKS_OUTPUTS @TRACKS_OUTPUTS@
/* C has no arrays of length 0. */
#define PINC_ROOM(count) (((count) > 0) ? (count) : 1)

/** How a step ended. The input is within its bounds in any case. */
typedef enum {
    /** The KKT residual is within the tolerance. */
    PINC_CONVERGED = 0,
    /** It is not, after all the iterations that are allowed. */
    PINC_ITERATION_LIMIT = 1,
    /** It is not, and the budget is spent. */
    PINC_DEADLINE = 2,
    /** No plan satisfies the dynamics and the hard constraints, near the one found. */
    PINC_INFEASIBLE_QP = 3,
    /** The residual is above the tolerance, and no step makes the plan better. */
    PINC_STALLED = 4,
    /** The model gave NaN or infinity, or a quadratic program could not be solved. */
    PINC_NUMERICAL_TROUBLE = 5,
    /** An argument is not finite; nothing has happened, and u is the last input. */
    PINC_BAD_ARGUMENT = 6
} pinc_status;

/* The multipliers of dynamics, of bounds, of increments and of outputs. */
typedef struct {
    PINC_REAL dynamics[PINC_STATES];
    PINC_REAL bounds[PINC_UNKNOWNS];
    PINC_REAL increments[PINC_INPUTS];
    PINC_REAL outputs[PINC_ROOM(PINC_OUTPUT_ROWS)];
} pinc_multipliers;

/* A plan with its multipliers. */
typedef struct {
    PINC_REAL z[PINC_UNKNOWNS];
    pinc_multipliers m;
} pinc_plan;

/* The control problem linearized at a plan. */
typedef struct {
    PINC_REAL a[PINC_STATES * PINC_NX];
    PINC_REAL b[PINC_STATES * PINC_NU];
    PINC_REAL c[PINC_STATES];
    PINC_REAL gradient[PINC_UNKNOWNS];
    PINC_REAL low[PINC_UNKNOWNS];
    PINC_REAL high[PINC_UNKNOWNS];
    PINC_REAL increment_low[PINC_INPUTS];
    PINC_REAL increment_high[PINC_INPUTS];
    PINC_REAL output_low[PINC_ROOM(PINC_OUTPUT_ROWS)];
    PINC_REAL output_high[PINC_ROOM(PINC_OUTPUT_ROWS)];
    PINC_REAL output_x[PINC_ROOM(PINC_OUTPUT_ROWS * PINC_NX)];
    PINC_REAL output_u[PINC_ROOM(PINC_OUTPUT_ROWS * PINC_NU)];
#if PINC_TRACKS_OUTPUTS
    /* The part of the Hessian that changes: by x and x, by u and x, by u and u. */
    PINC_REAL q[PINC_STATES * PINC_NX];
    PINC_REAL s[PINC_N2 * PINC_NU * PINC_NX];
    PINC_REAL t[PINC_INPUTS * PINC_NU];
#endif
} pinc_qp;

/* The same in the inputs alone, and the memory of the active-set method. */
typedef struct {
    PINC_REAL hessian[PINC_INPUTS * PINC_INPUTS];
    PINC_REAL gradient[PINC_INPUTS];
    PINC_REAL matrix[PINC_ROOM(PINC_INPUTS * PINC_ROWS)];
    PINC_REAL low[PINC_LIMITS];
    PINC_REAL high[PINC_LIMITS];
    PINC_REAL penalty[PINC_LIMITS];
    PINC_REAL response[PINC_STATES];
    PINC_REAL offset[PINC_STATES];
    PINC_REAL adjoint[2][PINC_NX];
    PINC_REAL factor[PINC_INPUTS * PINC_INPUTS];
    PINC_REAL inverse_diagonal[PINC_INPUTS];
    PINC_REAL q[PINC_INPUTS * PINC_INPUTS];
    PINC_REAL r[PINC_INPUTS * PINC_INPUTS];
    PINC_REAL x[PINC_INPUTS];
    PINC_REAL y[PINC_INPUTS];
    PINC_REAL z[PINC_INPUTS];
    PINC_REAL w[PINC_INPUTS];
    PINC_REAL rates[PINC_INPUTS];
    PINC_REAL mu[PINC_LIMITS];
    PINC_REAL values[PINC_LIMITS];
    PINC_REAL bound[PINC_INPUTS];
    PINC_REAL least[PINC_INPUTS];
    PINC_REAL most[PINC_INPUTS];
    int working[PINC_INPUTS];
    int members;
    int changes;
    PINC_REAL tolerance;
} pinc_dense;

/* What is known of the plan that an optimization ends with: the residual is its own; or the budget
   was spent when a program had been solved, and the plan is its solution, not linearized at; or
   within a program, and the plan is on the way to its solution. */
typedef enum { PINC_JUDGED = 0, PINC_STEPPED = 1, PINC_UNDERWAY = 2 } pinc_standing;

/** A controller: all of its memory. Set up by pinc_mpc_init. */
typedef struct {
    /**
     * How often a step may ask whether to go on, which it does before each quadratic program,
     * each change of active rows but the first of a program, and each further trial of a step; in
     * large controllers within linearizing, condensing and factoring too. 0: no limit. A step that
     * spends it ends with PINC_DEADLINE, and what it reached goes on in the next.
     */
    long budget;
    /** How many quadratic programs the last step solved. */
    int iterations;
    /**
     * The KKT residual that the last step ended with; of a plan that there was no budget to judge,
     * that of the one before.
     */
    PINC_REAL kkt;
    /** Whether the last input is of the plan that the step ended with. */
    int followed;
@UNKNOWN_FIELD@
    /* The rest is private. */
    pinc_plan plan;
    pinc_plan fallback;
    pinc_plan base;
    pinc_qp qp[2];
    int at;
    pinc_dense dense;
    PINC_REAL penalty[PINC_STATES];
    PINC_REAL output_penalty[PINC_ROOM(PINC_OUTPUT_ROWS)];
    PINC_REAL d[PINC_UNKNOWNS];
    pinc_multipliers step;
    pinc_multipliers weights;
    PINC_REAL last_step[PINC_UNKNOWNS];
    PINC_REAL last_length;
    int steps;
    PINC_REAL work[PINC_UNKNOWNS];
    PINC_REAL previous[PINC_NU];
    PINC_REAL pending[PINC_ROOM(PINC_DELAY * PINC_NU)];
    PINC_REAL start[PINC_NX];
    PINC_REAL bounds_residual;
    PINC_REAL dynamics_residual;
    long spent;
    int warm;
    /* Whether the plan is a guess only, and for how many steps it has been. */
    int tentative;
    int waited;
    /* Whether nobody knows what the model says of the plan. */
    int unjudged;
    int has_fallback;
    pinc_standing standing;
    int elastic;
} pinc_mpc;

/** Sets a controller up. Nothing else has to be done before the first step. */
void pinc_mpc_init(pinc_mpc *m);

/** Forgets everything but the budget: the next step is again the first. */
void pinc_mpc_reset(pinc_mpc *m);

/** Begins anew at a plant that is at x and has been given the input u so far. */
void pinc_mpc_reset_to(pinc_mpc *m, const PINC_REAL x[PINC_NX], const PINC_REAL u[PINC_NU]);

/**
 * Says which input the plant was really given in place of the last one chosen. An input that is
 * beyond the bounds or not finite is refused with PINC_BAD_ARGUMENT and changes nothing; the status
 * is PINC_CONVERGED otherwise.
 */
pinc_status pinc_mpc_set_applied(pinc_mpc *m, const PINC_REAL u[PINC_NU]);

/**
 * Chooses the input u for a plant measured to be at x. The reference has a row of PINC_NY numbers
 * for each of the PINC_N2 steps: what the state is to be at their ends (with a delay of d steps,
 * d steps later).
 */
pinc_status pinc_mpc_step(pinc_mpc *m, const PINC_REAL x[PINC_NX],
                          const PINC_REAL reference[PINC_N2 * PINC_NY], PINC_REAL u[PINC_NU]);

/** The word for a status, as "converged". */
const char *pinc_status_name(pinc_status status);

#ifdef __cplusplus
}
#endif

#endif
