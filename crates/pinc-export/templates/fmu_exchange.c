/* ---- Model exchange: states and their derivatives, for the integrator of a tool -------------- */

/* Whether the integrator of a tool is at work. */
static int pinc_exchanges(@INSTANCE@ c, int modes)
{
    return pinc_is_in(c, modes, "model exchange begins with the initialization");
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@EnterContinuousTimeMode)(@INSTANCE@ c)
{
    return (pinc_exchanges(c, PINC_EXCHANGING) != 0) ? @FMI@OK : @FMI@Error;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@EnterEventMode)(@INSTANCE@ c)
{
    return (pinc_exchanges(c, PINC_EXCHANGING) != 0) ? @FMI@OK : @FMI@Error;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@CompletedIntegratorStep)(@INSTANCE@ c, @FMI@Boolean noSet,
                                                             @FMI@Boolean *enterEventMode,
                                                             @FMI@Boolean *terminate)
{
    (void)c;
    (void)noSet;
    *enterEventMode = 0;
    *terminate = 0;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@SetTime)(@INSTANCE@ c, double time)
{
    if ((pinc_exchanges(c, PINC_EXCHANGING) == 0) || (pinc_are_finite(&time, 1) == 0)) {
        return @FMI@Error;
    }
    pinc_of(c)->time = time;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@SetContinuousStates)(@INSTANCE@ c, const double x[], size_t n)
{
    if ((n != PINC_NX) || (pinc_exchanges(c, PINC_EXCHANGING) == 0)) {
        return @FMI@Error;
    }
    memcpy(pinc_of(c)->reals, x, n * sizeof(double));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@GetContinuousStates)(@INSTANCE@ c, double x[], size_t n)
{
    if ((n != PINC_NX) || (pinc_exchanges(c, PINC_INITIALIZING | PINC_EXCHANGING) == 0)) {
        return @FMI@Error;
    }
    memcpy(x, pinc_of(c)->reals, n * sizeof(double));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@GetNominalsOfContinuousStates)(@INSTANCE@ c, double nominals[],
                                                                   size_t n)
{
    size_t i;
    (void)c;
    for (i = 0; i < n; i++) {
        nominals[i] = 1.0;
    }
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@Get@DERIVATIVES@)(@INSTANCE@ c, double dx[], size_t n)
{
    pinc_slave *s = pinc_of(c);
    if ((n != PINC_NX) || (pinc_exchanges(c, PINC_INITIALIZING | PINC_EXCHANGING) == 0)) {
        return @FMI@Error;
    }
    pinc_@RK@_derivative(s->reals, s->reals + PINC_INPUTS, dx);
    /* Where the equations have no value, a shorter step may not go. */
    return (pinc_are_finite(dx, PINC_NX) != 0) ? @FMI@OK : @FMI@Discard;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@GetEventIndicators)(@INSTANCE@ c, double indicators[], size_t n)
{
    (void)c;
    (void)indicators;
    return (n == 0) ? @FMI@OK : @FMI@Error;
}

