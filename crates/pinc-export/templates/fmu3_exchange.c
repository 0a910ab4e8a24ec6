PINC_EXPORT fmi3Status PINC_FMI(fmi3UpdateDiscreteStates)(fmi3Instance c, bool *discrete,
                                                          bool *terminate, bool *nominals,
                                                          bool *values, bool *defined, double *next)
{
    (void)c;
    (void)next;
    *discrete = *terminate = *nominals = *values = *defined = false;
    return fmi3OK;
}

PINC_EXPORT fmi3Status PINC_FMI(fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *n)
{
    (void)c;
    *n = PINC_NX;
    return fmi3OK;
}

PINC_EXPORT fmi3Status PINC_FMI(fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *n)
{
    (void)c;
    *n = 0;
    return fmi3OK;
}

PINC_EXPORT fmi3Instance PINC_FMI(fmi3InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    const fmi3Instance c = PINC_FMI(fmi3InstantiateCoSimulation)(
        name, token, resources, visible, logging, false, false, NULL, 0, environment, log, NULL);
    if (c != NULL) {
        ((pinc_instance *)c)->run = PINC_EXCHANGING;
    }
    return c;
}

