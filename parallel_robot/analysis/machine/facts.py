"""What was read of a machine's description, and its equations of motion at a state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms import closing, dynamics, margins, tool
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, SLIDE, Mechanism
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.contract import Coordinate
from parallel_robot_model.robots.described.parameters import FAULTS
from parallel_robot_model.robots.described.robot import DescribedRobot
from parallel_robot_model.robots.registry import RobotModel


class State(NamedTuple):
    """A machine at one state of its actuated joints.

    Attributes:
        position: Actuated joints [rad or m], shape (n,).
        velocity: Their rates, shape (n,).
        M: Inertia matrix, shape (n, n).
        Q: Coriolis and centrifugal matrix, shape (n, n).
        gravity: Torques that hold it against gravity [N m or N], shape (n,).
        pose: Shape (m,).
        joints: All joints [rad or m], shape (N,).
        closure: How far the loops are open at most [m or rad].
        margins: Those of the closures and of the tool, as shares of those at home.
    """

    position: Array
    velocity: Array
    M: Array
    Q: Array
    gravity: Array
    pose: Array
    joints: Array
    closure: float
    margins: tuple[float, float]


class Facts(NamedTuple):
    """A machine and its state at home, or where it was asked for.

    Attributes:
        name: Of the machine.
        machine: What was read.
        mechanism: The same, its numbers those of the parameters.
        axes: Coordinates of the pose.
        state: The state.
    """

    name: str
    machine: Machine
    mechanism: Mechanism
    axes: tuple[Coordinate, ...]
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
            'doubts': list(machine.doubts),
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
                'kind': 'slide' if kind == SLIDE else 'hinge',
                'role': role[name],
                'mass': float(mass),
            }
            for name, parent, kind, mass in zip(
                machine.names, value.parent, value.kind, value.mass, strict=True
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
    closing.close(mechanism, work, work.q.copy())
    home = margins.margins(mechanism, work)
    q = np.array(position, np.float64) if len(position) else work.q.copy()
    rate = np.array(velocity, np.float64) if len(velocity) else np.zeros(n)
    fault = closing.close(mechanism, work, q)
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
