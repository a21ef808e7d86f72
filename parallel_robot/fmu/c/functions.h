/* The functions that FMI 2.0 and 3.0 have alike, for fmi2.c and fmi3.c, which define before:
   FMI(NAME): the name of a function of the version
   STATE(VERB), SERIALIZED_SIZE, DESERIALIZE: those of functions of the states of a unit
   BEHIND, COUNT: parameter behind an array of values, and the number of values
   Boolean, Log: types; tell, defined after, gives a message to a Log. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;

typedef struct {
    Instance *instance;
    Log log;
} Unit;

#define UNIT ((Unit *)component)
#define INSTANCE (UNIT->instance)

static void tell(const Log *log, const char *message);

static Status said(void *component, int well)
{
    if (!well)
        tell(&UNIT->log, INSTANCE->message);
    return well ? OK : ERROR;
}

/* Make a unit of this token; 0 if it is another one, or there is no memory. */
static void *made(const char *token, Log log)
{
    Unit *unit = token && !strcmp(token, guid) ? calloc(1, sizeof *unit) : 0;
    if (unit && !(unit->instance = instance_new())) {
        free(unit);
        unit = 0;
    }
    if (unit)
        unit->log = log;
    return unit;
}

Status FMI(SetDebugLogging)(void *component, Boolean on, size_t count,
                            const char *const categories[])
{
    (void)component, (void)on, (void)count, (void)categories;
    return OK;
}

void FMI(FreeInstance)(void *component)
{
    if (component)
        instance_free(INSTANCE);
    free(component);
}

Status FMI(ExitInitializationMode)(void *component)
{
    return said(component, instance_begin(INSTANCE));
}

Status FMI(Terminate)(void *component)
{
    (void)component;
    return OK;
}

Status FMI(Reset)(void *component)
{
    instance_reset(INSTANCE);
    return OK;
}

/* Get and set variables of a type. */
#define ACCESS(NAME, TYPE, KIND)                                                                  \
    Status FMI(Get##NAME)(void *component, const uint32_t numbers[], size_t count,                \
                          TYPE values[] BEHIND)                                                   \
    {                                                                                             \
        for (size_t k = 0; k < count && k < COUNT; k++) {                                         \
            double value;                                                                         \
            if (!instance_get(INSTANCE, numbers[k], KIND, &value))                                \
                return said(component, 0);                                                        \
            values[k] = (TYPE)value;                                                              \
        }                                                                                         \
        return OK;                                                                                \
    }                                                                                             \
    Status FMI(Set##NAME)(void *component, const uint32_t numbers[], size_t count,                \
                          const TYPE values[] BEHIND)                                             \
    {                                                                                             \
        for (size_t k = 0; k < count && k < COUNT; k++)                                           \
            if (!instance_set(INSTANCE, numbers[k], KIND, (double)values[k]))                     \
                return said(component, 0);                                                        \
        return OK;                                                                                \
    }

Status STATE(Get)(void *component, void **state)
{
    if (!*state && !(*state = malloc(state_bytes())))
        return ERROR;
    state_read(INSTANCE, *state);
    return OK;
}

Status STATE(Set)(void *component, void *state)
{
    state_write(INSTANCE, state);
    return OK;
}

Status STATE(Free)(void *component, void **state)
{
    (void)component;
    free(*state);
    *state = 0;
    return OK;
}

Status SERIALIZED_SIZE(void *component, void *state, size_t *size)
{
    (void)component, (void)state;
    *size = state_bytes();
    return OK;
}

Status STATE(Serialize)(void *component, void *state, char bytes[], size_t size)
{
    (void)component;
    if (size != state_bytes())
        return ERROR;
    memcpy(bytes, state, size);
    return OK;
}

Status DESERIALIZE(void *component, const char bytes[], size_t size, void **state)
{
    (void)component;
    if (size != state_bytes() || (!*state && !(*state = malloc(size))))
        return ERROR;
    memcpy(*state, bytes, size);
    return OK;
}

/* A function that this unit does not have; its arguments are not looked at. */
#define MISSING(NAME, STATUS)                                                                     \
    Status FMI(NAME)(void) { return STATUS; }
