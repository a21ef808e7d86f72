"""An identified robot as people read it, and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot.studies.identification.base_parameters import linear_model
from parallel_robot.studies.identification.identified import Delay, Identified, Prediction
from parallel_robot.studies.identification.least_squares import UNKNOWN


def table(found: Identified) -> list[str]:
    """Base parameters with their 95 % intervals, what is not known, and the chosen robot."""
    fit, robot = found.fit, found.robot
    model = linear_model(found.nominal.robot)
    lines = [
        f'{found.nominal.robot.name}: {found.rows.duration:.3g} s of motion, '
        f'{len(found.rows.time)} rows for each joint',
        f'{"base parameter":<22}{"estimate":>12}{"95 % interval":>26}{"before":>12}  unit',
    ]
    half = fit.interval * fit.standard_errors
    for k, (name, unit) in enumerate(zip(found.base.names, found.base.units, strict=True)):
        unknown = half[k] > 0.1 * UNKNOWN * found.scale[k]
        interval = 'not determined' if unknown else f'+- {half[k]:.2g}'
        if not unknown:
            interval += f' ({100.0 * half[k] / found.scale[k]:.2g} %)'
        value = f'{fit.values[k]:.5g}'
        lines.append(f'{name:<22}{value:>12}{interval:>26}{found.before[k]:>12.5g}  {unit}')
    lines.append(f'  {model.NAMES}')
    lines.append(f'condition number {fit.condition:.4g}')
    lines.append(_delay(found.delay, found.period))
    lines += [f'the motion does not tell: {line}' for line in poor(found)]
    if robot.active:
        lines.append(
            'constraint active: no robot that can be built has these estimates; the nearest one '
            f'is {robot.misfit:.2g} standard errors away'
        )
    lines.append(f'{"one of many robots that explain it":<34}{"":>26}{"before":>12}')
    for key, value in robot.robot.items():
        for number, before, index in _each(value, robot.nominal[key]):
            lines.append(f'  {f"robot.{key}{index}":<20}{number:>12.5g}{"":>26}{before:>12.5g}')
    return lines


def _delay(found: Delay, period: float) -> str:
    """What is known of the age of the positions."""
    value = f'{1e3 * found.value:.3g} +- {1e3 * found.half_width:.2g} ms'
    if found.counts:
        return f'positions are late: {value} after torques of the same stamp, taken into account'
    if found.half_width > period:
        return f'the motion does not tell whether positions are late: {value}; none is assumed'
    return f'positions are not late: {value}'


def poor(found: Identified) -> list[str]:
    """Combinations that the motion hardly shows, one line each."""
    return [
        name if error > 0.1 * UNKNOWN else f'{name}, {100.0 * error:.2g} % standard error'
        for name, error in found.poor
    ]


def prediction(title: str, found: Prediction, joints: Sequence[str]) -> list[str]:
    """Errors of the predicted torques, joint by joint."""
    rows = {
        'identified': found.error,
        'before': found.nominal_error,
        'torque itself': found.size,
    }
    lines = [f'{title:<34}' + ''.join(f'{joint:>12}' for joint in joints)]
    return lines + [
        f'  {name:<32}' + ''.join(f'{value:>12.4g}' for value in values)
        for name, values in rows.items()
    ]


def as_data(found: Identified, checked: Prediction, joints: Sequence[str]) -> dict[str, Any]:
    """All results as plain data, for JSON; None for what the motion does not show."""
    fit, robot = found.fit, found.robot
    known = fit.standard_errors < 0.1 * UNKNOWN * found.scale
    return {
        'robot_model': found.nominal.robot.name,
        'duration_s': found.rows.duration,
        'rows': len(found.rows.time),
        'delay': {
            'estimate_s': found.delay.value,
            'half_width_95_s': found.delay.half_width,
            'taken_into_account': found.delay.counts,
        },
        'condition': fit.condition if np.isfinite(fit.condition) else None,
        'base_parameters': [
            {
                'name': name,
                'unit': unit,
                'estimate': float(fit.values[k]),
                'standard_error': float(fit.standard_errors[k]) if known[k] else None,
                'half_width_95': float(fit.interval[k] * fit.standard_errors[k])
                if known[k]
                else None,
                'before': float(found.before[k]),
                'of_chosen_robot': float(robot.values[k]),
            }
            for k, (name, unit) in enumerate(zip(found.base.names, found.base.units, strict=True))
        ],
        'left_of_torque': found.left.share.tolist(),
        'left_correlation': found.left.correlation,
        'not_told': [
            {
                'combination': name,
                'relative_standard_error': error if error < UNKNOWN / 10 else None,
            }
            for name, error in found.poor
        ],
        'constraint_active': robot.active,
        'misfit_standard_errors': robot.misfit,
        'robot': robot.robot,
        'friction': {'viscous': robot.viscous.tolist(), 'coulomb': robot.coulomb.tolist()},
        'torque_error_rms_nm': {
            joint: {
                'identified': float(checked.error[k]),
                'before': float(checked.nominal_error[k]),
                'torque': float(checked.size[k]),
            }
            for k, joint in enumerate(joints)
        },
    }


def _each(value: Any, before: Any) -> list[tuple[float, float, str]]:
    """Number, number before and index in brackets, of a number or a list."""
    if np.ndim(value):
        pairs = zip(value, before, strict=True)
        return [(one, other, f'[{k}]') for k, (one, other) in enumerate(pairs)]
    return [(value, before, '')]
