"""What was read of a machine, as lines and tables."""

from __future__ import annotations

import math
from collections.abc import Sized

from parallel_robot.analysis.machine.facts import Facts
from parallel_robot_model.common.errors import printable
from parallel_robot_model.common.tables import Part, Table


def _several(things: Sized) -> str:
    """The s of a plural."""
    return '' if len(things) == 1 else 's'


def readable(facts: Facts) -> list[Part]:
    """A machine and its state for people."""
    machine, state = facts.machine, facts.state
    counts = f'{len(machine.actuated)} actuated, {len(machine.passive)} passive'
    held = f', {len(machine.held)} held' if machine.held else ''
    pose = ', '.join(
        f'{axis.name} {round(float(value), 12) + 0.0:.6g} {axis.unit}'
        for axis, value in zip(facts.axes, state.pose, strict=True)
    )
    parts: list[Part] = [
        f'{facts.name}: {len(machine.names)} joint{_several(machine.names)}, {counts}{held}; '
        f'{len(machine.actuated)} freedom{_several(machine.actuated)}',
        Table(('joint', 'after', 'kind', '', 'mass [kg]'), _tree(facts), 'llllr'),
        'actuated joints, and what M and gravity are at this state',
        Table(HEAD, _actuated(facts), 'llr'),
        f'tool {printable(machine.tool)}: {pose}',
        f'loops closed to {state.closure:.1e} m; margins of closure and tool '
        f'{state.margins[0]:.3g} and {state.margins[1]:.3g} of those at home',
    ]
    if machine.held:
        parts.append(f'held at home: {", ".join(map(printable, machine.held))}')
    return [*parts, *(f'note: {printable(doubt)}' for doubt in machine.doubts)]


HEAD = (
    'joint', 'unit', 'at', 'lower', 'upper', 'effort', 'speed', 'viscous', 'dry', 'M', 'gravity',
)  # fmt: skip


def _tree(facts: Facts) -> list[list[str]]:
    return [
        [
            printable(row['name']),
            printable(row['parent'] or 'base'),
            row['kind'],
            row['role'],
            f'{row["mass"]:.4g}',
        ]
        for row in facts.tree()
    ]


def _actuated(facts: Facts) -> list[list[str]]:
    machine, state = facts.machine, facts.state
    columns = (
        state.position,
        machine.lower,
        machine.upper,
        machine.effort,
        machine.velocity,
        machine.viscous,
        machine.coulomb,
        state.M.diagonal(),
        state.gravity,
    )
    return [
        [printable(name), unit, *(_number(column[k]) for column in columns)]
        for k, (name, unit) in enumerate(zip(machine.actuated, machine.units, strict=True))
    ]


def _number(value: float) -> str:
    return f'{value + 0.0:.4g}' if math.isfinite(value) else 'none'
