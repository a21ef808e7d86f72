/* Computed torque with friction compensation: example_law.py in C. */

#include "parallel_robot_law.h"

static const double Kp = 900.0, Kd = 60.0, viscous = 2.5; /* 1/s^2, 1/s, N m s/rad */

int32_t law_update(const law_input *in, law_output *out)
{
    const int n = in->joints;
    for (int i = 0; i < n; i++) {
        double inertial = 0.0, coriolis = 0.0;
        for (int k = 0; k < n; k++) {
            double e = in->reference_position[k] - in->position[k];
            double e_dot = in->reference_velocity[k] - in->velocity[k];
            inertial += in->M[i * n + k] * (in->reference_acceleration[k] + Kd * e_dot + Kp * e);
            coriolis += in->Q[i * n + k] * in->velocity[k];
        }
        out->torque[i] = inertial + coriolis + in->gravity[i] + viscous * in->reference_velocity[i];
    }
    return 0;
}
