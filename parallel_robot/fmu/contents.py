"""What units are made of: a law with its cycle, the simulated robot, or the loop of both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.fmu import kernels
from parallel_robot.fmu.kernels import (
    LawInstance,
    PlantInstance,
    advance,
    answer_state,
    begin_law,
    begin_loop,
    law_instance,
    loop_instance,
    plant_instance,
    step_loop,
    tell_state,
)
from parallel_robot.fmu.variables import WORD, Rows, Variable, of_group
from parallel_robot_control import assembly as control
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.limiting import as_limits
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import Boxed, as_constants, vector
from parallel_robot_model.configuration.fields import ESTIMATOR, ZeroAngles
from parallel_robot_model.robots.joint_load import JointLoad
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.configuration import Configuration, assemble_plant
from parallel_robot_sim.plant import MUJOCO
from parallel_robot_sim.simulation import samples_of
from trajectory_gen import preflight

MOST = 600_001  # samples of a motion, of 24 bytes a joint
INSTEAD = {'clip': 'clip', 'where': 'select', 'dot': 'dot'}  # of NumPy, for vectors
SLIDING = "sliding variable in the law's unit"
APPLIED = 'torque applied during the step that ended at the measurement'
OF_MOTORS = 'plant.torque_'
OF_NODES = ('safety.state_timeout', 'safety.reference_timeout', 'safety.state_age')


class Contents(NamedTuple):
    """What a unit is made of."""

    text: str  # what it is, in a line
    root: Boxed  # what its kernels take, boxed
    entries: Mapping[str, Callable[..., int]]  # its kernels by name
    variables: tuple[Variable, ...]
    period: float  # time between two states [s]
    codes: Mapping[int, str]  # text of each fault by its number


def law_contents(configuration: ControlConfiguration) -> Contents:
    """A law with its control cycle.

    Raises:
        InputError: the law cannot be used.
    """
    loop, robot = configuration.loop, configuration.robot
    if configuration.laws[loop.law].foreign:
        raise InputError(f'{loop.law} is a foreign law: an FMU is made of kernels', 'law')
    assembled = control.assemble(configuration)
    if assembled.law.arrays:
        what = assembled.law.arrays.rpartition('>>> ')[2]
        own = INSTEAD.get(what.partition('(')[0])
        instead = f': {own} in place of it' if own else ''
        raise InputError(
            f'{loop.law}: native code cannot make arrays, which update needs for {what}; '
            f'see vectors in docs/robots.md{instead}',
            'law',
        )
    root = law_instance(assembled, loop.period, configuration.safety.state_timeout)
    instance: LawInstance = root.value
    values: Any = instance.values
    rows = Rows(int(values), loop.joints, robot.joint_units)
    last = int(values) + WORD * kernels.ROWS * len(loop.joints)
    gains, estimator = configuration.gains[loop.law], assembled.setup.estimator
    known = faults.of(robot.module)
    codes = {0: 'none'} | {number: fault.text for number, fault in known.items()}
    variables = [
        *rows.of(
            'input',
            (kernels.POSITION, 'position', 'rad', 'measured position'),
            (kernels.VELOCITY, 'velocity', 'rad/s', 'measured rate'),
            (kernels.EFFORT, 'effort', 'N m', APPLIED),
            (kernels.REFERENCE, 'reference.position', 'rad', 'desired position'),
            (kernels.REFERENCE + 1, 'reference.velocity', 'rad/s', 'desired rate'),
            (kernels.REFERENCE + 2, 'reference.acceleration', 'rad/s^2', 'desired acceleration'),
        ),
        Variable(
            'age', 'input', 'real', 'from the measurement to the moment at which the torque acts',
            's', 0.0, address=last + WORD * kernels.AGE,
        ),
        Variable(
            'elapsed', 'input', 'real', 'time since the state before: more than 1.5 periods '
            'where states are missing', 's', 0.0, address=last + WORD * kernels.ELAPSED,
        ),
        Variable(
            'reference_age', 'input', 'real', 'how long ago the reference was told, which is '
            'carried to the moment of the state', 's', 0.0,
            address=last + WORD * kernels.REFERENCE_AGE,
        ),
        Variable(
            'effort_known', 'parameter', 'boolean', 'whether effort is measured', '', 0.0, 0.0,
            1.0, last + WORD * kernels.EFFORT_KNOWN,
        ),
        Variable(
            'joins', 'parameter', 'boolean', 'whether the law begins where the robot is, its '
            'torque with what acts; else as at a common start', '', 0.0, 0.0, 1.0,
            last + WORD * kernels.JOINS,
        ),
        *rows.of(
            'output',
            (kernels.TORQUE, 'torque', 'N m', 'commanded torque'),
            (kernels.SLIDING_VARIABLE, 'sliding_variable', '', SLIDING),
            (kernels.COUPLED_ERROR, 'coupled_error', 'rad', 'coupled error'),
        ),
        *(
            Variable(name, 'output', 'integer', text, '', 0.0, address=last + WORD * place)
            for name, text, place in (
                ('fault', 'number of the latched fault; 0: none', kernels.FAULT),
                ('cause', 'number of the fault whose cause is there now', kernels.CAUSE),
                (
                    'acted',
                    'limits that acted: 1 torque, 2 rate, 4 ramp, 8 motors that do not apply it',
                    kernels.ACTED,
                ),
            )
        ),
        *of_group(
            gains, loop.law, assembled.law.law.value.gains, lambda other: other, robot.joint_units
        ),
        *(
            each
            for each in of_group(
                configuration.safety, 'safety', assembled.setup.safety,
                lambda safety: as_limits(safety, loop.period), robot.joint_units,
            )
            if each.name not in OF_NODES
        ),
        Variable(
            'safety.state_timeout', 'parameter', 'real', 'time without joint states that is a '
            'fault', 's', configuration.safety.state_timeout, 1e-3,
            address=last + WORD * kernels.STATE_TIMEOUT,
        ),
        *of_group(
            ZeroAngles(configuration.estimator.zero_angle), ESTIMATOR, estimator,
            lambda zero: estimator.value._replace(zero_angle=vector(zero.zero_angle)),
            robot.joint_units,
        ),
        *of_robot(robot, 'robot', assembled.setup.robot),
    ]  # fmt: skip
    return Contents(
        f'control cycle of {loop.law} for {robot.name}',
        root,
        {'unit_begin': begin_law, 'unit_step': answer_state},
        tuple(variables),
        loop.period,
        codes,
    )


def plant_contents(configuration: Configuration) -> Contents:
    """The simulated robot with its motors and sensors.

    Raises:
        InputError: it does not reach its initial pose, has hazards, or is moved by MuJoCo.
    """
    loop, robot = configuration.loop, configuration.true_robot
    if configuration.plant.engine == MUJOCO:
        raise InputError('plant.engine must be analytic in an FMU, not mujoco', 'plant.engine')
    if loop.hazards:
        raise InputError('hazards must be empty in an FMU: they happen to a loop', 'hazards')
    plant = assemble_plant(configuration)
    root = plant_instance(plant, loop.period, robot.pose_size)
    instance: PlantInstance = root.value
    values: Any = instance.values
    rows = Rows(int(values), loop.joints, robot.joint_units)
    last = int(values) + WORD * kernels.PLANT_ROWS * len(loop.joints)
    load = configuration.joint_load

    variables = [
        *rows.of('input', (kernels.PLANT_TORQUE, 'torque', 'N m', 'commanded torque')),
        *rows.of(
            'output',
            (kernels.PLANT_POSITION, 'position', 'rad', 'measured position'),
            (kernels.PLANT_VELOCITY, 'velocity', 'rad/s', 'measured rate'),
            (kernels.PLANT_EFFORT, 'effort', 'N m', APPLIED),
            (kernels.JOINTS, 'true.position', 'rad', 'true position'),
            (kernels.RATES, 'true.velocity', 'rad/s', 'true rate'),
        ),
        Variable(
            'age', 'output', 'real', 'age of the state that its stamp tells', 's', 0.0,
            address=last + WORD * kernels.PLANT_AGE,
        ),
        *(
            Variable(
                f'pose.{each.name}', 'output', 'real', 'true pose of the end effector', each.unit,
                0.0, address=last + WORD * (kernels.POSE + k),
            )
            for k, each in enumerate(robot.module.coordinates(robot.parameters))
        ),
        *of_group(
            load.friction, 'friction', plant.setup.load,
            lambda other: JointLoad(other, load.disturbance), robot.joint_units,
        ),
        *of_group(
            load.disturbance, 'disturbance', plant.setup.load,
            lambda other: JointLoad(load.friction, other), robot.joint_units,
        ),
        *(
            each
            for each in of_group(
                configuration.plant, 'plant', plant.setup.parameters, as_constants,
                robot.joint_units,
            )
            if each.name.startswith(OF_MOTORS)
        ),
        *of_robot(robot, 'true_robot', plant.setup.robot),
    ]  # fmt: skip
    return Contents(
        f'simulated {robot.name} with its motors and sensors',
        root,
        {'unit_begin': tell_state, 'unit_step': advance},
        tuple(variables),
        loop.period,
        {},
    )


def loop_contents(configuration: Configuration) -> Contents:
    """A law, the simulated robot and the motion of a scenario.

    Raises:
        InputError: as of both, or the robot cannot perform the motion.
    """
    law, plant = law_contents(configuration), plant_contents(configuration)
    count = samples_of(configuration)
    if count > MOST:
        longest = (MOST - 1) * law.period
        raise InputError(
            f'duration must be at most {longest:g} s in an FMU, which holds the motion', 'duration'
        )
    reference = configuration.trajectory.sample(np.arange(count) * law.period)
    preflight.check(configuration.trajectory, law.period, reference)
    variables = [
        each._replace(role='output') if each.name.startswith('reference.') else each
        for each in law.variables
        if each.role != 'input' or each.name.startswith('reference.')
    ]
    return Contents(
        f'{law.text}, with the simulated robot and its motion',
        loop_instance(law.root, plant.root, reference),
        {'unit_begin': begin_loop, 'unit_step': step_loop},
        (
            *(each for each in variables if each.name != 'effort_known'),
            *(each for each in plant.variables if each.role != 'input'),
        ),
        law.period,
        law.codes,
    )


def of_robot(robot: RobotModel, prefix: str, boxed: Boxed) -> list[Variable]:
    """Variables of the parameters of a robot."""
    make = None if robot.module.OWN_MEMORY else robot.module.constants
    return list(of_group(robot.parameters, prefix, boxed, make, robot.joint_units))
