"""S-FOTSMC on predicted motion, with the estimated disturbance fed forward."""

from __future__ import annotations

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.laws.s_fotsmc import Gains, Memory, initial_memory, judge
from parallel_robot_model.compiler import kernel
from parallel_robot_model.robots.contract import Model

__all__ = ['ESTIMATOR', 'Gains', 'Memory', 'initial_memory', 'judge', 'update']

ESTIMATOR = 'kalman'


@kernel
def update(
    gains: Gains,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    memory: Memory,
    dt: float,
) -> ControlOutput:
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
