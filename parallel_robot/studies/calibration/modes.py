"""What calibrating is asked for: the robot of a bag, or poses that tell most."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from parallel_robot.studies.calibration.tracker import FREE
from parallel_robot.studies.refused_options import refuse
from parallel_robot_model.common.errors import InputError, UnknownNameError

BAG, DESIGN = 'bag', 'design'
OF_BAG = (
    *('poses', 'pose-topic', 'figure', 'trust', 'topic', 'namespace', 'joints', 'override'),
    *('from', 'to'),
)


def mode(options: Mapping[str, Any]) -> str:
    """Which of BAG and DESIGN some options ask for.

    Args:
        options: What was given, by the names of the command's options; None, False or an empty
            list or mapping where nothing was.

    Raises:
        InputError: options do not go together.
    """
    if options['bag'] is None:
        if options['scenario'] is None or options['design'] is None:
            raise InputError('calibrate takes either a bag or --scenario SCENARIO --design N')
        check_free(options['free'])
        refuse(options, OF_BAG, '--design reads no bag: no {}')
        return DESIGN
    check_free(options['free'])
    if options['design'] is not None:
        raise InputError('--design reads no bag')
    refuse(options, ('seed',), '{} goes with --design alone')
    if options['poses'] is not None and options['pose-topic'] is not None:
        raise InputError('--poses and --pose-topic exclude each other')
    return BAG


def check_free(free: Collection[str]) -> None:
    """Refuse what cannot be free of a tracker.

    Raises:
        InputError: it is none of FREE.
    """
    if isinstance(free, str):
        raise InputError(f'free must be a list of {", ".join(FREE)}, not {free!r}')
    for each in free:
        if each not in FREE:
            raise UnknownNameError('--free', str(each), FREE)
