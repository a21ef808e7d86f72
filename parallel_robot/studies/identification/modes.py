"""What identifying is asked for: a robot, only the noise at rest, or an exciting motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from parallel_robot.studies.refused_options import refuse
from parallel_robot_model.common.errors import InputError

ROBOT, REST, DESIGN = 'robot', 'rest', 'design'
OF_BAG = ('topic', 'namespace', 'joints', 'scenario', 'override', 'from', 'to')


def mode(options: Mapping[str, Any]) -> str:
    """Which of ROBOT, REST and DESIGN some options ask for.

    Args:
        options: What was given, by the names of the command's options; None, False or an empty
            list or mapping where nothing was.

    Raises:
        InputError: options do not go together.
    """
    if (options['bag'] is None) == (options['design'] is None):
        raise InputError('identify takes either a bag or --design SCENARIO')
    if options['design'] is not None:
        none = ('rest', 'validate', 'figure', 'cutoff', *OF_BAG)
        refuse(options, none, '--design reads no bag: no {}')
        return DESIGN
    refuse(options, ('trials', 'seed'), '{} goes with --design alone')
    if options['rest']:
        refused, why = ('out', 'validate', 'figure', 'cutoff'), '--rest identifies no robot: no {}'
        refuse(options, refused, why)
        return REST
    return ROBOT
