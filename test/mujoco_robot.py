"""The 3-RRR robot in MuJoCo under given torques."""

from collections.abc import Sequence
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from parallel_robot_sim.mujoco_model import coordinates_of, planar_3rrr


def open_loop(
    robot: Any,
    pose: Sequence[float],
    torques: NDArray[np.float64],
    period: float,
    friction_viscous: Sequence[float] = (0, 0, 0),
    step: float = 1e-4,
) -> NDArray[np.float64]:
    """Return the poses of the robot, released at rest, under torques held over each period.

    Args:
        robot: Any object with l1, l2, l3, lc1, lc2 [m], m1, m2, mp [kg], I1, I2, Ip [kg m^2],
            and for each leg base_x, base_y [m], platform_angle [rad], working_mode (+1 or -1).
        pose: Start pose (x, y, phi) [m, m, rad].
        torques: Actuated joint torques [N m], shape (N, 3); row k acts from k to k + 1 periods.
        period: Hold time of a row of torques [s].
        friction_viscous: Viscous friction of the actuated joints [N m s/rad].
        step: Integration step [s]; the period is a multiple of it.

    Returns:
        Pose (x, y, phi) after 0, 1 ... N periods [m, m, rad], phi unwrapped, shape (N + 1, 3).
    """
    model = planar_3rrr(robot, friction_viscous, step)
    data = mujoco.MjData(model)
    data.qpos = coordinates_of(robot, np.asarray(pose))
    poses = [data.qpos[:3].copy()]
    for torque in torques:
        data.qfrc_applied[3::2] = torque
        mujoco.mj_step(model, data, round(period / step))
        poses.append(data.qpos[:3].copy())
    return np.array(poses)
