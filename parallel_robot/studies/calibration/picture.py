"""A calibration as a picture: errors of the poses before and after, and what was changed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from parallel_robot.analysis.report.looks import RUNS
from parallel_robot.bags.output import without_mathematics
from parallel_robot.studies.calibration.least_squares import Fit
from parallel_robot.studies.calibration.pose_model import PoseModel
from parallel_robot.studies.calibration.readable import MICRO

WIDTH, ROW = 11.0, 2.2  # in
NAME = 0.16  # in, for the name of an unknown


def draw(model: PoseModel, found: Fit) -> Figure:
    """Draw a calibration.

    Above is the error of each pose, one panel a coordinate; below, by how much each unknown
    differs from what was believed, with its 95 % interval, one panel a unit.
    """
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
