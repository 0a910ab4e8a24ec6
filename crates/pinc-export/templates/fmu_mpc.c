/* Value references: inputs of the plant, estimated states if there is an estimator, then what is
   measured, then references, then the inputs before the first sample. */
#define PINC_ESTIMATED @ESTIMATED@
#define PINC_SEEN @SEEN@
#define PINC_FIRST_REFERENCE (PINC_FIRST_SET + PINC_SEEN)
#define PINC_FIRST_START @FIRST_START@
/* Then weights and bounds, as far as they can be changed. */
#define PINC_TUNES_WEIGHTS @TUNES_WEIGHTS@
#define PINC_FIRST_WEIGHT @FIRST_WEIGHT@
#define PINC_BOUNDS @BOUNDS@
#define PINC_FIRST_BOUND @FIRST_BOUND@
#if PINC_BOUNDS > 0
/* All bounds, low and high ones of states, then of inputs; which can be changed. */
@BOUND_TABLES@#endif

/* Gives the controller its weights and bounds; 0 if it refuses them. */
static int pinc_tune(pinc_slave *s)
{
    int good = 1;
#if PINC_TUNES_WEIGHTS
    PINC_REAL weights[PINC_NY + PINC_NU];
#endif
#if PINC_BOUNDS > 0
    PINC_REAL bounds[2 * (PINC_NX + PINC_NU)];
#endif
#if PINC_TUNES_WEIGHTS || (PINC_BOUNDS > 0)
    int i;
#else
    (void)s;
#endif
#if PINC_TUNES_WEIGHTS
    for (i = 0; i < PINC_NY + PINC_NU; i++) {
        weights[i] = PINC_N(s->reals[PINC_FIRST_WEIGHT + i]);
    }
    good &= (pinc_mpc_set_weights(&@MPC@, weights, weights + PINC_NY) == PINC_CONVERGED) ? 1 : 0;
#endif
#if PINC_BOUNDS > 0
    memcpy(bounds, pinc_bound, sizeof(bounds));
    for (i = 0; i < PINC_BOUNDS; i++) {
        bounds[pinc_bound_place[i]] = PINC_N(s->reals[PINC_FIRST_BOUND + i]);
    }
    good &= (pinc_mpc_set_bounds(&@MPC@, bounds, bounds + PINC_NX, bounds + (2 * PINC_NX),
                                 bounds + (2 * PINC_NX) + PINC_NU) == PINC_CONVERGED)
                ? 1
                : 0;
#endif
    return good;
}

/* Begins with the start values; 0 if an input that is given in place of the config's can be one that
   was applied. */
static int pinc_begin_run(pinc_slave *s)
{
    PINC_REAL u[PINC_NU];
    int given = 0;
    int refused = 0;
    int i;
    @CONTROLLER@_init(&s->before);
    for (i = 0; i < PINC_NU; i++) {
        const double value = s->reals[PINC_FIRST_START + i];
        const double own = pinc_starts[PINC_FIRST_START + i];
        u[i] = PINC_N(value);
        given = ((value >= own) && (value <= own)) ? given : 1;
    }
    if (given != 0) {
        s->after = s->before;
        (void)pinc_tune(s);
        refused = (@CONTROLLER@_set_applied(&s->after, u) == PINC_CONVERGED) ? 0 : 1;
        @RESET@(&s->before, u);
    }
    s->computed = 0;
    s->start = s->time;
    s->steps = 0.0;
    return refused;
}

/* Computes the step at hand, for what is measured and asked now. */
static void pinc_refresh(pinc_slave *s)
{
    PINC_REAL seen[PINC_SEEN];
    PINC_REAL reference[PINC_N2 * PINC_NY];
    PINC_REAL u[PINC_NU];
    int tuned;
    int i;
    if (s->computed != 0) {
        return;
    }
    for (i = 0; i < PINC_SEEN; i++) {
        seen[i] = PINC_N(s->reals[PINC_FIRST_SET + i]);
    }
    for (i = 0; i < PINC_N2 * PINC_NY; i++) {
        reference[i] = PINC_N(s->reals[PINC_FIRST_REFERENCE + (i % PINC_NY)]);
    }
    s->after = s->before;
    tuned = pinc_tune(s);
    s->status[0] = (int)@CONTROLLER@_step(&s->after, seen, reference, u);
    for (i = 0; i < PINC_NU; i++) {
        s->reals[i] = (double)u[i];
    }
#if PINC_ESTIMATED > 0
    s->status[1] = (int)s->after.estimate_status;
    for (i = 0; i < PINC_ESTIMATED; i++) {
        s->reals[PINC_NU + i] = (double)s->after.x[i];
    }
#endif
    if (tuned == 0) {
        s->status[0] = (int)PINC_BAD_ARGUMENT;
    }
@JUDGEMENTS@    s->computed = 1;
}

/* Whether it is time for a sample. */
static int pinc_is_sample(const pinc_slave *s, double time)
{
    return (time >= s->start + (s->steps * PINC_SAMPLE_TIME_S) - pinc_slack(time)) ? 1 : 0;
}

/* At a sample the step depends on what was set last; between samples the input is held. */
static void pinc_changed(pinc_slave *s)
{
    if (pinc_is_sample(s, s->time) != 0) {
        s->computed = 0;
    }
}

/* Goes on by a communication step; 0 if that is possible. */
static int pinc_advance(pinc_slave *s, double from, double length)
{
    const int is_sample = pinc_is_sample(s, from);
    const double steps = s->steps + (double)is_sample;
    if (from + length > s->start + (steps * PINC_SAMPLE_TIME_S) + (1e-6 * PINC_SAMPLE_TIME_S)) {
        /* A communication step must not pass a sample. */
        return 1;
    }
    if (is_sample != 0) {
        pinc_refresh(s);
        s->before = s->after;
        s->steps = steps;
    }
    s->time = from + length;
    if (pinc_is_sample(s, s->time) != 0) {
        s->computed = 0;
    }
    return 0;
}
