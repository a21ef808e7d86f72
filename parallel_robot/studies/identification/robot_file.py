"""An identified robot as YAML, for ``--param-file``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from parallel_robot.studies.identification.base_parameters import linear_model
from parallel_robot.studies.identification.identified import Identified
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.units import rounded

DIGITS = 8  # significant digits of a parameter


def text(found: Identified, bag: str, noise: Mapping[str, list[float]]) -> str:
    """Contents of the file: keys ``robot`` and ``friction``, and how they were found.

    Args:
        found: The identified robot.
        bag: Path of the bag, for the comment.
        noise: Parameters of the estimator, by key, from what the sensors show at rest.
    """
    model = linear_model(found.nominal.robot)
    robot = found.robot
    kept = [key for key, value in robot.robot.items() if _same(value, robot.nominal[key])]
    lines = [
        f'The robot {found.nominal.robot.name} as identified from {printable(bag)}.',
        'Torques depend on these combinations alone (estimate, standard error):',
        *(
            f'  {name} = {value:.6g} +- {error:.2g} {unit}'
            for name, value, error, unit in zip(
                found.base.names,
                found.fit.values,
                found.fit.standard_errors,
                found.base.units,
                strict=True,
            )
        ),
        f'with {model.NAMES}.',
        'They do not fix each mass: of all robots that have them, this is the one with the least',
        'relative change from the configuration of the bag; centres of mass change last.',
    ]
    if kept:
        lines.append(f'Unchanged: {", ".join(kept)}.')
    if robot.active:
        lines.append(
            'No robot that can be built has the estimates themselves: this one is the nearest, '
            f'{robot.misfit:.2g} standard errors away.'
        )
    if noise:
        lines.append('The noise of the sensors is that at rest.')
    comment = ''.join(f'# {line}\n' for line in lines)
    return comment + dump(groups(found, noise))


def groups(found: Identified, noise: Mapping[str, list[float]]) -> dict[str, dict[str, Any]]:
    """The robot as groups of the configuration, see :func:`text`."""
    robot = found.robot
    tree: dict[str, dict[str, Any]] = {
        'robot': {key: rounded(value, DIGITS) for key, value in robot.robot.items()},
        'friction': {
            'viscous': rounded(robot.viscous, DIGITS),
            'coulomb': rounded(robot.coulomb, DIGITS),
        },
    }
    return tree | ({'estimator': dict(noise)} if noise else {})


def dump(tree: Mapping[str, Any]) -> str:
    """Groups of parameters as YAML, lists in one line each."""
    return yaml.safe_dump(dict(tree), sort_keys=False, default_flow_style=None, width=1000)


def _same(value: Any, nominal: Any) -> bool:
    return bool(np.allclose(value, nominal, rtol=1e-5, atol=0.0))
