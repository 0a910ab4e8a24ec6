#ifdef @FMI_UPPER@_FUNCTION_PREFIX
#define PINC_FMI(name) PINC_JOIN(@FMI_UPPER@_FUNCTION_PREFIX, name)
#else
#define PINC_FMI(name) name
#endif
#ifdef _WIN32
#define PINC_EXPORT __declspec(dllexport)
#else
#define PINC_EXPORT __attribute__((visibility("default")))
#endif

/* ---- The model ------------------------------------------------------------------------------ */

#define PINC_GUID "@GUID@"
/* Real variables, by their value references; from the first on those that can be set. */
#define PINC_REALS @REALS@
#define PINC_FIRST_SET @FIRST_SET@
/* Those that are fixed once the run has begun. */
#define PINC_FIRST_FIXED @FIRST_FIXED@
#define PINC_FIXED @FIXED@
/* Integer variables: how the step ended, and how the correction of the estimator, if there is one. */
#define PINC_STATUSES @STATUSES@

/* What a step that cannot be taken is logged with. */
#define PINC_REFUSAL "@REFUSAL@"

static const double pinc_starts[PINC_REALS] = {
@STARTS@};

/* The modes of an instance, from its instantiation on. */
#define PINC_INSTANTIATED 1
#define PINC_SET_UP 2
#define PINC_INITIALIZING 4
#define PINC_STEPPING 8
#define PINC_EXCHANGING 16
#define PINC_TERMINATED 32

/* The longest communication step. */
#define PINC_LONGEST_S (1e5 * PINC_SAMPLE_TIME_S)

typedef struct {
    int mode;
    /* The time of the last communication point. */
    double time;
    double reals[PINC_REALS];
    int status[PINC_STATUSES];
@FIELDS@} pinc_slave;

/* Whether all of these are finite. */
static int pinc_are_finite(const double *values, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        const double difference = values[i] - values[i];
        if (!(difference <= 0.0)) {
            return 0;
        }
    }
    return 1;
}

/* How far times may be apart that differ by rounding. */
static double pinc_slack(double time)
{
    return 1e-9 * ((fabs(time) > PINC_SAMPLE_TIME_S) ? fabs(time) : PINC_SAMPLE_TIME_S);
}

@MODEL_CODE@

static void pinc_set_defaults(pinc_slave *s)
{
    memset(s, 0, sizeof(*s));
    s->mode = PINC_INSTANTIATED;
    memcpy(s->reals, pinc_starts, sizeof(s->reals));
    (void)pinc_begin_run(s);
}
