/* ---- What slaves of all versions have ------------------------------------------------------- */

/* Whether an instance is in one of these modes; says what is expected if not. */
static int pinc_is_in(@INSTANCE@ c, int modes, const char *expected)
{
    if ((pinc_of(c)->mode & modes) == 0) {
        pinc_say(c, @FMI@Error, expected);
        return 0;
    }
    return 1;
}

/* Takes the times of a run over; 0 if they are none. */
static int pinc_set_up(@INSTANCE@ c, double start, int stops, double stop)
{
    if (pinc_is_in(c, PINC_INSTANTIATED | PINC_SET_UP, "a run is set up before it begins") == 0) {
        return 0;
    }
    if ((pinc_are_finite(&start, 1) == 0) || ((stops != 0) && !(stop >= start))) {
        pinc_say(c, @FMI@Error, "a run needs a finite start time and a stop time that is not before it");
        return 0;
    }
    pinc_of(c)->time = start;
    pinc_of(c)->mode = PINC_SET_UP;
    return 1;
}

static @FMI@Status pinc_initialize(@INSTANCE@ c)
{
    if (pinc_is_in(c, PINC_SET_UP, "the initialization begins after the set-up, and once") == 0) {
        return @FMI@Error;
    }
    pinc_of(c)->mode = PINC_INITIALIZING;
    (void)pinc_begin_run(pinc_of(c));
    return @FMI@OK;
}

/* Whether variables can be read. */
static int pinc_is_readable(@INSTANCE@ c)
{
    return pinc_is_in(c, PINC_INITIALIZING | PINC_STEPPING | PINC_EXCHANGING | PINC_TERMINATED,
                      "variables are read from the initialization on");
}

/* Reads a real variable; 0 if there is none. */
static int pinc_read(@INSTANCE@ c, size_t place, double *value)
{
    if (place >= PINC_REALS) {
        pinc_say(c, @FMI@Error, "no real variable has this value reference");
        return 0;
    }
    if (place < PINC_FIRST_SET) {
        pinc_refresh(pinc_of(c));
    }
    *value = pinc_of(c)->reals[place];
    return 1;
}

/* Reads how a step ended; 0 if there is no such variable. */
static int pinc_read_status(@INSTANCE@ c, size_t place, int *value)
{
    if (place >= PINC_STATUSES) {
        pinc_say(c, @FMI@Error, "no enumeration has this value reference");
        return 0;
    }
    pinc_refresh(pinc_of(c));
    *value = pinc_of(c)->status[place];
    return 1;
}

/* Sets a real variable; 0 if that cannot be set, or not any more. */
static int pinc_write(@INSTANCE@ c, size_t place, double value)
{
    const int before = PINC_INSTANTIATED | PINC_SET_UP | PINC_INITIALIZING;
    const int fixed = (place >= PINC_FIRST_FIXED) && (place < PINC_FIRST_FIXED + PINC_FIXED);
    if ((place < PINC_FIRST_SET) || (place >= PINC_REALS)) {
        pinc_say(c, @FMI@Error, "no real variable that can be set has this value reference");
        return 0;
    }
    if (pinc_is_in(c, (fixed != 0) ? before : (before | PINC_STEPPING | PINC_EXCHANGING),
                   "start values are set before the end of the initialization, and others before that "
                   "of the run") == 0) {
        return 0;
    }
    pinc_of(c)->reals[place] = value;
    return 1;
}

/* What was set acts: in the initialization the run begins with it. */
static void pinc_apply(pinc_slave *s)
{
    if (s->mode == PINC_INITIALIZING) {
        (void)pinc_begin_run(s);
    } else {
        pinc_changed(s);
    }
}

/* Goes on by a communication step, or leaves all as it was. */
static @FMI@Status pinc_do_step(@INSTANCE@ c, double from, double length)
{
    pinc_slave *s = pinc_of(c);
    if (pinc_is_in(c, PINC_STEPPING, "steps are taken in co-simulation, after the initialization") == 0) {
        return @FMI@Error;
    }
    if (!((fabs(from - s->time) <= pinc_slack(s->time)) && (from + length > from) &&
          (length <= PINC_LONGEST_S))) {
        pinc_say(c, @FMI@Error, "a step begins where the last one ended and has a length above 0, of at "
                             "most 1e5 sample times");
        return @FMI@Error;
    }
    if (pinc_advance(s, from, length) != 0) {
        pinc_say(c, @FMI@Discard, "the step was not taken: " PINC_REFUSAL);
        return @FMI@Discard;
    }
    return @FMI@OK;
}

/* Switches off what pinc_say logs, the only category, or on again. */
PINC_EXPORT @FMI@Status PINC_FMI(@FMI@SetDebugLogging)(@INSTANCE@ c, @FMI@Boolean on, size_t n,
                                                     const @FMI@String categories[])
{
    size_t i = 0;
    while ((i < n) && (strcmp(categories[i], "error") != 0)) {
        i++;
    }
    if ((n == 0) || (i < n)) {
        ((pinc_instance *)c)->is_silent = on ? 0 : 1;
    }
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@ExitInitializationMode)(@INSTANCE@ c)
{
    if (pinc_is_in(c, PINC_INITIALIZING, "the initialization ends after it has begun") == 0) {
        return @FMI@Error;
    }
    if (pinc_begin_run(pinc_of(c)) != 0) {
        pinc_say(c, @FMI@Error, "a start value (_start) is not a number within its bounds");
        return @FMI@Error;
    }
    pinc_of(c)->mode = ((pinc_instance *)c)->run;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Terminate)(@INSTANCE@ c)
{
    if (pinc_is_in(c, PINC_STEPPING | PINC_EXCHANGING, "a run ends after it has begun, and once") == 0) {
        return @FMI@Error;
    }
    pinc_of(c)->mode = PINC_TERMINATED;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Reset)(@INSTANCE@ c)
{
    pinc_set_defaults(pinc_of(c));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Set@STATE@)(@INSTANCE@ c, @FMI@@STATE@ state)
{
    memcpy(pinc_of(c), state, sizeof(pinc_slave));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Serialized@STATE@Size)(@INSTANCE@ c, @FMI@@STATE@ state,
                                                            size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(pinc_slave);
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Serialize@STATE@)(@INSTANCE@ c, @FMI@@STATE@ state,
                                                       @FMI@Byte bytes[], size_t size)
{
    (void)c;
    if (size != sizeof(pinc_slave)) {
        return @FMI@Error;
    }
    memcpy(bytes, state, size);
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Get@STATE@)(@INSTANCE@ c, @FMI@@STATE@ *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(pinc_slave));
    }
    if (*state == NULL) {
        return @FMI@Error;
    }
    memcpy(*state, pinc_of(c), sizeof(pinc_slave));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Free@STATE@)(@INSTANCE@ c, @FMI@@STATE@ *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@@DESERIALIZE@@STATE@)(@INSTANCE@ c, const @FMI@Byte bytes[],
                                                         size_t size, @FMI@@STATE@ *state)
{
    if (size != sizeof(pinc_slave)) {
        return @FMI@Error;
    }
    if (PINC_FMI(@FMI@Get@STATE@)(c, state) != @FMI@OK) {
        return @FMI@Error;
    }
    memcpy(*state, bytes, size);
    return @FMI@OK;
}

PINC_EXPORT void PINC_FMI(@FMI@FreeInstance)(@INSTANCE@ c)
{
    free(c);
}

