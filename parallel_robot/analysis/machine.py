"""What was read of a machine: its facts, as text, and as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence, Sized
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis import pictures
from parallel_robot.analysis.report.looks import VIEWS
from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms import closure_solver, dynamics, margins, tool
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, Mechanism
from parallel_robot_model.mechanisms.skeleton import drawn
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.contract import Coordinate
from parallel_robot_model.robots.described.parameters import FAULTS
from parallel_robot_model.robots.described.robot import DescribedRobot
from parallel_robot_model.robots.registry import RobotModel

# What was read of a machine's description, and its equations of motion at a state.


class State(NamedTuple):
    """A machine at one state of its actuated joints."""

    position: Array  # actuated joints [rad or m], shape (n,)
    velocity: Array  # their rates, shape (n,)
    M: Array  # inertia matrix, shape (n, n)
    Q: Array  # Coriolis and centrifugal matrix, shape (n, n)
    gravity: Array  # torques that hold it against gravity [N m or N], shape (n,)
    pose: Array  # shape (m,)
    joints: Array  # all joints [rad or m], shape (N,)
    closure: float  # how far the loops are open at most [m or rad]
    # those of the closures and of the tool, as shares of those at home
    margins: tuple[float, float]


class Facts(NamedTuple):
    """A machine and its state at home, or where it was asked for."""

    name: str  # of the machine
    machine: Machine  # what was read
    mechanism: Mechanism  # the same, its numbers those of the parameters
    axes: tuple[Coordinate, ...]  # coordinates of the pose
    state: State

    def plain(self) -> dict[str, Any]:
        """All of it as plain data."""
        machine, state = self.machine, self.state
        joints = dict(zip(machine.names, state.joints.tolist(), strict=True))
        return {
            'name': self.name,
            'joints': self.tree(),
            'actuated': list(machine.actuated),
            'units': list(machine.units),
            'lower': list(machine.lower),
            'upper': list(machine.upper),
            'effort': list(machine.effort),
            'velocity_limit': list(machine.velocity),
            'viscous': list(machine.viscous),
            'coulomb': list(machine.coulomb),
            'tool': machine.tool,
            'coordinates': [axis.name for axis in self.axes],
            'coordinate_units': [axis.unit for axis in self.axes],
            'home_moved': machine.home_moved,
            'doubts': [*machine.warnings, *machine.remarks],
            'state': state.position.tolist(),
            'rate': state.velocity.tolist(),
            'M': state.M.tolist(),
            'Q': state.Q.tolist(),
            'gravity': state.gravity.tolist(),
            'pose': state.pose.tolist(),
            'passive': {name: joints[name] for name in machine.passive},
            'held': {name: joints[name] for name in machine.held},
            'closure': state.closure,
            'margins': list(state.margins),
        }

    def tree(self) -> list[dict[str, Any]]:
        """All joints, each with the one before, what it is, and what it moves."""
        machine, value = self.machine, self.mechanism
        role = {
            **dict.fromkeys(machine.actuated, 'actuated'),
            **dict.fromkeys(machine.passive, 'passive'),
            **dict.fromkeys(machine.held, 'held'),
        }
        return [
            {
                'name': name,
                'parent': None if parent == BASE else machine.names[parent],
                'kind': 'hinge' if turns else 'slide',
                'role': role[name],
                'mass': float(mass),
            }
            for name, parent, turns, mass in zip(
                machine.names, value.parent, value.turns, value.mass, strict=True
            )
        ]


def facts_of(
    robot: RobotModel, position: Sequence[float] = (), velocity: Sequence[float] = ()
) -> Facts:
    """What was read of a machine, and its state.

    Args:
        robot: The machine.
        position: Actuated joints [rad or m], shape (n,); empty: at home.
        velocity: Their rates, shape (n,); empty: at rest.

    Raises:
        InputError: the robot is not described by a file, there are not as many numbers as joints,
            or the loops cannot be closed there.
    """
    module: Any = robot.module
    if not isinstance(module, DescribedRobot):
        raise InputError(f'{robot.name} has no description; its equations are in docs/robots.md')
    machine = module.machine(robot.parameters)
    value = module.mechanism(robot.parameters)
    mechanism, work = boxed(value)
    n = len(machine.actuated)
    for key, numbers in (('state', position), ('rate', velocity)):
        if len(numbers) not in (0, n):
            names = ', '.join(machine.actuated)
            raise InputError(f'--{key} must be {n} numbers, one for each of {names}')
    closure_solver.close(mechanism, work, work.q.copy())
    home = margins.margins(mechanism, work)
    q = np.array(position, np.float64) if len(position) else work.q.copy()
    rate = np.array(velocity, np.float64) if len(velocity) else np.zeros(n)
    fault = closure_solver.close(mechanism, work, q)
    if fault != FOUND:
        raise InputError(f'--state {q.tolist()}: {FAULTS[fault].text}')
    M, Q, gravity, pose = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n)
    dynamics.model(mechanism, work, rate, M, Q, gravity)
    tool.tool_pose(mechanism, work, pose)
    here = margins.margins(mechanism, work)
    closure = float(np.abs(work.error).max(initial=0.0))
    shares = here[0] / home[0], here[1] / home[1]
    state = State(q, rate, M, Q, gravity, pose, work.all.copy(), closure, shares)
    return Facts(robot.name, machine, value, module.coordinates(robot.parameters), state)


# What was read of a machine, as lines and tables.


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
    return [
        *parts,
        *(f'note: {printable(each)}' for each in (*machine.warnings, *machine.remarks)),
    ]


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
        [
            printable(name),
            unit,
            *(f'{each[k] + 0.0:.4g}' if math.isfinite(each[k]) else 'none' for each in columns),
        ]
        for k, (name, unit) in enumerate(zip(machine.actuated, machine.units, strict=True))
    ]


# A machine drawn in three views and in space.


def draw(facts: Facts, file: Path) -> None:
    """Draw a machine at its state.

    Args:
        facts: The machine.
        file: Picture that is written, which must not exist.

    Raises:
        InputError: it cannot be written, or its suffix is of no picture format.
    """
    ends = drawn(facts.mechanism, facts.state.joints[np.newaxis])[0]
    figure = pictures.new((9, 8))
    figure.suptitle(facts.name)
    for k, (across, up, shown) in enumerate(VIEWS):
        axes = figure.add_subplot(2, 2, k + 1)
        axes.set_aspect('equal', 'datalim')
        axes.set_xlabel(f'{across} [m]')
        axes.set_ylabel(f'{up} [m]')
        _add(axes, ends[..., shown], facts.state.pose, shown, facts)
    space: Any = figure.add_subplot(2, 2, 4, projection='3d')
    for line in ends:
        space.plot(*line.T, color='C0', lw=1.5)
    space.set_box_aspect(np.maximum(np.ptp(ends.reshape(-1, 3), axis=0), 1e-3))
    pictures.save(figure, file)


def _add(axes: Any, ends: Array, pose: Array, shown: tuple[int, int], facts: Facts) -> None:
    for line in ends:
        axes.plot(*line.T, color='C0', lw=1.5, marker='o', ms=2.5)
    names = [axis.name for axis in facts.axes]
    wanted = ['xyz'[k] for k in shown]
    if all(name in names for name in wanted):
        axes.plot(*(pose[names.index(name)] for name in wanted), 'x', color='C3', label='tool')
        axes.legend(loc='best', fontsize=8)
