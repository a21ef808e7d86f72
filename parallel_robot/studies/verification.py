"""Plants against MuJoCo, which shares parameters with them, and robots against their contract."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.output import tracked
from parallel_robot.studies import file_in_engine
from parallel_robot.studies.file_in_engine import Compared
from parallel_robot_control.configuration import resolve as resolve_control
from parallel_robot_model.common.errors import Frame, InputError, RunError, pandas, printable
from parallel_robot_model.common.tables import Part, ShownResult, Table, returning
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.config import Changes, changes, layers
from parallel_robot_model.configuration.config_files import machine_file
from parallel_robot_model.configuration.plain_data import merged
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.robots.described.default_values import at_home
from parallel_robot_model.robots.registry import (
    KERNELS,
    load_robots,
    resolve,
    robot_of,
)
from parallel_robot_model.robots.robot_checks import FINE, RATE, Check, checks
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.mujoco_machine import MujocoMachine
from parallel_robot_sim.mujoco_model import MujocoRobot
from parallel_robot_sim.plant_run import Simulator

SCENARIOS = {'planar_3rrr': 'paper_circle', 'serial_2r': 'serial_2r_circle', 'axes': 'axes_step'}
UNCERTAIN = ('m1', 'm2', 'mp', 'I1', 'I2', 'Ip', 'lc1', 'lc2', 'inertia')
SPREAD = 0.2  # of the parameters, relative
POSE = {  # m, rad, about that of the scenario
    'planar_3rrr': np.array([0.04, 0.04, 0.3]),
    'serial_2r': np.array([0.05, 0.05]),
    'axes': np.ones(1),
}
TORQUE = {'planar_3rrr': 1.5, 'serial_2r': 1.5, 'axes': 1.0}  # N m, amplitude
FREQUENCY = 1.0, 4.0  # Hz
VISCOUS = 1.0, 3.0  # N m s/rad
DRAWS = 50  # of one robot, until its motion stays in the workspace
PLANT = {  # as exact as MuJoCo's integration
    'plant.integrator': 'rk4',
    'plant.substeps': 10,
    'friction.coulomb': 0.0,
    'friction.stribeck': 0.0,
    'friction.offset': 0.0,
    'friction.load': 0.0,
    'disturbance.amplitude': 0.0,
}


class Difference(NamedTuple):
    """The largest difference of the poses of a robot."""

    robot: int  # its number
    largest: float  # [m] or [rad], over the whole motion
    path: float  # length of the motion of the pose, largest coordinate [m] or [rad]


def _check_numbers(robots: int, seed: int, duration: float) -> None:
    """Refuse numbers with which nothing can be compared."""
    if not isinstance(robots, int) or robots < 1:
        raise InputError(f'--robots must be at least 1, not {robots}')
    if not isinstance(seed, int) or seed < 0:
        raise InputError(f'--seed must not be negative, not {seed}')
    if not 0.001 <= duration <= 10.0:
        raise InputError(f'--duration must be 0.001 to 10 s, not {duration:g}')


def verify_kind(kind: str, numbers: Iterable[int], seed: int, duration: float) -> list[Difference]:
    """Compare random robots of a kind, each from a random pose under random torques.

    Args:
        kind: Key of SCENARIOS.
        numbers: Numbers of the robots; one of the same number and seed is the same.
        seed: Of all that is random.
        duration: Of each motion [s].

    Raises:
        InputError: MuJoCo is not installed.
        RunError: no motion was found that stays in the workspace.
    """
    base = resolve(SCENARIOS[kind])

    def drawn(random: np.random.Generator, _: int) -> tuple[dict[str, Any], Array]:
        values = _drawn(kind, base, random)
        return values, torques(TORQUE[kind], len(values['joints']), duration, values, random)

    what = f'robot {{}} of {kind}'
    return [_compared(what, drawn, MujocoRobot, number, seed) for number in numbers]


def _compared(
    what: str,
    drawn: Callable[[np.random.Generator, int], tuple[dict[str, Any], Array]],
    model: type[MujocoRobot | MujocoMachine],
    number: int,
    seed: int,
) -> Difference:
    """Draw one robot and a motion until the motion stays in the workspace; compare the poses."""
    random = np.random.default_rng([seed, number])
    for draw in range(DRAWS):
        values, moved_by = drawn(random, draw)
        try:
            plant = Simulator(configure_plant(values))
            ours = _poses(plant, moved_by, ())
            robot, pose = robot_of(values, 'true_robot'), values['plant.initial_pose']
            other = model(robot, pose, values['friction.viscous'])
        except RunError:
            continue
        except InputError as error:
            if error.key == 'plant.initial_pose':  # out of reach
                continue
            raise
        theirs = _poses(other, moved_by, (values['period'],))
        apart, path = np.abs(ours - theirs).max(), np.ptp(ours, axis=0).max()
        return Difference(number, float(apart), float(path))
    raise RunError(f'{what.format(number)}: no motion was found that stays in the workspace')


def _drawn(kind: str, base: Mapping[str, Any], random: np.random.Generator) -> dict[str, Any]:
    """A configuration with a random robot at a random pose."""
    changes: dict[str, Any] = dict(PLANT)
    for name in UNCERTAIN:
        key = f'robot.{name}'
        if key in base:
            factor = 1.0 + SPREAD * random.uniform(-1.0, 1.0, np.shape(base[key]))
            changes[key] = factor * base[key]
    pose = np.asarray(base['plant.initial_pose'])
    changes['plant.initial_pose'] = pose + random.uniform(-1.0, 1.0, pose.shape) * POSE[kind]
    changes['friction.viscous'] = random.uniform(*VISCOUS, len(base['joints']))
    return resolve(SCENARIOS[kind], changes)


def torques(
    amplitude: Array | float,
    joints: int,
    duration: float,
    values: Mapping[str, Any],
    random: np.random.Generator,
) -> Array:
    """A sine for each joint [N m], one row for each period."""
    time = np.arange(round(duration / values['period']))[:, None] * values['period']
    frequency, phase = random.uniform(*FREQUENCY, joints), random.uniform(0.0, 2 * math.pi, joints)
    return amplitude * np.sin(2.0 * math.pi * frequency * time + phase)


def _poses(plant: Any, torques: Array, period: tuple[float, ...]) -> Array:
    """Poses of a plant under torques, each held over a period, shape (N + 1, m)."""
    found = [np.array(plant.pose)]
    for torque in torques:
        plant.advance(torque, *period)
        found.append(np.array(plant.pose))
    return np.array(found)


# One robot against its contract: whether its functions describe one machine.

STATES = 20  # the first at the initial pose
SPREAD_OF_STATES = 0.02  # m or rad, of the poses about it


def verify_robot(given: Mapping[str, Any], seed: int) -> tuple[str, list[Check]]:
    """Check a robot near its initial pose, with the parameters of the true one.

    Args:
        given: Keys of the configuration and their values, robot_model and custom_robots too.
        seed: Of poses and rates.

    Returns:
        Name of the robot, and of each check the worst result.

    Raises:
        InputError: a value is wrong, or a function of the robot cannot be used.
    """
    configuration = configure_plant(values_of(given))
    robot, margins = configuration.true_robot, configuration.margins
    centre = np.array(robot.pose_of('plant.initial_pose', configuration.plant.initial_pose))
    random = np.random.default_rng(seed)
    worst: dict[tuple[str, str], Check] = {}
    for k in range(STATES):
        pose = centre + (
            random.uniform(-SPREAD_OF_STATES, SPREAD_OF_STATES, len(centre)) if k else 0.0
        )
        rate = random.uniform(-RATE, RATE, len(centre))
        try:
            found = [*checks(robot, configuration.joint_load, pose, rate, margins)]
        except InputError:
            if k:  # out of reach
                continue
            raise
        for check in found:
            key = check.function, check.what
            if key not in worst or not check.share <= worst[key].share:
                worst[key] = check
    missing = KERNELS.keys() - {function for function, _ in worst}
    what = 'anything within reach and margins, near plant.initial_pose'
    return robot.name, [*worst.values(), *(Check(each, what, np.nan, 0.0) for each in missing)]


def verify_file(given: Mapping[str, Any], path: Path, seed: int) -> tuple[str, list[Compared]]:
    """Hold a described machine against what an engine makes of its file.

    Args:
        given: Keys of the configuration and their values, robot_model, too.
        path: The file.
        seed: Of postures and rates.

    Returns:
        What it was held against, or why it was not; of each quantity the largest difference.

    Raises:
        InputError: a value is wrong.
    """
    robot = robot_of(values_of(given))
    try:
        engine, found = file_in_engine.compare(robot, path, seed)
    except InputError as error:
        return f'not compared with an engine: {error}', []
    return f'{engine}, {file_in_engine.POSTURES} postures near home', found


def values_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration of one robot from what is given of it.

    Raises:
        InputError: a value is wrong.
    """
    scenario = SCENARIOS.get(str(given.get('robot_model')), 'paper_circle')
    own = load_robots(given).defaults({'robot_model': '', **given})  # of its poses, say
    return resolve_control(scenario, merged([own, given]))


# A described machine against MuJoCo's own model of its file, with random masses and motions.

POSE_SPREAD = 0.05  # of the length of the machine, or rad, about the initial pose
PUSH = 10.0  # rad/s^2 or lengths/s^2, amplitude of the torques over the inertia
CALMER = 10  # draws after which it is halved: not every machine has room for it
DAMPING = 3.0, 6.0  # 1/s, viscous friction over the inertia


def name_of(given: Mapping[str, Any]) -> str:
    """Name of a described machine.

    Args:
        given: Keys of the configuration and their values, robot_model, too.

    Raises:
        InputError: a value is wrong, or the robot is none.
    """
    robot = robot_of(values_of(given))
    if not hasattr(robot.module, 'machine'):
        raise InputError(
            f'{robot.name} is not described by a file: without --set, robots of each kind are '
            'compared with MuJoCo'
        )
    return robot.name


def verify_machine(
    given: Mapping[str, Any], numbers: Iterable[int], seed: int, duration: float
) -> list[Difference]:
    """Compare a machine with random masses, each time from a random pose under random torques.

    Args:
        given: Keys of the configuration and their values, robot_model, too.
        numbers: Numbers of the variants; one of the same number and seed is the same.
        seed: Of all that is random.
        duration: Of each motion [s].

    Raises:
        InputError: MuJoCo is not installed, or the description is not MJCF.
        RunError: no motion was found that stays in the workspace.
    """
    base = values_of(given)
    robot = robot_of(base)
    module: Any = robot.module
    machine = module.machine(robot.parameters)
    inertia, gravity, _ = at_home(machine)
    units = np.where([unit == 'm' for unit in machine.units], machine.mechanism.length, 1.0)
    left = np.asarray(base['plant.torque_limit']) - np.abs(gravity)  # MuJoCo's motors have none
    largest = np.minimum(PUSH * inertia * units, left)

    def drawn(random: np.random.Generator, draw: int) -> tuple[dict[str, Any], Array]:
        values = _drawn_machine(given, base, machine, random)
        push = 0.5 ** (draw // CALMER) * largest
        return values, gravity + torques(push, len(inertia), duration, base, random)

    return [_compared('variant {}', drawn, MujocoMachine, each, seed) for each in numbers]


def _drawn_machine(
    given: Mapping[str, Any],
    base: Mapping[str, Any],
    machine: Machine,
    random: np.random.Generator,
) -> dict[str, Any]:
    """A configuration with random masses, friction and pose."""
    inertia, _, _ = at_home(machine)
    lengths = [unit == 'm' for _, unit in machine.coordinates] or [
        unit == 'm' for unit in machine.units
    ]
    spread = POSE_SPREAD * np.where(lengths, machine.mechanism.length, 1.0)
    pose = np.asarray(base['plant.initial_pose'])
    factor = np.broadcast_to(base['robot.mass_factor'], len(machine.names))
    changes = PLANT | {
        'robot.mass_factor': factor * (1.0 + SPREAD * random.uniform(-1.0, 1.0, factor.shape)),
        'robot.payload': SPREAD * machine.mechanism.mass.max() * random.uniform(),
        'plant.initial_pose': pose + spread * random.uniform(-1.0, 1.0, pose.shape),
        'friction.viscous': inertia * random.uniform(*DAMPING, inertia.shape),
    }
    return values_of(merged([given, changes]))


# All of them as one function, and what came of it.

TOLERANCE = 1e-9  # m or rad
ROBOTS, DURATION = 10, 1.0


@dataclass(frozen=True, repr=False)
class AgainstMujoco(ShownResult):
    """Plants against MuJoCo."""

    differences: Mapping[str, list[Difference]]  # of the robots of each kind
    duration: float  # of each motion [s]

    def as_data(self) -> list[dict[str, Any]]:
        """The worst robot of each kind."""
        worst = {
            kind: max(found, key=lambda difference: difference.largest)
            for kind, found in self.differences.items()
        }
        return [
            {
                'kind': kind,
                'robots': len(found),
                'largest_difference': worst[kind].largest,
                'robot': worst[kind].robot,
                'least_path': min(difference.path for difference in found),
                'agrees': worst[kind].largest < TOLERANCE,
            }
            for kind, found in self.differences.items()
        ]

    def parts(self) -> list[Part]:
        """The same as a table."""
        rows = [
            [
                each['kind'],
                f'{each["largest_difference"]:.1e}',
                f'{each["robot"]} of {each["robots"]}',
                f'{each["least_path"]:.2g}',
                'agrees' if each['agrees'] else f'more than {TOLERANCE:g}',
            ]
            for each in self.as_data()
        ]
        head = f'largest difference of the poses over {self.duration:g} s, [m] or [rad]'
        columns = ['kind', 'difference', 'robot', 'least way', 'verdict']
        return [head, Table(columns, rows, 'lrrrl')]

    @property
    def failed(self) -> bool:
        """Whether one differs."""
        return not all(row['agrees'] for row in self.as_data())

    def frame(self) -> Frame:
        """A row a robot."""
        rows = [(kind, *each) for kind, found in self.differences.items() for each in found]
        columns = ['kind', 'robot', 'largest_difference', 'path']
        return pandas().DataFrame(rows, columns=columns)


@dataclass(frozen=True, repr=False)
class RobotChecks(ShownResult):
    """The functions of one robot against each other, and against an engine."""

    name: str
    checks: list[Check]
    file: Path | None  # its description, if it has one
    against: str  # what this was held against, or why it was not
    compared: list[Compared]  # of each quantity the largest difference

    def as_data(self) -> list[dict[str, Any]]:
        """A row a check."""
        data = [
            {'function': 'file', **each._asdict(), 'agrees': each.agrees} for each in self.compared
        ]
        return data + [each._asdict() | {'agrees': each.passes(FINE)} for each in self.checks]

    def parts(self) -> list[Part]:
        """Each check; of a described robot what differs."""
        lines, rows = [], []
        if self.file:
            differ = [each.text() for each in self.compared if not each.agrees]
            largest = max((each.share for each in self.compared), default=0.0)
            verdict = f'differs: {"; ".join(differ)}' if differ else f'agrees, {largest:.1e}'
            told = f'{printable(self.file.name)} beside {self.against}: {verdict}'
            lines = [told if self.compared else self.against]
        for check in self.checks:
            known = math.isfinite(check.difference)
            sizes = f'{check.difference:.2g}' if known else 'not finite', f'{check.size:.2g}'
            verdict = 'agrees' if check.passes(FINE) else 'wrong'
            rows.append([check.function, check.what, *sizes, verdict])
        if self.file and all(row[-1] == 'agrees' for row in rows):
            return [*lines, f'{self.name}: its functions agree with each other']
        head = f'{self.name}: largest differences near plant.initial_pose'
        columns = ['function', 'what', 'difference', 'of', 'verdict']
        return [*lines, head, Table(columns, rows, 'llrrl')]

    @property
    def failed(self) -> bool:
        """Whether one is wrong."""
        return not all(row['agrees'] for row in self.as_data())

    def frame(self) -> Frame:
        """A row a check."""
        rows: list[tuple[Any, ...]] = []
        for each in self.compared:
            what, apart = f'{each.what}, {each.where}', abs(each.here - each.there)
            rows.append(('file', what, apart, each.size, each.agrees))
        rows += [(*check, check.passes(FINE)) for check in self.checks]
        columns = ['function', 'what', 'difference', 'size', 'agrees']
        return pandas().DataFrame(rows, columns=columns)


def _frame(found: AgainstMujoco | RobotChecks) -> Frame:
    return found.frame()


@returning(_frame, pandas)
def verify(
    robots: int | None = None,
    *,
    seed: int = 0,
    duration: float | None = None,
    param_file: Changes = None,
    **values: Any,
) -> AgainstMujoco | RobotChecks:
    """Compare plants with MuJoCo, or check one robot, as ``parallel_robot verify`` does.

    >>> import parallel_robot as pr
    >>> bool(pr.verify(robot_model='serial_2r').agrees.all())
    True

    Args:
        robots: Number of random robots of each kind against MuJoCo; default: 10.
        seed: Of all that is random; default: 0.
        duration: Of each motion against MuJoCo [s]; default: 1.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration, such as ``robot_model``, ``custom_robots``; with any of
            them, the functions of that robot are checked against each other, and a described
            machine is held against MuJoCo's or Pinocchio's model of its file, where it is
            installed; or, with `robots`, random variants of it move beside MuJoCo's.

    Returns:
        A pandas.DataFrame. Against MuJoCo, a row a robot: kind, number, and the largest difference
        of its poses [m] or [rad]. Of one robot, a row a check, and whether it agrees.

    Raises:
        InputError: something is wrong in the arguments; MuJoCo or pandas is not installed.
        RunError: no motion was found that stays in the workspace.
    """
    number = ROBOTS if robots is None else robots
    length = DURATION if duration is None else duration
    _check_numbers(number, seed, length)
    given = changes(param_file, values)
    if given and robots is None:
        if duration is not None:
            what = '--set checks one robot without MuJoCo: no --duration without --robots'
            raise InputError(what)
        file = machine_file(merged(layers(param_file, values)))
        beside = verify_file(given, file, seed) if file else ('', [])
        return RobotChecks(*verify_robot(given, seed), file, *beside)
    kinds: dict[str, Callable[..., list[Difference]]]
    if given:
        kinds = {name_of(given): partial(verify_machine, given)}
    else:
        kinds = {kind: partial(verify_kind, kind) for kind in SCENARIOS}
    found = {
        kind: compared(tracked(range(number), number, kind), seed, length)
        for kind, compared in kinds.items()
    }
    return AgainstMujoco(found, length)
