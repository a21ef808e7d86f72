"""MuJoCo model of the 3-RRR robot: an independent check of the closed-form plant.

Three two-link legs and a platform move in the x-y plane, without gravity or contact. MuJoCo knows
only trees, so a `connect` constraint holds the tip of each leg at its corner of the platform.
qpos = (x, y, phi, theta_1, psi_1, theta_2, psi_2, theta_3, psi_3): metres and radians.
"""

import math
from collections.abc import Sequence
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray


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
    model = model_of(robot, friction_viscous, step)
    data = mujoco.MjData(model)
    data.qpos = coordinates_of(robot, pose)
    poses = [data.qpos[:3].copy()]
    for torque in torques:
        data.qfrc_applied[3::2] = torque
        mujoco.mj_step(model, data, round(period / step))
        poses.append(data.qpos[:3].copy())
    return np.array(poses)


def model_of(robot: Any, friction_viscous: Sequence[float], step: float) -> mujoco.MjModel:
    """Build the robot with every link along +x at qpos = 0, so that no frame is rotated."""
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = (0, 0, 0)

    platform = _add_body(spec.worldbody, (0, 0), robot.mp, 0, robot.Ip)
    platform.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0))
    platform.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 1, 0))
    platform.add_joint()  # MuJoCo's default joint: a hinge along z

    for leg, angle in enumerate(robot.platform_angle):
        base = robot.base_x[leg], robot.base_y[leg]
        proximal = _add_body(spec.worldbody, base, robot.m1, robot.lc1, robot.I1)
        proximal.add_joint(damping=friction_viscous[leg])
        distal = _add_body(proximal, (robot.l1, 0), robot.m2, robot.lc2, robot.I2)
        distal.add_joint()

        corner = robot.l3 * math.cos(angle), robot.l3 * math.sin(angle), 0
        distal.add_site(name=f'tip{leg}', pos=(robot.l2, 0, 0))
        platform.add_site(name=f'corner{leg}', pos=corner)
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f'tip{leg}',
            name2=f'corner{leg}',
            solref=(10 * step, 1),  # time constant [s], slow enough for RK4; critical damping
        )

    model = spec.compile()
    model.body_invweight0[:] *= 1e-6  # constraints yield in proportion: harder than solimp allows
    return model


def _add_body(
    parent: Any, origin: tuple[float, float], mass: float, centre: float, inertia: float
) -> Any:
    """Add a body whose centre of mass lies on its own x axis [m, kg, m, kg m^2]."""
    return parent.add_body(
        pos=(*origin, 0),
        mass=mass,
        ipos=(centre, 0, 0),
        inertia=(inertia, inertia, inertia),
        explicitinertial=True,
    )


def coordinates_of(robot: Any, pose: Sequence[float]) -> list[float]:
    """Return qpos of the robot at a pose."""
    return [*pose, *(angle for leg in range(3) for angle in _leg_angles(robot, pose, leg))]


def _leg_angles(robot: Any, pose: Sequence[float], leg: int) -> tuple[float, float]:
    """Return the actuated and the passive angle (theta, psi) of a leg [rad]."""
    x, y, phi = pose
    corner = phi + robot.platform_angle[leg]
    rx = x + robot.l3 * math.cos(corner) - robot.base_x[leg]
    ry = y + robot.l3 * math.sin(corner) - robot.base_y[leg]
    reach = math.hypot(rx, ry)
    cosine = (robot.l1**2 - robot.l2**2 + reach**2) / (2 * robot.l1 * reach)
    theta = math.atan2(ry, rx) + robot.working_mode[leg] * math.acos(cosine)
    beta = math.atan2(ry - robot.l1 * math.sin(theta), rx - robot.l1 * math.cos(theta))
    return theta, beta - theta
