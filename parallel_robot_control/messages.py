"""What the controller says, as messages; one row a state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control.coupling import synchronisation_error
from parallel_robot_interface import cdr, topics


class Telemetry(NamedTuple):
    """What the controller publishes beside its commands, each shape (N, n).

    Attributes:
        error: e = reference - feedback [rad].
        error_rate: Its derivative [rad/s].
        integral: int De dt [rad s].
        sliding_variable: In the law's unit.
        coupling_gain: lambda of the law [1/s]; 0 for laws without coupling.
    """

    error: np.ndarray
    error_rate: np.ndarray
    integral: np.ndarray
    sliding_variable: np.ndarray
    coupling_gain: float


def telemetry_messages(
    joints: tuple[str, ...], stamps: np.ndarray, telemetry: Telemetry
) -> dict[topics.Topic, np.ndarray]:
    """sensor_msgs/JointState per topic: errors as positions, their rates as velocities."""
    both = cdr.joint_state(joints, ('position', 'velocity'))
    single = cdr.joint_state(joints, ('position',))
    count = len(telemetry.error)
    e, e_dot = telemetry.error, telemetry.error_rate
    e_s, e_s_dot = synchronisation_error(e), synchronisation_error(e_dot)
    coupled = e_s - np.roll(e_s, 1, axis=-1)
    e_c = e + telemetry.coupling_gain * telemetry.integral
    e_c_dot = e_dot + telemetry.coupling_gain * coupled
    return {
        topics.ERROR: both.records(count, stamps, position=e, velocity=e_dot),
        topics.SYNCHRONISATION_ERROR: both.records(count, stamps, position=e_s, velocity=e_s_dot),
        topics.CROSS_COUPLING_ERROR: both.records(count, stamps, position=e_c, velocity=e_c_dot),
        topics.SLIDING_VARIABLE: single.records(
            count, stamps, position=telemetry.sliding_variable
        ),
    }
