@BANNER@
#include "pinc_mpc.h"
@INCLUDE@
#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "this controller tests for infinity and NaN: compile it without -ffast-math"
#endif

#define PINC_INFINITY ((PINC_REAL)INFINITY)
/* A row counts as met when it is off by less than this, relative to 1 + |bound|. */
#define PINC_MET PINC_PICK(1e-11, 1e-5)
/* A row off by more than this that cannot be met makes a program infeasible. */
#define PINC_CONFLICT PINC_PICK(1e-8, 1e-3)
/* A normal of which less than this part is independent counts as dependent. */
#define PINC_DEPENDENT PINC_PICK(1e-10, 1e-4)
/* A pivot below this part of its diagonal entry counts as 0. */
#define PINC_SMALLEST_PIVOT PINC_PICK(1e-13, 1e-6)
/* A combination of rows proves a conflict if no x up to this can make up for its rounding. */
#define PINC_FARTHEST PINC_PICK(1e5, 1e2)
/* A working row that is off by more than this, relative to the numbers involved, is not met. */
#define PINC_NEAR PINC_PICK(1e-7, 1e-2)
/* Of a singular matrix: what is added to its diagonal at first, as a part of the largest entry; the
   slope that may be left, relative to 1 + the largest; and how many proximal points there are at most. */
#define PINC_PROXIMAL PINC_PICK(1e-10, 1e-4)
#define PINC_SLOPE PINC_PICK(1e-11, 1e-5)
#define PINC_CENTERS 30
/* What rounding makes of the merit function, relative to its value. */
#define PINC_NOISE PINC_PICK(1e-14, 1e-6)
/* The KKT residual's largest defect in the dynamics with which a plan is followed. */
#define PINC_CREDIBLE PINC_PICK(@CREDIBLE@, @CREDIBLE_FLOAT@)
/* Of the line search. */
#define PINC_CONTRACTION PINC_N(0.9)
#define PINC_SUFFICIENT PINC_N(1e-4)
#define PINC_HALVINGS 20
/* A row with a smaller multiplier is not active. */
#define PINC_ACTIVE PINC_PICK(1e-7, 1e-4)
/* Two differences of steps are independent if so much of one is orthogonal to the other. */
#define PINC_INDEPENDENT PINC_PICK(1e-8, 1e-3)
/* For how many steps a plan that was followed goes on without having been improved. */
#define PINC_MOST_WAITING 5
/* What is done between two questions whether the budget is spent: stages linearized, inputs
   condensed, columns of the Cholesky factor, rows of the first working set. */
#define PINC_UNASKED_STAGES (((PINC_NX + PINC_NU) > 8) ? 8 : 32)
#define PINC_OPERATIONS (4 * PINC_NU * PINC_N2 * PINC_NX * (PINC_NX + PINC_NU))
#define PINC_UNASKED_INPUTS ((PINC_OPERATIONS < 20000) ? (20000 / PINC_OPERATIONS) : 1)
#define PINC_UNASKED_COLUMNS 16
#define PINC_UNASKED_ROWS 8
/* Of the elastic mode: weight of violations, and whether bounds on states and outputs stay
   so soft. */
#define PINC_ELASTIC_WEIGHT PINC_PICK(1e3, 10)
#define PINC_STATES_EXACT @STATES_EXACT@
#define PINC_OUTPUTS_EXACT @OUTPUTS_EXACT@
/* Which hard bounds on states and outputs are soft for now. */
#define PINC_AS_STATED 0
#define PINC_EXACT_SOFT 1
#define PINC_ALL_SOFT 2
/* The largest entry of W. */
#define PINC_LARGEST_W PINC_N(@LARGEST_W@)
/* Rows of bounded outputs, as the mean of all multipliers counts them. */
#define PINC_ALL_OUTPUT_ROWS @ALL_OUTPUT_ROWS@
/* How many of them an interval has, and whether some are at its start. */
#define PINC_OUTPUT_WIDTH @OUTPUT_WIDTH@
#define PINC_OUTPUT_STARTS @OUTPUT_STARTS@
/* The first stage that is weighted, and whether the last has a weight of its own. */
#define PINC_N1 @N1@
#define PINC_HAS_TERMINAL @HAS_TERMINAL@
/* Whether bounds vary along the horizon. */
#define PINC_BOUNDS_VARY @BOUNDS_VARY@
/* The optimization's units, in the plant's units. */
#define PINC_COST_UNIT PINC_N(@COST_UNIT@)
#define PINC_HAS_UNITS @HAS_UNITS@
#if PINC_HAS_UNITS
#define PINC_X_UNIT(i) (pinc_x_unit[i])
#define PINC_U_UNIT(i) (pinc_u_unit[i])
#else
#define PINC_X_UNIT(i) PINC_N(1)
#define PINC_U_UNIT(i) PINC_N(1)
#endif
/* Whether the config says which input the plant has been given at first. */
#define PINC_HAS_INITIAL_INPUT @HAS_INITIAL_INPUT@
/* Values that the references have, one after the other, and whether later ones are known. */
#define PINC_SEGMENTS @SEGMENTS@
#define PINC_PREVIEW @PREVIEW@
/* Whether the sequence of inputs is weighted. */
#define PINC_HAS_W @HAS_W@
/* The bounds that plans keep, which a tube tightens. */
#define PINC_HAS_TUBE @HAS_TUBE@
#if PINC_HAS_TUBE
#define PINC_LOW(m) ((m)->tight_low)
#define PINC_HIGH(m) ((m)->tight_high)
#define PINC_OUTPUT_LOW(m) ((m)->tight_output_low)
#define PINC_OUTPUT_HIGH(m) ((m)->tight_output_high)
#else
#define PINC_LOW(m) ((m)->low)
#define PINC_HIGH(m) ((m)->high)
#define PINC_OUTPUT_LOW(m) pinc_output_low
#define PINC_OUTPUT_HIGH(m) pinc_output_high
#endif

@TABLES@@TUBE_TABLES@
@START@
@VECTORS@static PINC_REAL pinc_abs(PINC_REAL v)
{
    return PINC_MATH(fabs)(v);
}

static PINC_REAL pinc_max(PINC_REAL a, PINC_REAL b)
{
    return (a > b) ? a : b;
}

static PINC_REAL pinc_min(PINC_REAL a, PINC_REAL b)
{
    return (a < b) ? a : b;
}

/* sum += matrix vector */
static void pinc_add_product(const PINC_REAL *matrix, const PINC_REAL *v, PINC_REAL *sum, int rows,
                             int columns)
{
    int i;
    for (i = 0; i < rows; i++) {
        sum[i] += pinc_dot(matrix + (i * columns), v, columns);
    }
}

/* sum += matrix' vector */
static void pinc_add_transposed(const PINC_REAL *matrix, const PINC_REAL *v, PINC_REAL *sum,
                                int rows, int columns)
{
    int i;
    for (i = 0; i < rows; i++) {
        pinc_add_scaled(sum, v[i], matrix + (i * columns), columns);
    }
}

/* The index of the input that acts in stage j: the last is held. */
static int pinc_acting(int j)
{
    return (j < PINC_NC) ? j : (PINC_NC - 1);
}

/* Asks whether to go on: 1 if the budget is spent. */
static int pinc_expired(pinc_mpc *m)
{
    m->spent++;
    if ((m->budget > 0) && (m->spent > m->budget)) {
        return 1;
    }
    if ((m->clock_us == NULL) || (m->budget_us == 0UL)) {
        return 0;
    }
    return ((m->clock_us() - m->begun_us) >= m->budget_us) ? 1 : 0;
}

@DENSE@
@CONDENSE@
@PLANT@@OUTPUTS@@SQP@
@CHANGE@@SENSITIVITY@
