"""An identified robot: as people read it, as plain data, as YAML and as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.report import figures
from parallel_robot.studies.estimate import WrittenResult
from parallel_robot.studies.identification import motor_lag
from parallel_robot.studies.identification.base_parameters import ALWAYS, FRICTION, linear_model
from parallel_robot.studies.identification.identified import Delay, Identified, Prediction
from parallel_robot.studies.identification.least_squares import UNKNOWN
from parallel_robot.studies.identification.measured_motion import joined, rows_of
from parallel_robot.studies.identification.motor_lag import MotorLag, Rest
from parallel_robot.studies.identification.physical_robot import PhysicalRobot
from parallel_robot.studies.identification.torque_constants import TorqueConstants
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import Array, rounded
from parallel_robot_model.configuration.fields import plain

# kinds of friction for people
WORDS = {
    'viscous': 'viscous', 'coulomb': 'dry', 'offset': 'constant', 'stribeck': 'Stribeck',
    'load': 'by load',
}  # fmt: skip
ROUNDING = 1e-6  # of a sum of masses, what a combination of parameters may leave of it
DIGITS = 8  # significant digits of a parameter in a file
LONG = 12  # numbers of a list, of which beyond that only those that changed are told


@dataclass(repr=False)
class Identification(WrittenResult):
    """What a bag tells of its robot."""

    bag: Path
    joints: tuple[str, ...]  # names of the actuated joints
    found: Identified  # what was identified
    # torques as the identified robot predicts them, of the second bag if there is one
    checked: Prediction
    validated: bool  # whether there is
    rest: Rest | None  # noise of the sensors; None if the robot never rests
    lag: MotorLag | None  # that of the motors; None if commands or efforts do not tell it
    constants: TorqueConstants | None  # torque constants that were found, if any were asked for
    warnings: tuple[str, ...]  # what was not used, and what to doubt, one line each
    all: bool = False  # whether all parameters and their intervals are shown

    def groups(self) -> dict[str, dict[str, Any]]:
        """The robot as keys of the configuration, by group."""
        return parameter_groups(self.found, self._noise)

    def header(self) -> list[str]:
        """How it was found."""
        found, robot = self.found, self.found.robot
        names = linear_model(found.nominal.robot).NAMES
        kept = [
            key
            for key, value in robot.robot.items()
            if np.allclose(value, robot.nominal[key], rtol=1e-5, atol=0.0)
        ]
        lines = [
            f'The robot {found.nominal.robot.name} as identified from {printable(str(self.bag))}.',
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
            f'with {names}.',
            'They do not fix each mass: of all robots that have them, this is the one whose '
            'bodies',
            'are nearest to those of the configuration of the bag.',
        ]
        if kept:
            lines.append(f'Unchanged: {", ".join(kept)}.')
        if robot.active:
            lines.append(
                'No robot that can be built has the estimates themselves: this one is the '
                f'nearest, {robot.misfit:.2g} standard errors away.'
            )
        lines += [f'Bound active: {each}.' for each in robot.bounds]
        if self._noise:
            lines.append('The noise of the sensors is that at rest.')
        return lines

    @property
    def _noise(self) -> dict[str, list[float]]:
        return self.rest.parameters() if self.rest else {}

    def parts(self) -> list[Part]:
        """What its owner asks first: how far to believe it, friction, mass, what is not told."""
        if self.all:
            return self._all_parts()
        found, joints, fit, robot = self.found, self.joints, self.found.fit, self.found.robot
        units = found.nominal.robot.joint_units
        columns: dict[str, list[str]] = {'joint': [*joints]}
        title = f'{found.nominal.robot.name}: {found.squares.duration:.3g} s of motion'
        if held := found.held_out:
            title += f'; the error is that from {held.rows.time[0]:.3g} s on, which was not fitted'
            for name, shares in (('error, %', held.share), ('before, %', held.share_before)):
                columns[name] = [_percent(each) for each in shares]
        if self.validated:
            columns['validation, %'] = [_percent(each) for each in self.checked.share]
        half = fit.half_widths
        for k, (kind, joint, _) in enumerate(found.base.friction, len(found.base.inertias)):
            unit = f' [{FRICTION[kind]}]' if FRICTION[kind] else ''
            column = columns.setdefault(units.label(WORDS[kind] + unit), [''] * len(joints))
            column[joint] = f'{fit.values[k]:.3g} +- {float(f"{half[k]:.1g}"):g}'  # 10, not 1e+01
        rows = [[each[k] for each in columns.values()] for k in range(len(joints))]
        told: list[Part] = [title, Table([*columns], rows), *_mass(found)]
        if speeds := {each.speed for each in found.base.friction} - {0.0}:
            speed = f'{max(speeds):.3g} {units.of("rad/s")}'
            told.append(
                f'Stribeck: more dry friction at rest (less: below 0), exp(-(v / ({speed}))^2)'
            )
        told += _active(robot)
        if found.poor:
            told.append(
                f'the motion does not tell {len(found.poor)} of {len(fit.values)} combinations to '
                '10 %; to find one that does: identify --design'
            )
        return [*told, 'all parameters and intervals: --all', *self._others()]

    def _all_parts(self) -> list[Part]:
        """All results as tables."""
        told, held, checked = parts(self.found), self.found.held_out, self.checked
        if held:
            begin, end = held.rows.time[0], held.rows.time[-1]
            title = f'held out, {begin:.3g} to {end:.3g} s, fitted before: error, % of torque, rms'
            shares = {'identified': held.share, 'before': held.share_before}
            cells = [[name, *map(_percent, each)] for name, each in shares.items()]
            told.insert(0, Table([title, *self.joints], cells))
        of = 'validation' if self.validated else 'same bag'
        title = self.found.nominal.robot.joint_units.label(f'torque error, rms, {of} [N m]')
        rows = {
            'identified': checked.error,
            'before': checked.nominal_error,
            'torque itself': checked.size,
        }
        cells = [[name, *(f'{value:.4g}' for value in each)] for name, each in rows.items()]
        rest = [] if self.rest else [motor_lag.NO_REST]
        return [*told, Table([title, *self.joints], cells), *self._others(), *rest]

    def _others(self) -> list[Part]:
        """What is told beside the robot."""
        found = [each for each in (self.constants, self.lag, self.rest) if each]
        return [part for each in found for part in each.parts()]

    def as_data(self) -> dict[str, Any]:
        """The results as plain data, as ``--format json`` has them."""
        data = as_data(self.found, self.checked, self.joints)
        rest = self.rest.as_data() if self.rest else {'rest': None}
        found = {'motor_lag': self.lag, 'torque_constants': self.constants}
        others = {name: each.as_data() if each else None for name, each in found.items()}
        return data | rest | others

    def draw(self) -> Any:
        """Draw the torques, measured and predicted."""
        rows, torque = self.checked.rows, self.checked.torque
        held, begin = None if self.validated else self.found.held_out, None
        if held:  # as it was predicted by the fit to what is before it
            begin = float(held.rows.time[0])
            rows = rows_of(rows, rows.time < begin)
            torque = np.concatenate([torque[: len(rows.time)], held.torque])
            rows = joined([rows, held.rows])
        units = self.found.nominal.robot.joint_units
        measured, predicted = (
            np.where(rows.known, each, np.nan) for each in (rows.torque, torque)
        )
        return figures.figure_of_prediction(
            rows.time, self.joints, measured, predicted, units, begin
        )


def _percent(share: float) -> str:
    return '' if np.isnan(share) else f'{100.0 * share:.3g}'


def _known(values: Array) -> list[float | None]:
    return [None if np.isnan(each) else each for each in values.tolist()]


def _active(robot: PhysicalRobot) -> list[str]:
    bounds = [f'bound active: {each}' for each in robot.bounds]
    if not robot.active:
        return bounds
    return [
        'constraint active: no robot that can be built has these estimates; the nearest one '
        f'is {robot.misfit:.2g} standard errors away',
        *bounds,
    ]


def _mass(found: Identified) -> list[str]:
    """Mass of the chosen robot and of the nominal one, where it has a mass."""
    nominal = found.nominal.robot
    model, parameters = linear_model(nominal), nominal.parameters
    bodies = model.bodies(parameters)
    if 'mass' not in bodies.known:
        return []
    chosen = model.bodies(parameters._replace(**found.robot.robot))  # without a payload of zero
    row, own = (each.known['mass'].rows(0.0, np.inf)[0, :-1] for each in (bodies, chosen))
    shown = (found.base.K @ bodies.linear).T
    left = row - shown @ np.linalg.lstsq(shown, row, rcond=None)[0]
    told = np.abs(left).max() < ROUNDING * np.abs(row).max()
    doubt = '' if told else '; torques do not tell it, --bounds mass=LOW:HIGH does'
    return [f'mass {own @ chosen.numbers:.4g} kg in all, {row @ bodies.numbers:.4g} before{doubt}']


def parts(found: Identified) -> list[Part]:
    """Base parameters with their 95 % intervals, what is not known, and the chosen robot."""
    fit, robot = found.fit, found.robot
    model = linear_model(found.nominal.robot)
    half = fit.half_widths
    rows = []
    for k, (name, unit) in enumerate(zip(found.base.names, found.base.units, strict=True)):
        unknown = half[k] > 0.1 * UNKNOWN * found.scale[k]
        interval = 'not determined' if unknown else f'+- {half[k]:.2g}'
        if half[k] < abs(fit.values[k]):
            interval += f' ({100.0 * half[k] / abs(fit.values[k]):.2g} %)'
        rows.append([name, f'{fit.values[k]:.5g}', interval, f'{found.before[k]:.5g}', unit])
    parts: list[Part] = [
        f'{found.nominal.robot.name}: {found.squares.duration:.3g} s of motion, '
        f'{found.squares.count} rows for each joint',
        Table(['base parameter', 'estimate', '95 % interval', 'before', 'unit'], rows, 'lrrrl'),
        f'  {model.NAMES}',
        f'condition number {fit.condition:.4g}',
        _delay(found.delay, found.period),
        *(
            f'the motion does not tell: {name}'
            + ('' if error > 0.1 * UNKNOWN else f', {100.0 * error:.2g} % standard error')
            for name, error in found.poor
        ),
    ]
    keys = [
        [f'robot.{key}{index}', f'{number:.5g}', f'{before:.5g}']
        for key, value in robot.robot.items()
        for number, before, index in _each(value, robot.nominal[key])
    ]
    many = 'one of many robots that explain it'
    return [*parts, *_active(robot), many, Table(['key', 'value', 'before'], keys)]


def _delay(found: Delay, period: float) -> str:
    """What is known of the age of the positions."""
    value = f'{1e3 * found.value:.3g} +- {1e3 * found.half_width:.2g} ms'
    if found.counts:
        return f'positions are late: {value} after torques of the same stamp, taken into account'
    if found.half_width > period:
        return f'the motion does not tell whether positions are late: {value}; none is assumed'
    return f'positions are not late: {value}'


def as_data(found: Identified, checked: Prediction, joints: Sequence[str]) -> dict[str, Any]:
    """All results as plain data, for JSON; None for what the motion does not show."""
    fit, robot = found.fit, found.robot
    known = fit.standard_errors < 0.1 * UNKNOWN * found.scale
    held = found.held_out
    return {
        'held_out': held
        and {
            'from_s': float(held.rows.time[0]),
            'to_s': float(held.rows.time[-1]),
            'share': _known(held.share),
            'share_before': _known(held.share_before),
        },
        'robot_model': found.nominal.robot.name,
        'duration_s': found.squares.duration,
        'rows': found.squares.count,
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
                'half_width_95': float(fit.half_widths[k]) if known[k] else None,
                'before': float(found.before[k]),
                'of_chosen_robot': float(robot.values[k]),
            }
            for k, (name, unit) in enumerate(zip(found.base.names, found.base.units, strict=True))
        ],
        'friction_chosen': [
            {
                'name': f'{each.kind}{each.joint + 1}',
                'error_saved': saved,
                'half_width_95': half,
            }
            for each, (saved, half) in found.choice.saved.items()
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
        'bounds_active': list(robot.bounds),
        'robot': robot.robot,
        'robot_before': {key: robot.nominal[key] for key in robot.robot},
        'friction': friction(found),
        found.nominal.robot.joint_units.key('torque_error_rms_nm'): {
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
        pairs = enumerate(zip(value, before, strict=True))
        every = len(value) <= LONG
        return [(*pair, f'[{k}]') for k, pair in pairs if every or not np.isclose(*pair)]
    return [(value, before, '')]


def parameter_groups(
    found: Identified, noise: Mapping[str, list[float]]
) -> dict[str, dict[str, Any]]:
    """The robot as groups of the configuration; `noise` of the sensors, keys of the estimator."""
    robot = found.robot
    tree: dict[str, dict[str, Any]] = {
        'robot': {key: rounded(value, DIGITS) for key, value in robot.robot.items()},
        'friction': {key: rounded(value, DIGITS) for key, value in friction(found).items()},
    }
    return tree | ({'estimator': dict(noise)} if noise else {})


def friction(found: Identified) -> dict[str, Any]:
    """Friction as a group of the configuration: the kinds that are always there or not zero."""
    group, nominal = found.robot.friction, found.nominal.friction
    kinds = [*FRICTION]
    told = [
        kind
        for kind in kinds
        if kind in kinds[:ALWAYS] or any(getattr(group, kind)) or any(getattr(nominal, kind))
    ]
    speed = {'stribeck_velocity': group.stribeck_velocity} if any(group.stribeck) else {}
    return {kind: plain(getattr(group, kind)) for kind in told} | speed
