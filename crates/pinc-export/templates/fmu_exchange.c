/* ---- Model exchange: states and their derivatives, for the integrator of a tool -------------- */

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@EnterContinuousTimeMode)(@INSTANCE@ c)
{
    (void)c;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@EnterEventMode)(@INSTANCE@ c)
{
    (void)c;
    return @FMI@OK;
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
    pinc_of(c)->time = time;
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@SetContinuousStates)(@INSTANCE@ c, const double x[], size_t n)
{
    if (n != PINC_NX) {
        return @FMI@Error;
    }
    memcpy(pinc_of(c)->reals, x, n * sizeof(double));
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@GetContinuousStates)(@INSTANCE@ c, double x[], size_t n)
{
    if (n != PINC_NX) {
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
    size_t i;
    if (n != PINC_NX) {
        return @FMI@Error;
    }
    pinc_@RK@_derivative(s->reals, s->reals + PINC_INPUTS, dx);
    for (i = 0; i < n; i++) {
        const double difference = dx[i] - dx[i];
        if (!(difference <= 0.0)) {
            /* The equations have no value there: a shorter step may not go there. */
            return @FMI@Discard;
        }
    }
    return @FMI@OK;
}

PINC_EXPORT @FMI@Status PINC_FMI(@FMI@GetEventIndicators)(@INSTANCE@ c, double indicators[], size_t n)
{
    (void)c;
    (void)indicators;
    return (n == 0) ? @FMI@OK : @FMI@Error;
}

