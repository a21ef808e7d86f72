"""Poses that tell most of the geometry: those with the largest determinant of the information.

Of many poses that the robot reaches, some are chosen one after another, then exchanged one by one
as long as that is better.

Source:
    Fedorov (1972), Theory of Optimal Experiments, chapter 3 (exchange); Borm, Menq (1991),
    Determination of optimal measurement configurations for robot calibration based on
    observability measure, Int. J. Robotics Research 10(1).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from parallel_robot.studies.calibration import least_squares
from parallel_robot.studies.calibration.pose_model import (
    NOISE,
    JointTrack,
    MeasuredPoses,
    PoseModel,
)
from parallel_robot.studies.calibration.tracker import FREE
from parallel_robot.studies.estimate import WrittenResult, check_files, condition_number
from parallel_robot_control.configuration import nominal_of, resolve
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.options import named, optional_path
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.config import Changes, Place, changes
from parallel_robot_model.configuration.fields import Field, check, given_zero_angles
from parallel_robot_model.robots.contract import REACHED
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen import preflight
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.trajectory import Reference, Trajectory
from trajectory_gen.waypoints import Spline

# Poses that a robot reaches from a first one along straight lines, as its motion limits allow.

SAMPLES = 200  # of a line that is looked at
FARTHEST = 1.5  # m or rad of a coordinate, the end of a line that nothing stops
SHARE = 0.5  # of the line up to what stops it: nearer to singularities, little more is told
EDGE = 0.98  # the same of lines between poses, in parts of what is left of it


def along(trajectory: Trajectory, first: Array, last: Array) -> Reference:
    """A straight line of poses, at an even rate, up to the first that is out of reach.

    Args:
        trajectory: Any motion of the robot, within the limits that hold.
        first: Where it begins, shape (m,).
        last: Where it ends, shape (m,).
    """
    return _line(trajectory, first, last).sample(np.linspace(0.0, 1.0, SAMPLES), beyond=False)


def joints_within_reach(trajectory: Trajectory, pose: Array) -> Array:
    """Joints at a pose within reach [rad or m], shape (n,)."""
    return np.asarray(_line(trajectory, pose, pose).sample(0.0).position[0])


def _line(trajectory: Trajectory, first: Array, last: Array) -> Trajectory:
    coefficients = np.zeros((1, 6, len(first)))
    coefficients[0, 4:] = last - first, first
    return trajectory.along(Spline(np.array([0.0, 1.0]), coefficients, False))


def reached(trajectory: Trajectory, line: Reference) -> int:
    """How many samples of a line can be performed before the first that cannot."""
    failures = trajectory.robot.module.infeasible(
        trajectory.robot.parameters, trajectory.limits, line
    )
    lost = np.flatnonzero(line.out_of_reach != REACHED)
    return min([len(line.pose), *(each.sample for each in failures), *lost[:1].tolist()])


def candidates(trajectory: Trajectory, centre: Array, count: int, seed: int) -> Array:
    """Poses in all directions from a first one, up to the limits, shape (count, m).

    Every second one is at the end of its line, the others anywhere on it.
    """
    rng = np.random.default_rng(seed)
    found = np.empty((count, len(centre)))
    for k in range(count):
        direction = rng.normal(size=len(centre))
        direction *= FARTHEST / np.abs(direction).max()
        line = along(trajectory, centre, centre + direction)
        share = SHARE * (rng.uniform() if k % 2 else 1.0)
        part = share * max(reached(trajectory, line) - 1, 0) / (SAMPLES - 1)
        found[k] = centre + part * direction
    return found


CANDIDATES = 500
PASSES = 20  # of exchanges
BETTER = 1e-9  # of the logarithm of the determinant
RANDOM = 20  # choices at random, for comparison
MOST = 200  # poses
REST = 1.0  # s at each pose
FASTEST = 0.3  # rad/s of a joint on the way
SHORTEST = 1.0  # s of a way
INNER = 7  # points of a way between its ends, and of a rest


@dataclass(repr=False)
class Designed(WrittenResult):
    """Poses that tell most."""

    robot: RobotModel
    joints: tuple[str, ...]  # names of the joints
    time: Array  # middle of the rest at each pose [s], shape (N,)
    poses: Array  # the poses in the order in which they are visited, shape (N, m)
    position: Array  # actuated joints at them [rad], shape (N, n)
    # error of the calibrated robot that is to be expected over its reach, rms, for a noise
    # of NOISE [m], or [rad] without a plane
    error: float
    at_random: float  # the same with as many poses at random, the median of RANDOM choices
    condition: float  # condition number of what is looked for
    motion: dict[str, dict[str, Any]]  # keys of a motion that visits them

    content = 'motion'

    @property
    def unit(self) -> str:
        """Unit of the errors."""
        return 'm' if self.robot.place else self.robot.joint_units.of('rad')

    def parts(self) -> list[Part]:
        """The poses, and what they tell."""
        poses = np.column_stack((self.time, self.poses, self.position))
        rows = [[f'{value:.5f}' for value in row] for row in poses]
        units = self.robot.joint_units
        axes = self.robot.module.coordinates(self.robot.parameters)
        head = ['t [s]', *(f'{axis.name} [{axis.unit}]' for axis in axes)]
        head += [f'{joint} [{units.one(k).of("rad")}]' for k, joint in enumerate(self.joints)]
        noise = f'noise of {1e6 * NOISE["m"]:g} µm and {1e6 * NOISE["rad"]:g} µrad'
        error, at_random = (f'{1e6 * each:.3g}' for each in (self.error, self.at_random))
        return [
            Table(head, rows, 'r'),
            f'error of the calibrated robot that is to be expected, rms, with a {noise}: '
            f'{error} µ{self.unit}; by {len(rows)} poses at random {at_random}',
            f'condition number {self.condition:.4g}',
        ]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        names = [axis.name for axis in self.robot.module.coordinates(self.robot.parameters)]
        return {
            'robot': self.robot.name,
            'time_s': self.time.tolist(),
            'poses': [dict(zip(names, pose.tolist(), strict=True)) for pose in self.poses],
            'joints_rad': [dict(zip(self.joints, q.tolist(), strict=True)) for q in self.position],
            f'error_rms_{self.unit}': self.error,
            f'at_random_rms_{self.unit}': self.at_random,
            'condition_number': self.condition,
        }

    def groups(self) -> dict[str, dict[str, Any]]:
        """A motion that visits the poses."""
        return self.motion

    def header(self) -> list[str]:
        """What it is."""
        what = f'{len(self.poses)} poses of {self.robot.name} that tell most of its geometry'
        return [f'{what}, with {REST:g} s of rest at each.']


def check_free(free: Any) -> None:
    """Refuse what cannot be unknown of a tracker.

    Raises:
        InputError: it is no list, or one of them is none of FREE.
    """
    if isinstance(free, str):
        raise InputError(f'free must be a list of {", ".join(FREE)}, not {free!r}')
    for each in free:
        if each not in FREE:
            raise UnknownNameError('--free', str(each), FREE)


def calibration_poses(
    scenario: Place,
    count: int,
    *,
    free: Sequence[Literal['frame', 'target']] = (),
    out: Place | None = None,
    seed: int = 0,
    param_file: Changes = None,
    **values: Any,
) -> Designed:
    """Choose poses that tell most, as ``parallel_robot calibrate --design`` does.

    >>> import parallel_robot as pr
    >>> pr.calibration_poses('serial_2r_circle', 4).poses.shape
    (4, 2)

    Args:
        scenario: Name or file of a scenario, around whose first pose they are.
        count: Without a bag: so many poses are chosen that tell most around the first one of
            `scenario`; `out` has the motion through them.
        free: What is unknown of the tracker, as of ``calibrate``.
        out: YAML file of the motion, for `param_file`, which must not exist; default: none.
        seed: Seed of the poses that they are chosen from; default: 0.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values.

    Raises:
        InputError: a value is wrong, or so few poses cannot tell the geometry.
    """
    file = optional_path('out', out)
    check_files(file)
    check_free(free)
    name = named('scenario', scenario)
    found = _designed(name, changes(param_file, values), count, free, seed)
    found.write(file)
    return found


def _designed(
    scenario: str, changes: Mapping[str, Any], count: int, free: Collection[str], seed: int
) -> Designed:
    count = check('--design', int, Field('', '', 2, MOST), count)
    seed = check('--seed', int, Field('', '', 0, 2**63 - 1), seed)
    values = resolve(scenario, changes)
    robot, centre = nominal_of(values)
    trajectory = trajectory_of(values)
    poses = np.vstack((centre, candidates(trajectory, centre, CANDIDATES, seed)))
    position = np.array([joints_within_reach(trajectory, pose) for pose in poses])
    time = np.arange(len(poses), dtype=np.float64)
    joints = tuple(values['joints'])
    measured = MeasuredPoses(time, tuple(range(poses.shape[1])), poses)
    track = JointTrack(time, position + given_zero_angles(values))
    model = PoseModel(robot, joints, track, measured, poses, given_zero_angles(values), free)
    size = len(model.start) - 1  # without the clock
    slopes = model.slopes(model.start, (size,))[:, :, :size] / model.noise[:, np.newaxis]
    flat = slopes.reshape(-1, size) * model.told[:size]
    kept, _ = least_squares.kept_values(flat, model.preference[:size])
    told = [k for k in range(size) if k not in kept]
    if count * poses.shape[1] < len(told):
        raise InputError(
            f'--design must be at least {-(-len(told) // poses.shape[1])} poses for '
            f'{len(told)} unknown, not {count}'
        )
    J = slopes[:, :, told]
    chosen = _exchanged(J, _greedy(J, count))
    rng = np.random.default_rng(seed)
    columns = measured.columns[: robot.place or None]
    robots = [k for k, each in enumerate(told) if each < model.zeros.stop]
    others = [rng.choice(len(J), count, replace=False) for _ in range(RANDOM)]
    error, *at_random = (
        _error(J, rows, model.noise, robots, columns) for rows in (chosen, *others)
    )
    ordered = _ordered(position, chosen)
    motion, rests = _motion(values, trajectory, centre, poses[ordered])
    singular = np.linalg.svd(J[chosen].reshape(-1, len(told)), compute_uv=False)
    return Designed(
        robot,
        joints,
        rests,
        poses[ordered],
        position[ordered],
        error,
        float(np.median(at_random)),
        condition_number(singular),
        motion,
    )


def _information(J: Array, rows: Any) -> Array:
    """Information of some poses, with a trace of some that is known before, shape (P, P)."""
    found = np.einsum('nkp,nkq->pq', J[rows], J[rows])
    return np.asarray(found + np.eye(J.shape[2]))


def _gains(J: Array, chosen: list[int]) -> Array:
    """By how much each other pose increases the logarithm of the determinant, shape (N,)."""
    of = J @ np.linalg.inv(_information(J, chosen)) @ J.swapaxes(1, 2)
    gains = np.asarray(np.linalg.slogdet(np.eye(J.shape[1]) + of)[1])
    gains[chosen] = -math.inf
    return gains


def _greedy(J: Array, count: int) -> list[int]:
    """Poses chosen one after another, each the best beside those before."""
    chosen: list[int] = []
    for _ in range(count):
        chosen.append(int(np.argmax(_gains(J, chosen))))
    return chosen


def _exchanged(J: Array, chosen: list[int]) -> list[int]:
    """Poses after exchanges, each for the best beside the others."""
    chosen = [*chosen]
    for _ in range(PASSES):
        before = [*chosen]
        for place, old in enumerate(before):
            others = chosen[:place] + chosen[place + 1 :]
            gains = _gains(J, others)
            best = int(np.argmax(gains))
            if gains[best] > gains[old] + BETTER:
                chosen[place] = best
        if chosen == before:
            break
    return chosen


def _error(
    J: Array, rows: Any, scale: Array, of_robot: list[int], columns: Collection[int]
) -> float:
    """Error of the robot that is to be expected over all poses by a calibration at some, rms."""
    covariance = np.linalg.inv(_information(J, rows))[np.ix_(of_robot, of_robot)]
    slopes = (J * scale[:, np.newaxis])[:, list(columns)][:, :, of_robot]
    square = np.einsum('nkp,pq,nkq->n', slopes, covariance, slopes).mean()
    return float(np.sqrt(square if len(columns) == 2 else square / len(columns)))


def _ordered(position: Array, chosen: list[int]) -> list[int]:
    """Poses in an order of short ways between their joints, from the first of all candidates."""
    left, here, found = [*chosen], 0, []
    while left:
        ways = np.abs(position[left] - position[here]).max(axis=1)
        here = left.pop(int(np.argmin(ways)))
        found.append(here)
    return found


def _motion(
    values: Mapping[str, Any], trajectory: Trajectory, centre: Array, poses: Array
) -> tuple[dict[str, dict[str, Any]], Array]:
    """A motion with a rest at each of some poses, by straight lines; over the centre if need be.

    Returns:
        Its keys, and the middle of the rest at each pose [s], shape (N,).
    """
    stops, wanted = [centre], []
    for pose in poses:
        # a straight line must be as far within the limits as the candidates are
        ends = (centre + (end - centre) * EDGE / SHARE for end in (stops[-1], pose))
        if reached(trajectory, along(trajectory, *ends)) < SAMPLES:
            stops.append(centre)
        wanted.append(len(stops))
        stops.append(pose)
    times, points, rests, now = [0.0], [stops[0]], [], 0.0
    shares = np.arange(1, INNER + 2) / (INNER + 1)
    for first, last in zip([stops[0], *stops], stops, strict=False):
        turned = np.abs(
            joints_within_reach(trajectory, last) - joints_within_reach(trajectory, first)
        ).max()
        way = max(SHORTEST, 1.875 * turned / FASTEST)  # a quintic's peak over its mean rate
        if (last != first).any():
            smooth = shares**3 * (10.0 - 15.0 * shares + 6.0 * shares**2)
            times += (now + way * shares).tolist()
            points += [first + share * (last - first) for share in smooth]
            now += way
        times += (now + REST * shares).tolist()
        points += [last] * len(shares)
        rests.append(now + 0.5 * REST)
        now += REST
    tree: dict[str, dict[str, Any]] = {
        'trajectory': {'shape': 'waypoints'},
        'waypoints': {
            'times': [round(time, 4) for time in times],
            'points': [round(float(number), 6) for point in points for number in point],
        },
        'plant': {'initial_pose': [round(float(number), 6) for number in stops[0]]},
    }
    flat = {f'{group}.{key}': each for group, of in tree.items() for key, each in of.items()}
    preflight.check(trajectory_of({**values, **flat}), float(values['period']))
    return tree, np.array(rests)[wanted]
