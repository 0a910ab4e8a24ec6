/** How many steps the window of the estimator has. */
#define PINC_WINDOW @WINDOW@
/* Its states, and how many numbers these are. */
#define PINC_STAGES (PINC_WINDOW + 1)
#define PINC_STAGED (PINC_STAGES * PINC_NZ)
/* Rows of a stage: what is measured, and bounds behind. */
#define PINC_STAGE_ROWS (PINC_NM + (PINC_HAS_BOUNDS * PINC_NZ))

/* The states of the window, the oldest first, what led to each besides the model in standard
   deviations, and the multipliers of these equations and of the bounds. */
typedef struct {
    PINC_REAL x[PINC_STAGED];
    PINC_REAL v[PINC_STAGED];
    PINC_REAL dynamics[PINC_STAGED];
    PINC_REAL bounds[PINC_STAGED];
} pinc_horizon;

