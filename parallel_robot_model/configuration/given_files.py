"""Files that a configuration names, whose content takes the place of their names."""

from __future__ import annotations

from parallel_robot_model.configuration import points, robot_names
from parallel_robot_model.configuration.plain_data import Placed


def filled(values: Placed) -> Placed:
    """Values with the content of the files that they name: points of a motion, a machine.

    Raises:
        InputError: a file cannot be read, or is no such file.
    """
    return robot_names.filled(points.with_points(values))
