/* A control law in C, see docs/c_law.md. */

#ifndef PARALLEL_ROBOT_LAW_H
#define PARALLEL_ROBOT_LAW_H

#include <stdint.h>

#define PARALLEL_ROBOT_LAW_VERSION 1

/* What is known when a torque is wanted; n = joints. A slide has m and N for rad and N m. */
typedef struct {
    int32_t joints;
    int32_t begins;    /* 1: a run begins, forget all that was before */
    double dt;         /* s, since the last state */
    const double *position, *velocity; /* n, rad and rad/s: measured, or predicted by a filter */
    const double *reference_position, *reference_velocity, *reference_acceleration; /* n */
    const double *excess;      /* n, N m: torque of the last update that the limits cut off */
    const double *disturbance; /* n, N m: that the model does not know; 0 without a Kalman filter */
    /* torque = M acceleration + Q velocity + gravity, of the nominal robot */
    const double *gravity; /* n, N m */
    const double *M, *Q;   /* n x n, row by row */
} law_input;

/* What the law fills. */
typedef struct {
    double *torque;           /* n, N m */
    double *sliding_variable; /* n, in a unit of its own; is reference - position */
    double *coupled_error;    /* n, rad; is reference - position */
} law_output;

#ifdef __cplusplus
extern "C" {
#endif

#define LAW_SHOWN __attribute__((visibility("default")))

/* Answer a state; 0, or the number of a fault of the law, after which the robot is stopped. */
LAW_SHOWN int32_t law_update(const law_input *in, law_output *out);

/* Of this header; the file of the law defines nothing but law_update. */
extern LAW_SHOWN __attribute__((weak)) const int32_t law_version; /* weak: in several files */
const int32_t law_version = PARALLEL_ROBOT_LAW_VERSION;

/* A law for one robot or one period may define these, else none is checked. */
extern LAW_SHOWN const int32_t law_joints;
extern LAW_SHOWN const double law_period; /* s */

#ifdef __cplusplus
}
#endif

#endif
