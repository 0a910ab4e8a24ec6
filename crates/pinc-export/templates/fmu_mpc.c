/* Value references: inputs of the plant, then its measured states, then references. */
static void pinc_begin_run(pinc_slave *s)
{
    pinc_mpc_init(&s->before);
    s->computed = 0;
    s->start = s->time;
    s->steps = 0.0;
}

/* Computes the step at hand, for what is measured and asked now. */
static void pinc_refresh(pinc_slave *s)
{
    PINC_REAL x[PINC_NX];
    PINC_REAL reference[PINC_N2 * PINC_NY];
    PINC_REAL u[PINC_NU];
    int i;
    if (s->computed != 0) {
        return;
    }
    for (i = 0; i < PINC_NX; i++) {
        x[i] = PINC_N(s->reals[PINC_NU + i]);
    }
    for (i = 0; i < PINC_N2 * PINC_NY; i++) {
        reference[i] = PINC_N(s->reals[PINC_NU + PINC_NX + (i % PINC_NY)]);
    }
    s->after = s->before;
    s->status = (int)pinc_mpc_step(&s->after, x, reference, u);
    for (i = 0; i < PINC_NU; i++) {
        s->reals[i] = (double)u[i];
    }
    s->computed = 1;
}

/* Whether the time is that of a sample. */
static int pinc_is_sample(const pinc_slave *s, double time)
{
    const double largest = (fabs(time) > PINC_SAMPLE_TIME_S) ? fabs(time) : PINC_SAMPLE_TIME_S;
    return (time >= s->start + (s->steps * PINC_SAMPLE_TIME_S) - (1e-9 * largest)) ? 1 : 0;
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
    s->time = from;
    if (pinc_is_sample(s, from) != 0) {
        pinc_refresh(s);
        s->before = s->after;
        s->steps += 1.0;
    }
    s->time = from + length;
    if (s->time > s->start + (s->steps * PINC_SAMPLE_TIME_S) + (1e-6 * PINC_SAMPLE_TIME_S)) {
        /* A communication step must not pass a sample. */
        return 1;
    }
    if (pinc_is_sample(s, s->time) != 0) {
        s->computed = 0;
    }
    return 0;
}
