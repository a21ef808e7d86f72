"""A machine drawn in three views and in space."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.machine.facts import Facts
from parallel_robot.analysis.report.space_views import VIEWS
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.skeleton import drawn


def draw(facts: Facts, file: Path) -> None:
    """Draw a machine at its state.

    Args:
        facts: The machine.
        file: Picture that is written.
    """
    from matplotlib.figure import Figure  # it takes long to load

    ends = drawn(facts.mechanism, facts.state.joints[np.newaxis])[0]
    figure = Figure(figsize=(9, 8), layout='constrained')
    figure.suptitle(facts.name)
    for k, (across, up, shown) in enumerate(VIEWS):
        axes = figure.add_subplot(2, 2, k + 1)
        axes.set_aspect('equal', 'datalim')
        axes.set_xlabel(f'{across} [m]')
        axes.set_ylabel(f'{up} [m]')
        _add(axes, ends[..., shown], facts.state.pose, shown, facts)
    space: Any = figure.add_subplot(2, 2, 4, projection='3d')
    for line in ends:
        space.plot(*line.T, color='C0', lw=1.5)
    space.set_box_aspect(np.maximum(np.ptp(ends.reshape(-1, 3), axis=0), 1e-3))
    figure.savefig(file, dpi=120)


def _add(axes: Any, ends: Array, pose: Array, shown: tuple[int, int], facts: Facts) -> None:
    for line in ends:
        axes.plot(*line.T, color='C0', lw=1.5, marker='o', ms=2.5)
    names = [axis.name for axis in facts.axes]
    wanted = ['xyz'[k] for k in shown]
    if all(name in names for name in wanted):
        axes.plot(*(pose[names.index(name)] for name in wanted), 'x', color='C3', label='tool')
        axes.legend(loc='best', fontsize=8)
