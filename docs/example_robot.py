"""A table with two axes and belts, moved by two motors: an example of a custom robot."""

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot.robot import (
    FOUND,
    REACHED,
    Coordinate,
    Estimate,
    Fault,
    Field,
    JointMotion,
    Location,
    Measurement,
    Model,
    RobotError,
    every,
    first_sample,
    kernel,
    net_torque,
    select,
    vector,
)

PARTS = ('axis', 'table')
PLANAR = True
FAULTS = {1: Fault('off_the_table', 'the tool is close to the edge of the table')}
DEFAULTS = {  # of everything else that depends on the robot
    'joints': ['motor_x', 'motor_y'],
    'trajectory': {'margin': 0.05},
    'safety': {
        'margin': 0.02, 'damping': 2.0, 'stiffness': 20.0, 'torque_limit': 30.0,
        'torque_rate': 3e4, 'ramp_rate': 200.0, 'speed_limit': 60.0,
    },
    'plant': {'initial_pose': [0.241, 0.2], 'torque_limit': 30.0},
    'friction': {'viscous': 1e-3, 'coulomb': 0.0},
    'disturbance': {'amplitude': 0.0, 'phase': 0.0},
    'circle': {'center': [0.2, 0.2], 'radius': 0.04},
    'move': {'start': [0.1, 0.1], 'end': [0.3, 0.25]},
}  # fmt: skip


class Parameters(NamedTuple):
    width: Annotated[float, Field('m', 'of the table, in x and in y')] = 0.4
    bridge: Annotated[float, Field('kg', 'mass that moves in x alone')] = 6.0
    tool: Annotated[float, Field('kg', 'mass that moves in x and y')] = 2.0
    radius: Annotated[float, Field('m', 'of the pulleys')] = 0.02
    inertia: Annotated[float, Field('kg m^2', 'of each motor with its pulley')] = 2e-4


class SafetyMargins(NamedTuple):
    margin: Annotated[float, Field('m', 'distance to an edge that is a fault', 0.0)]


class MotionLimits(NamedTuple):
    margin: Annotated[float, Field('m', 'smallest distance to an edge allowed', 0.0)]


def validate(robot, name='robot'):
    for key, value in robot._asdict().items():
        if not value > 0.0:
            raise RobotError(f'{name}.{key} must be positive, not {value:g}')
    return robot


def joints(robot):
    return 2


def coordinates(robot):
    return Coordinate('x', 'm'), Coordinate('y', 'm')


def start(robot, pose):
    return pose / robot.radius  # the plant integrates the motor angles


@kernel
def _inertia(robot):
    tool = robot.inertia + robot.tool * robot.radius**2
    return vector((tool + robot.bridge * robot.radius**2, tool))


@kernel
def joint_motion(robot, motion):
    r = robot.radius
    none = vector(())  # no passive joints
    return JointMotion(motion.pose / r, motion.rate / r, motion.acceleration / r, none, REACHED)


@kernel
def locate(robot, position, guess):
    return Location(robot.radius * position, FOUND)


@kernel
def estimate(robot, margins, position, velocity, guess):
    pose = robot.radius * position
    inside = (pose > margins.margin) & (pose < robot.width - margins.margin)
    M = np.diag(_inertia(robot))
    model = Model(M, np.zeros_like(M), np.zeros_like(pose))
    return Estimate(select(every(inside), FOUND, 1), pose, model)


@kernel
def acceleration(robot, load, position, velocity, torque, time):
    return net_torque(load, torque, velocity, time) / _inertia(robot)


@kernel
def measure(robot, position, velocity):
    none = vector(())
    return Measurement(position, velocity, none, none, robot.radius * position)


def infeasible(robot, limits, reference):
    edge = np.minimum(reference.pose, robot.width - reference.pose)
    text = f'{{:.3f}} m from an edge, at least {limits.margin:g} m are needed'
    found = first_sample(edge < limits.margin, edge, text)
    return [] if found is None else [found]


def segments(robot, pose, position):
    low, high = np.array(pose), np.array(pose)
    low[..., 1], high[..., 1] = 0.0, robot.width
    bridge = np.stack([low, high], axis=-2)[..., np.newaxis, :, :]
    edge = robot.width * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    table = np.stack([edge, np.roll(edge, -1, axis=0)], axis=-2)
    return {'bridge': bridge, 'table': np.broadcast_to(table, (*bridge.shape[:-3], 4, 2, 2))}
