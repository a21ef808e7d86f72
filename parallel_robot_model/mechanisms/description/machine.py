"""The machine that a description describes: a mechanism, names, limits and doubts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, UnknownNameError, printable
from parallel_robot_model.mechanisms.description.assembly import (
    as_mechanism,
    assembled,
    named,
    rebased,
)
from parallel_robot_model.mechanisms.description.assembly import coordinates as coordinates_of
from parallel_robot_model.mechanisms.description.doubts import check_closed, told
from parallel_robot_model.mechanisms.description.home import (
    check_singular,
    close,
    on_grid,
    polished,
    posture,
)
from parallel_robot_model.mechanisms.description.inertia import check_felt, doubtful, merged
from parallel_robot_model.mechanisms.description.parts import BALL, Description, listed
from parallel_robot_model.mechanisms.description.tool_guess import guessed
from parallel_robot_model.mechanisms.description.tree import build, divide, followed
from parallel_robot_model.mechanisms.mechanism import HINGE, Mechanism

MOST = 200  # joints
NO_TOOL = 'robot.tool is not given; the tool taken is {}'
JOINTS_AS_POSE = (
    'the tool has not as many independent motions at home as there are actuated joints: the pose '
    'is these joints'
)


class Machine(NamedTuple):
    """A mechanism and what people call its parts.

    Attributes:
        mechanism: The value that kernels take.
        names: Of all N joints; a ball is three.
        actuated: Names of the n actuated joints.
        passive: Names of those that follow by the closures.
        held: Names of those that stay where they are at home.
        units: Of the actuated joints, ``'rad'`` or ``'m'``.
        viscous: Viscous friction of the actuated joints [N m s/rad or N s/m].
        coulomb: Their dry friction [N m or N].
        lower: Ends of their travel [rad or m]; infinite if there is none.
        upper: The others.
        effort: Their greatest torques or forces [N m or N]; infinite if there is none.
        velocity: Their greatest rates [rad/s or m/s]; infinite if there is none.
        tool: Name of the frame that is controlled.
        coordinates: Names and units of the m coordinates of the tool; empty: the pose is the
            actuated joints.
        home_moved: By how much the loops were open at the home that was asked for [m].
        doubts: What people should know of how the file was read, one line each.
    """

    mechanism: Mechanism
    names: tuple[str, ...]
    actuated: tuple[str, ...]
    passive: tuple[str, ...]
    held: tuple[str, ...]
    units: tuple[str, ...]
    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    effort: tuple[float, ...]
    velocity: tuple[float, ...]
    tool: str
    coordinates: tuple[tuple[str, str], ...]
    home_moved: float
    doubts: tuple[str, ...]


def machine(
    description: Description,
    *,
    actuated: Sequence[str] = (),
    tool: str = '',
    home: str | Mapping[str, float] = '',
    held: Sequence[str] = (),
    mass_factor: float = 1.0,
    payload: float = 0.0,
) -> Machine:
    """The machine of a description.

    Args:
        description: What a file says.
        actuated: Names of the joints that are driven; none: those that its actuators drive.
        tool: A site, body or link that is controlled; empty: what has the name of a tool, the
            platform or the end of the chain.
        home: Where it begins, see `home.posture`.
        held: Joints that do not move.
        mass_factor: By which all masses and inertias are multiplied.
        payload: A point of mass at the tool [kg].

    Raises:
        InputError: a name is unknown, the loops do not close, there are not as many actuated
            joints as freedoms, or the masses make no positive definite inertia matrix.
    """
    _check_names(description)
    at = posture(description, home)
    tree = build(description, at)
    names = tuple(link.name for link in tree.links)
    if not names:
        raise InputError(f'{description.source} has no joints that move')
    if len(names) > MOST:
        raise InputError(f'{description.source} has {len(names)} joints; {MOST} are possible')
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise InputError(f'{description.source} has several joints of the name {listed(twice)}')
    driven = _indices(names, actuated or _by_file(description), description)
    if not driven:
        raise InputError(f'{description.source}: no joint is actuated, of {listed(names)}')
    stopped = _indices(names, held, description)
    if both := sorted({*driven} & {*stopped}):
        raise InputError(f'held: {printable(names[both[0]])} is actuated')

    start = assembled(description, tree, at)
    closed = on_grid(close(start, driven, stopped), start.home)
    check_closed(description.source, start, closed)
    parts = rebased(start, closed)
    check_singular(description.source, parts, stopped)
    found = named(description, tree, tool) if tool else guessed(description, parts, driven)
    motion, closures = parts.motion_of(found.frame), parts.closures()
    freedoms = divide(description.source, names, closures, motion, driven, stopped)
    exact = polished(parts, freedoms.rows, freedoms.passive)
    parts = parts._replace(home=exact, tool=found)
    inertia = merged(description, parts.tree, mass_factor, payload, found.frame)
    check_felt(description.source, parts, freedoms, inertia)
    chosen, coordinates = coordinates_of(motion @ followed(closures, freedoms))
    links = parts.tree.links
    joints = [links[i].joint for i in freedoms.actuated]
    efforts = _efforts(description)
    return Machine(
        mechanism=as_mechanism(description, parts, freedoms, inertia, chosen),
        names=names,
        actuated=tuple(names[i] for i in freedoms.actuated),
        passive=tuple(names[i] for i in freedoms.passive),
        held=tuple(names[i] for i in freedoms.held),
        units=tuple('rad' if links[i].kind == HINGE else 'm' for i in freedoms.actuated),
        viscous=tuple(joint.viscous for joint in joints),
        coulomb=tuple(joint.coulomb for joint in joints),
        lower=tuple(-np.inf if joint.lower >= joint.upper else joint.lower for joint in joints),
        upper=tuple(np.inf if joint.lower >= joint.upper else joint.upper for joint in joints),
        effort=tuple(min(joint.effort, efforts.get(joint.name, np.inf)) for joint in joints),
        velocity=tuple(joint.velocity for joint in joints),
        tool=found.name,
        coordinates=coordinates,
        home_moved=start.distance(start.home),
        doubts=(
            *description.doubts,
            *doubtful(description, parts.tree),
            *([] if tool else [NO_TOOL.format(printable(found.name))]),
            *([] if coordinates else [JOINTS_AS_POSE]),
            *told(start, closed, parts, freedoms, stopped),
        ),
    )


def _efforts(description: Description) -> dict[str, float]:
    """Greatest torque or force of the actuators of each joint."""
    efforts: dict[str, float] = {}
    for actuator in description.actuators:
        efforts[actuator.joint] = efforts.get(actuator.joint, 0.0) + actuator.effort
    return efforts


def _by_file(description: Description) -> Sequence[str]:
    """The joints that a file actuates, or that it must mean."""
    if description.actuators:
        return tuple(dict.fromkeys(actuator.joint for actuator in description.actuators))
    following = {coupling.joint for coupling in description.couplings}
    movable = [
        joint.name
        for joint in description.joints
        if joint.kind != BALL and joint.name not in following
    ]
    if description.loops:
        raise InputError(
            f'{description.source} names no actuators: name those joints in actuated that are '
            f'driven, of {listed(movable)}'
        )
    return movable


def _indices(names: tuple[str, ...], wanted: Sequence[str], description: Description) -> list[int]:
    """Indices of joints by their names, or by those of their actuators."""
    driven = {actuator.name: actuator.joint for actuator in description.actuators}
    found = []
    for name in wanted:
        name = name if name in names else driven.get(name, name)
        if name not in names:
            raise UnknownNameError('joint', name, names)
        found.append(names.index(name))
    if len(set(found)) < len(found):
        raise InputError(f'joints stand twice in {listed(wanted)}')
    return found


def _check_names(description: Description) -> None:
    """Refuse couplings of joints that do not exist, or are balls."""
    known = {joint.name for joint in description.joints if joint.kind != BALL}
    for coupling in description.couplings:
        for name in filter(None, (coupling.joint, coupling.other)):
            if name not in known:
                raise UnknownNameError('joint', name, known)
