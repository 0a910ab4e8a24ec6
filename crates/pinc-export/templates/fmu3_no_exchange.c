PINC_ABSENT(fmi3EnterEventMode, fmi3Instance c)
PINC_ABSENT(fmi3EnterContinuousTimeMode, fmi3Instance c)
PINC_ABSENT(fmi3UpdateDiscreteStates, fmi3Instance c, bool *discrete, bool *terminate,
            bool *nominals, bool *values, bool *defined, double *next)
PINC_ABSENT(fmi3CompletedIntegratorStep, fmi3Instance c, bool noSet, bool *enter, bool *terminate)
PINC_ABSENT(fmi3SetTime, fmi3Instance c, double time)
PINC_ABSENT(fmi3SetContinuousStates, fmi3Instance c, const double states[], size_t n)
PINC_ABSENT(fmi3GetContinuousStates, fmi3Instance c, double states[], size_t n)
PINC_ABSENT(fmi3GetContinuousStateDerivatives, fmi3Instance c, double derivatives[], size_t n)
PINC_ABSENT(fmi3GetNominalsOfContinuousStates, fmi3Instance c, double nominals[], size_t n)
PINC_ABSENT(fmi3GetNumberOfContinuousStates, fmi3Instance c, size_t *n)
PINC_ABSENT(fmi3GetNumberOfEventIndicators, fmi3Instance c, size_t *n)
PINC_ABSENT(fmi3GetEventIndicators, fmi3Instance c, double indicators[], size_t n)
PINC_EXPORT fmi3Instance PINC_FMI(fmi3InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    return NULL;
}
