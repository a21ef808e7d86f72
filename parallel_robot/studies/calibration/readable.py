"""A calibrated robot as people read it, and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot.analysis.report.looks import RUNS
from parallel_robot.bags.output import without_mathematics
from parallel_robot.studies.calibration.least_squares import Fit
from parallel_robot.studies.calibration.outliers import Outlier, Starts, summary
from parallel_robot.studies.calibration.pose_model import PoseModel
from parallel_robot.studies.estimation.fit import combination
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import Array, rounded

SHARE = 0.1  # in a unit vector from which an unknown is named
MICRO = {'m': 'µm', 'rad': 'µrad', 's': 'µs'}


def parts(model: PoseModel, found: Fit) -> list[Part]:
    """Geometry, zero angles and tracker with 95 % intervals, and what is not known."""
    half, rows = found.half_widths, []
    for k, each in enumerate(model.unknown):
        unit = MICRO[each.unit]
        interval = 'kept' if k in found.kept else f'+- {1e6 * half[k]:.3g} {unit}'
        change = f'{1e6 * (found.values[k] - model.start[k]):.1f} {unit}'
        rows.append([each.name, f'{found.values[k]:.7g}', each.unit, interval, change])
    kept = ', '.join(model.unknown[k].name for k in found.kept)
    errors = []
    axes = model.robot.module.coordinates(model.robot.parameters)
    for k, column in enumerate(model.measured.columns):
        before, now = (1e6 * rms(rows[:, k]) for rows in (found.before, found.left))
        name = f'{axes[column].name} [{MICRO[axes[column].unit]}]'
        noise = 1e6 * found.noise[k]
        errors.append([name, f'{before:.4g}', f'{now:.4g}', f'{noise:.4g}'])
    expected = ', '.join(
        f'{1e6 * value:.3g} {MICRO[unit]}' for unit, value in expected_error(model, found).items()
    )
    return [
        f'{model.robot.name}: {len(model.measured.time)} poses',
        Table(['unknown', 'estimate', 'unit', '95 % interval', 'change'], rows, 'lrlr'),
        *(f'the poses do not tell: {text}' for text in untold(model, found)),
        *([f'kept, so that the others can be told: {kept}'] if kept else []),
        f'condition number {found.condition:.4g}',
        Table(['error of the poses, rms', 'before', 'now', 'noise'], errors),
        f'error of the calibrated robot that is expected at these poses, rms: {expected}',
    ]


def untold(model: PoseModel, found: Fit) -> list[str]:
    """Combinations that the poses do not tell, one line each.

    There are as many as are kept, and any mixture of them is as good; these have one of those
    that are kept each.
    """
    if not found.kept:
        return []
    basis = np.linalg.solve(found.untold[:, list(found.kept)], found.untold)
    names = [each.name for each in model.unknown]
    return [combination(each / np.linalg.norm(each), names, SHARE) for each in basis]


def expected_error(model: PoseModel, found: Fit) -> dict[str, float]:
    """Error of the calibrated robot at the poses by its covariance, rms, by unit.

    In metres it is a distance, if the robot moves in a plane.
    """
    of_robot = slice(0, model.zeros.stop)
    slopes = found.slopes[:, :, of_robot]
    spread = found.covariance[of_robot, of_robot]
    variance = np.einsum('nkp,pq,nkq->nk', slopes, spread, slopes).mean(axis=0)
    by_unit = sorted(model.columns_by_unit.items())
    return {unit: float(np.sqrt(variance[columns].sum())) for unit, columns in by_unit}


def as_data(
    model: PoseModel, found: Fit, stray: Sequence[Outlier], starts: Starts
) -> dict[str, Any]:
    """All results as plain data, for JSON; None for what keeps its value."""
    axes = model.robot.module.coordinates(model.robot.parameters)
    half = found.half_widths
    return {
        'robot_model': model.robot.name,
        'poses': len(model.measured.time),
        'unknown': [
            {
                'name': each.name,
                'unit': each.unit,
                'estimate': float(found.values[k]),
                'half_width_95': None if k in found.kept else float(half[k]),
                'before': float(model.start[k]),
            }
            for k, each in enumerate(model.unknown)
        ],
        'kept': [model.unknown[k].name for k in found.kept],
        'not_told': untold(model, found),
        'condition': found.condition,
        'pose_error_rms': {
            axes[column].name: {
                'unit': axes[column].unit,
                'before': rms(found.before[:, k]),
                'now': rms(found.left[:, k]),
                'noise': float(found.noise[k]),
            }
            for k, column in enumerate(model.measured.columns)
        },
        'expected_error_rms': expected_error(model, found),
        'outliers': [
            {
                'time': each.time,
                **{
                    axes[column].name: {
                        'unit': axes[column].unit,
                        'off': float(off),
                        'deviations': float(share),
                    }
                    for column, off, share in zip(
                        model.measured.columns, each.off, each.share, strict=True
                    )
                },
            }
            for each in stray
        ],
        'starts': starts._asdict(),
    }


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


# A calibrated robot as YAML, for ``--param-file``.

DIGITS = 10  # significant digits of a parameter
TAKEN_OFF, SHOWN = 'estimator', 'sensor'  # groups with a zero angle: of controller and plant


def header(model: PoseModel, found: Fit, bag: str, outliers: int, robust: bool) -> list[str]:
    """How a robot was found, for the comment of its file; `robust`: without the outliers."""
    kept, count = [model.unknown[k].name for k in found.kept], len(model.measured.time)
    lines = [
        f'The robot {model.robot.name} as calibrated from {count} poses, {printable(bag)}.',
        'Estimate, half width of the 95 % interval:',
        *(
            f'  {each.name} = {value:.8g} +- {half:.2g} {each.unit}'
            for k, (each, value, half) in enumerate(
                zip(model.unknown, found.values, found.half_widths, strict=True)
            )
            if k not in found.kept
        ),
    ]
    if outliers:
        what = 'left out' if robust else 'used, too'
        lines.insert(1, f'{summary(outliers, count + outliers * robust)}: {what}.')
    if kept:
        lines.append(f'Kept as they were, as the poses do not tell them: {", ".join(kept)}.')
    lines.append('The controller takes estimator.zero_angle off what the encoders show; a')
    lines.append('simulated robot has the same in sensor.zero_angle.')
    return lines


def parameter_groups(model: PoseModel, found: Fit) -> dict[str, dict[str, Any]]:
    """The robot and its zero angles as groups of the configuration."""
    every = model.robot_with(found.values).parameters._asdict()
    robot = {
        key: rounded(every[key], DIGITS)
        for key in dict.fromkeys(each.key for each in model.numbers)
    }
    zero = found.values[model.zeros].tolist()
    both = {group: {'zero_angle': rounded(zero, DIGITS)} for group in (TAKEN_OFF, SHOWN)}
    return ({'robot': robot} if robot else {}) | both


# A calibration as a picture: errors of the poses before and after, and what was changed.

WIDTH, ROW = 11.0, 2.2  # in
NAME = 0.16  # in, for the name of an unknown


def draw(model: PoseModel, found: Fit) -> Any:
    """Draw a calibration.

    Above is the error of each pose, one panel a coordinate; below, by how much each unknown
    differs from what was believed, with its 95 % interval, one panel a unit.
    """
    from matplotlib.figure import Figure  # slow to import: only when drawn

    units = [*dict.fromkeys(each.unit for each in model.unknown)]
    of_unit = [[k for k, each in enumerate(model.unknown) if each.unit == one] for one in units]
    heights = [ROW for _ in model.measured.columns] + [1.0 + NAME * len(of) for of in of_unit]
    figure = Figure(figsize=(WIDTH, sum(heights)), layout='constrained')
    panels = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    axes = model.robot.module.coordinates(model.robot.parameters)
    count, colors = len(model.measured.columns), (RUNS[0].light, RUNS[1].light)
    for k, (panel, column) in enumerate(zip(panels, model.measured.columns, strict=False)):
        for color, name, error in zip(
            colors, ('before', 'now'), (found.before, found.left), strict=True
        ):
            size = 1e6 * np.abs(error[:, k])
            panel.plot(model.measured.time, size, '.', color=color, markersize=3, label=name)
        panel.axhline(1e6 * found.noise[k], color='0.4', linestyle=':', label='noise')
        panel.set_yscale('log')
        panel.set_ylabel(f'|error| of {axes[column].name} [{MICRO[axes[column].unit]}]')
        panel.grid(alpha=0.3)
    over = {'loc': 'lower right', 'bbox_to_anchor': (1.0, 1.0), 'frameon': False}
    panels[0].legend(ncols=3, fontsize='small', **over)
    panels[count - 1].set_xlabel('t [s]')
    half = found.half_widths
    for panel, unit, of in zip(panels[count:], units, of_unit, strict=True):
        change = 1e6 * (found.values[of] - model.start[of])
        kept = np.isin(of, found.kept)
        spread = np.where(kept, 0.0, 1e6 * half[of])
        rows = np.arange(len(of))
        panel.errorbar(
            change, rows, xerr=spread, fmt='o', color=colors[1], markersize=4, capsize=3
        )
        names = [
            without_mathematics(model.unknown[k].name + (' (kept)' if k in found.kept else ''))
            for k in of
        ]
        panel.set_yticks(rows, names, fontsize='x-small')
        panel.set_ylim(len(of) - 0.5, -0.5)
        panel.axvline(0.0, color='0.4', linewidth=0.8)
        panel.set_xlabel(f'change, with its 95 % interval [{MICRO[unit]}]')
        panel.grid(alpha=0.3)
    return figure
