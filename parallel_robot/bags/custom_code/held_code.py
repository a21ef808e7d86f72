"""Whether a bag holds the robot and the trajectory that its configuration names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from parallel_robot_model.common.errors import BagError
from parallel_robot_model.robots.registry import is_known
from trajectory_gen.shapes import shapes


def check(bag: Path, values: Mapping[str, Any], addable: bool = False) -> None:
    """Refuse a bag whose robot or trajectory is of neither the suite nor the files that are given.

    Args:
        bag: The bag, for error messages.
        values: Its configuration, with the files of its custom code that may run.
        addable: Whether the user may give files of his own.

    Raises:
        BagError: one is not known.
    """
    hint = '; --set {}=[FILE] adds one' if addable else ''
    if not is_known(values):
        lacks = f'{bag} does not hold the robot {values["robot_model"]}'
        raise BagError(lacks + hint.format('custom_robots'))
    shape = values['trajectory.shape']
    if shape not in shapes(values['custom_trajectories']):
        lacks = f'{bag} does not hold the trajectory {shape}'
        raise BagError(lacks + hint.format('custom_trajectories'))
