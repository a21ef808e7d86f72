"""The robot's geometry once more, in complex numbers: what the tests compare the kernels with."""

import numpy as np
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots.planar_3rrr.kinematics import RobotParameters

ROBOT = group(config.resolve('paper_circle'), RobotParameters, 'robot')
PAPER_START = np.array([0.5284, 0.3681, np.pi / 2])
PI12_START = np.array([0.5284, 0.3681, 0.1247])


def wrap(angle: ArrayLike) -> Array:
    """Angle without whole turns, in [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def corners(robot: RobotParameters, pose: ArrayLike) -> NDArray[np.complex128]:
    """Platform joints, shape (..., 3)."""
    x, y, phi = np.moveaxis(np.asarray(pose)[..., None], -2, 0)
    return x + 1j * y + robot.l3 * np.exp(1j * (phi + np.array(robot.platform_angle)))


def elbows(robot: RobotParameters, theta: ArrayLike) -> NDArray[np.complex128]:
    """Elbows, shape (..., 3)."""
    base = np.array(robot.base_x) + 1j * np.array(robot.base_y)
    return base + robot.l1 * np.exp(1j * np.asarray(theta))


def legs(robot: RobotParameters, pose: ArrayLike) -> tuple[Array, Array]:
    """Theta and beta by the law of cosines, each shape (..., 3); NaN out of reach."""
    span = corners(robot, pose) - np.array(robot.base_x) - 1j * np.array(robot.base_y)
    c = np.abs(span)
    with np.errstate(invalid='ignore'):
        inner = np.arccos((robot.l1**2 + c**2 - robot.l2**2) / (2 * robot.l1 * c))
    theta = np.angle(span) + np.array(robot.working_mode) * inner
    return theta, np.angle(corners(robot, pose) - elbows(robot, theta))


def closure(robot: RobotParameters, pose: ArrayLike, theta: ArrayLike, beta: ArrayLike) -> Array:
    """Gap between leg tips and platform joints [m], shape (..., 3)."""
    tips = elbows(robot, theta) + robot.l2 * np.exp(1j * np.asarray(beta))
    return np.abs(tips - corners(robot, pose))


def jacobian(robot: RobotParameters, pose: ArrayLike) -> Array:
    """Jx with its angle column over l3, shape (..., 3, 3).

    It has the directions of the distal links, and their levers.
    """
    beta = legs(robot, pose)[1]
    lever = np.sin(beta - np.asarray(pose)[..., 2:] - np.array(robot.platform_angle))
    return np.stack([np.cos(beta), np.sin(beta), lever], axis=-1)


def margins(robot: RobotParameters, pose: ArrayLike) -> tuple[float, float]:
    """Smallest |sin psi| and smallest singular value of `jacobian`; zeros out of reach."""
    theta, beta = legs(robot, pose)
    if np.isnan(theta).any():
        return 0.0, 0.0
    smallest = np.linalg.svd(jacobian(robot, pose), compute_uv=False)[-1]
    return float(np.abs(np.sin(beta - theta)).min()), float(smallest)


def kinetic_energy(robot: RobotParameters, pose: Array, rate: Array, h: float = 1e-5) -> float:
    """Energy of seven bodies from central differences of where they are [J]."""
    ahead, behind = pose + h * rate, pose - h * rate
    theta, beta = (
        wrap(a - b) / (2 * h) for a, b in zip(legs(robot, ahead), legs(robot, behind), strict=True)
    )

    def distal(p: Array) -> NDArray[np.complex128]:
        angle, beta = legs(robot, p)
        return elbows(robot, angle) + robot.lc2 * np.exp(1j * beta)

    speed = np.abs(distal(ahead) - distal(behind)) / (2 * h)
    energies = [
        (robot.I1 + robot.m1 * robot.lc1**2) * theta @ theta,
        robot.m2 * speed @ speed + robot.I2 * beta @ beta,
        robot.mp * rate[:2] @ rate[:2] + robot.Ip * rate[2] ** 2,
    ]
    return 0.5 * float(sum(energies))


def poses(margin: float = 0.2) -> st.SearchStrategy[Array]:
    """Poses of the paper's robot at least `margin` away from both singularities."""
    drawn = st.tuples(st.floats(0.2, 0.8), st.floats(0.0, 0.6), st.floats(-np.pi, np.pi))
    return drawn.map(np.array).filter(lambda pose: min(margins(ROBOT, pose)) > margin)


def rows(size: float, count: int = 3) -> st.SearchStrategy[Array]:
    """Vectors with components between -size and size."""
    return st.lists(st.floats(-size, size), min_size=count, max_size=count).map(np.array)
