"""What a robot provides to the rest of the suite: the interface between machine and suite.

A robot is a module, or a package, with what :class:`RobotModule` has and, if need be, what
:class:`Robot` has defaults for. Its kernels take its ``constants`` and vectors (see
:mod:`parallel_robot_model.compiler`), whose size is known when they are compiled; n is the number
of its actuated joints, m that of the coordinates of its pose. Of all this, the laws see only the
:class:`Model`.

The plant integrates coordinates that the robot chooses: minimal ones, in which its equations
of motion are simplest. Those of the 3-RRR robot are its pose, those of a serial arm its joints.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.errors import distinct_texts
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, multiply
from parallel_robot_model.robots.joint_load import JointLoad

# Which sample of a motion a robot cannot perform.


class Infeasible(NamedTuple):
    """The first sample of a motion that the robot cannot perform.

    Attributes:
        sample: Index of the sample.
        part: Number of the leg or joint that fails, 1-based; None if it is the whole robot.
        reason: The reason, for people.
    """

    sample: int
    part: int | None
    reason: str


def first_sample(
    bad: NDArray[np.bool_], values: Array, text: str, limit: float | None = None
) -> Infeasible | None:
    """The first sample that is bad; None if all are good.

    Args:
        bad: Which samples are bad, shape (N,), or (N, n) with a column for each leg or joint.
        values: Values for the text, same shape.
        text: The reason, with a placeholder for the value, and one for the limit if there is one.
        limit: What the value is compared with; both get digits enough to differ.
    """
    if not bad.any():
        return None
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    part = index[1] + 1 if len(index) == 2 else None
    value = float(values[index])
    shown = (value,) if limit is None else distinct_texts(value, limit)
    return Infeasible(index[0], part, text.format(*shown))


FOUND = 0  # no fault: there is a pose, and no margin is violated
REACHED = -1  # no part of the robot is out of reach


class Model(NamedTuple):
    """Equations of motion in the actuated joints at one state: M thdd + Q thd + gravity = tau.

    Attributes:
        M: Inertia matrix [kg m^2], shape (n, n).
        Q: Coriolis and centrifugal matrix [kg m^2/s], shape (n, n); Mdot - 2 Q is skew-symmetric.
        gravity: Torque that holds the robot against gravity [N m], shape (n,).
    """

    M: Array
    Q: Array
    gravity: Array


@kernel
def inverse_dynamics(model: Model, acceleration: Array, velocity: Array) -> Array:
    """Torque for an acceleration at a velocity: M a + Q v + gravity [N m], shape (n,)."""
    return multiply(model.M, acceleration) + multiply(model.Q, velocity) + model.gravity


@kernel
def no_model(template: Model) -> Model:
    """The placeholder for a model in a fault: zeros."""
    return Model(
        np.zeros_like(template.M), np.zeros_like(template.Q), np.zeros_like(template.gravity)
    )


class PoseMotion(NamedTuple):
    """Pose with two derivatives at one time, each shape (m,)."""

    pose: Array
    rate: Array
    acceleration: Array


class JointMotion(NamedTuple):
    """Joints with two derivatives at one time.

    Attributes:
        position: Actuated joints [rad], shape (n,); NaN where the robot does not reach.
        velocity: Their rates [rad/s], shape (n,).
        acceleration: Their accelerations [rad/s^2], shape (n,).
        passive: Other angles of the posture, for checks and pictures, shape (p,).
        out_of_reach: 0-based index of the first part that does not reach, else REACHED.
    """

    position: Array
    velocity: Array
    acceleration: Array
    passive: Array
    out_of_reach: int


class Location(NamedTuple):
    """Pose by the forward kinematics, shape (m,), and FOUND or the fault if there is no pose."""

    pose: Array
    fault: int


class Estimate(NamedTuple):
    """What the controller knows of the robot from its joints.

    Attributes:
        fault: FOUND or a key of the robot's FAULTS: no pose fits, or a margin is violated.
        pose: Pose, shape (m,); the guess if none was found.
        model: Equations of motion; zero in a fault.
    """

    fault: int
    pose: Array
    model: Model


class Measurement(NamedTuple):
    """Joints and pose of the true robot at one state.

    Attributes:
        position: Actuated joints [rad], shape (n,).
        velocity: Their rates [rad/s], shape (n,).
        passive_position: Passive joints [rad], shape (p,).
        passive_velocity: Their rates [rad/s], shape (p,).
        pose: Pose, shape (m,).
    """

    position: Array
    velocity: Array
    passive_position: Array
    passive_velocity: Array
    pose: Array


class Margin(NamedTuple):
    """A distance from singularities at many poses.

    Attributes:
        key: Name of the limit that it has in SafetyMargins.
        label: What it is, for pictures.
        values: Zero at a singularity, and where the sign is another, another mode; NaN where the
            robot does not get. Any shape.
    """

    key: str
    label: str
    values: Array


class Reach(NamedTuple):
    """What of a grid of poses a robot reaches from one of them.

    Attributes:
        margins: Of all poses to which a posture is known, shape (rows, columns) each.
        left: Travel left of the joint that has least, negative beyond its end, the same shape.
    """

    margins: tuple[Margin, ...]
    travel_left: Array


class Fault(NamedTuple):
    """A fault of a robot: a code for bags, which never changes, and a text for people."""

    key: str
    text: str


class Coordinate(NamedTuple):
    """A coordinate of the pose: its name and its unit."""

    name: str
    unit: str


class Geometry(NamedTuple):
    """Numbers of a robot's parameters by which its pose can be differentiated.

    Attributes:
        key: The parameter that holds them.
        names: What each of them is of.
        unit: Their unit.
    """

    key: str
    names: tuple[str, ...]
    unit: str


def place_of(axes: Sequence[Coordinate], planar: bool) -> int:
    """Number of the first coordinates of a pose that are the place of the end effector.

    Args:
        axes: Coordinates of the pose.
        planar: Whether it is a place in a plane, see PLANAR.
    """
    if planar:
        return len('xy')
    return len('xyz') if [axis.name for axis in axes[:3]] == ['x', 'y', 'z'] else 0


class RobotModule(Protocol):
    """What every robot module has.

    Attributes:
        Parameters: NamedTuple of the parameters ``robot.*``, nominal, and ``true_robot.*``.
        SafetyMargins: NamedTuple of the parameters ``safety.*`` that only this robot has:
            limits beyond which there is a fault.
        MotionLimits: NamedTuple of the parameters ``trajectory.*`` that only this robot has:
            limits of a reference motion.
        FAULTS: Faults of this robot by number, 1 to 9.
        PARTS: Names of what one joint moves and of the whole, e.g. ``('leg', 'platform')``.
        PLANAR: Whether its pose begins with x and y [m] in a plane and perhaps the angle phi
            [rad], or with x, z or y, z and the angle about the third axis, so that it can be
            shown and its error is a distance. A pose that begins with x, y, z [m] is one in
            space; rx, ry, rz [rad] after them are components of its rotation vector.
    """

    Parameters: Any
    SafetyMargins: Any
    MotionLimits: Any
    FAULTS: dict[int, Fault]
    PARTS: tuple[str, str]
    PLANAR: bool

    def validate(self, parameters: Any, name: str = 'robot', /) -> Any:
        """Return the parameters if such a robot can be built; else raise RobotError."""

    def joints(self, parameters: Any, /) -> int:
        """Number of the actuated joints, n."""

    def coordinates(self, parameters: Any, /) -> tuple[Coordinate, ...]:
        """Coordinates of the pose."""

    def start(self, parameters: Any, pose: Array, /) -> Array:
        """Coordinates of the plant at a pose; raises InputError where it is out of reach."""

    def joint_motion(self, parameters: Any, motion: PoseMotion, /) -> JointMotion:
        """Kernel: joints with two derivatives at a pose with two derivatives."""

    def locate(self, parameters: Any, position: Array, guess: Array, /) -> Location:
        """Kernel: pose at joint positions, near a guess."""

    def estimate(
        self,
        parameters: Any,
        margins: Any,
        position: Array,
        velocity: Array,
        guess: Array,
        /,
    ) -> Estimate:
        """Kernel: pose, margins and model at a joint state; `guess` is a pose near it."""

    def acceleration(
        self,
        parameters: Any,
        load: JointLoad,
        coordinates: Array,
        rate: Array,
        torque: Array,
        time: float,
        /,
    ) -> Array:
        """Kernel: second derivative of the plant's coordinates under motor torques [N m]."""

    def measure(self, parameters: Any, coordinates: Array, rate: Array, /) -> Measurement:
        """Kernel: joints and pose at coordinates of the plant."""

    def infeasible(self, parameters: Any, limits: Any, reference: Any, /) -> list[Infeasible]:
        """Samples of a reference that MotionLimits forbid or that are out of reach."""

    def segments(self, parameters: Any, pose: Array, position: Array, /) -> dict[str, Array]:
        """Straight lines of a picture by the name of their part.

        Args:
            parameters: The robot.
            pose: Pose, shape (..., m).
            position: Actuated joints, shape (..., n).

        Returns:
            Ends of the lines [m], shape (..., lines, 2, 2), in space (..., lines, 2, 3); empty for
            a robot without a picture.
        """


class Robot(RobotModule):
    """A robot: what its module defines, and defaults for what it leaves out."""

    DEFAULTS: Mapping[str, Any] = MappingProxyType({})  # of its keys, see registry.default_values
    Constants: Any  # class of its constants; that of its parameters, if they are these
    OWN_MEMORY = False  # whether its kernels keep something there, which each user has for himself
    # FAULTS at which `estimate` has no trustworthy pose; without it all of them, or none where the
    # pose does not depend on the guess
    NO_POSE: Collection[int] | None = None
    estimate_coarse: (
        Any  # kernel as `estimate`, which may be less exact, for states that are only predicted
    )
    tree: Any = None  # its links, see tree.py
    linear_model: LinearModel | None = None
    # of parameters and poses: quaternions of the end effector of a robot in space
    orientations: Callable[[Any, Array], Array] | None = None
    # what of a grid of poses, shape (rows, columns, m), it reaches from one of them, where joints
    # of a pose depend on the way
    trace: Callable[[Any, Array, tuple[int, int]], Reach] | None = None
    # of parameters, joints and poses: derivatives of the poses by the actuated joints, then by the
    # numbers of `geometry`, shape (N, m, ...)
    pose_slopes: Callable[[Any, Array, Array], Array] | None = None
    geometry: Callable[[Any], Geometry] | None = None

    @classmethod
    def of(cls, module: RobotModule) -> Robot:
        """The robot of a module."""
        robot, instead = (
            cls(),
            {'Constants': module.Parameters, 'estimate_coarse': module.estimate},
        )
        vars(robot).update(instead | vars(module))
        return robot

    def constants(self, parameters: Any, /) -> Any:
        """What its kernels take: all that follows from the parameters alone."""
        return parameters

    def planar(self, parameters: Any, /) -> bool:
        """PLANAR, of a robot where it depends on the parameters."""
        return self.PLANAR

    def units(self, parameters: Any, /) -> tuple[str, ...]:
        """Unit of each actuated joint, 'rad' or 'm'; empty if all are rad."""
        return ()

    def parameter_warnings(self, parameters: Any, /) -> tuple[str, ...]:
        """What is doubtful in its file, lines of text."""
        return ()

    def margins(self, parameters: Any, reference: Any, /) -> tuple[Margin, ...]:
        """Distances from singularities along a motion."""
        return ()

    def home(self, parameters: Any, /) -> Array | None:
        """The pose from which motions are traced, if `trace` needs one."""
        return None

    def pose_with(self, parameters: Any, position: Array, passive: Array, /) -> Array:
        """The pose at all measured joints, shape (m,); NaN where they contradict each other."""
        return np.array([np.nan])


# By how much an end effector in space is turned from where it should be.

PLACE = ('x', 'y', 'z')
VECTOR = ('rx', 'ry', 'rz')  # components of a rotation vector in the world


def rotation_components_of(coordinates: Sequence[Coordinate]) -> tuple[int, ...]:
    """Components of the rotation vector, 0 to 2, that follow the place in a pose in space."""
    names = tuple(axis.name for axis in coordinates)
    if names[:3] != PLACE or not {*names[3:]} <= {*VECTOR}:
        return ()
    return tuple(VECTOR.index(name) for name in names[3:])


def angles_between(actual: Array, reference: Array, components: Sequence[int]) -> Array:
    """Angles of the rotations from some poses to others [rad], shape (N,).

    Args:
        actual: Poses in space, shape (N, m).
        reference: Other ones, shape (N, m).
        components: See :func:`rotation_components_of`; NaN if there are none.
    """
    if not components:
        return np.full(len(actual), np.nan)
    (u, p), (v, q) = (_quaternions(poses, components) for poses in (actual, reference))
    apart = p * v - q * u - np.cross(u, v)
    alike = np.abs(p * q + np.sum(u * v, axis=1, keepdims=True))[:, 0]
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(apart, axis=1), alike))


def _quaternions(poses: Array, components: Sequence[int]) -> tuple[Array, Array]:
    """Vectors, shape (N, 3), and scalars, shape (N, 1), of the rotations of poses."""
    vectors = np.zeros((len(poses), 3))
    vectors[:, list(components)] = poses[:, len(PLACE) :]
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return 0.5 * np.sinc(half / np.pi) * vectors, np.cos(half)


# Equations of motion written as linear in their parameters: what identification needs of a robot.
#
# A robot without a ``linear_model`` of this kind cannot be identified. Its functions are NumPy.


class KnownQuantity(NamedTuple):
    """Something of a robot that its owner may know, with the range that is assumed otherwise.

    Attributes:
        low: Least value.
        high: Greatest value.
        rows: For such a range, of which one end may be infinite: rows r with r (numbers, 1) >= 0,
            shape (R, Z + 1).
    """

    low: float
    high: float
    rows: Callable[[float, float], Array]


class Bodies(NamedTuple):
    """Numbers z of a robot's bodies, in which its equations of motion are linear.

    Attributes:
        numbers: z of a robot that can be built, as near to this one as possible, shape (Z,).
        linear: p = linear z + fixed, shape (P, Z).
        fixed: Shape (P,).
        pseudo_inertias: Second moments of the mass of each body with its centre and its mass, or
            a part of them: symmetric, positive definite, linear in z, each of shape (k, k, Z).
        known: What its owner may know, by name.
    """

    numbers: Array
    linear: Array
    fixed: Array
    pseudo_inertias: tuple[Array, ...]
    known: dict[str, KnownQuantity]


def amount(row: Array, low: float = -np.inf, high: float = np.inf) -> KnownQuantity:
    """What is row z."""

    def rows(low: float, high: float) -> Array:
        ends = [np.append(sign * row, -sign * end) for sign, end in ((1.0, low), (-1.0, high))]
        return np.array(ends)[np.isfinite([low, high])]

    return KnownQuantity(low, high, rows)


def within(second: Array, first: Array, mass: Array, low: float, high: float) -> KnownQuantity:
    """Where along a line the mass of a body lies; 0 as second moment: where its centre does.

    Of a body between two places, the mean of (x - low) (high - x) is not negative.
    """

    def rows(low: float, high: float) -> Array:
        ends = [first - low * mass, high * mass - first]
        if second.any():
            ends = [(low + high) * first - second - low * high * mass]
        return np.pad(ends, ((0, 0), (0, 1)))

    return KnownQuantity(low, high, rows)


class LinearModel(Protocol):
    """M thdd + Q thd + gravity = Y(theta, thd, thdd) p, with p the parameters of the inertia.

    It may have ``sizes(robot)``, magnitudes to which errors of p are compared, shape (P,); without
    it they are those of `values`.

    Attributes:
        NAMES: Text that says what the names of p mean.
    """

    NAMES: str

    def units(self, robot: Any, /) -> dict[str, str]:
        """Names of p with their units; the later ones are regrouped into the earlier ones."""

    def values(self, robot: Any, /) -> Array:
        """p of a robot, shape (P,)."""

    def regressor(
        self, robot: Any, pose: Array, position: Array, velocity: Array, acceleration: Array, /
    ) -> Array:
        """Y at each sample; of the robot, the geometry alone counts.

        Args:
            robot: Parameters of the robot.
            pose: Poses, shape (N, m).
            position: Actuated joints [rad], shape (N, n).
            velocity: Their rates [rad/s], shape (N, n).
            acceleration: Their accelerations [rad/s^2], shape (N, n).

        Returns:
            Shape (N, n, P).
        """

    def bodies(self, robot: Any, /) -> Bodies:
        """What the robot is made of."""

    def parameters(self, robot: Any, numbers: Array, /) -> dict[str, Any]:
        """The keys of the robot on which p depends, with their values for numbers of bodies."""
