"""What a description says of all that a configuration asks, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.mechanisms import closure_solver, dynamics, tool
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.margins import margins
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.described.shifting import loops

CHOICES: dict[str, Any] = {'actuated': (), 'tool': '', 'home': '', 'held': ()}
FAR = 1e6  # rad or m, an end of travel that is none
BANDWIDTH = 10.0  # rad/s, of the spring and the damper that hold the machine after a fault
PUSH = 20.0  # rad/s^2 or m/s^2, for which motors without a limit are strong enough
SPEED = 10.0  # rad/s or m/s, a fault where the file has no limit
WIDE = 0.1  # of the length of the machine, a motion that is proposed
HARMONICS = 5
TINY = 1e-12  # rad or m, a motion that is none
USED = 0.8  # of the travel, by a motion that is proposed where there is less than it needs


def choices(values: Mapping[str, Any]) -> dict[str, Any]:
    """What of a machine is chosen, the ``robot.*`` of CHOICES, in their order.

    Args:
        values: What is chosen.
    """
    return {
        key: _chosen(key, values.get(f'robot.{key}', default)) for key, default in CHOICES.items()
    }


def defaults_of(made: Machine, chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults in groups.

    Args:
        made: The machine.
        chosen: What of it is chosen, see :func:`choices`.
    """
    inertia, gravity, pose = at_home(made)
    shapes = figures(made, pose)
    n = len(made.actuated)
    back, forth = torque_ends(made, inertia, gravity)
    limits = np.maximum(back, forth)
    some = np.where(limits > 0.0, limits, 1.0)
    speeds = [SPEED if speed == np.inf else speed for speed in made.velocity]
    lengths = [unit == 'm' for _, unit in coordinates_of(made)]
    steps = WIDE * np.where(lengths, made.mechanism.length, 1.0)
    steps[0] *= _share(made, steps[0])
    end = pose.copy()
    end[0] += steps[0]
    sine, cosine = np.zeros((2, n, HARMONICS))
    for k, step in enumerate(0.3 * steps):  # each coordinate at two frequencies of its own
        sine[k, k % HARMONICS] = step
        cosine[k, (k + 2) % HARMONICS] = 0.5 * step
    return {
        'joints': list(made.actuated),
        **shapes,
        'robot': {
            **{
                key: list(value) if isinstance(value, tuple) else value
                for key, value in chosen.items()
            },
            'mass_factor': [1.0] * len(made.names),
            'spread_factor': [1.0] * 3 * len(made.names),
            'centre_shift': [0.0] * 3 * len(made.names),
            'inertia_shift': [0.0] * 6 * len(made.names),
            'armature': made.mechanism.armature[made.mechanism.actuated].tolist(),
            'payload': 0.0,
            'shift': [0.0] * (3 * len(made.names) + 6 * len(loops(made.mechanism))),
            'gravity': made.mechanism.gravity.tolist(),
            'lower': [max(low, -FAR) for low in made.lower],
            'upper': [min(high, FAR) for high in made.upper],
        },
        'trajectory': {
            'shape': 'circle' if shapes else 'move',
            'min_closure': 0.1,
            'min_tool': 0.1,
            'min_travel': 0.0,
            'max_joint_speed': max(*speeds, SPEED),
        },
        'move': {'start': pose.tolist(), 'end': end.tolist()},
        'trapezoid': {
            'start': pose.tolist(),
            'end': end.tolist(),
            'speed': (5.0 * np.abs(steps)).tolist(),
            'acceleration': (20.0 * np.abs(steps)).tolist(),
        },
        'excitation': {
            'center': pose.tolist(),
            'sine': sine.ravel().tolist(),
            'cosine': cosine.ravel().tolist(),
        },
        'plant': {
            'initial_pose': pose.tolist(),
            'torque_limit': limits.tolist(),
            'torque_forward': (forth / some).tolist(),
            'torque_backward': (back / some).tolist(),
        },
        'friction': {'viscous': list(made.viscous), 'coulomb': list(made.coulomb)},
        'actuator': {'lag': list(made.lag), 'delay': made.delay},
        'disturbance': {'amplitude': 0.0, 'phase': 0.0},
        'safety': {
            'min_closure': 0.05,
            'min_tool': 0.05,
            'min_travel': 0.0,
            'residual_limit': 0.0,
            'damping': (2.0 * BANDWIDTH * inertia).tolist(),
            'stiffness': (BANDWIDTH**2 * inertia).tolist(),
            'torque_limit': limits.tolist(),
            'torque_rate': (1000.0 * limits).tolist(),
            'ramp_rate': (5.0 * limits).tolist(),
            'speed_limit': speeds,
        },
    }


def figures(made: Machine, pose: Array) -> dict[str, dict[str, Any]]:
    """Figures near home of a machine whose tool moves in a plane or in space."""
    planar = made.planar
    if not (planar or [name for name, _ in made.coordinates[:3]] == ['x', 'y', 'z']):
        return {}
    size = round(0.5 * WIDE * made.mechanism.length, 3)
    shown = pose[:2] if planar else pose
    phi = {'phi': float(pose[2]) if len(pose) > len('xy') and planar else 0.0}
    center, end = shown.copy(), shown.copy()
    center[0] -= size
    end[:2] += size
    at = {'center': center.tolist(), **phi}
    return {
        'circle': {**at, 'radius': size},
        'ellipse': {**at, 'semi_axes': [size, 0.5 * size]},
        'figure_eight': {**at, 'length': 2.0 * size, 'width': size},
        'line': {'start': shown.tolist(), 'end': end.tolist(), **phi},
        'pick_and_place': {
            'pick': shown.tolist(),
            'place': (2.0 * shown - center).tolist(),
            'height': 0.5 * size,
            **phi,
        },
    }


def coordinates_of(made: Machine) -> tuple[tuple[str, str], ...]:
    """Names and units of its pose."""
    joints = tuple((f'q{k + 1}', unit) for k, unit in enumerate(made.units))
    return made.coordinates or joints


def at_home(made: Machine) -> tuple[Array, Array, Array]:
    """Diagonal of M, gravity and pose at home, each shape (n,)."""
    n = len(made.actuated)
    mechanism, work = boxed(made.mechanism)
    M, Q, gravity, pose = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n)
    closure_solver.close(mechanism, work, work.q.copy())
    dynamics.model(mechanism, work, np.zeros(n), M, Q, gravity)
    tool.tool_pose(mechanism, work, pose)
    return np.diag(M).copy(), gravity, pose


def _share(made: Machine, step: float) -> float:
    """Share of a step of the first coordinate for which the travel has room, from -1 to 1.

    To first order, from home: 1 where all of it fits; negative where more fits the other way; 1,
    too, where home is outside the travel or the tool cannot be led.
    """
    mechanism, work = boxed(made.mechanism)
    n, position = len(made.actuated), work.q.copy()
    closure_solver.close(mechanism, work, position)
    margins(mechanism, work)  # writes the Jacobian, of a pose that is not the joints
    slopes = work.tool_jacobian if made.coordinates else np.eye(n)
    if np.linalg.matrix_rank(slopes) < n:
        return 1.0
    motion = step * np.linalg.inv(slopes)[:, 0]
    moving = np.abs(motion) > TINY
    if not moving.any():
        return 1.0
    ends = np.array([made.lower, made.upper])[:, moving] - position[moving]
    shares = np.sort(ends / motion[moving], axis=0)  # of the step back, and ahead
    back, ahead = shares[0].max(), shares[1].min()
    if back > 0.0 or ahead < 0.0 or ahead >= 1.0:
        return 1.0
    return float(USED * ahead if ahead >= -back else max(USED * back, -1.0))


def torque_ends(made: Machine, inertia: Array, gravity: Array) -> tuple[Array, Array]:
    """Greatest torques of the motors backwards and forwards [N m or N], each shape (n,).

    Those that the file does not have are assumed.
    """
    assumed = 3.0 * np.abs(gravity) + PUSH * inertia
    ends = -np.array(made.least_effort), np.array(made.effort)
    back, forth = (np.where(np.isfinite(end), np.maximum(end, 0.0), assumed) for end in ends)
    return back, forth


def _chosen(key: str, value: Any) -> Any:
    kind = str if isinstance(CHOICES[key], str) else tuple[str, ...]
    return check(f'robot.{key}', kind, Field('', ''), value)
