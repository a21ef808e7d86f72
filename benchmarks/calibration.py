"""What calibration makes of robots off by 1 mm and 2 mrad: coverage of intervals, true error.

Each robot differs from the nominal one in links, platform, base and zero angles, by normal
numbers of that rms. It stands in the poses that `calibrate --design` chooses, as the nominal robot
would; a tracker measures them with 10 um of noise, and 50 urad, which is as much at the joints of
the platform, encoders the joints with 5 urad. The true error is that of the calibrated robot over
all that it reaches, beside the true one.

Usage: python benchmarks/calibration.py [robots [poses]]
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import checkout  # noqa: F401 finds the suite
import numpy as np
from rows import row, show

from parallel_robot.studies.calibration import geometry, least_squares, reach
from parallel_robot.studies.calibration.design import design
from parallel_robot.studies.calibration.locating import Locator
from parallel_robot.studies.calibration.pose_model import JointTrack, MeasuredPoses, PoseModel
from parallel_robot_control.configuration import nominal_of, resolve
from trajectory_gen.configuration import trajectory_of

OFF, TURNED = 1e-3, 2e-3  # m and rad, rms
ENCODER = 5e-6  # rad, rms
TRACKER = {'m': 1e-5, 'rad': 5e-5}  # rms
ROBOTS = {'planar_3rrr': 'paper_circle', 'serial_2r': 'serial_2r_circle'}
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
    for name, scenario in ROBOTS.items():
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
    chosen = design(scenario, {}, poses)
    trajectory = trajectory_of(values)
    places = reach.candidates(trajectory, centre, PLACES, seed=1)
    everywhere = np.array([reach.joints(trajectory, each) for each in places])
    locate, numbers = Locator(robot), geometry.find(robot, chosen.position, chosen.poses)
    size = np.array([OFF if each.unit == 'm' else TURNED for each in numbers])
    noise = [TRACKER[axis.unit] for axis in robot.module.coordinates(robot.parameters)]
    columns = tuple(range(len(noise)))
    found = []
    for seed in range(robots):
        rng = np.random.default_rng(seed)
        nominal = geometry.values(robot, numbers)
        true = nominal + size * rng.normal(size=len(size))
        zero = TURNED * rng.normal(size=everywhere.shape[1])
        body = geometry.with_values(robot, numbers, true)
        pose = locate(body, chosen.position - zero, chosen.poses)
        assert pose is not None
        pose = pose + noise * rng.normal(size=pose.shape)
        shown = chosen.position + ENCODER * rng.normal(size=chosen.position.shape)
        rest = np.repeat(shown, 2, axis=0)
        track = JointTrack(np.add.outer(10.0 * np.arange(poses), [0.0, 1.0]).ravel(), rest)
        measured = MeasuredPoses(10.0 * np.arange(poses) + 0.5, columns, pose)
        names = tuple(values['joints'])
        model = PoseModel(robot, names, track, measured, chosen.poses, np.zeros_like(zero))
        fit = least_squares.fit(model)
        truth = np.concatenate([true, zero])
        inside = np.abs(fit.values - np.append(truth, 0.0)) <= fit.half_widths
        told = [k for k in range(len(truth)) if k not in fit.kept]
        actual = locate(body, everywhere - zero, places)
        believed = locate(robot, everywhere, places)
        turned = everywhere - fit.values[model.zeros]
        calibrated = locate(model.robot_with(fit.values), turned, places)
        assert actual is not None and believed is not None and calibrated is not None
        before, after = (
            1e6 * float(np.sqrt(((pose - actual)[:, :2] ** 2).sum(axis=1).mean()))
            for pose in (believed, calibrated)
        )
        found.append(Found(inside[told].tolist(), before, after))
    return found


if __name__ == '__main__':
    main()
