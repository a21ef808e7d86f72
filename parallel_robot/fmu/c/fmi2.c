/* The functions of FMI 2.0 for co-simulation. Types and names are those of the standard. */

#include <string.h>
#include <stdio.h>
#include <stdlib.h>

#include "instance.h"

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated }
    fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String name, fmi2Status, fmi2String category,
                   fmi2String message, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment environment;
} fmi2CallbackFunctions;

typedef struct {
    Instance *instance;
    fmi2CallbackFunctions callbacks;
    char name[100];
} Unit;

#define UNIT ((Unit *)component)
#define INSTANCE (UNIT->instance)

static fmi2Status said(fmi2Component component, int well)
{
    if (well)
        return fmi2OK;
    if (UNIT->callbacks.logger)
        UNIT->callbacks.logger(UNIT->callbacks.environment, UNIT->name, fmi2Error,
                               "logStatusError", "%s", INSTANCE->message);
    return fmi2Error;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }

const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count,
                               const fmi2String categories[])
{
    (void)component, (void)on, (void)count, (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String identifier,
                              fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || !identifier || strcmp(identifier, guid))
        return 0;
    Unit *unit = calloc(1, sizeof *unit);
    if (!unit || !(unit->instance = instance_new())) {
        free(unit);
        return 0;
    }
    if (callbacks)
        unit->callbacks = *callbacks;
    snprintf(unit->name, sizeof unit->name, "%s", name ? name : "");
    return unit;
}

void fmi2FreeInstance(fmi2Component component)
{
    if (component)
        instance_free(INSTANCE);
    free(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean with_tolerance,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean with_stop,
                               fmi2Real stop)
{
    (void)with_tolerance, (void)tolerance, (void)with_stop, (void)stop;
    INSTANCE->time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    return said(component, instance_begin(INSTANCE));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    return said(component, instance_begin(INSTANCE));
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component)
{
    instance_reset(INSTANCE);
    return fmi2OK;
}

/* Get and set variables of a type; there are no texts. */
#define ACCESS(NAME, TYPE, KIND)                                                                  \
    fmi2Status fmi2Get##NAME(fmi2Component component, const fmi2ValueReference numbers[],         \
                             size_t count, TYPE values[])                                         \
    {                                                                                             \
        for (size_t k = 0; k < count; k++) {                                                      \
            double value;                                                                         \
            if (!instance_get(INSTANCE, numbers[k], KIND, &value))                                \
                return said(component, 0);                                                        \
            values[k] = (TYPE)value;                                                              \
        }                                                                                         \
        return fmi2OK;                                                                            \
    }                                                                                             \
    fmi2Status fmi2Set##NAME(fmi2Component component, const fmi2ValueReference numbers[],         \
                             size_t count, const TYPE values[])                                   \
    {                                                                                             \
        for (size_t k = 0; k < count; k++)                                                        \
            if (!instance_set(INSTANCE, numbers[k], KIND, (double)values[k]))                     \
                return said(component, 0);                                                        \
        return fmi2OK;                                                                            \
    }

ACCESS(Real, fmi2Real, REAL)
ACCESS(Integer, fmi2Integer, INTEGER)
ACCESS(Boolean, fmi2Boolean, BOOLEAN)

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference numbers[],
                         size_t count, fmi2String values[])
{
    (void)component, (void)numbers, (void)values;
    return count ? fmi2Error : fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference numbers[],
                         size_t count, const fmi2String values[])
{
    (void)component, (void)numbers, (void)values;
    return count ? fmi2Error : fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    if (!*state && !(*state = malloc(state_bytes())))
        return fmi2Error;
    state_read(INSTANCE, *state);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    state_write(INSTANCE, state);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    (void)component;
    free(*state);
    *state = 0;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    (void)component, (void)state;
    *size = state_bytes();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size)
{
    (void)component;
    if (size != state_bytes())
        return fmi2Error;
    memcpy(bytes, state, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    (void)component;
    if (size != state_bytes() || (!*state && !(*state = malloc(size))))
        return fmi2Error;
    memcpy(*state, bytes, size);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean keep)
{
    (void)keep;
    return said(component, instance_step(INSTANCE, time, step));
}

/* What this unit does not have, see modelDescription.xml. */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component,
                                        const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns,
                                        const fmi2Real seed[], fmi2Real sensitivity[])
{
    (void)component, (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed;
    (void)sensitivity;
    return fmi2Error;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference numbers[],
                                       size_t count, const fmi2Integer order[],
                                       const fmi2Real values[])
{
    (void)component, (void)numbers, (void)count, (void)order, (void)values;
    return fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component,
                                        const fmi2ValueReference numbers[], size_t count,
                                        const fmi2Integer order[], fmi2Real values[])
{
    (void)component, (void)numbers, (void)count, (void)order, (void)values;
    return fmi2Error;
}

fmi2Status fmi2CancelStep(fmi2Component component)
{
    (void)component;
    return fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    *value = INSTANCE->time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Integer *value)
{
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Boolean *value)
{
    if (kind != fmi2Terminated)
        return fmi2Discard;
    (void)component;
    *value = 0;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind,
                               fmi2String *value)
{
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}
