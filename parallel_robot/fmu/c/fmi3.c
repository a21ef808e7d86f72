/* The functions of FMI 3.0 for co-simulation. Types and names are those of the standard. */

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef int32_t fmi3Int32;
typedef bool fmi3Boolean;
typedef uint8_t fmi3Byte;
typedef const char *fmi3String;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category,
                                       fmi3String message);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean *, fmi3Float64 *);

typedef struct {
    Instance *instance;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Unit;

#define UNIT ((Unit *)component)
#define INSTANCE (UNIT->instance)

static fmi3Status said(fmi3Instance component, int well)
{
    if (well)
        return fmi3OK;
    if (UNIT->log)
        UNIT->log(UNIT->environment, fmi3Error, "logStatusError", INSTANCE->message);
    return fmi3Error;
}

const char *fmi3GetVersion(void) { return "3.0"; }

fmi3Status fmi3SetDebugLogging(fmi3Instance component, fmi3Boolean on, size_t count,
                               const fmi3String categories[])
{
    (void)component, (void)on, (void)count, (void)categories;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)early, (void)required;
    (void)update;
    if (events || count || !token || strcmp(token, guid))
        return 0;
    Unit *unit = calloc(1, sizeof *unit);
    if (!unit || !(unit->instance = instance_new())) {
        free(unit);
        return 0;
    }
    unit->environment = environment;
    unit->log = log;
    return unit;
}

void fmi3FreeInstance(fmi3Instance component)
{
    if (component)
        instance_free(INSTANCE);
    free(component);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance component, fmi3Boolean with_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean with_stop, fmi3Float64 stop)
{
    (void)with_tolerance, (void)tolerance, (void)with_stop, (void)stop;
    INSTANCE->time = start;
    return said(component, instance_begin(INSTANCE));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance component)
{
    return said(component, instance_begin(INSTANCE));
}

fmi3Status fmi3Terminate(fmi3Instance component)
{
    (void)component;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance component)
{
    instance_reset(INSTANCE);
    return fmi3OK;
}

/* Get and set variables of a type. */
#define ACCESS(NAME, KIND)                                                                        \
    fmi3Status fmi3Get##NAME(fmi3Instance component, const fmi3ValueReference numbers[],          \
                             size_t count, fmi3##NAME values[], size_t size)                      \
    {                                                                                             \
        for (size_t k = 0; k < count && k < size; k++) {                                          \
            double value;                                                                         \
            if (!instance_get(INSTANCE, numbers[k], KIND, &value))                                \
                return said(component, 0);                                                        \
            values[k] = (fmi3##NAME)value;                                                        \
        }                                                                                         \
        return fmi3OK;                                                                            \
    }                                                                                             \
    fmi3Status fmi3Set##NAME(fmi3Instance component, const fmi3ValueReference numbers[],          \
                             size_t count, const fmi3##NAME values[], size_t size)                \
    {                                                                                             \
        for (size_t k = 0; k < count && k < size; k++)                                            \
            if (!instance_set(INSTANCE, numbers[k], KIND, (double)values[k]))                     \
                return said(component, 0);                                                        \
        return fmi3OK;                                                                            \
    }

ACCESS(Float64, REAL)
ACCESS(Int32, INTEGER)
ACCESS(Boolean, BOOLEAN)

fmi3Status fmi3GetFMUState(fmi3Instance component, fmi3FMUState *state)
{
    if (!*state && !(*state = malloc(state_bytes())))
        return fmi3Error;
    state_read(INSTANCE, *state);
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance component, fmi3FMUState state)
{
    state_write(INSTANCE, state);
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance component, fmi3FMUState *state)
{
    (void)component;
    free(*state);
    *state = 0;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance component, fmi3FMUState state, size_t *size)
{
    (void)component, (void)state;
    *size = state_bytes();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance component, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size)
{
    (void)component;
    if (size != state_bytes())
        return fmi3Error;
    memcpy(bytes, state, size);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance component, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
    (void)component;
    if (size != state_bytes() || (!*state && !(*state = malloc(size))))
        return fmi3Error;
    memcpy(*state, bytes, size);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance component, fmi3Float64 time, fmi3Float64 step, fmi3Boolean keep,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last)
{
    (void)keep;
    fmi3Status status = said(component, instance_step(INSTANCE, time, step));
    *event = *terminate = *early = false;
    *last = status == fmi3OK ? INSTANCE->time : time;
    return status;
}

/* What the standard asks a library to have, and this unit does not: other modes, types, clocks,
   derivatives. The arguments are not looked at. */

#define NONE(NAME)                                                                                \
    void *fmi3##NAME(void) { return 0; }
#define MISSING(NAME)                                                                             \
    fmi3Status fmi3##NAME(void) { return fmi3Error; }

NONE(InstantiateModelExchange)
NONE(InstantiateScheduledExecution)
MISSING(EnterEventMode)
MISSING(EnterStepMode)
MISSING(EnterConfigurationMode)
MISSING(ExitConfigurationMode)
MISSING(EnterContinuousTimeMode)
MISSING(CompletedIntegratorStep)
MISSING(EvaluateDiscreteStates)
MISSING(UpdateDiscreteStates)
MISSING(ActivateModelPartition)
MISSING(SetTime)
MISSING(GetFloat32)
MISSING(GetInt8)
MISSING(GetUInt8)
MISSING(GetInt16)
MISSING(GetUInt16)
MISSING(GetUInt32)
MISSING(GetInt64)
MISSING(GetUInt64)
MISSING(GetString)
MISSING(GetBinary)
MISSING(GetClock)
MISSING(SetFloat32)
MISSING(SetInt8)
MISSING(SetUInt8)
MISSING(SetInt16)
MISSING(SetUInt16)
MISSING(SetUInt32)
MISSING(SetInt64)
MISSING(SetUInt64)
MISSING(SetString)
MISSING(SetBinary)
MISSING(SetClock)
MISSING(GetIntervalDecimal)
MISSING(GetIntervalFraction)
MISSING(GetShiftDecimal)
MISSING(GetShiftFraction)
MISSING(SetIntervalDecimal)
MISSING(SetIntervalFraction)
MISSING(SetShiftDecimal)
MISSING(SetShiftFraction)
MISSING(GetDirectionalDerivative)
MISSING(GetAdjointDerivative)
MISSING(GetOutputDerivatives)
MISSING(GetNumberOfVariableDependencies)
MISSING(GetVariableDependencies)
MISSING(GetContinuousStates)
MISSING(SetContinuousStates)
MISSING(GetContinuousStateDerivatives)
MISSING(GetNominalsOfContinuousStates)
MISSING(GetNumberOfContinuousStates)
MISSING(GetEventIndicators)
MISSING(GetNumberOfEventIndicators)
