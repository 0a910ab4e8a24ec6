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
@UNKNOWNS@/** How many quadratic programs a step may solve, unless max_iterations is changed. */
#define PINC_MAX_ITERATIONS @MAX_ITERATIONS@
/** The config's budget_us, the time that a step may take, in us; 0: none. It needs a clock. */
#define PINC_BUDGET_US @BUDGET_US@
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
/* What an initialized controller is marked with. */
#define PINC_MARK 0x50494E43UL
/* Whether outputs are tracked. */
#define PINC_TRACKS_OUTPUTS @TRACKS_OUTPUTS@
/* Numbers of the weights of what is tracked, a block per stage. */
#define PINC_Q_WIDTH @Q_WIDTH@
#define PINC_WEIGHTS (PINC_N2 * PINC_Q_WIDTH * PINC_Q_WIDTH)
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
    /**
     * A measurement is missing, or an argument is not finite. Nothing was optimized, and u is the
     * last input, moved into its bounds.
     */
    PINC_BAD_ARGUMENT = 6,
    /** The struct was not set up by its init function; u is the initial input within its bounds. */
    PINC_NOT_INITIALIZED = 7
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

/* How many earlier steps accelerate one. */
#define PINC_DEPTH 2

/* A step of an optimization, and where it ended, from where that is now. */
typedef struct {
    PINC_REAL d[PINC_UNKNOWNS];
    pinc_plan end;
} pinc_past;

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
    PINC_REAL linear[PINC_INPUTS];
    PINC_REAL proximal;
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

@GUARD_TYPES@/**
 * A controller: all of its memory. Set up by pinc_mpc_init. A copy of it is the controller's state: a
 * program of the same build that assigns it goes on from there, without a bump.
 */
typedef struct {
    /**
     * How often a step may ask whether to go on, which it does before each quadratic program,
     * each change of active rows but the first of a program, and each further trial of a step; in
     * large controllers within linearizing, condensing and factoring too. 0: no limit. A step that
     * spends it ends with PINC_DEADLINE, and what it reached goes on in the next.
     */
    long budget;
    /**
     * How many quadratic programs a step may solve; one that solves them all without converging
     * ends with PINC_ITERATION_LIMIT. Without a clock this is what bounds a step's time.
     */
    int max_iterations;
    /**
     * Reads a clock that counts microseconds up to ULONG_MAX and goes on with 0; NULL: there is no
     * clock. It is read where the step asks whether to go on.
     */
    unsigned long (*clock_us)(void);
    /** How long a step may take by this clock, in us, before it ends with PINC_DEADLINE; 0: no
        limit. At first PINC_BUDGET_US. */
    unsigned long budget_us;
    /* Private, and kept by a reset: bounds on z and weights, twice, in the units of the optimization. */
    PINC_REAL low[PINC_UNKNOWNS];
    PINC_REAL high[PINC_UNKNOWNS];
    PINC_REAL q[PINC_WEIGHTS];
    PINC_REAL r[PINC_INPUTS * PINC_NU];
    /* A reset clears what follows. */
    /** How many quadratic programs the last step solved. */
    int iterations;
    /**
     * The KKT residual at the end of the last step; if there was no budget to judge its plan, the
     * residual of the plan before.
     */
    PINC_REAL kkt;
    /** Whether the last input is of the plan that the step ended with. */
    int followed;
    /** How many steps in a row, up to the last, did not end with PINC_CONVERGED: for a watchdog. */
    unsigned int missed;
@TRUST_FIELDS@@TUBE_FIELD@@UNKNOWN_FIELD@
    /* The rest is private. */
    unsigned long mark;
    pinc_plan plan;
    pinc_plan fallback;
    pinc_plan base;
@ORIGIN_FIELD@    pinc_qp qp[2];
    int at;
    pinc_dense dense;
    PINC_REAL penalty[PINC_STATES];
    PINC_REAL output_penalty[PINC_ROOM(PINC_OUTPUT_ROWS)];
@TUBE_MEMORY@    PINC_REAL d[PINC_UNKNOWNS];
    pinc_multipliers step;
    pinc_multipliers weights;
    pinc_past past[PINC_DEPTH + 1];
    int count;
    PINC_REAL work[PINC_UNKNOWNS];
    PINC_REAL previous[PINC_NU];
    PINC_REAL pending[PINC_ROOM(PINC_DELAY * PINC_NU)];
    PINC_REAL start[PINC_NX];
    PINC_REAL bounds_residual;
    PINC_REAL dynamics_residual;
    long spent;
    unsigned long begun_us;
    /* Whether the clock has been read for the step at hand. */
    int timed;
    int warm;
    /* Whether the first plan is to stay at the state of the first step. */
    int unplaced;
    /* Whether the plan is a guess only, and for how many steps it has been. */
    int tentative;
    int waited;
    /* Whether nobody knows what the model says of the plan. */
    int unjudged;
    int has_fallback;
    pinc_standing standing;
    int elastic;
} pinc_mpc;

/**
 * Sets a controller up for a plant that has been given @INITIAL_INPUT_TEXT@ so far.
 * Nothing else has to be done before the first step.
 */
void pinc_mpc_init(pinc_mpc *m);

/**
 * Begins as after pinc_mpc_init, with the limits, the clock, the weights and the bounds as they
 * are.
 */
void pinc_mpc_reset(pinc_mpc *m);

/** Begins anew at a plant that has been given the input u so far, wherever it is. */
void pinc_mpc_reset_input(pinc_mpc *m, const PINC_REAL u[PINC_NU]);

/** Begins anew at a plant that is at x and has been given the input u so far. */
void pinc_mpc_reset_to(pinc_mpc *m, const PINC_REAL x[PINC_NX], const PINC_REAL u[PINC_NU]);

/**
 * Says which input was sent to the plant in place of the last one chosen; with a delay of d steps it
 * acts d steps later, as that one would have. An input that is
 * beyond the bounds or not finite is refused with PINC_BAD_ARGUMENT and changes nothing, as a struct
 * that was not set up is with PINC_NOT_INITIALIZED; the status is PINC_CONVERGED otherwise.
 */
pinc_status pinc_mpc_set_applied(pinc_mpc *m, const PINC_REAL u[PINC_NU]);

/**
 * Replaces the weights between two steps: q of what is tracked (@TRACKED@),
 * r of changes of the inputs, both as in the config, diagonal and the same in all stages@TERMINAL_TEXT@.
 * A number that is negative or not finite is refused with PINC_BAD_ARGUMENT and changes nothing; the
 * status is PINC_CONVERGED otherwise.
 */
pinc_status pinc_mpc_set_weights(pinc_mpc *m, const PINC_REAL q[PINC_NY],
                                 const PINC_REAL r[PINC_NU]);

/**
 * Replaces the bounds of states and inputs between two steps, in the plant's units; an infinite one
 * is none. Refused with PINC_BAD_ARGUMENT, which changes nothing: a low bound that is not <= the high
 * one@BAKED_TEXT@.
 * Bounds of outputs and of changes of the inputs are the config's.
 */
pinc_status pinc_mpc_set_bounds(pinc_mpc *m, const PINC_REAL x_low[PINC_NX],
                                const PINC_REAL x_high[PINC_NX], const PINC_REAL u_low[PINC_NU],
                                const PINC_REAL u_high[PINC_NU]);

/** Reads the clock for the step that follows, where its budget is to include other work. */
void pinc_mpc_start_clock(pinc_mpc *m);

/**
 * Writes the reference of a step at t_s seconds from the start: the config's schedule by the
 * controller's rule. @PREVIEW_TEXT@
 *
 * Columns: @TRACKED@.
 */
void pinc_reference(double t_s, PINC_REAL rows[PINC_N2 * PINC_NY]);

/**
 * Chooses the input u for a plant measured to be at x. A number of x that is missing is NaN.
 *
 * The reference has PINC_N2 rows of PINC_NY numbers, in the order of pinc_reference. Row j, from 0,
 * is what is to be reached at the end of the step that begins j steps from now (with a delay of d
 * steps, j + d). In a schedule its value is read at the beginning of this step: a row that ends
 * exactly at a change still has the value from before the change.
 */
pinc_status pinc_mpc_step(pinc_mpc *m, const PINC_REAL x[PINC_NX],
                          const PINC_REAL reference[PINC_N2 * PINC_NY], PINC_REAL u[PINC_NU]);

#ifdef PINC_SENSITIVITY
/** Whether the input of a step is a differentiable function of what the step was given. */
typedef enum {
    /** It is. */
    PINC_REGULAR = 0,
    /** A constraint is about to become active or inactive; the derivatives are those of the side on
        which it is inactive. */
    PINC_KINK = 1,
    /** Active constraints depend on each other, or the cost does not determine the plan; the
        derivatives are NaN. */
    PINC_SINGULAR = 2,
    /** The step did not converge, or was given something else than is said here. */
    PINC_NOT_OPTIMAL = 3
} pinc_regularity;

/** The derivatives of the input that a step chose, in the plant's units. */
typedef struct {
    /** In x, PINC_NU rows of PINC_NX numbers; with a delay, in the state predicted for the time at
        which the input acts. */
    PINC_REAL by_state[PINC_NU * PINC_NX];
    /** In the input applied before it, PINC_NU rows of PINC_NU numbers; with a delay, the predicted
        state does not move with it. */
    PINC_REAL by_applied[PINC_NU * PINC_NU];
    /** In the reference, PINC_NU rows of PINC_N2 rows of PINC_NY numbers. */
    PINC_REAL by_reference[PINC_NU * PINC_N2 * PINC_NY];
    /* The rest is private. */
    PINC_REAL matrix[4 * PINC_INPUTS * PINC_INPUTS];
    PINC_REAL right[2 * PINC_INPUTS * (PINC_NX + (2 * PINC_NU))];
    PINC_REAL z[PINC_UNKNOWNS];
    PINC_REAL direction[PINC_UNKNOWNS];
    PINC_REAL change[PINC_UNKNOWNS];
    PINC_REAL values[PINC_INPUTS];
    PINC_REAL size[PINC_NX + PINC_NU];
    PINC_REAL previous[PINC_NU];
    int rows[PINC_INPUTS];
    int upper[PINC_INPUTS];
    int active;
} pinc_sensitivity;

/**
 * Differentiates the input of the last step, which was given `reference` and found u_before applied
 * last, with the exact Hessian of the Lagrangian, by central differences of its gradient: as much
 * work as 2 (PINC_INPUTS + PINC_NX + PINC_NU) evaluations of the model and its Jacobians along the
 * horizon, whatever the budget. The steps that follow are as without it.
 */
pinc_regularity pinc_mpc_sensitivity(pinc_mpc *m, const PINC_REAL reference[PINC_N2 * PINC_NY],
                                     const PINC_REAL u_before[PINC_NU], pinc_sensitivity *s);
#endif

/** The word for a status, as "converged". */
const char *pinc_status_name(pinc_status status);

#ifdef __cplusplus
}
#endif

#endif
