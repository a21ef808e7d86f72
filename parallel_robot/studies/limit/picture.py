"""The price of calm as a picture: least error against chattering."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from parallel_robot.analysis.report.looks import RUNS
from parallel_robot.bags.output import without_mathematics
from parallel_robot.studies.limit.calm import WHOLE, LeastError
from parallel_robot_model.common.units import JointUnits

SIZE = (6.5, 4.2)  # in
GRID = np.logspace(-1.5, 1.0, 60)  # N m, of chattering


def draw(found: Mapping[str, Sequence[LeastError]], error: str, units: JointUnits) -> Figure:
    """Draw the robots of each scenario, and their median.

    Args:
        found: Scenario to its robots.
        error: Name and unit of the error.
        units: Units of the joints.
    """
    figure = Figure(figsize=SIZE, layout='constrained')
    panel = figure.subplots()
    for k, (scenario, members) in enumerate(found.items()):
        color = RUNS[k % len(RUNS)].light
        known = [one.calm for one in members if one.calm is not None]
        for each in known:
            panel.plot(each.chattering, 1e6 * each.error, color=color, alpha=0.25, linewidth=0.7)
        if known:
            values = np.array([[1e6 * each.at(level) for level in GRID] for each in known])
            whole = np.isfinite(values).all(axis=0)
            middle = np.median(values[:, whole], axis=0)
            name = without_mathematics(scenario)
            panel.plot(GRID[whole], middle, color=color, linewidth=2.2, label=f'{name}: median')
            limit = 1e6 * np.median([one.errors[WHOLE] for one in members if one.calm])
            panel.axhline(limit, color=color, linestyle=':', label=f'{name}: limit, median')
    panel.set_xscale('log')
    panel.set_yscale('log')
    panel.set_xlabel(units.label('torque, chattering [N m]'))
    panel.set_ylabel(f'least {error}')
    panel.grid(alpha=0.3, which='both')
    if panel.lines:
        panel.legend(fontsize=8)
    return figure
