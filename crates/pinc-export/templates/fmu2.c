@BANNER@
/* A slave of the Functional Mock-up Interface, version 2.0. */
#include "pinc_@HEADER@.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

/* ---- The interface, as far as it is needed -------------------------------------------------- */

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
    fmi2DoStepStatus,
    fmi2PendingStatus,
    fmi2LastSuccessfulTime,
    fmi2Terminated
} fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

@MODEL_PART@
typedef struct {
    pinc_slave slave;
    /* The mode behind the initialization. */
    int run;
    fmi2CallbackFunctions callbacks;
    int is_silent;
    /* The name, behind this. */
    char *name;
} pinc_instance;

static pinc_slave *pinc_of(fmi2Component instance)
{
    return &((pinc_instance *)instance)->slave;
}

/* Logs why a call fails, which is no debug message that an instance is to be asked for. The text is the format,
   as loggers in other languages print it as it is; it has no percent sign. */
static void pinc_say(fmi2Component c, fmi2Status status, const char *text)
{
    const pinc_instance *instance = (pinc_instance *)c;
    const fmi2CallbackFunctions *to = &instance->callbacks;
    if ((to->logger != NULL) && (instance->is_silent == 0)) {
        to->logger(to->componentEnvironment, instance->name, status, "error", text);
    }
}

#ifdef __cplusplus
extern "C" {
#endif

@COMMON@
/* ---- Functions of every slave --------------------------------------------------------------- */

PINC_EXPORT const char *PINC_FMI(fmi2GetTypesPlatform)(void)
{
    return "default";
}

PINC_EXPORT const char *PINC_FMI(fmi2GetVersion)(void)
{
    return "2.0";
}

PINC_EXPORT fmi2Component PINC_FMI(fmi2Instantiate)(fmi2String name, fmi2Type type,
                                                    fmi2String guid, fmi2String resources,
                                                    const fmi2CallbackFunctions *callbacks,
                                                    fmi2Boolean visible, fmi2Boolean logging)
{
    pinc_instance *instance;
    (void)resources;
    (void)visible;
    (void)logging;
    if ((name == NULL) || (callbacks == NULL)) {
        return NULL;
    }
    if ((@OTHER_KIND@) || (guid == NULL) || (strcmp(guid, PINC_GUID) != 0)) {
        if (callbacks->logger != NULL) {
            callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "error",
                              "expected @KINDS@ with the GUID %s", PINC_GUID);
        }
        return NULL;
    }
    instance = (pinc_instance *)calloc(1, sizeof(pinc_instance) + strlen(name) + 1);
    if (instance != NULL) {
        instance->run = (type == fmi2CoSimulation) ? PINC_STEPPING : PINC_EXCHANGING;
        instance->callbacks = *callbacks;
        instance->name = strcpy((char *)(instance + 1), name);
        pinc_set_defaults(&instance->slave);
    }
    return instance;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean toleranceDefined,
                                                     fmi2Real tolerance, fmi2Real startTime,
                                                     fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    return (pinc_set_up(c, startTime, stopTimeDefined, stopTime) != 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2EnterInitializationMode)(fmi2Component c)
{
    return pinc_initialize(c);
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[],
                                             size_t n, fmi2Real value[])
{
    size_t i;
    int good = pinc_is_readable(c);
    for (i = 0; (i < n) && (good != 0); i++) {
        good = pinc_read(c, vr[i], &value[i]);
    }
    return (good != 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[],
                                             size_t n, const fmi2Real value[])
{
    size_t i;
    int good = 1;
    for (i = 0; (i < n) && (good != 0); i++) {
        good = pinc_write(c, vr[i], value[i]);
    }
    pinc_apply(pinc_of(c));
    return (good != 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetInteger)(fmi2Component c, const fmi2ValueReference vr[],
                                                size_t n, fmi2Integer value[])
{
    size_t i;
    int good = pinc_is_readable(c);
    for (i = 0; (i < n) && (good != 0); i++) {
        good = pinc_read_status(c, vr[i], &value[i]);
    }
    return (good != 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2DoStep)(fmi2Component c, fmi2Real from, fmi2Real length,
                                            fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    return pinc_do_step(c, from, length);
}

@EXCHANGE@/* ---- What this slave has not ---------------------------------------------------------------- */

PINC_EXPORT fmi2Status PINC_FMI(fmi2SetInteger)(fmi2Component c, const fmi2ValueReference vr[],
                                                size_t n, const fmi2Integer value[])
{
    (void)c;
    (void)vr;
    (void)value;
    return (n == 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference vr[],
                                                size_t n, fmi2Boolean value[])
{
    (void)c;
    (void)vr;
    (void)value;
    return (n == 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference vr[],
                                                size_t n, const fmi2Boolean value[])
{
    (void)c;
    (void)vr;
    (void)value;
    return (n == 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetString)(fmi2Component c, const fmi2ValueReference vr[],
                                               size_t n, fmi2String value[])
{
    (void)c;
    (void)vr;
    (void)value;
    return (n == 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2SetString)(fmi2Component c, const fmi2ValueReference vr[],
                                               size_t n, const fmi2String value[])
{
    (void)c;
    (void)vr;
    (void)value;
    return (n == 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetDirectionalDerivative)(
    fmi2Component c, const fmi2ValueReference unknown[], size_t nUnknown,
    const fmi2ValueReference known[], size_t nKnown, const fmi2Real dKnown[], fmi2Real dUnknown[])
{
    (void)c;
    (void)unknown;
    (void)nUnknown;
    (void)known;
    (void)nKnown;
    (void)dKnown;
    (void)dUnknown;
    return fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2SetRealInputDerivatives)(fmi2Component c,
                                                             const fmi2ValueReference vr[],
                                                             size_t n, const fmi2Integer order[],
                                                             const fmi2Real value[])
{
    (void)c;
    (void)vr;
    (void)order;
    (void)value;
    return (n == 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetRealOutputDerivatives)(fmi2Component c,
                                                              const fmi2ValueReference vr[],
                                                              size_t n, const fmi2Integer order[],
                                                              fmi2Real value[])
{
    (void)c;
    (void)vr;
    (void)order;
    (void)value;
    return (n == 0) ? fmi2OK : fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2CancelStep)(fmi2Component c)
{
    (void)c;
    return fmi2Error;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetStatus)(fmi2Component c, fmi2StatusKind kind,
                                               fmi2Status *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetRealStatus)(fmi2Component c, fmi2StatusKind kind,
                                                   fmi2Real *value)
{
    if (kind == fmi2LastSuccessfulTime) {
        *value = pinc_of(c)->time;
        return fmi2OK;
    }
    return fmi2Discard;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetIntegerStatus)(fmi2Component c, fmi2StatusKind kind,
                                                      fmi2Integer *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetBooleanStatus)(fmi2Component c, fmi2StatusKind kind,
                                                      fmi2Boolean *value)
{
    (void)c;
    if (kind == fmi2Terminated) {
        *value = 0;
        return fmi2OK;
    }
    return fmi2Discard;
}

PINC_EXPORT fmi2Status PINC_FMI(fmi2GetStringStatus)(fmi2Component c, fmi2StatusKind kind,
                                                     fmi2String *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

#ifdef __cplusplus
}
#endif
