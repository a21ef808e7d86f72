"""The geometry of the robot of a bag calibrated by measured poses, told and written."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot.bags import gathered_run, new_files, pose_topics, recorded_robot
from parallel_robot.bags.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.pose_topics import StampedPoses
from parallel_robot.bags.recorded_robot import NONE, RobotCode
from parallel_robot.bags.run_log import RunLog
from parallel_robot.studies.calibration import (
    least_squares,
    parameter_file,
    readable,
    tracker_file,
)
from parallel_robot.studies.calibration.least_squares import Fit
from parallel_robot.studies.calibration.pose_model import JointTrack, MeasuredPoses, PoseModel
from parallel_robot.studies.calibration.tracker import TURNS
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import BagError, InputError, KinematicsError, RobotError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.common.shown_result import ShownResult
from parallel_robot_model.common.tables import Part
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.zero_angles import known
from parallel_robot_model.robots.configuration import is_known
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_model.robots.registry import RobotModel

GAP = 0.02  # s between two states, beyond which nobody knows the joints in between
MOST = 20_000  # poses that are used
STRAY = 6.0  # of the noise, an error that is doubted


@dataclass(frozen=True, repr=False)
class Calibration(ShownResult):
    """What measured poses tell of a robot.

    Attributes:
        bag: The bag.
        model: What was looked for.
        found: What was found.
        warnings: What was not used, and what to doubt, one line each.
    """

    bag: Path
    model: PoseModel
    found: Fit
    warnings: tuple[str, ...]

    @property
    def robot(self) -> RobotModel:
        """The calibrated robot."""
        return self.model.robot_with(self.found.values)

    @property
    def values(self) -> dict[str, Any]:
        """The robot as keys of the configuration and their values."""
        groups = parameter_file.groups(self.model, self.found)
        return {f'{group}.{key}': each for group, of in groups.items() for key, each in of.items()}

    def parts(self) -> list[Part]:
        """The results as tables."""
        return readable.parts(self.model, self.found)

    def as_data(self) -> dict[str, Any]:
        """The results as plain data, as ``--format json`` has them."""
        return readable.as_data(self.model, self.found)

    def write(self, out: Path) -> None:
        """Write the robot as YAML, for ``--param-file``, into a file that must not exist.

        Raises:
            InputError: it cannot be written.
        """
        content = parameter_file.text(self.model, self.found, str(self.bag))
        new_files.save(out, content.encode())


def calibrate(
    bag: Path,
    poses: Path | None = None,
    topic: str | None = None,
    free: Collection[str] = (),
    memory: int = MEMORY,
    code: RobotCode = NONE,
    view: BagView = AS_RECORDED,
) -> Calibration:
    """Calibrate the robot of a bag.

    Args:
        bag: Directory of the bag, or its MCAP file.
        poses: CSV of measured poses; None: they are in the bag.
        topic: Topic of measured poses in the bag; None: the only one.
        free: What is unknown of the tracker, see FREE.
        memory: What may be held of the bag [bytes].
        code: What may run to know the robot.
        view: What the bag does not say itself, and which part is wanted.

    Raises:
        BagError: it is no bag of a run, or its poses do not suffice.
        InputError: a value is wrong, or a file cannot be read.
    """
    log = recorded_robot.evaluated(
        lambda windows: gathered_run.of(bag, windows, ('position',)),
        bag,
        memory,
        code,
        view=view,
        motion_only=True,
    ).log
    if not is_known(log.config):
        raise BagError(f'{bag}: {recorded_robot.unknown(log.config)}')
    robot, guess = nominal_of(log.config)
    names = [axis.name for axis in robot.module.coordinates(robot.parameters)]
    warnings = [*log.warnings]
    home = _home(robot)
    if poses is not None:
        file = tracker_file.read(poses, names, log.start_stamp, home)
        measured = MeasuredPoses(file.time, file.columns, file.pose)
        if file.unused:
            listed = printable(', '.join(file.unused), 80)
            warnings.append(f'{poses}: not used: the columns {listed}')
        if file.missing:
            warnings.append(f'{poses}: not used: {file.missing} lines without a pose')
    else:
        found = pose_topics.read(bag, topic, memory)
        if found.missing:
            warnings.append(f'{bag}: not used: {found.missing} messages without a pose')
        time = (found.stamps - log.start_stamp) / NANOSECONDS
        measured = MeasuredPoses(time, *_coordinates(robot, names, found, home))
    track = _track(log)
    measured, remarks = _joined(track, measured, poses or bag)
    warnings += remarks
    with _naming(bag):
        zero = known(log.config)
        nominal = poses_of(robot, track.position - zero, guess)
        rows = np.minimum(np.searchsorted(track.time, measured.time), len(nominal) - 1)
        model = PoseModel(robot, log.joints, track, measured, nominal[rows], zero, free)
        fit = least_squares.fit(model)
    return Calibration(bag, model, fit, (*warnings, *_doubts(model, fit)))


def _home(robot: RobotModel) -> Rotation | None:
    """Attitude from which the rotation vector of a robot in space counts; None: it has none."""
    if robot.turns != (0, 1, 2):
        return None
    module: Any = robot.module
    [turned] = module.orientations(robot.parameters, np.zeros((1, robot.pose_size)))
    return Rotation.from_quat(turned)


def _coordinates(
    robot: RobotModel, names: list[str], found: StampedPoses, home: Rotation | None
) -> tuple[tuple[int, ...], Array]:
    """Numbers of the coordinates that poses of a bag tell of a robot, and these, shape (N, k).

    Raises:
        InputError: they tell none.
    """
    told = dict(zip('xyz', found.place.T, strict=True))
    if robot.planar:
        told['phi'] = found.phi
    elif robot.place == 0:
        raise InputError(
            f'{robot.name} moves neither in a plane nor in space: --poses FILE.csv has its poses'
        )
    if home is not None:
        turned = (Rotation.from_quat(found.turned) * home.inv()).as_rotvec()
        told |= dict(zip(TURNS, turned.T, strict=True))
    columns = tuple(k for k, name in enumerate(names) if name in told)
    return columns, np.column_stack([told[names[k]] for k in columns])


def _track(log: RunLog) -> JointTrack:
    """The joints of a run, each stamp once."""
    newer = log.stamps > np.concatenate(
        [log.stamps[:1] - 1, np.maximum.accumulate(log.stamps)[:-1]]
    )
    return JointTrack(log.time[newer], log.position[newer])


def _joined(
    track: JointTrack, measured: MeasuredPoses, source: Path
) -> tuple[MeasuredPoses, list[str]]:
    """Poses at which the joints are known, at most MOST, and what was not used, one line each.

    Raises:
        BagError: there are none.
    """
    after = np.searchsorted(track.time, measured.time)
    inside = (after > 0) & (after < len(track.time))
    inside |= np.isin(measured.time, track.time[[0, -1]])
    steps = np.diff(track.time)
    gap = max(GAP, 5.5 * float(np.median(steps))) if len(steps) else GAP
    inside[inside] &= steps[np.clip(after[inside], 1, len(steps)) - 1] <= gap
    remarks = []
    if not inside.any():
        first, last = measured.time[0], measured.time[-1]
        raise BagError(
            f'{source}: no pose was measured while the joints were recorded: poses are from '
            f't = {first:.3f} to {last:.3f} s, joint states from {track.time[0]:.3f} to '
            f'{track.time[-1]:.3f} s'
        )
    outside = int((~inside).sum())
    if outside:
        remarks.append(f'{source}: not used: {outside} poses at times without joint states')
    rows = np.flatnonzero(inside)
    if len(rows) > MOST:
        remarks.append(f'{source}: of {len(rows)} poses, {MOST} are used, evenly')
        rows = rows[np.linspace(0, len(rows) - 1, MOST).astype(int)]
    return MeasuredPoses(measured.time[rows], measured.columns, measured.pose[rows]), remarks


def _doubts(model: PoseModel, found: Fit) -> list[str]:
    """What to doubt of a calibration, one line each."""
    share: Array = np.abs(found.left) / found.noise
    stray = (share > STRAY).any(axis=1)
    if not stray.any():
        return []
    worst = int(np.argmax(share.max(axis=1)))
    return [
        f'{int(stray.sum())} poses are more than {STRAY:g} standard deviations beside what is '
        f'explained, at worst at t = {model.measured.time[worst]:.3f} s: the tracker strayed?'
    ]


@contextlib.contextmanager
def _naming(bag: Path) -> Iterator[None]:
    """Errors of a bag with its name."""
    try:
        yield
    except (BagError, KinematicsError, RobotError) as error:
        raise BagError(f'{bag}: {error}') from None
    except np.linalg.LinAlgError as error:
        raise BagError(f'{bag}: the poses do not tell a geometry: {error}') from None
