"""S-FOTSMC on predicted motion, with the estimated disturbance fed forward.

Proved: with D the whole unknown torque, S = Xi - tau_sw, Xi = M^-1 (D - d). Where the prediction
is exact and |Xi'| <= G, the paper's argument leads to S = 0 in finite time, then to e_c = 0 (Bhat,
Bernstein 2000, for the homogeneous system e_c'' + w = 0). That is a condition on the loop, since d
depends on it, and Coulomb friction breaks it at each reversal.

Not proved: there is no separation principle here, as sig is not Lipschitz at zero. With noise Xi'
is not bounded, and S does not stay zero. Two things are approximations: joints that depend on each
other through M alone in the covariances, and friction by the sign of the desired motion.
"""

from __future__ import annotations

from parallel_robot_control.law import ControlOutput, kernel
from parallel_robot_control.laws import s_fotsmc

TITLE = 'observer S-FOTSMC'
ESTIMATOR = 'kalman'

Gains = s_fotsmc.Gains
initial_memory = s_fotsmc.initial_memory
validate_gains = s_fotsmc.validate_gains


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        tau = M (thdd_d + M^-1 Q thd + lambda De' + w + tau_sw) + d,   tau_sw' = (G + g) sgn(S)

    Surface and switching are those of S-FOTSMC, of the motion that the Kalman filter predicts for
    the moment at which the torque acts; d is the disturbance that it estimates. So G need only
    exceed the rate of what the estimate misses.

    Returns:
        Torque [N m], S [rad/s^2] as the difference quotient of v, new memory.

    Source:
        Doan, Le, Vo (2019), eqs. (12)-(17), for surface and switching; Johnson (1971), IEEE Trans.
        Automatic Control 16(6), for the disturbance as a state that is estimated and fed forward.
    """
    output = s_fotsmc.update(gains, model, reference, feedback, memory, dt)
    return ControlOutput(
        output.torque + feedback.disturbance,
        output.sliding_variable,
        output.coupled_error,
        output.memory,
    )
