/** Whether the net was trusted in the first step of the plan. */
typedef enum {
    /** Nothing was judged: no plan was followed. */
    PINC_NOT_JUDGED = 0,
    /** The estimated error is within the tolerances. */
    PINC_TRUSTED = 1,
    /** It is not, and the plan was followed all the same. */
    PINC_DOUBTED = 2,
    /** It is not, and the step was repeated @SUBSTITUTE@. */
    PINC_SUBSTITUTED = 3
} pinc_trust;

/* Whether steps are repeated. */
#define PINC_REPEATS @REPEATS@
#if PINC_REPEATS
/* What a step starts from. */
typedef struct {
    pinc_plan plan;
    pinc_plan fallback;
    int warm;
    int unplaced;
    int tentative;
    int waited;
    int unjudged;
    int has_fallback;
} pinc_origin;
#endif

