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
/* Integer variables: how the step ended, and how the correction of the estimator, if there is one. */
#define PINC_STATUSES @STATUSES@

/* What a step that cannot be taken is logged with. */
#define PINC_REFUSAL "@REFUSAL@"

static const double pinc_starts[PINC_REALS] = {
@STARTS@};

typedef struct {
    /* The time of the last communication point. */
    double time;
    double reals[PINC_REALS];
    int status[PINC_STATUSES];
@FIELDS@} pinc_slave;

@MODEL_CODE@

static void pinc_set_defaults(pinc_slave *s)
{
    memset(s, 0, sizeof(*s));
    memcpy(s->reals, pinc_starts, sizeof(s->reals));
    (void)pinc_begin_run(s);
}
