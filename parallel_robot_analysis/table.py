"""A bag as a table: one row a state, the units in the names of the columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_analysis import metrics
from parallel_robot_analysis.metrics import Poses
from parallel_robot_bags import answers, run_log, telemetry
from parallel_robot_bags.limits import MEMORY
from parallel_robot_bags.run_log import RunLog
from parallel_robot_base.errors import InputError, ParallelRobotError
from parallel_robot_base.topics import SLIDING_VARIABLE
from parallel_robot_control.coupling import synchronisation_error

POSE = ('x_m', 'y_m', 'phi_rad')


class Table(NamedTuple):
    """A bag as a table.

    Attributes:
        columns: Name to numbers, shape (N,).
        warnings: What is wrong with the bag, or cannot be computed, one line each.
    """

    columns: dict[str, np.ndarray]
    warnings: tuple[str, ...]


def read(bag: Path, memory: int = MEMORY) -> Table:
    """Read a bag, see :func:`run_log.read`.

    Args:
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of it [bytes].

    Raises:
        BagError: not a bag, or a topic that the table needs is not in it.
    """
    log = run_log.read(bag, memory)
    warnings = log.warnings
    try:
        _, poses, cut = metrics.with_poses(log)
        warnings += (f'the pose of the platform is {cut}',) if cut else ()
    except ParallelRobotError as error:
        nothing = np.empty((0, len(POSE)))
        poses = Poses(nothing, nothing)
        warnings += (f'no pose of the platform: {error}',)
    sliding = np.full(log.position.shape, np.nan)
    found = telemetry.read(bag, log, SLIDING_VARIABLE, memory)
    if found is not None:
        row = answers.by_state(log.stamps, found.stamps)
        sliding[row >= 0] = found.numbers['position'][row[row >= 0]]
    return Table(columns(log, poses, sliding), warnings)


def columns(log: RunLog, poses: Poses, sliding_variable: np.ndarray) -> dict[str, np.ndarray]:
    """A run as columns: name with unit to numbers, shape (N,).

    Args:
        log: The run.
        poses: Those of its first states; NaN takes the place of the others.
        sliding_variable: In the unit of the law, NaN where it is not known, shape (N, n).
    """
    count = len(log.time)
    actual, reference = (_filled(pose, count) for pose in poses)
    quantities = {
        'position_rad': log.position,
        'velocity_rad_per_s': log.velocity,
        'effort_nm': log.effort,
        'reference_position_rad': log.reference_position,
        'reference_velocity_rad_per_s': log.reference_velocity,
        'reference_acceleration_rad_per_s2': log.reference_acceleration,
        'command_nm': log.answer,
        'synchronisation_error_rad': synchronisation_error(log.reference_position - log.position),
        'sliding_variable': sliding_variable,
    }
    return (
        {'time_s': log.time, 'stamp_ns': log.stamps}
        | {
            f'{joint}_{quantity}': numbers[:, k]
            for quantity, numbers in quantities.items()
            for k, joint in enumerate(log.joints)
        }
        | {f'platform_{name}': actual[:, k] for k, name in enumerate(POSE)}
        | {f'platform_reference_{name}': reference[:, k] for k, name in enumerate(POSE)}
        | {'platform_error_m': metrics.distances(Poses(actual, reference))}
    )


def to_frame(bag: Path) -> Any:
    """A bag as a pandas DataFrame, see :func:`read`.

    Raises:
        InputError: pandas is not installed.
        BagError: not a bag, or a topic that the table needs is not in it.
    """
    try:
        import pandas  # optional
    except ImportError:
        raise InputError('pandas is not installed; pip install pandas') from None
    return pandas.DataFrame(read(bag).columns)


def _filled(rows: np.ndarray, count: int) -> np.ndarray:
    """Rows and then NaN, `count` in all."""
    missing = np.full((count - len(rows), rows.shape[1]), np.nan)
    return np.concatenate([rows, missing])
