"""The geometry of the robot of a bag calibrated by measured poses, told and written."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot.bags.bag_reader import BagView, view
from parallel_robot.bags.output import Progress
from parallel_robot.bags.run import recorded_robot, recording, run_log
from parallel_robot.bags.run.recorded_robot import RobotCode, code_of
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot.studies.calibration import least_squares, measured_poses
from parallel_robot.studies.calibration.calibrated import Calibration, rms
from parallel_robot.studies.calibration.design import check_free
from parallel_robot.studies.calibration.least_squares import (
    MOST_OF_NOISE,
    Fit,
    Outlier,
    Starts,
    search,
    summary,
)
from parallel_robot.studies.calibration.likely_cause import TRIED, likely_cause
from parallel_robot.studies.calibration.measured_poses import (
    KEPT,
    NearStates,
    StampedPoses,
    margin,
)
from parallel_robot.studies.calibration.pose_model import CLOCK_STEP, MeasuredPoses, PoseModel
from parallel_robot.studies.calibration.tracker import TURNS
from parallel_robot.studies.estimate import check_files, named_errors
from parallel_robot_control.configuration import nominal_of
from parallel_robot_model.common.errors import (
    BagError,
    InputError,
    WholeNeededError,
)
from parallel_robot_model.common.options import optional_path, path
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.configuration.config import Place
from parallel_robot_model.configuration.fields import given_zero_angles
from parallel_robot_model.processes.blas_threads import one_blas_thread
from parallel_robot_model.robots.registry import RobotModel, is_known

GAP = 0.02  # s between two states, beyond which nobody knows the joints in between
MOST = 20_000  # poses that are used
MOST_LEFT = 0.2  # of what was left before: more is no result, if it is also MOST_OF_NOISE
STILL = 1e-3  # rad or m, between the least and the greatest place of joints that stand
AT_REST = 10  # pairs of poses that tell the noise of their tracker
NAMED = 5  # outliers that a warning lists

_naming = partial(named_errors, f'the poses do not tell a geometry ({{}}): tried: {TRIED}')


@one_blas_thread()
def calibrate(
    bag: Place,
    *,
    poses: Place | None = None,
    pose_topic: str | None = None,
    free: Sequence[Literal['frame', 'target']] = (),
    robust: bool = False,
    out: Place | None = None,
    figure: Place | None = None,
    trust: bool = False,
    **options: Any,
) -> Calibration:
    """Calibrate the geometry of the robot of a bag, as ``parallel_robot calibrate`` does.

    >>> import parallel_robot as pr
    >>> pr.calibrate('runs/laboratory', poses='tracker.csv').values  # doctest: +SKIP

    Args:
        bag: Bag with the joint states: its directory, or one file of it.
        poses: CSV of measured poses: t [s] or stamp [ns], coordinates of the pose; default: a
            topic of the bag.
        pose_topic: Topic of the bag with measured poses; default: the only one.
        free: What is unknown of the tracker; frame: where it stands; target: where its target sits
            on the platform; may be repeated.
        robust: Whether poses that are not what the others tell are left out, of a tracker that
            lost its target, or swapped rows; default: they are named.
        out: YAML file of the robot, or of the motion, for `param_file`; it must not exist.
        figure: Picture of the errors of the poses before and after, and of the changes: .png,
            .pdf, .svg; likewise.
        trust: Whether the code of the robot that the bag holds runs, with all your rights; on a
            terminal, it is shown first.
        options: What the bag does not say itself, see ``load``, and keys of its configuration,
            such as `custom_robots`, files that take the place of that in the bag.

    Returns:
        The robot as keys of the configuration, ``values``, with tables and warnings.

    Raises:
        BagError: it is no bag of a run, its poses do not suffice, or no geometry explains them.
        InputError: a value is wrong, or a file cannot be read or written.
    """
    file, picture = optional_path('out', out), optional_path('figure', figure)
    check_files(file, picture)
    check_free(free)
    place, table = path('a bag', bag), optional_path('poses', poses)
    if not (pose_topic is None or isinstance(pose_topic, str)):
        raise InputError(f'pose_topic must be the name of a topic, not {pose_topic!r}')
    if table is not None and pose_topic is not None:
        raise InputError('--poses and --pose-topic exclude each other')
    asked = view(**options)
    found = _calibrated(place, table, pose_topic, free, code_of(trust, asked), asked, robust)
    found.write(file, picture)
    return found


def _calibrated(
    bag: Path,
    poses: Path | None,
    topic: str | None,
    free: Collection[str],
    code: RobotCode,
    view: BagView,
    robust: bool,
) -> Calibration:
    duration, states = recording.size(bag, view)

    def look(windows: Iterator[Recording]) -> tuple[RunLog, MeasuredPoses, NearStates, list[str]]:
        """The run without its states, the poses, the states near them, and warnings."""
        lines, near = AlikeLines(), None
        for window in windows:
            log = window.log
            lines.take(bag, log)
            if near is None:
                head = run_log.head(log, 0)
                measured, remarks = _measured(bag, log, poses, topic, states > KEPT)
                most = margin(duration, states, len(measured.time))
                near = NearStates(
                    *nominal_of(log.config), given_zero_angles(log.config), measured.time, most
                )
            with _naming(bag):
                near.add(log)
        if near is None:
            raise WholeNeededError('no window has a state')
        return head, measured, near, [*lines.lines, *remarks]

    log, measured, near, warnings = recorded_robot.evaluated(
        look, bag, code=code, view=view, motion_only=True
    )
    measured, remarks = _joined(near, measured, poses or bag)
    warnings += remarks
    with _naming(bag):
        track, nominal = near.track()
        rows = np.minimum(np.searchsorted(track.time, measured.time), len(nominal) - 1)
        if (np.ptp(track.position, axis=0) < STILL).all():
            raise BagError('the joints stand at one place at all poses')
        robot, _ = nominal_of(log.config)
        zero = given_zero_angles(log.config)
        model = PoseModel(robot, log.joints, track, measured, nominal[rows], zero, free)
    cause, distant = likely_cause(model, free) or ('', False)
    nominally = _rms(model, model.errors(model.start))
    unlike = f'{poses or bag}: the poses are not those of the {robot.name}, {nominally} off;'
    if distant:
        raise BagError(f'{unlike} but with {cause} they are')
    with Progress(None, 'robots tried') as progress, _naming(bag):
        model.watch = progress.show
        (used, fit, stray), tried = search(model)
        hint = _named(model, stray, robust)
        if robust:
            model = used
        elif stray:
            try:
                fit = least_squares.fit(model, fit.values)
            except BagError as error:
                raise BagError(f'{error}; {hint}') from None
    model.watch = lambda _: None  # the bar is gone
    doubt = _judged(model, fit, hint)
    warnings += _doubts(fit, tried, margin(duration, states, len(near.around)))
    warnings += [f'{poses or bag}: {line}' for line in (hint, doubt) if line]
    if cause:
        warnings.append(f'{unlike} with {cause} they nearly are')
    return Calibration(bag, model, fit, stray, robust, tried, tuple(warnings))


def _measured(
    bag: Path, log: RunLog, poses: Path | None, topic: str | None, thinned: bool
) -> tuple[MeasuredPoses, list[str]]:
    """Poses of a file or of the bag, and what was not used of them, one line each."""
    if not is_known(log.config):
        raise BagError(f'{bag}: {recorded_robot.unknown(log.config)}')
    robot, _ = nominal_of(log.config)
    names = [axis.name for axis in robot.module.coordinates(robot.parameters)]
    home, most = _home(robot), MOST if thinned else None
    if poses is not None:
        measured, total, remarks = measured_poses.read_file(
            poses, names, log.start_stamp, home, most
        )
    else:
        found = measured_poses.read_topic(bag, topic, most=most)
        total, missing = found.total, f'{bag}: not used: {found.missing} messages without a pose'
        remarks = [missing] if found.missing else []
        time = (found.stamps - log.start_stamp) / NANOSECONDS
        measured = MeasuredPoses(time, *_coordinates(robot, names, found, home))
    if len(measured.time) < total:
        remarks.append(f'{poses or bag}: of {total} poses, {MOST} are used, evenly')
    return measured, remarks


def _home(robot: RobotModel) -> Rotation | None:
    """Attitude from which the rotation vector of a robot in space counts; None: it has none."""
    if robot.rotation_components != (0, 1, 2):
        return None
    module: Any = robot.module
    [turned] = module.orientations(robot.parameters, np.zeros((1, robot.pose_size)))
    return Rotation.from_quat(turned)


def _coordinates(
    robot: RobotModel, names: list[str], found: StampedPoses, home: Rotation | None
) -> tuple[tuple[int, ...], Array]:
    """Numbers of the coordinates that poses of a bag tell of a robot, and these, shape (N, k)."""
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


def _joined(
    near: NearStates, measured: MeasuredPoses, source: Path
) -> tuple[MeasuredPoses, list[str]]:
    """Poses at which the joints are known, at most MOST, and what was not used, one line each."""
    inside = near.around <= max(GAP, 5.5 * near.period)
    if not inside.any():
        first, last = measured.time[0], measured.time[-1]
        raise BagError(
            f'{source}: no pose was measured while the joints were recorded: poses are from '
            f't = {first:.3f} to {last:.3f} s, joint states from {near.first:.3f} to '
            f'{near.last:.3f} s'
        )
    remarks = []
    outside = int((~inside).sum())
    if outside:
        remarks.append(f'{source}: not used: {outside} poses at times without joint states')
    rows = np.flatnonzero(inside)
    if len(rows) > MOST:
        remarks.append(f'{source}: of {len(rows)} poses, {MOST} are used, evenly')
        rows = rows[np.linspace(0, len(rows) - 1, MOST).astype(int)]
    return measured.of(rows), remarks


def _rms(model: PoseModel, left: Array) -> str:
    """What is left of poses, rms, by unit, for people."""
    return ' and '.join(
        f'{1e3 * rms(left[:, columns]):.3g} m{unit}'
        for unit, columns in model.columns_by_unit.items()
    )


def _named(model: PoseModel, stray: tuple[Outlier, ...], left_out: bool) -> str:
    """Poses that the others do not tell, in one line, the worst ones first; empty if none."""
    if not stray:
        return ''

    def shown(each: Outlier) -> str:
        k = int(np.argmax(each.share))
        axis = model.axes[k]
        return f't = {each.time:.3f} s ({axis.name} by {1e3 * each.off[k]:.3g} m{axis.unit})'

    ordered = sorted(stray, key=lambda each: -each.share.max())
    told = [shown(each) for each in ordered[:NAMED]]
    rest = [each.time for each in ordered[NAMED:]]
    if rest:
        told.append(f'{len(rest)} more between t = {min(rest):.3f} and {max(rest):.3f} s')
    return (
        f'{summary(len(stray), len(model.nominal))}: {", ".join(told)}; '
        f'{"left out" if left_out else "--robust leaves them out"}'
    )


def _judged(model: PoseModel, found: Fit, hint: str) -> str:
    """What to doubt of a calibration by what it leaves of the poses; empty if nothing.

    Medians count, so that poses which stray do not; `hint` tells of these in an error. The noise
    is that of a good tracker, or of this one, if it tells that by poses that follow each other at
    rest.
    """
    left, before = (1.48 * np.median(np.abs(each), axis=0) for each in (found.left, found.before))
    noise = model.noise
    resting = (np.abs(np.diff(model.nominal, axis=0)) < 0.1 * left.min()).all(axis=1)
    if resting.sum() >= AT_REST:
        scatter = np.diff(found.left, axis=0)[resting]
        noise = np.maximum(noise, 1.48 * np.median(np.abs(scatter), axis=0) / math.sqrt(2.0))
    told = ''
    for of in model.columns_by_unit.values():
        now, then, least = (float(np.sqrt(np.mean(x[of] ** 2))) for x in (left, before, noise))
        if now <= MOST_OF_NOISE * least:
            continue
        if now > MOST_LEFT * then:
            raise BagError(
                f'no geometry explains the poses: they are {_rms(model, found.left)} off, before '
                f'{_rms(model, found.before)}; nor does one of {TRIED}'
                + (f'; {hint}' if hint else '')
            )
        told = f'{_rms(model, found.left)} of the poses is left, more than the noise of a tracker'
    return told


def _doubts(found: Fit, tried: Starts, most: float) -> list[str]:
    """What to doubt of a calibration, one line each; `most` of the clock, see :func:`margin`."""
    lines = []
    if abs(found.values[-1]) + CLOCK_STEP > most:
        lines.append(
            f'the clock of the tracker is off by more than {most - CLOCK_STEP:.3g} s: of so long '
            'a bag the joints are kept no further from a pose; shift the times of the poses'
        )
    if tried.rivals:
        lines.append(
            f'{tried.rivals} of {tried.tried} starts of the search end in another robot, which '
            'explains the poses about as well: the best one is given; more poses would decide'
        )
    return lines
