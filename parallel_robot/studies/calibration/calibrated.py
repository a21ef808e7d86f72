"""A calibrated robot: as people read it, as plain data, as YAML and as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.pictures import RUNS, stacked
from parallel_robot.bags.output import without_mathematics
from parallel_robot.studies.calibration.least_squares import Fit, Outlier, Starts, summary
from parallel_robot.studies.calibration.pose_model import PoseModel, by_unit
from parallel_robot.studies.estimate import WrittenResult, combination
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import Array, rounded
from parallel_robot_model.robots.registry import RobotModel

SHARE = 0.1  # in a unit vector from which an unknown is named
MICRO = {'m': 'µm', 'rad': 'µrad', 's': 'µs'}
DIGITS = 10  # significant digits of a parameter
TAKEN_OFF, SHOWN = 'estimator', 'sensor'  # groups with a zero angle: of controller and plant
WIDTH, ROW = 11.0, 2.2  # in
NAME = 0.16  # in, for the name of an unknown


@dataclass(repr=False)
class Calibration(WrittenResult):
    """What measured poses tell of a robot."""

    bag: Path
    model: PoseModel  # what was looked for, by the poses that were used
    found: Fit  # what was found
    outliers: tuple[Outlier, ...]  # poses that the others do not predict
    robust: bool  # whether these are left out
    starts: Starts  # how many starts of the search agree
    warnings: tuple[str, ...]  # what was not used, and what to doubt, one line each

    @property
    def robot(self) -> RobotModel:
        """The calibrated robot."""
        return self.model.robot_with(self.found.values)

    def as_data(self) -> dict[str, Any]:
        """The results as plain data, for JSON; None for what keeps its value."""
        model, found = self.model, self.found
        return {
            'robot_model': model.robot.name,
            'poses': len(model.measured.time),
            'unknown': [
                {
                    'name': each.name,
                    'unit': each.unit,
                    'estimate': float(found.values[k]),
                    'half_width_95': None if k in found.kept else float(found.half_widths[k]),
                    'before': float(model.start[k]),
                }
                for k, each in enumerate(model.unknown)
            ],
            'kept': [model.unknown[k].name for k in found.kept],
            'not_told': untold(model, found),
            'condition': found.condition,
            'pose_error_rms': {
                axis.name: {
                    'unit': axis.unit,
                    'before': rms(found.before[:, k]),
                    'now': rms(found.left[:, k]),
                    'noise': float(found.noise[k]),
                }
                for k, axis in enumerate(model.axes)
            },
            'expected_error_rms': expected_error(model, found),
            'outliers': [
                {
                    'time': each.time,
                    **{
                        axis.name: {
                            'unit': axis.unit,
                            'off': float(off),
                            'deviations': float(share),
                        }
                        for axis, off, share in zip(model.axes, each.off, each.share, strict=True)
                    },
                }
                for each in self.outliers
            ],
            'starts': self.starts._asdict(),
        }

    def parts(self) -> list[Part]:
        """Geometry, zero angles and tracker with 95 % intervals, and what is not known."""
        data, rows, errors = self.as_data(), [], []
        for each in data['unknown']:
            value, half, unit = each['estimate'], each['half_width_95'], MICRO[each['unit']]
            interval = 'kept' if half is None else f'+- {1e6 * half:.3g} {unit}'
            change = f'{1e6 * (value - each["before"]):.1f} {unit}'
            rows.append([each['name'], f'{value:.7g}', each['unit'], interval, change])
        for name, each in data['pose_error_rms'].items():
            cells = [f'{1e6 * each[when]:.4g}' for when in ('before', 'now', 'noise')]
            errors.append([f'{name} [{MICRO[each["unit"]]}]', *cells])
        kept = ', '.join(data['kept'])
        expected = ', '.join(
            f'{1e6 * value:.3g} {MICRO[unit]}'
            for unit, value in data['expected_error_rms'].items()
        )
        return [
            f'{data["robot_model"]}: {data["poses"]} poses',
            Table(['unknown', 'estimate', 'unit', '95 % interval', 'change'], rows, 'lrlr'),
            *(f'the poses do not tell: {text}' for text in data['not_told']),
            *([f'kept, so that the others can be told: {kept}'] if kept else []),
            f'condition number {data["condition"]:.4g}',
            Table(['error of the poses, rms', 'before', 'now', 'noise'], errors),
            f'error of the calibrated robot that is expected at these poses, rms: {expected}',
        ]

    def header(self) -> list[str]:
        """How it was found."""
        data, lines = self.as_data(), []
        poses, outliers, kept = data['poses'], len(self.outliers), ', '.join(data['kept'])
        lines.append(
            f'The robot {data["robot_model"]} as calibrated from {poses} poses, '
            f'{printable(str(self.bag))}.'
        )
        if outliers:
            what = 'left out' if self.robust else 'used, too'
            lines.append(f'{summary(outliers, poses + outliers * self.robust)}: {what}.')
        lines.append('Estimate, half width of the 95 % interval:')
        for each in data['unknown']:
            value, half, unit = each['estimate'], each['half_width_95'], each['unit']
            if half is not None:
                lines.append(f'  {each["name"]} = {value:.8g} +- {half:.2g} {unit}')
        if kept:
            lines.append(f'Kept as they were, as the poses do not tell them: {kept}.')
        lines.append('The controller takes estimator.zero_angle off what the encoders show; a')
        lines.append('simulated robot has the same in sensor.zero_angle.')
        return lines

    def groups(self) -> dict[str, dict[str, Any]]:
        """The robot and its zero angles as keys of the configuration, by group."""
        every = self.robot.parameters._asdict()
        robot = {each.key: rounded(every[each.key], DIGITS) for each in self.model.numbers}
        zero = self.found.values[self.model.zeros]
        both = {group: {'zero_angle': rounded(zero, DIGITS)} for group in (TAKEN_OFF, SHOWN)}
        return ({'robot': robot} if robot else {}) | both

    def draw(self) -> Any:
        """Draw the error of each pose, before and after, and the changes.

        Above there is one panel a coordinate; below one panel a unit, with by how much each
        unknown differs from what was believed, and its 95 % interval.
        """
        model, found = self.model, self.found
        of_unit = by_unit(each.unit for each in model.unknown)
        heights = [ROW for _ in model.measured.columns]
        heights += [1.0 + NAME * len(of) for of in of_unit.values()]
        figure, panels = stacked(WIDTH, heights)
        count, colors = len(model.measured.columns), (RUNS[0].light, RUNS[1].light)
        for k, (panel, axis) in enumerate(zip(panels, model.axes, strict=False)):
            for color, name, error in zip(
                colors, ('before', 'now'), (found.before, found.left), strict=True
            ):
                size = 1e6 * np.abs(error[:, k])
                panel.plot(model.measured.time, size, '.', color=color, markersize=3, label=name)
            panel.axhline(1e6 * found.noise[k], color='0.4', linestyle=':', label='noise')
            panel.set_yscale('log')
            panel.set_ylabel(f'|error| of {axis.name} [{MICRO[axis.unit]}]')
            panel.grid(alpha=0.3)
        over = {'loc': 'lower right', 'bbox_to_anchor': (1.0, 1.0), 'frameon': False}
        panels[0].legend(ncols=3, fontsize='small', **over)
        panels[count - 1].set_xlabel('t [s]')
        half = found.half_widths
        for panel, (unit, of) in zip(panels[count:], of_unit.items(), strict=True):
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
    of_unit = sorted(model.columns_by_unit.items())
    return {unit: float(np.sqrt(variance[columns].sum())) for unit, columns in of_unit}


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
