"""What calibration makes of robots off by 1 mm and 2 mrad: coverage of intervals, true error.

Each robot differs from the nominal one in links, platform, base and zero angles, by normal
numbers of that rms. It stands in the poses that `calibrate --design` chooses, as the nominal robot
would; a tracker measures them with 10 um of noise, and 50 urad, which is as much at the joints of
the platform, encoders the joints with 5 urad, or 5 um where they slide. Of described machines all
joints lie elsewhere, also where poses cannot tell it: the truth in an interval is what poses
without noise tell beside the same kept values. The true error is that of the calibrated robot over
all that it reaches, beside the true one.

Usage: python benchmarks/calibration.py [robots [poses [name ...]]]
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import checkout  # noqa: F401 finds the suite
import numpy as np
from rows import row, show

from parallel_robot.studies.calibration import least_squares, pose_model
from parallel_robot.studies.calibration.design import (
    Designed,
    calibration_poses,
    candidates,
    joints_within_reach,
)
from parallel_robot.studies.calibration.pose_model import JointTrack, MeasuredPoses, PoseModel
from parallel_robot.studies.calibration.tracker import Locator
from parallel_robot_control.configuration import nominal_of, resolve
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen.configuration import trajectory_of

OFF, TURNED = 1e-3, 2e-3  # m and rad, rms
ENCODER = 5e-6  # rad, rms
TRACKER = {'m': 1e-5, 'rad': 5e-5}  # rms
ROBOTS = {
    'planar_3rrr': 'paper_circle',
    'serial_2r': 'serial_2r_circle',
    'five_bar': 'five_bar_circle',
    'arm6': 'arm6_circle',
    'hexapod': 'hexapod_circle',
    'delta': 'delta_circle',
}
PLACES = 200  # at which the true error is looked at


class Found(NamedTuple):
    """Of one robot: which truths lie in their intervals; true error before and after [um]."""

    inside: list[bool]
    before: float
    after: float


def main() -> None:
    """Print the figures."""
    robots = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    poses = int(sys.argv[2]) if len(sys.argv) > 2 else 30
    rows = []
    for name in sys.argv[3:] or ROBOTS:
        scenario = ROBOTS[name]
        found = campaign(scenario, robots, poses)
        covered = [100.0 * float(np.mean([truth for each in found for truth in each.inside]))]
        after = [each.after for each in found]
        rows += [
            row(f'{name}, truths in their 95 % intervals', '%', covered, '>= 90'),
            row(f'{name}, true error before', 'um', [each.before for each in found]),
            row(f'{name}, true error after {poses} poses', 'um', after, '<= 15'),
            row(f'{name}, the same, worst robot', 'um', [max(after)], '<= 15'),
        ]
    show(rows)


def campaign(scenario: str, robots: int, poses: int) -> list[Found]:
    """Calibrate robots, one after another."""
    values = resolve(scenario)
    robot, centre = nominal_of(values)
    chosen = calibration_poses(scenario, poses)
    trajectory = trajectory_of(values)
    places = candidates(trajectory, centre, PLACES, seed=1)
    everywhere = np.array([joints_within_reach(trajectory, each) for each in places])
    locate, numbers = Locator(robot), movable(robot, chosen)
    size = np.array([OFF if each.unit == 'm' else TURNED for each in numbers])
    joints = len(values['joints'])
    slides = np.array([robot.joint_units.one(k).of('rad') == 'm' for k in range(joints)])
    noise = [TRACKER[axis.unit] for axis in robot.module.coordinates(robot.parameters)]
    columns, names = tuple(range(len(noise))), tuple(values['joints'])
    found = []
    for seed in range(robots):
        rng = np.random.default_rng(seed)
        nominal = pose_model.values_of(robot, numbers)
        true = nominal + size * rng.normal(size=len(size))
        zero = np.where(slides, OFF, TURNED) * rng.normal(size=joints)
        body = pose_model.with_values(robot, numbers, true)
        rows = reached(locate, body, chosen.position - zero, chosen.poses)
        exact = locate(body, chosen.position[rows] - zero, chosen.poses[rows])
        assert exact is not None
        pose = exact + noise * rng.normal(size=exact.shape)
        shown = chosen.position[rows] + ENCODER * rng.normal(size=(len(rows), joints))

        def seen(pose: Array, joints: Array, rows: Array = rows) -> PoseModel:
            time = np.add.outer(10.0 * np.arange(len(rows)), [0.0, 1.0])
            track = JointTrack(time.ravel(), np.repeat(joints, 2, axis=0))
            measured = MeasuredPoses(time[:, 0] + 0.5, columns, pose)
            guesses = chosen.poses[rows]
            return PoseModel(robot, names, track, measured, guesses, np.zeros(joints.shape[1]))

        model = seen(pose, shown)
        fit = least_squares.fit(model)
        told = [k for k in range(len(model.start)) if k not in fit.kept]
        truth = fit.values.copy()  # where those that are kept have these values
        clear = seen(exact, chosen.position[rows])
        truth[told] = least_squares.solved(clear, truth.copy(), told, fit.noise)
        inside = np.abs(fit.values - truth) <= fit.half_widths
        there = reached(locate, body, everywhere - zero, places)
        joints_there, guesses = everywhere[there], places[there]
        actual = locate(body, joints_there - zero, guesses)
        believed = locate(robot, joints_there, guesses)
        turned = joints_there - fit.values[model.zeros]
        calibrated = locate(model.robot_with(fit.values), turned, guesses)
        assert actual is not None and believed is not None and calibrated is not None
        before, after = (
            1e6 * float(np.sqrt(((pose - actual)[:, : robot.place] ** 2).sum(axis=1).mean()))
            for pose in (believed, calibrated)
        )
        found.append(Found(inside[told].tolist(), before, after))
    return found


def movable(robot: RobotModel, chosen: Designed) -> tuple[pose_model.Number, ...]:
    """What of a robot is off: of a machine all, also what poses do not show."""
    geometry = robot.module.geometry
    if geometry is None:
        return pose_model.find_numbers(robot, chosen.position, chosen.poses)
    key, names, unit = geometry(robot.parameters)
    return tuple(pose_model.Number(key, k, unit) for k in range(len(names)))


def reached(locate: Locator, body: RobotModel, position: Array, poses: Array) -> Array:
    """Poses which the true robot can reach at these joints, one after another."""
    rows: list[int] = []
    for k in range(len(poses)):
        tried = [*rows, k]
        if locate(body, position[tried], poses[tried]) is not None:
            rows = tried
    return np.array(rows)


if __name__ == '__main__':
    main()
