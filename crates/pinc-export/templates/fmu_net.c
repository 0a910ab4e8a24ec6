/* Value references: states, then inputs, then initial states. */
static double *pinc_outputs(pinc_slave *s)
{
    return s->reals;
}

static int pinc_begin_run(pinc_slave *s)
{
    int i;
    for (i = 0; i < PINC_NX; i++) {
        s->state[i] = PINC_N(s->reals[PINC_NX + PINC_NU + i]);
        pinc_outputs(s)[i] = s->reals[PINC_NX + PINC_NU + i];
    }
    for (i = 0; i < PINC_NU; i++) {
        s->input[i] = PINC_N(s->reals[PINC_NX + i]);
    }
    s->origin = s->time;
    s->marks = 0.0;
    return 1 - pinc_are_finite(pinc_outputs(s), PINC_NX);
}

static void pinc_refresh(pinc_slave *s)
{
    (void)s;
}

static void pinc_changed(pinc_slave *s)
{
    (void)s;
}

/* Takes the inputs over; if they change within a step of the net, a new chain begins. */
static void pinc_take_inputs(pinc_slave *s, double slack)
{
    const double begin = s->origin + (s->marks * PINC_SAMPLE_TIME_S);
    int changed = 0;
    int i;
    for (i = 0; i < PINC_NU; i++) {
        const PINC_REAL value = PINC_N(s->reals[PINC_NX + i]);
        if ((value < s->input[i]) || (value > s->input[i])) {
            changed = 1;
        }
        s->input[i] = value;
    }
    if ((changed != 0) && (fabs(s->time - begin) > slack)) {
        for (i = 0; i < PINC_NX; i++) {
            s->state[i] = PINC_N(pinc_outputs(s)[i]);
        }
        s->origin = s->time;
        s->marks = 0.0;
    }
}

/* Chains the net up to the end of a communication step; 0 if it has a value there. */
static int pinc_chain(pinc_slave *s, double from, double length)
{
    const double end = from + length;
    const double slack = pinc_slack(end);
    PINC_REAL next[PINC_NX];
    double begin;
    int i;
    s->time = from;
    pinc_take_inputs(s, slack);
    while (end >= s->origin + ((s->marks + 1.0) * PINC_SAMPLE_TIME_S) - slack) {
        pinc_net_step(s->state, s->input, next);
        memcpy(s->state, next, sizeof(next));
        s->marks += 1.0;
    }
    begin = s->origin + (s->marks * PINC_SAMPLE_TIME_S);
    if (fabs(end - begin) <= slack) {
        memcpy(next, s->state, sizeof(next));
    } else {
@BETWEEN@    }
    for (i = 0; i < PINC_NX; i++) {
        pinc_outputs(s)[i] = (double)next[i];
    }
    s->time = end;
    return 1 - pinc_are_finite(pinc_outputs(s), PINC_NX);
}

/* Goes on by a communication step; 0 if that is possible, and all is as before if not. */
static int pinc_advance(pinc_slave *s, double from, double length)
{
    const pinc_slave before = *s;
    const int refused = pinc_chain(s, from, length);
    if (refused != 0) {
        *s = before;
    }
    return refused;
}
