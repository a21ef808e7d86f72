"""From a configuration to the desired motion of its robot."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config, fields, points
from parallel_robot_model.configuration.config import Modules
from parallel_robot_model.configuration.fields import (
    Declared,
    Field,
    check,
    declared_in,
    grouped,
)
from parallel_robot_model.configuration.loop import DURATION
from parallel_robot_model.configuration.plain_data import (
    LocatedDict,
    locations_of,
    merged,
    with_location,
)
from parallel_robot_model.robots import registry
from parallel_robot_model.robots.contract import Robot
from parallel_robot_model.robots.registry import RobotConfiguration, RobotModel
from trajectory_gen import hold, waypoints
from trajectory_gen.joint_path import as_poses
from trajectory_gen.shapes import SHAPES, Shape, custom_trajectories, shapes
from trajectory_gen.trajectory import Trajectory, TrajectoryParameters

OF_FILE = (points.POINTS_FILE, points.THINNED, points.COLUMNS, points.UNITS)
FIXED = ('trajectory.lookahead', *OF_FILE)  # at the start
INITIAL = 'plant.initial_pose'
QUATERNIONS = 'quaternions'


class MotionConfiguration(RobotConfiguration):
    """The desired motion of a robot, and all to which it can be changed."""

    motion = grouped('trajectory', TrajectoryParameters)

    @cached_property
    def shapes(self) -> Mapping[str, Shape]:
        """All shapes by name."""
        with with_location(self.values):
            return shapes(self.loop.custom_trajectories)

    @cached_property
    def here(self) -> Sequence[Any]:
        """Pose in which the robot is, for `hold`; at first the initial one of the plant."""
        pose: Sequence[Any] = self.values.get(INITIAL, ())
        return pose

    @property
    def limits(self) -> Any:
        """MotionLimits of the robot."""
        return self.at('trajectory', self.module.MotionLimits)

    @cached_property
    def trajectory(self) -> Trajectory:
        """The desired motion.

        Raises:
            UnknownNameError: no such shape.
            InputError: the shape refuses its parameters, or does not suit the robot.
        """
        with with_location(self.values):
            name, robot, known = self.motion.shape, self.robot, self.shapes
            if name not in known:
                raise UnknownNameError('trajectory.shape', name, known, 'trajectory.shape')
            shape: Any = known[name]  # a module, which is hashable
            given = self.placed(name, self.here)
            joints = getattr(given, 'space', '') == 'joints'
            near = robot.pose_of(INITIAL, self.here) if joints else ()
            return _trajectory(robot, self.motion, self.limits, shape, given, near)

    def at_pose(self, here: Sequence[Any]) -> MotionConfiguration:
        """The same of a robot that is in another pose."""
        motions = self.with_parts(here=here)
        motions.__dict__.pop('trajectory', None)
        return motions

    def parameters_of(self, name: str) -> Any:
        """Parameters of a shape."""
        return self.at(name, self.shapes[name].Parameters)

    def placed(self, name: str, here: Sequence[Any]) -> Any:
        """Parameters of a shape of the robot that is in the pose `here`."""
        given = self.parameters_of(name)
        if name == 'hold' and not given.pose:
            given = hold.Parameters(self.robot.pose_of(INITIAL, here))
        if getattr(given, 'space', '') == QUATERNIONS:
            given = given._replace(points=as_poses(self.robot, given.points), space='pose')
        return given

    @property
    def inputs(self) -> tuple[Any, ...]:
        """The values on which the desired motion depends."""
        own = self.motion
        return (
            own._replace(lookahead=0.0, transition=0.0),
            self.limits,
            self.parameters_of(own.shape),
        )

    def check_motion(self) -> None:
        """Find what is wrong in the parameters of the motion, even of shapes that are not used.

        Raises:
            InputError: a value is wrong.
        """
        robot = self.robot  # at first the number of its joints
        self.check(declared(robot.module, self.shapes))
        with with_location(self.values):
            check_columns(self.values, robot)

    def load_kernels(self) -> None:
        """Load the machine code of all motions, which would hold up a loop that runs.

        Those that this robot cannot perform, or not with their present parameters, are left out.
        """
        own = self.trajectory
        still = np.zeros((1, 6, self.robot.pose_size))
        still[0, -1] = own.first_pose
        own.along(waypoints.Spline(np.array([0.0, 1.0]), still, False)).sample(0.0)
        for name, shape in self.shapes.items():
            parameters = own.parameters._replace(shape=name)
            with contextlib.suppress(InputError):
                given = self.placed(name, own.first_pose)
                Trajectory(self.robot, parameters, own.limits, shape, given).sample(0.0)


def of_shapes(shapes: Mapping[str, Shape]) -> Declared:
    """Groups of some shapes."""
    for name, shape in shapes.items():
        yield name, shape.Parameters


def declared(robot: Robot, shapes: Mapping[str, Shape]) -> Declared:
    """Groups of the motion and of all its shapes."""
    yield from declared_in(MotionConfiguration)
    yield 'trajectory', robot.MotionLimits
    yield from of_shapes(shapes)


def motions_of(values: Mapping[str, Any]) -> MotionConfiguration:
    """The desired motion of a resolved configuration, and all to which it can be changed.

    Raises:
        InputError: a value is wrong, even one of a shape that is not used.
    """
    motions = MotionConfiguration(values)
    motions.check_motion()
    return motions


def trajectory_of(values: Mapping[str, Any]) -> Trajectory:
    """The desired motion of a resolved configuration.

    Raises:
        InputError: a value is wrong, even one of a shape that is not used.
    """
    return motions_of(values).trajectory


def check_columns(values: Mapping[str, Any], robot: RobotModel) -> None:
    """Refuse points of a file that are poses of another kind of robot.

    Args:
        values: A resolved configuration.
        robot: The robot that is to follow the points.

    Raises:
        InputError: they are.
    """
    place = locations_of(values).get(points.POINTS)
    if place is None or not place.columns or values['trajectory.shape'] != 'waypoints':
        return
    module, columns = robot.module, place.columns
    axes = module.coordinates(robot.parameters)
    own = columns == tuple(axis.name for axis in axes)
    plane = columns in (points.PLANE, points.PLANE[:2])
    other = points.is_joint(columns[0]) or columns[-1] == points.QUATERNION[-1]
    if own or other or (plane and (robot.axes == ('x', 'y') or len(columns) != len(axes))):
        return  # or it is told elsewhere
    names = ', '.join(f'{axis.name} [{axis.unit}]' for axis in axes)
    kind = 'a place in a plane' if plane else 'of another robot'
    raise InputError(
        f'{points.POINTS_FILE}: columns {", ".join(columns)} are {kind}; a point must '
        f'be a pose of {robot.name}, {names}',
        points.POINTS,
    )


def changed(motions: MotionConfiguration, values: Mapping[str, Any]) -> MotionConfiguration:
    """The same motions with other parameters.

    Args:
        motions: The motions.
        values: All keys of the groups of :func:`declared`.

    Raises:
        UnknownNameError: no such shape.
        InputError: a value is wrong, or a list of a custom trajectory has another length, for
            which it would have to be compiled.
    """
    same = {key: getattr(motions, key) for key in ('loop', 'module', 'robot', 'shapes', 'here')}
    made = MotionConfiguration({**motions.values, **values}).with_parts(**same)
    made.check(declared(made.module, made.shapes))
    for name in motions.shapes.keys() - SHAPES.keys():
        if _lengths(made.parameters_of(name)) != _lengths(motions.parameters_of(name)):
            raise InputError(f'the lists of {name} keep their lengths while the node runs', name)
    return made


def settings(motions: MotionConfiguration) -> Iterator[tuple[str, Any]]:
    """Keys and plain values of what can change while the motion is performed.

    Not when its samples are sent, nor the file of points, which is read at the start alone.
    """
    for prefix, kind in declared(motions.module, motions.shapes):
        for parameter, value in zip(
            fields.parameters(kind), motions.at(prefix, kind), strict=True
        ):
            key = f'{prefix}.{parameter.key}'
            if key not in FIXED:
                yield key, fields.plain(value)


def _lengths(given: Any) -> list[int]:
    return [len(value) if isinstance(value, tuple) else 0 for value in given]


@functools.lru_cache(maxsize=4)  # the runs of a study share them
def _trajectory(*given: Any) -> Trajectory:
    return Trajectory(*given)


def load(values: Mapping[str, Any]) -> Modules:
    """Load the custom robots and trajectories that a configuration, or a change of one, names.

    Raises:
        InputError: one cannot be loaded.
    """
    loaded = registry.load_robots(values)
    shapes = custom_trajectories(config.module_files(values, 'custom_trajectories'))
    return loaded._replace(
        shapes={name: fields.defaults(one.Parameters, f'{name}.') for name, one in shapes.items()}
    )


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A configuration with the defaults of custom robot and trajectories; see `config.resolve`.

    Gains of custom laws are left as they are: their files are not loaded.
    """
    return config.resolve(scenario, overrides, load(overrides or {}))


# How long a run is: as configured, else as long as its motion, else some turns.

KEY = 'duration'


def with_duration(
    scenario: str, changed: Mapping[str, Any], hold: float | None = None
) -> LocatedDict:
    """Changes of a scenario that say how long its run is.

    Args:
        scenario: Name of a scenario, or the path of its file.
        changed: Key to value; where it has a duration, that counts.
        hold: Time for which the robot is held where its motion ended [s]; None: it is not asked
            for.

    Returns:
        The changes. Where neither they nor the scenario say how long the run is, it is as long as
        its motion, in whole periods, or DURATION where the motion has no end.

    Raises:
        InputError: a value is wrong, or the motion that is to be followed by a hold has no end.
    """
    given = KEY in changed or bool(config.scenario_values(scenario).get(KEY))
    if hold is None and given:
        return merged([changed])
    values = resolve(scenario, changed)
    end = trajectory_of(values).end
    if hold is None:
        duration = DURATION if end is None else end
    else:
        hold = check('hold', float, Field('s', '', 0.0), hold)
        if KEY in changed:
            raise InputError(
                'hold and duration exclude each other: hold is from the end of the motion on'
            )
        if end is None:
            raise InputError('hold is for a motion that comes to an end; this one has none')
        duration = end + hold
    period = float(values['period'])
    samples = max(1, math.ceil(duration / period - 1e-6))
    return merged([{KEY: round(samples * period, 9)}, changed])
