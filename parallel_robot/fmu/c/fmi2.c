/* The functions of FMI 2.0 for co-simulation. Types and names are those of the standard. */

#include <stddef.h>

typedef int Boolean;
typedef struct {
    void (*logger)(void *environment, const char *name, int status, const char *category,
                   const char *message, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *environment, int status);
    void *environment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2CallbackFunctions callbacks;
    char name[100];
} Log;

#define FMI(NAME) fmi2##NAME
#define STATE(VERB) fmi2##VERB##FMUstate
#define SERIALIZED_SIZE fmi2SerializedFMUstateSize
#define DESERIALIZE fmi2DeSerializeFMUstate
#define BEHIND
#define COUNT count

#include "functions.h"

typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated }
    fmi2StatusKind;

static void tell(const Log *log, const char *message)
{
    if (log->callbacks.logger)
        log->callbacks.logger(log->callbacks.environment, log->name, ERROR, "logStatusError", "%s",
                              message);
}

const char *fmi2GetTypesPlatform(void) { return "default"; }

const char *fmi2GetVersion(void) { return "2.0"; }

void *fmi2Instantiate(const char *name, fmi2Type type, const char *token, const char *resources,
                      const fmi2CallbackFunctions *callbacks, Boolean visible, Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    Log log = {0};
    if (callbacks)
        log.callbacks = *callbacks;
    snprintf(log.name, sizeof log.name, "%s", name ? name : "");
    return type == fmi2CoSimulation ? made(token, log) : 0;
}

Status fmi2SetupExperiment(void *component, Boolean with_tolerance, double tolerance, double start,
                           Boolean with_stop, double stop)
{
    (void)with_tolerance, (void)tolerance, (void)with_stop, (void)stop;
    INSTANCE->time = start;
    return OK;
}

Status fmi2EnterInitializationMode(void *component)
{
    return said(component, instance_begin(INSTANCE));
}

ACCESS(Real, double, REAL)
ACCESS(Integer, int, INTEGER)
ACCESS(Boolean, Boolean, BOOLEAN)

Status fmi2GetString(void *component, const uint32_t numbers[], size_t count, const char *values[])
{
    (void)component, (void)numbers, (void)values;
    return count ? ERROR : OK;
}

Status fmi2SetString(void *component, const uint32_t numbers[], size_t count,
                     const char *const values[])
{
    (void)component, (void)numbers, (void)values;
    return count ? ERROR : OK;
}

Status fmi2DoStep(void *component, double time, double step, Boolean keep)
{
    (void)keep;
    return said(component, instance_step(INSTANCE, time, step));
}

Status fmi2GetRealStatus(void *component, const fmi2StatusKind kind, double *value)
{
    if (kind != fmi2LastSuccessfulTime)
        return DISCARD;
    *value = INSTANCE->time;
    return OK;
}

Status fmi2GetBooleanStatus(void *component, const fmi2StatusKind kind, Boolean *value)
{
    (void)component;
    if (kind != fmi2Terminated)
        return DISCARD;
    *value = 0;
    return OK;
}

/* What this unit does not have, see modelDescription.xml. */
MISSING(GetStatus, DISCARD)
MISSING(GetIntegerStatus, DISCARD)
MISSING(GetStringStatus, DISCARD)
MISSING(GetDirectionalDerivative, ERROR)
MISSING(SetRealInputDerivatives, ERROR)
MISSING(GetRealOutputDerivatives, ERROR)
MISSING(CancelStep, ERROR)
