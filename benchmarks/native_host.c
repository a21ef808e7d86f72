/* Runs the library of an FMU 2.0 of a law at a fixed rate, and prints what it took as JSON.

   Each cycle also has a spin, work of the same length that touches no memory, before or after the
   law in turns: what it takes more than usual is the machine's.

   Usage: native_host LIBRARY GUID STATES JOINTS CYCLES PERIOD_NS TORQUE
   STATES: rows of doubles, the real inputs of the law in their order.
   TORQUE: number of the torque of the first joint. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <malloc.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>

#define SECOND 1000000000LL
#define WARM 200 /* cycles that are not counted */
#define TURNS 500 /* of the first spin; each later one has one more or less */

enum { LAW, SPIN };

extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_memalign(size_t, size_t);

static long allocations;
static volatile double spun;

void *malloc(size_t size) { return allocations++, __libc_malloc(size); }
void *calloc(size_t count, size_t size) { return allocations++, __libc_calloc(count, size); }
void *aligned_alloc(size_t step, size_t size) { return allocations++, __libc_memalign(step, size); }

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec * SECOND + time.tv_nsec;
}

static int rising(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double spin(long turns)
{
    double x = 1.0;
    for (long k = 0; k < turns; k++)
        x = 0.5 * x + 1.0; /* each needs the one before */
    return x;
}

static void told(const char *name, double *values, long count)
{
    qsort(values, count, sizeof *values, rising);
    printf("\"%s\": {\"median\": %.3f, \"p9999\": %.3f, \"worst\": %.3f}, ", name,
           values[count / 2], values[(long)(0.9999 * (count - 1))], values[count - 1]);
}

int main(int count, char **words)
{
    if (count != 8)
        return 2;
    int joints = atoi(words[4]);
    long cycles = atol(words[5]), inputs = 6 * joints + 1, rows;
    int64_t period = atoll(words[6]);
    FILE *file = fopen(words[3], "rb");
    void *library = dlopen(words[1], RTLD_NOW);
    if (!library || !file) {
        fprintf(stderr, "%s\n", library ? words[3] : dlerror());
        return 2;
    }
    fseek(file, 0, SEEK_END);
    rows = ftell(file) / (8 * inputs);
    rewind(file);
    double *states = malloc(rows * inputs * 8);
    if (fread(states, 8 * inputs, rows, file) != (size_t)rows)
        return 2;
    void *(*make)(const char *, int, const char *, const char *, const void *, int, int) =
        dlsym(library, "fmi2Instantiate");
    int (*set)(void *, const unsigned *, size_t, const double *) = dlsym(library, "fmi2SetReal");
    int (*get)(void *, const unsigned *, size_t, double *) = dlsym(library, "fmi2GetReal");
    int (*step)(void *, double, double, int) = dlsym(library, "fmi2DoStep");
    int (*reset)(void *) = dlsym(library, "fmi2Reset");
    void *unit = make("unit", 1, words[2], "", 0, 0, 0);
    if (!unit)
        return 2;
    unsigned numbers[inputs], outputs[joints];
    for (long k = 0; k < inputs; k++)
        numbers[k] = k;
    for (long k = 0; k < joints; k++)
        outputs[k] = atoi(words[7]) + k;
    double *late = malloc(cycles * 8), *spent[2], torque[joints], sum = 0.0, took[2];
    memset(late, 1, cycles * 8);
    for (int what = LAW; what <= SPIN; what++)
        spent[what] = memset(malloc(cycles * 8), 1, cycles * 8);
    struct sched_param priority = {.sched_priority = 80};
    int fifo = sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
    int locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    struct rusage before, after;
    long allocated = 0, turns = TURNS;
    int status = 0;
    int64_t due = now() + period;
    for (long k = -WARM; k < cycles; k++, due += period) {
        long row = (k + WARM) % rows;
        if (k == 0) {
            getrusage(RUSAGE_SELF, &before);
            allocated = allocations;
        }
        if (row == 0)
            reset(unit);
        struct timespec time = {due / SECOND, due % SECOND};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &time, 0);
        int64_t begun = now();
        if (k >= 0)
            late[k] = 1e-3 * (begun - due);
        for (int part = 0; part < 2; part++) {
            int what = (k + part) & 1 ? SPIN : LAW;
            begun = now();
            if (what == LAW) {
                status |= set(unit, numbers, inputs, states + row * inputs);
                status |= step(unit, row * 1e-9 * period, 1e-9 * period, 1);
                status |= get(unit, outputs, joints, torque);
            } else {
                spun = spin(turns); /* volatile: not moved out of the time */
            }
            took[what] = 1e-3 * (now() - begun);
            if (k >= 0)
                spent[what][k] = took[what];
        }
        turns += took[SPIN] < took[LAW] ? 1 : -1; /* until both have the same median */
        sum += torque[0];
    }
    getrusage(RUSAGE_SELF, &after);
    allocated = allocations - allocated;
    printf("{");
    told("cycle", spent[LAW], cycles);
    told("spin", spent[SPIN], cycles);
    told("wake", late, cycles);
    printf("\"fifo\": %s, \"locked\": %s, \"page_faults\": %ld, \"allocations\": %ld, "
           "\"status\": %d, \"sum\": %.17g}\n",
           fifo ? "true" : "false", locked ? "true" : "false",
           after.ru_minflt + after.ru_majflt - before.ru_minflt - before.ru_majflt, allocated,
           status, sum);
    return 0;
}
