"""Whether the functions of a robot describe one machine: each against another, at some states.

Rates are compared with differences over time, the model of the controller with the plant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, vector
from parallel_robot_model.processes.custom_module import wrap_user_errors
from parallel_robot_model.robots.contract import FOUND, REACHED, Estimate, Measurement, PoseMotion
from parallel_robot_model.robots.joint_load import JointLoad, net_torque
from parallel_robot_model.robots.registry import ROBOTS, RobotModel

H = 1e-4  # s, of central differences
SLOPE = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}  # weights of states by steps from here
RATE = 0.5  # of the coordinates of plant and pose, largest, in their units per s
GUESS = 1e-4  # between a pose and the guess for it, relative
COARSE = 1e-3  # relative difference that is a mistake in any robot
FINE = 1e-5  # that of `verify`
LEAST = 1e-10  # differences below it are rounding, in any unit


class Check(NamedTuple):
    """A comparison."""

    function: str  # function of the robot that is wrong if it fails
    what: str  # what is compared
    difference: float  # the largest difference; NaN where something is not finite
    size: float  # size of what is compared, in the same unit

    @property
    def share(self) -> float:
        """The difference relative to the size, which is at least that of rounding."""
        return self.difference / (self.size + LEAST)

    def passes(self, tolerance: float) -> bool:
        """Whether the difference is less than this share of the size."""
        return self.difference <= tolerance * self.size + LEAST

    def text(self) -> str:
        """The check with its figure."""
        if not np.isfinite(self.difference):
            return f'{self.function}: {self.what}: not found or not finite'
        return f'{self.function}: {self.what}: differs by {self.difference:.2g} of {self.size:.2g}'


def refuse_mistakes(robot: RobotModel, load: JointLoad, pose: Array) -> None:
    """Refuse a custom robot whose kinematics contradicts itself, or whose plant does not move.

    Args:
        robot: The robot.
        load: Friction and disturbance of its joints.
        pose: Its initial pose, shape (m,).

    Raises:
        InputError: a function is wrong.
    """
    if robot.name in ROBOTS:
        return
    rate = RATE * np.cos(np.arange(len(pose)))
    for check in checks(robot, load, pose, rate):
        if not check.passes(COARSE):
            raise InputError(
                f'{robot.name}: {check.text()} (parallel_robot verify has all checks)'
            )


def checks(
    robot: RobotModel, load: JointLoad, pose: Array, rate: Array, margins: Any = None
) -> Iterator[Check]:
    """Compare the functions of a robot at one state.

    Args:
        robot: The robot.
        load: Friction and disturbance of its joints.
        pose: A pose that the robot reaches, shape (m,).
        rate: Its rate, shape (m,); the coordinates of the plant move likewise.
        margins: SafetyMargins; None: without `estimate`.
    """
    with wrap_user_errors(robot.name):
        start = np.array(robot.module.start(robot.parameters, pose), dtype=float)
    coordinates = vector(start)
    moved = np.resize(rate, len(start))
    measure = _bound(robot, 'measure', coordinates, coordinates)

    def at(time: float, change: Any = 0.0) -> Measurement:
        here: Measurement = measure(
            vector(start + moved * time), vector(moved + np.asarray(change) * time)
        )
        return here

    here, near = at(0.0), _near(at)
    yield _check('measure', 'pose, from that given to start', here.pose, pose)
    for name in ('position', 'passive_position'):
        rates = name.replace('position', 'velocity')
        slope = _slope(getattr(each, name) for each in near)
        what = f'{rates.replace("_", " ")}, from differences of {name.replace("_", " ")}'
        yield _check('measure', what, getattr(here, rates), slope)
    yield from _kinematics(robot, here, pose, rate)
    row = vector(here.position)
    box = Boxed(load)
    accelerate = _bound(robot, 'acceleration', box, coordinates, coordinates, row, 0.0)
    torque = np.cos(np.arange(len(row)))
    for speed in (0.0, 1.0):  # from rest, too
        change = np.asarray(
            accelerate(box, coordinates, vector(speed * moved), vector(torque), 0.0)
        )
        yield Check('acceleration', 'result', float(np.abs(change - change).max(initial=0.0)), 0.0)
    if margins is not None:
        given = np.asarray(net_torque(box.value, vector(torque), here.velocity, 0.0))
        yield from _dynamics(robot, margins, at, change, given)


def _kinematics(robot: RobotModel, here: Measurement, pose: Array, rate: Array) -> Iterator[Check]:
    """Joints of a moving pose, and the pose of these joints."""
    still = vector(np.zeros(len(pose)))
    motion = _bound(robot, 'joint_motion', PoseMotion(still, still, still))
    change = rate[::-1]

    def at(time: float) -> Any:
        moved = pose + rate * time + change * time**2 / 2
        return motion(PoseMotion(*map(vector, (moved, rate + change * time, change))))

    now, near = at(0.0), _near(at)
    if any(each.out_of_reach != REACHED for each in (now, *near)):
        return  # whoever plans a motion says so
    yield _check('joint_motion', 'position, from that of measure', now.position, here.position)
    for name, of in (('velocity', 'position'), ('acceleration', 'velocity')):
        slope = _slope(getattr(each, of) for each in near)
        yield _check(
            'joint_motion', f'{name}, from differences of {of}', getattr(now, name), slope
        )
    guess = vector(pose * (1.0 + GUESS))
    location = _bound(robot, 'locate', vector(now.position), guess)(vector(now.position), guess)
    what = 'pose, from that whose joints it is given'
    missing = np.full(len(pose), np.nan)
    yield _check('locate', what, location.pose if location.fault == FOUND else missing, pose)


def _dynamics(
    robot: RobotModel, margins: Any, at: Callable[..., Measurement], change: Array, given: Array
) -> Iterator[Check]:
    """The model of the controller, against itself and against the plant."""
    here, beside = at(0.0), _near(lambda time: at(time, change))
    words = margins, vector(here.position), vector(here.velocity), vector(here.pose)
    estimate = _bound(robot, 'estimate', *words)

    def model_at(state: Measurement) -> Estimate:
        estimated: Estimate = estimate(
            margins, vector(state.position), vector(state.velocity), vector(state.pose)
        )
        return estimated

    now, *near = map(model_at, (here, *beside))
    if any(each.fault != FOUND for each in (now, *near)):
        return  # beyond a margin
    yield _check('estimate', 'pose, from that of measure', now.pose, here.pose)
    M, Q = np.asarray(now.model.M), np.asarray(now.model.Q)
    size = float(np.abs(M).max())
    yield _check('estimate', 'M, from its transpose', M, M.T)
    least = float(np.linalg.eigvalsh((M + M.T) / 2).min()) if np.isfinite(M).all() else np.nan
    lacks = 0.0 if least > 0.0 else max(-least, 1e-3 * size, 1e-3)
    yield Check('estimate', 'M, from one that is positive definite', lacks, size)
    slope = _slope(each.model.M for each in near)
    skew = slope - Q - Q.T
    largest = max(float(np.abs(slope).max()), float(np.abs(Q).max()), 1e-3 * size)
    what = 'Mdot - 2 Q, from a skew-symmetric matrix'
    yield Check('estimate', what, float(np.abs(skew).max()), largest)
    joints = _slope(each.velocity for each in beside)
    needed = M @ joints + Q @ np.asarray(here.velocity) + np.asarray(now.model.gravity)
    yield _check(
        'estimate', 'M thdd + Q thd + gravity, from the torque of acceleration', needed, given
    )


def _bound(robot: RobotModel, name: str, *example: Any) -> Callable[..., Any]:
    """A kernel of the robot with its constants."""
    function, constants = robot.kernel(name, *example), robot.constants

    def called(*arguments: Any) -> Any:
        with wrap_user_errors(f'{robot.name}: {name}'):
            return function(constants, *arguments)

    return called


def _near(at: Callable[[float], Any]) -> list[Any]:
    """States from which a rate follows, see :func:`_slope`."""
    return [at(steps * H) for steps in SLOPE]


def _slope(near: Iterable[Any]) -> Array:
    """Rate of change by a central difference of fourth order, from states of :func:`_near`."""
    weights = np.array([*SLOPE.values()]) / H
    return np.tensordot(weights, np.array([np.asarray(each) for each in near]), 1)


def _check(function: str, what: str, given: Any, right: Any) -> Check:
    given, right = np.asarray(given), np.asarray(right)
    difference = float(np.abs(given - right).max(initial=0.0))
    return Check(function, what, difference, float(np.abs(right).max(initial=0.0)))
