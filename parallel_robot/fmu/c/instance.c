/* See instance.h. */

#include "instance.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ALIGNMENT 64 /* bytes, as in the compiler */

extern const unsigned char image_content[];
extern const int64_t image_size, image_root;
extern const int64_t image_pointers[][2], image_pointer_count;
extern const int64_t image_code_places[], image_code_count;
extern void *const image_code[];

/* Write the addresses that belong into the memory. */
static void link_memory(unsigned char *memory)
{
    for (int64_t k = 0; k < image_pointer_count; k++) {
        unsigned char *to = memory + image_pointers[k][1];
        memcpy(memory + image_pointers[k][0], &to, sizeof to);
    }
    for (int64_t k = 0; k < image_code_count; k++)
        memcpy(memory + image_code_places[k], &image_code[k], sizeof(void *));
}

Instance *instance_new(void)
{
    Instance *instance = calloc(1, sizeof *instance);
    size_t size = ((size_t)image_size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    if (instance && !(instance->memory = aligned_alloc(ALIGNMENT, size))) {
        free(instance);
        instance = 0;
    }
    if (instance)
        instance_reset(instance);
    return instance;
}

void instance_free(Instance *instance)
{
    if (instance)
        free(instance->memory);
    free(instance);
}

void instance_reset(Instance *instance)
{
    memcpy(instance->memory, image_content, image_size);
    link_memory(instance->memory);
    instance->time = 0.0;
}

static const Variable *variable(Instance *instance, uint32_t number, enum Kind kind)
{
    if (number < variable_count && variables[number].kind == kind)
        return &variables[number];
    snprintf(instance->message, sizeof instance->message,
             "there is no variable %u of this type", (unsigned)number);
    return 0;
}

int instance_get(Instance *instance, uint32_t number, enum Kind kind, double *value)
{
    const Variable *known = variable(instance, number, kind);
    if (!known)
        return 0;
    if (known->role == TIME)
        *value = instance->time;
    else if (known->role == CONSTANT)
        *value = known->value;
    else
        memcpy(value, instance->memory + known->place, sizeof *value);
    return 1;
}

int instance_set(Instance *instance, uint32_t number, enum Kind kind, double value)
{
    const Variable *known = variable(instance, number, kind);
    if (!known)
        return 0;
    if (known->role != INPUT && known->role != PARAMETER) {
        snprintf(instance->message, sizeof instance->message, "%s cannot be set", known->name);
        return 0;
    }
    if (known->role == PARAMETER && !(value >= known->low && value <= known->high)) {
        snprintf(instance->message, sizeof instance->message,
                 "%s must be from %g to %g, not %g", known->name, known->low, known->high, value);
        return 0;
    }
    memcpy(instance->memory + known->place, &value, sizeof value);
    return 1;
}

static int well(Instance *instance, int status)
{
    if (status)
        snprintf(instance->message, sizeof instance->message,
                 "the robot has left its workspace");
    return !status;
}

int instance_begin(Instance *instance)
{
    return well(instance, unit_begin(instance->memory + image_root));
}

int instance_step(Instance *instance, double time, double step)
{
    /* A master that subtracts two times rounds the step as coarsely as these. */
    if (!(fabs(step - period) <= 1e-9 * period + 4 * DBL_EPSILON * fabs(time))) {
        snprintf(instance->message, sizeof instance->message,
                 "the step must be %.9g s, the period of the loop, not %.9g", period, step);
        return 0;
    }
    if (!well(instance, unit_step(instance->memory + image_root)))
        return 0;
    instance->time = time + step;
    return 1;
}

size_t state_bytes(void)
{
    return sizeof(double) + (size_t)image_size;
}

void state_read(const Instance *instance, unsigned char *bytes)
{
    memcpy(bytes, &instance->time, sizeof(double));
    memcpy(bytes + sizeof(double), instance->memory, image_size);
}

void state_write(Instance *instance, const unsigned char *bytes)
{
    memcpy(&instance->time, bytes, sizeof(double));
    memcpy(instance->memory, bytes + sizeof(double), image_size);
    link_memory(instance->memory); /* the bytes may be of another instance, or process */
}
