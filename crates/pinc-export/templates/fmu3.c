@BANNER@
/* A slave of the Functional Mock-up Interface, version 3.0. */
#include "pinc_@HEADER@.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* ---- The interface, as far as it is needed -------------------------------------------------- */

#ifndef __cplusplus
#include <stdbool.h>
#endif

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef int32_t fmi3Int32;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);

@MODEL_PART@
/* Value references: 0 is the time, then the real variables from 1 on, then the statuses. */
#define PINC_FIRST_STATUS (PINC_REALS + 1)

typedef struct {
    pinc_slave slave;
    /* The mode behind the initialization. */
    int run;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    int is_silent;
} pinc_instance;

static pinc_slave *pinc_of(fmi3Instance instance)
{
    return &((pinc_instance *)instance)->slave;
}

/* Logs why a call fails, which is no debug message that an instance is to be asked for. */
static void pinc_say(fmi3Instance c, fmi3Status status, const char *text)
{
    const pinc_instance *instance = (pinc_instance *)c;
    if ((instance->log != NULL) && (instance->is_silent == 0)) {
        instance->log(instance->environment, status, "error", text);
    }
}

#ifdef __cplusplus
extern "C" {
#endif

@COMMON@
/* ---- Functions of every slave --------------------------------------------------------------- */

PINC_EXPORT const char *PINC_FMI(fmi3GetVersion)(void)
{
    return "3.0";
}

PINC_EXPORT fmi3Instance PINC_FMI(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean eventMode, fmi3Boolean earlyReturn,
    const fmi3ValueReference intermediate[], size_t nIntermediate,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, void *intermediateUpdate)
{
    pinc_instance *instance;
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)eventMode;
    (void)earlyReturn;
    (void)intermediate;
    (void)nIntermediate;
    (void)intermediateUpdate;
    if ((token == NULL) || (strcmp(token, PINC_GUID) != 0)) {
        if (log != NULL) {
            log(environment, fmi3Error, "error", "expected the token " PINC_GUID);
        }
        return NULL;
    }
    instance = (pinc_instance *)calloc(1, sizeof(pinc_instance));
    if (instance != NULL) {
        instance->run = PINC_STEPPING;
        instance->environment = environment;
        instance->log = log;
        pinc_set_defaults(&instance->slave);
    }
    return instance;
}

PINC_EXPORT fmi3Status PINC_FMI(fmi3EnterInitializationMode)(
    fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance, fmi3Float64 startTime,
    fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    if (pinc_set_up(c, startTime, stopTimeDefined, stopTime) == 0) {
        return fmi3Error;
    }
    return pinc_initialize(c);
}

PINC_EXPORT fmi3Status PINC_FMI(fmi3GetFloat64)(fmi3Instance c, const fmi3ValueReference vr[],
                                                size_t n, fmi3Float64 values[], size_t nValues)
{
    size_t i;
    int good = pinc_is_readable(c);
    for (i = 0; (i < n) && (i < nValues) && (good != 0); i++) {
        values[i] = pinc_of(c)->time;
        good = (vr[i] == 0) ? 1 : pinc_read(c, (size_t)vr[i] - 1, &values[i]);
    }
    return ((good != 0) && (n <= nValues)) ? fmi3OK : fmi3Error;
}

PINC_EXPORT fmi3Status PINC_FMI(fmi3SetFloat64)(fmi3Instance c, const fmi3ValueReference vr[],
                                                size_t n, const fmi3Float64 values[],
                                                size_t nValues)
{
    size_t i;
    int good = 1;
    for (i = 0; (i < n) && (i < nValues) && (good != 0); i++) {
        /* The time, which is 0 and cannot be set, becomes a place that there is not. */
        good = pinc_write(c, (size_t)vr[i] - 1, values[i]);
    }
    pinc_apply(pinc_of(c));
    return ((good != 0) && (n <= nValues)) ? fmi3OK : fmi3Error;
}

PINC_EXPORT fmi3Status PINC_FMI(fmi3GetInt64)(fmi3Instance c, const fmi3ValueReference vr[],
                                              size_t n, int64_t values[], size_t nValues)
{
    size_t i;
    int status = 0;
    int good = pinc_is_readable(c);
    for (i = 0; (i < n) && (i < nValues) && (good != 0); i++) {
        good = pinc_read_status(c, (size_t)vr[i] - PINC_FIRST_STATUS, &status);
        values[i] = status;
    }
    return ((good != 0) && (n <= nValues)) ? fmi3OK : fmi3Error;
}

PINC_EXPORT fmi3Status PINC_FMI(fmi3DoStep)(fmi3Instance c, fmi3Float64 from, fmi3Float64 length,
                                            fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                            fmi3Boolean *eventHandlingNeeded,
                                            fmi3Boolean *terminateSimulation,
                                            fmi3Boolean *earlyReturn, fmi3Float64 *lastTime)
{
    fmi3Status status;
    (void)noSetFMUStatePriorToCurrentPoint;
    *eventHandlingNeeded = false;
    *terminateSimulation = false;
    *earlyReturn = false;
    status = pinc_do_step(c, from, length);
    *lastTime = pinc_of(c)->time;
    return status;
}

@EXCHANGE@/* ---- What this slave has not ---------------------------------------------------------------- */

PINC_EXPORT fmi3Instance PINC_FMI(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    void *clockUpdate, void *lock, void *unlock)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)environment;
    (void)log;
    (void)clockUpdate;
    (void)lock;
    (void)unlock;
    return NULL;
}

/* Variables of a type that there are none of. */
#define PINC_NONE_OF(Type, type)                                                                   \
    PINC_EXPORT fmi3Status PINC_FMI(fmi3Get##Type)(                                                \
        fmi3Instance c, const fmi3ValueReference vr[], size_t n, type values[], size_t nValues)    \
    {                                                                                              \
        (void)c;                                                                                   \
        (void)vr;                                                                                  \
        (void)values;                                                                              \
        (void)nValues;                                                                             \
        return (n == 0) ? fmi3OK : fmi3Error;                                                      \
    }                                                                                              \
    PINC_NO_SETTER(Type, type)
#define PINC_NO_SETTER(Type, type)                                                                 \
    PINC_EXPORT fmi3Status PINC_FMI(fmi3Set##Type)(fmi3Instance c, const fmi3ValueReference vr[],  \
                                                   size_t n, const type values[], size_t nValues)  \
    {                                                                                              \
        (void)c;                                                                                   \
        (void)vr;                                                                                  \
        (void)values;                                                                              \
        (void)nValues;                                                                             \
        return (n == 0) ? fmi3OK : fmi3Error;                                                      \
    }

PINC_NO_SETTER(Int64, int64_t)
PINC_NONE_OF(Float32, float)
PINC_NONE_OF(Int8, int8_t)
PINC_NONE_OF(UInt8, uint8_t)
PINC_NONE_OF(Int16, int16_t)
PINC_NONE_OF(UInt16, uint16_t)
PINC_NONE_OF(UInt32, uint32_t)
PINC_NONE_OF(Int32, fmi3Int32)
PINC_NONE_OF(UInt64, uint64_t)
PINC_NONE_OF(Boolean, fmi3Boolean)
PINC_NONE_OF(String, fmi3String)

/* A function that nothing calls, as the model description says. */
#define PINC_ABSENT(name, ...)                                                                     \
    PINC_EXPORT fmi3Status PINC_FMI(name)(__VA_ARGS__);                                            \
    PINC_EXPORT fmi3Status PINC_FMI(name)(__VA_ARGS__)                                             \
    {                                                                                              \
        return fmi3Error;                                                                          \
    }

#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
PINC_ABSENT(fmi3GetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[],
            const fmi3Byte *values[], size_t nValues)
PINC_ABSENT(fmi3SetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            const size_t sizes[], const fmi3Byte *const values[], size_t nValues)
PINC_ABSENT(fmi3GetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n, bool values[])
PINC_ABSENT(fmi3SetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            const bool values[])
@NO_EXCHANGE@PINC_ABSENT(fmi3EnterStepMode, fmi3Instance c)
PINC_ABSENT(fmi3EnterConfigurationMode, fmi3Instance c)
PINC_ABSENT(fmi3ExitConfigurationMode, fmi3Instance c)
PINC_ABSENT(fmi3EvaluateDiscreteStates, fmi3Instance c)
PINC_ABSENT(fmi3GetNumberOfVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t *n)
PINC_ABSENT(fmi3GetVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t elements[],
            fmi3ValueReference independents[], size_t places[], int kinds[], size_t n)
PINC_ABSENT(fmi3GetDirectionalDerivative, fmi3Instance c, const fmi3ValueReference unknowns[],
            size_t nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns,
            const double seed[], size_t nSeed, double sensitivity[], size_t nSensitivity)
PINC_ABSENT(fmi3GetAdjointDerivative, fmi3Instance c, const fmi3ValueReference unknowns[],
            size_t nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns,
            const double seed[], size_t nSeed, double sensitivity[], size_t nSensitivity)
PINC_ABSENT(fmi3GetOutputDerivatives, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            const int32_t orders[], double values[], size_t nValues)
PINC_ABSENT(fmi3ActivateModelPartition, fmi3Instance c, fmi3ValueReference clock, double time)
PINC_ABSENT(fmi3GetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            double intervals[], int qualifiers[])
PINC_ABSENT(fmi3GetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            uint64_t counters[], uint64_t resolutions[], int qualifiers[])
PINC_ABSENT(fmi3GetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            double shifts[])
PINC_ABSENT(fmi3GetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            uint64_t counters[], uint64_t resolutions[])
PINC_ABSENT(fmi3SetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            const double intervals[])
PINC_ABSENT(fmi3SetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            const uint64_t counters[], const uint64_t resolutions[])
PINC_ABSENT(fmi3SetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            const double shifts[])
PINC_ABSENT(fmi3SetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n,
            const uint64_t counters[], const uint64_t resolutions[])
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

#ifdef __cplusplus
}
#endif
