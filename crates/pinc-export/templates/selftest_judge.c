#define PINC_IS_FLOAT (sizeof(PINC_REAL) == sizeof(float))
/* The number of steps that are compared: later ones depend on rounding. */
#define PINC_COMPARED (PINC_IS_FLOAT ? @FLOAT_STEPS@ : @DOUBLE_STEPS@)

/* What a number of each step may differ by in single precision, relative to its unit plus its size: what its
   rounding, and the residual that is asked for, leave. */
@ALLOWED@
/* The difference that is the largest part of what is allowed in its step. */
static double pinc_worst = 0.0;
static double pinc_limit = PINC_IS_FLOAT ? @FLOAT@ : @DOUBLE@;

static void pinc_compare(int k, PINC_REAL found, double expected, PINC_REAL unit)
{
    const double off = fabs((double)found - expected) / ((double)unit + fabs(expected));
    const double allowed = PINC_IS_FLOAT ? pinc_allowed_float[k] : @DOUBLE@;
    if ((k < PINC_COMPARED) && !((off * pinc_limit) <= (pinc_worst * allowed))) {
        pinc_worst = (off <= 1e300) ? off : 1.0;
        pinc_limit = allowed;
    }
}

/* What else does not hold; the first of it is said, with its step unless that is negative. */
static int pinc_failures = 0;

static void pinc_require(int holds, int k, const char *otherwise)
{
    if (holds != 0) {
        return;
    }
    pinc_failures++;
    if (pinc_failures > 3) {
        return;
    }
    printf("@name@: ");
    if (k >= 0) {
        printf("step %d (t = %g s): ", k, (double)PINC_SAMPLE_TIME_S * (double)k);
    }
    printf("%s\n", otherwise);
}

/* A step of the controller ended with this status. */
static void pinc_require_step(int k, pinc_status status)
{
    pinc_require((status != PINC_NUMERICAL_TROUBLE) ? 1 : 0, k,
                 "PINC_NUMERICAL_TROUBLE: the model gave no finite number, or a quadratic program "
                 "could not be solved");
    pinc_require((status != PINC_BAD_ARGUMENT) ? 1 : 0, k,
                 "PINC_BAD_ARGUMENT: a state, measurement or reference is not finite");
}

/* Says how far numbers are off, and returns 0 if that is allowed and nothing else failed. */
static int pinc_judge(void)
{
    const int is_far = (pinc_worst <= pinc_limit) ? 0 : 1;
    const int bad = ((is_far != 0) || (pinc_failures > 0)) ? 1 : 0;
    printf("@name@: %d steps, largest difference %.2e, allowed %.2e\n", PINC_STEPS, pinc_worst,
           pinc_limit);
    if (PINC_COMPARED < PINC_STEPS) {
        printf("@name@: numbers from step %d on depend on rounding and are not compared\n",
               PINC_COMPARED);
    }
    if (pinc_failures > 0) {
        printf("@name@: failed: %d of the other checks, the first of them above\n", pinc_failures);
    }
    if (is_far != 0) {
        printf("@name@: failed: the difference is larger than allowed\n");
    }
    if ((bad != 0) && PINC_IS_FLOAT) {
        printf("@name@: single precision is not enough for this controller: take double\n");
    }
    return bad;
}
