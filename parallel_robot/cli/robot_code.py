"""The code of the robot of a bag, on a command line."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from parallel_robot.bags.run.recorded_robot import KEY, RobotCode
from parallel_robot_model.configuration import config


def robot_code(arguments: argparse.Namespace, values: Mapping[str, Any]) -> RobotCode:
    """What may run to know the robot of a bag.

    Args:
        arguments: Of the command.
        values: What ``--set`` says.

    Raises:
        InputError: it is of no list of files.
    """
    return RobotCode(arguments.trust, tuple(config.absolute_modules(KEY, values.get(KEY, []))))
