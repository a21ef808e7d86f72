"""The attributes of a robot, for a machine that a description tells."""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Mapping
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError, RobotError, optional, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.config_files import flat
from parallel_robot_model.configuration.fields import PerLink
from parallel_robot_model.mechanisms import spatial
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.description.compiled import (
    SAME,
    difference,
    numbers_of,
    written,
)
from parallel_robot_model.mechanisms.description.machine import (
    Machine,
    checked,
    machine,
    parsed,
    read,
)
from parallel_robot_model.mechanisms.description.parts import Description
from parallel_robot_model.mechanisms.margins import flood_fill
from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism
from parallel_robot_model.mechanisms.pose_solving import solve_pose
from parallel_robot_model.mechanisms.skeleton import drawn, positions_of
from parallel_robot_model.mechanisms.tool import tool_pose
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.contract import (
    FOUND,
    Coordinate,
    Geometry,
    Infeasible,
    Margin,
    Reach,
    Robot,
    first_sample,
    place_of,
)
from parallel_robot_model.robots.described import kernels, parameters
from parallel_robot_model.robots.described.default_values import (
    choices,
    coordinates_of,
    defaults_of,
)
from parallel_robot_model.robots.described.kernels import Constants, constants
from parallel_robot_model.robots.described.linear_machine import LinearMachine
from parallel_robot_model.robots.described.masses import possible, weighing
from parallel_robot_model.robots.described.parameters import MotionLimits, Parameters
from parallel_robot_model.robots.described.shifting import loops, pose_slopes, shifted
from parallel_robot_model.robots.described.tree import DescribedTree

LINES = 'link'  # name of the only part of its picture
TOO_NEAR = (  # a key of MotionLimits, and what is below it
    ('min_closure', 'type 2 singularity, {} of the closure margin at home'),
    ('min_tool', 'type 1 singularity, {} of the tool margin at home'),
    ('min_travel', 'end of travel of a passive joint or a tendon, {} left'),
)
SIZES = {'mass_factor': 1, 'spread_factor': 3, 'centre_shift': 3, 'inertia_shift': 6}  # of a link


class DescribedRobot(Robot):
    """A machine as a robot."""

    FAULTS = parameters.FAULTS
    NO_POSE = parameters.NO_POSE
    PARTS = ('joint', 'machine')
    PLANAR = False  # it depends on the tool, see `planar`
    OWN_MEMORY = True  # whoever has its constants has a memory of his own

    joint_motion = staticmethod(kernels.joint_motion)
    locate = staticmethod(kernels.locate)
    estimate = staticmethod(kernels.estimate)
    estimate_coarse = staticmethod(kernels.estimate_coarse)
    acceleration = staticmethod(kernels.acceleration)
    measure = staticmethod(kernels.measure)

    def __init__(self, text: str, compiled: str = '') -> None:
        """Take the text of a description, and the numbers that its compiler made of it."""
        self.text, self.compiled = text, compiled
        self.Parameters: Any = Parameters
        self.SafetyMargins: Any = parameters.SafetyMargins
        self.MotionLimits: Any = MotionLimits
        self.tree = DescribedTree(self)
        self.linear_model = LinearMachine(self.machine, self.mechanism)

    @property
    def description(self) -> Description:
        """What its text says."""
        return description_of(self.text, self.compiled)

    def machine(self, robot: Parameters) -> Machine:
        """The machine with what is chosen of it, its numbers those of the file."""
        return _machine(self.text, self.compiled, *robot[: robot._fields.index('held') + 1])

    def mechanism(self, robot: Parameters) -> Mechanism:
        """The machine with its numbers as the parameters have them.

        Raises:
            RobotError: its loops do not close.
        """
        of_file = self.machine(robot).mechanism
        return shifted(weighing(of_file, robot), robot.shift)

    def placed(self, robot: Parameters) -> Mechanism:
        """The machine with the joints where the parameters have them, masses as in the file.

        Raises:
            RobotError: its loops do not close.
        """
        return shifted(self.machine(robot).mechanism, robot.shift)

    def validate(self, robot: Parameters, name: str = 'robot') -> Parameters:
        """Return `robot`, one factor a link, if such a machine can be built.

        Raises:
            RobotError: it cannot.
        """
        made = self.machine(robot)
        for low, high, joint in zip(robot.lower, robot.upper, made.actuated, strict=True):
            if not low < high:
                what = f'{name}.lower must be below {name}.upper, not {low:g} and {high:g}'
                raise InputError(f'{what} ({joint})', f'{name}.lower')
        if isinstance(robot.mass_factor, float):  # one for all links
            robot = robot._replace(mass_factor=PerLink((robot.mass_factor,) * len(made.names)))
        for key, each in SIZES.items():
            given, count = len(getattr(robot, key)), each * len(made.names)
            if given != count:
                what = f'{name}.{key} must be {count} numbers, {each} for each of its links'
                what = what.replace('must be', 'must be a number or', each == 1)
                raise InputError(f'{what}, not {given}', f'{name}.{key}')
        given, count = len(robot.shift), len(self.geometry(robot).names)
        if given != count:
            what = f'{name}.shift must be {count} numbers, 3 for each joint and each end of a loop'
            raise InputError(f'{what}, not {given}', f'{name}.shift')
        for link in np.flatnonzero(~possible(made.mechanism, robot)):
            what = f'{name}.inertia_shift: no body has such moments of inertia'
            raise RobotError(f'{what} ({printable(made.names[link])})', f'{name}.inertia_shift')
        self.mechanism(robot)
        return robot

    def joints(self, robot: Parameters) -> int:
        """Number of the actuated joints, n."""
        return len(self.machine(robot).actuated)

    def units(self, robot: Parameters) -> tuple[str, ...]:
        """Units of the actuated joints, rad or m."""
        return self.machine(robot).units

    def coordinates(self, robot: Parameters) -> tuple[Coordinate, ...]:
        """Coordinates of the tool, or the actuated joints."""
        return tuple(Coordinate(*each) for each in coordinates_of(self.machine(robot)))

    def planar(self, robot: Parameters) -> bool:
        """Whether the tool moves in a plane of two of x, y and z."""
        return self.machine(robot).planar

    def parameter_warnings(self, robot: Parameters) -> tuple[str, ...]:
        """What its file says and what is left out of it, or is doubtful, a line each."""
        return self.machine(robot).warnings

    def orientations(self, robot: Parameters, poses: Array) -> Array:
        """Quaternions x, y, z, w of the tool at poses, shapes (N, 4) and (N, m)."""
        mechanism = self.machine(robot).mechanism
        vectors = np.zeros((len(poses), 3))
        for k, coordinate in enumerate(mechanism.coordinate):
            if coordinate >= 3:
                vectors[:, coordinate - 3] = poses[:, k]
        home = spatial.quaternion_of_matrix(mechanism.tool_home)
        return spatial.quaternion_product(spatial.quaternions_of_vectors(vectors), home)

    def geometry(self, robot: Parameters) -> Geometry:
        """Where its joints lie, and where its loops close."""
        made = self.machine(robot)
        places = [printable(joint) for joint in made.names]
        for number, rows in enumerate(loops(made.mechanism), 1):
            for end in (made.mechanism.first, made.mechanism.second):
                link = 'base' if end[rows[0]] == BASE else printable(made.names[end[rows[0]]])
                places.append(f'loop {number} on {link}')
        return Geometry(
            'shift', tuple(f'{place} {axis}' for place in places for axis in 'xyz'), 'm'
        )

    def pose_slopes(self, robot: Parameters, position: Array, pose: Array) -> Array:
        """Derivatives of the pose, see :func:`pose_slopes`."""
        return pose_slopes(self.mechanism(robot), position, pose)

    def constants(self, robot: Parameters) -> Constants:
        """The arrays of the machine, with a new memory at home."""
        return constants(self.mechanism(robot), robot.lower, robot.upper)

    def start(self, robot: Parameters, pose: Array) -> Array:
        """Actuated joints at a pose, each shape (n,).

        Raises:
            InputError: it is out of reach.
        """
        return self.posture(robot, pose)[self.machine(robot).mechanism.actuated]

    def posture(self, robot: Parameters, pose: Array) -> Array:
        """All joints at a pose, shape (N,).

        Raises:
            InputError: it is out of reach.
        """
        mechanism, made = boxed(self.mechanism(robot))
        wanted = np.ascontiguousarray(pose, np.float64)
        if solve_pose(mechanism, made, wanted) != FOUND:
            what = f'{pose.tolist()} is out of reach from home'
            raise InputError(f'plant.initial_pose {what}', 'plant.initial_pose')
        return np.array(made.all)

    def home(self, robot: Parameters) -> Array:
        """The pose at home, shape (m,)."""
        mechanism, made = boxed(self.mechanism(robot))
        pose = np.zeros(len(made.q))
        close(mechanism, made, made.q.copy())
        tool_pose(mechanism, made, pose)
        return pose

    def trace(self, robot: Parameters, poses: Array, first: tuple[int, int]) -> Reach:
        """What of a grid of poses it reaches within its travel, in the modes of home.

        Args:
            robot: The machine.
            poses: Poses [m, rad], shape (rows, columns, m).
            first: Row and column of the one to which it comes straight from home.
        """
        constants = self.constants(robot)
        shape = poses.shape[:2]
        joints = len(constants.mechanism.parent)
        found = np.full((*shape, 3), np.nan)
        postures, queue = np.empty((*shape, joints + 1)), np.empty(shape[0] * shape[1], np.int64)
        grid = np.ascontiguousarray(poses, np.float64)
        machine, made = constants.mechanism, constants.workspace
        flood_fill(machine, made, grid, constants.travel, first, postures, found, queue)
        closure, of_tool = np.moveaxis(found[..., :2] / constants.home, -1, 0)
        margins = [
            Margin('min_closure', 'closure margin, share of that at home (type 2)', closure),
            Margin('min_tool', 'tool margin, share of that at home (type 1)', of_tool),
        ]
        if not len(machine.passive):
            margins.pop(0)
        return Reach(tuple(margins), found[..., 2])

    def infeasible(
        self, robot: Parameters, limits: MotionLimits, reference: Any
    ) -> list[Infeasible]:
        """First samples of a motion out of reach, near a singularity or an end of travel."""
        unreached = np.flatnonzero(reference.out_of_reach >= 0)
        reached = slice(0, int(unreached[0]) if unreached.size else None)
        failures = [
            first_sample(values < least, values, f'{what} is below trajectory.{key}, {{}}', least)
            for (key, what), values, least in zip(
                TOO_NEAR, reference.passive[reached].T, limits, strict=True
            )
        ]
        failures.insert(2, self._at_an_end(robot, limits.min_travel, reference.position[reached]))
        if unreached.size:
            failures.append(Infeasible(int(unreached[0]), None, 'out of reach'))
        return [failure for failure in failures if failure is not None]

    def _at_an_end(self, robot: Parameters, least: float, position: Array) -> Infeasible | None:
        """First sample too near to an end of travel; names a home that is so already."""
        lower, upper = np.array(robot.lower), np.array(robot.upper)
        left = np.minimum(position - lower, upper - position)
        text = 'end of travel, {} left is below trajectory.min_travel, {}'
        found = first_sample(left < least, left, text, least)
        if found is None or found.part is None:
            return found
        machine, j = self.machine(robot), found.part - 1
        home = machine.mechanism.home[machine.mechanism.actuated[j]]
        if position[found.sample, j] - lower[j] < upper[j] - position[found.sample, j]:
            room = home - lower[j]
        else:
            room = upper[j] - home
        if room > least:
            return found
        what = f'{machine.actuated[j]} is at {home:.4g}, its travel from {lower[j]:.4g} to'
        return found._replace(
            reason=f'{found.reason}; at home {printable(what)} {upper[j]:.4g}: choose robot.home'
        )

    def segments(self, robot: Parameters, pose: Array, position: Array) -> dict[str, Array]:
        """Lines from joint to joint and to the tool, each posture found from the one before.

        NaN where no loop closes; nothing of a machine whose tool has no place.
        """
        place = place_of(self.coordinates(robot), self.planar(robot))
        if not place:
            return {}
        mechanism = self.placed(robot)
        rows = np.reshape(position, (-1, position.shape[-1]))
        ends = drawn(mechanism, positions_of(mechanism, rows)[0])
        ends = ends[..., mechanism.coordinate[:place]]
        return {LINES: ends.reshape(*position.shape[:-1], *ends.shape[1:])}


@functools.lru_cache(maxsize=8)
def described(text: str, compiled: str = '') -> DescribedRobot:
    """The robot of a description, with the numbers of its compiler."""
    return DescribedRobot(text, compiled)


def default_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults that a description gives, by key.

    Args:
        values: What else is asked for: the text in ``robot_description``, its compiled numbers
            in ``robot_compiled``, and of ``robot.*`` what is chosen.
    """
    text, compiled = values['robot_description'], str(values.get('robot_compiled', ''))
    found = flat(_defaults(text, compiled, *choices(values).items()))
    return found | {'robot_compiled': compiled_of(text, compiled)}


@functools.lru_cache(maxsize=8)
def description_of(text: str, compiled: str = '') -> Description:
    """A description, read once, of the numbers that its compiler made of it if they are known."""
    known = numbers_of(compiled, text, 'description')
    return read(text) if known is None else checked(known)


@functools.lru_cache(maxsize=8)
def compiled_of(text: str, compiled: str = '') -> str:
    """The numbers that MuJoCo makes of MJCF, see `mechanisms.description.compiled`.

    Args:
        text: The text of a description.
        compiled: Its numbers, if they are known; those of another text do not count.

    Returns:
        Empty for a format that needs no compiler.
    """
    if numbers_of(compiled, text, 'description') is not None:
        return compiled
    if parsed(text, 'description')[0].tag != 'mujoco':
        return ''
    return written(text, f'MuJoCo {optional("mujoco").__version__}', description_of(text))


def compiler_warning(text: str, compiled: str) -> str:
    """That MuJoCo makes other numbers of a text than stand beside it; empty if it is not here."""
    known = numbers_of(compiled, text, 'description')
    if known is None or importlib.util.find_spec('mujoco') is None:
        return ''
    apart = difference(known, read(text))
    if apart <= SAME:
        return ''
    ours = f'MuJoCo {optional("mujoco").__version__}'
    return f'{ours} makes other numbers of the description than stand beside it, by {apart:.1e}'


@functools.lru_cache(maxsize=64)  # a sweep resolves thousands of configurations
def _defaults(text: str, compiled: str, *chosen: tuple[str, Any]) -> dict[str, Any]:
    """Defaults in groups, of a machine of which something is chosen."""
    return defaults_of(_machine(text, compiled, *(value for _, value in chosen)), dict(chosen))


@functools.lru_cache(maxsize=64)
def _machine(
    text: str,
    compiled: str,
    actuated: tuple[str, ...],
    tool: str,
    home: str,
    held: tuple[str, ...],
) -> Machine:
    """The machine of a description, with what is chosen of it."""
    return machine(
        description_of(text, compiled),
        actuated=actuated,
        tool=tool,
        home=home,
        held=held,
    )
