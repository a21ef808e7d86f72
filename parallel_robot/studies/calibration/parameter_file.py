"""A calibrated robot as YAML, for ``--param-file``."""

from __future__ import annotations

from typing import Any

from parallel_robot.studies.calibration.least_squares import Fit
from parallel_robot.studies.calibration.pose_model import PoseModel
from parallel_robot.studies.identification.robot_file import dump
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.units import rounded

DIGITS = 10  # significant digits of a parameter
TAKEN_OFF, SHOWN = 'estimator', 'sensor'  # groups with a zero angle: of controller and plant


def text(model: PoseModel, found: Fit, bag: str) -> str:
    """Contents of the file: the robot and its zero angles, and how they were found.

    Args:
        model: What was looked for.
        found: What was found.
        bag: Path of the bag, for the comment.
    """
    kept = [model.unknown[k].name for k in found.kept]
    lines = [
        f'The robot {model.robot.name} as calibrated from {len(model.measured.time)} poses, '
        f'{printable(bag)}.',
        'Estimate, half width of the 95 % interval:',
        *(
            f'  {each.name} = {value:.8g} +- {half:.2g} {each.unit}'
            for k, (each, value, half) in enumerate(
                zip(model.unknown, found.values, found.half_widths, strict=True)
            )
            if k not in found.kept
        ),
    ]
    if kept:
        lines.append(f'Kept as they were, as the poses do not tell them: {", ".join(kept)}.')
    lines.append('The controller takes estimator.zero_angle off what the encoders show; a')
    lines.append('simulated robot has the same in sensor.zero_angle.')
    return ''.join(f'# {line}\n' for line in lines) + dump(groups(model, found))


def groups(model: PoseModel, found: Fit) -> dict[str, dict[str, Any]]:
    """The robot as groups of the configuration, see :func:`text`."""
    every = model.robot_with(found.values).parameters._asdict()
    robot = {
        key: rounded(every[key], DIGITS)
        for key in dict.fromkeys(each.key for each in model.numbers)
    }
    zero = found.values[model.zeros].tolist()
    both = {group: {'zero_angle': rounded(zero, DIGITS)} for group in (TAKEN_OFF, SHOWN)}
    return ({'robot': robot} if robot else {}) | both
