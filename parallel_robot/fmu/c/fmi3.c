/* The functions of FMI 3.0 for co-simulation. Types and names are those of the standard. */

#include <stdbool.h>
#include <stddef.h>

typedef bool Boolean;
typedef struct {
    void *environment;
    void (*callback)(void *environment, int status, const char *category, const char *message);
} Log;
typedef void (*fmi3IntermediateUpdateCallback)(void *environment, double, bool, bool, bool, bool,
                                               bool *, double *);

#define FMI(NAME) fmi3##NAME
#define STATE(VERB) fmi3##VERB##FMUState
#define SERIALIZED_SIZE fmi3SerializedFMUStateSize
#define DESERIALIZE fmi3DeserializeFMUState
#define BEHIND , size_t size
#define COUNT size

#include "functions.h"

static void tell(const Log *log, const char *message)
{
    if (log->callback)
        log->callback(log->environment, ERROR, "logStatusError", message);
}

const char *fmi3GetVersion(void) { return "3.0"; }

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources,
                                  bool visible, bool logging, bool events, bool early,
                                  const uint32_t required[], size_t count, void *environment,
                                  void (*log)(void *, int, const char *, const char *),
                                  fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)early, (void)required;
    (void)update;
    return events || count ? 0 : made(token, (Log){environment, log});
}

Status fmi3EnterInitializationMode(void *component, bool with_tolerance, double tolerance,
                                   double start, bool with_stop, double stop)
{
    (void)with_tolerance, (void)tolerance, (void)with_stop, (void)stop;
    INSTANCE->time = start;
    return said(component, instance_begin(INSTANCE));
}

ACCESS(Float64, double, REAL)
ACCESS(Int32, int32_t, INTEGER)
ACCESS(Boolean, bool, BOOLEAN)

Status fmi3DoStep(void *component, double time, double step, bool keep, bool *event,
                  bool *terminate, bool *early, double *last)
{
    (void)keep;
    Status status = said(component, instance_step(INSTANCE, time, step));
    *event = *terminate = *early = false;
    *last = status == OK ? INSTANCE->time : time;
    return status;
}

/* What the standard asks a library to have, and this unit does not: other modes, types, clocks,
   derivatives. */

#define NONE(NAME)                                                                                \
    void *fmi3##NAME(void) { return 0; }

NONE(InstantiateModelExchange)
NONE(InstantiateScheduledExecution)
MISSING(EnterEventMode, ERROR)
MISSING(EnterStepMode, ERROR)
MISSING(EnterConfigurationMode, ERROR)
MISSING(ExitConfigurationMode, ERROR)
MISSING(EnterContinuousTimeMode, ERROR)
MISSING(CompletedIntegratorStep, ERROR)
MISSING(EvaluateDiscreteStates, ERROR)
MISSING(UpdateDiscreteStates, ERROR)
MISSING(ActivateModelPartition, ERROR)
MISSING(SetTime, ERROR)
MISSING(GetFloat32, ERROR)
MISSING(GetInt8, ERROR)
MISSING(GetUInt8, ERROR)
MISSING(GetInt16, ERROR)
MISSING(GetUInt16, ERROR)
MISSING(GetUInt32, ERROR)
MISSING(GetInt64, ERROR)
MISSING(GetUInt64, ERROR)
MISSING(GetString, ERROR)
MISSING(GetBinary, ERROR)
MISSING(GetClock, ERROR)
MISSING(SetFloat32, ERROR)
MISSING(SetInt8, ERROR)
MISSING(SetUInt8, ERROR)
MISSING(SetInt16, ERROR)
MISSING(SetUInt16, ERROR)
MISSING(SetUInt32, ERROR)
MISSING(SetInt64, ERROR)
MISSING(SetUInt64, ERROR)
MISSING(SetString, ERROR)
MISSING(SetBinary, ERROR)
MISSING(SetClock, ERROR)
MISSING(GetIntervalDecimal, ERROR)
MISSING(GetIntervalFraction, ERROR)
MISSING(GetShiftDecimal, ERROR)
MISSING(GetShiftFraction, ERROR)
MISSING(SetIntervalDecimal, ERROR)
MISSING(SetIntervalFraction, ERROR)
MISSING(SetShiftDecimal, ERROR)
MISSING(SetShiftFraction, ERROR)
MISSING(GetDirectionalDerivative, ERROR)
MISSING(GetAdjointDerivative, ERROR)
MISSING(GetOutputDerivatives, ERROR)
MISSING(GetNumberOfVariableDependencies, ERROR)
MISSING(GetVariableDependencies, ERROR)
MISSING(GetContinuousStates, ERROR)
MISSING(SetContinuousStates, ERROR)
MISSING(GetContinuousStateDerivatives, ERROR)
MISSING(GetNominalsOfContinuousStates, ERROR)
MISSING(GetNumberOfContinuousStates, ERROR)
MISSING(GetEventIndicators, ERROR)
MISSING(GetNumberOfEventIndicators, ERROR)
