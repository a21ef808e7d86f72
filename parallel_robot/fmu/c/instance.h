/* An instance of a unit: the memory of its kernels, by the numbers of its variables. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>

enum Role { INPUT, OUTPUT, PARAMETER, CONSTANT, TIME };
enum Kind { REAL, INTEGER, BOOLEAN };

/* A variable; its number is its place in the table. In memory each is a double. */
typedef struct {
    enum Role role;
    enum Kind kind;
    int64_t place;    /* in the image; of a constant none */
    double low, high; /* range of a parameter */
    double value;     /* of a constant */
    const char *name;
} Variable;

/* Written for each unit. */
extern const Variable variables[];
extern const int64_t variable_count;
extern const double period; /* s */
extern const char *const guid;

/* Of the object file of the kernels; 0 if all is well. */
extern int unit_begin(void *root);
extern int unit_step(void *root);

typedef struct {
    unsigned char *memory; /* laid down from the image */
    double time;           /* s */
    char message[200];     /* what is wrong, after a function has returned 0 */
} Instance;

/* Make an instance; 0 if there is no memory. Nothing is allocated after this. */
Instance *instance_new(void);
void instance_free(Instance *instance);
/* Be as at the beginning. */
void instance_reset(Instance *instance);

/* Each returns 1, or 0 with a message. */
int instance_get(Instance *instance, uint32_t number, enum Kind kind, double *value);
int instance_set(Instance *instance, uint32_t number, enum Kind kind, double value);
int instance_begin(Instance *instance);
int instance_step(Instance *instance, double time, double step);

/* All that changes, as bytes of a constant number: time, then memory. */
size_t state_bytes(void);
void state_read(const Instance *instance, unsigned char *bytes);
void state_write(Instance *instance, const unsigned char *bytes);

#endif
