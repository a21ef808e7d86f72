"""The machine that a description describes: a mechanism, names, limits and warnings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, UnknownNameError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.configuration.robot_file import Node
from parallel_robot_model.mechanisms.description import mjcf, urdf_sdf
from parallel_robot_model.mechanisms.description.assembly import (
    Assembly,
    Inertia,
    as_mechanism,
    assembled,
    guessed,
    named,
    rebased,
    with_spins,
)
from parallel_robot_model.mechanisms.description.assembly import coordinates as coordinates_of
from parallel_robot_model.mechanisms.description.home import (
    check_closed,
    check_singular,
    close,
    on_grid,
    polished,
    posture,
    remarks,
)
from parallel_robot_model.mechanisms.description.parts import (
    Body,
    Description,
    Frame,
    added,
    check_bounds,
    held_by_loops,
    independent,
    listed,
    null_space,
    slides_of,
)
from parallel_robot_model.mechanisms.description.tree import (
    Freedoms,
    Tree,
    build,
    divide,
    joint_map,
    link_frames,
)
from parallel_robot_model.mechanisms.joint_kinds import SLIDE
from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism

# Masses of the links of a tree: merged from bodies, checked, and felt at the actuated joints.

HEAVY, LIGHT = 1e4, 1e-6  # kg, beyond which a mass is doubtful
WIDE = 5.0  # radius of gyration over the size of the machine that no body has
GRAM, SOLID = 100.0, 1e6  # kg from which a mass may be in g, and kg/m^3 that nothing weighs
ROUND = 16.6  # greatest volume of a body by the cube of its radius of gyration, that of a ball
NO_LOOP = '; no loop is closed: of a URDF, `<constraint>` or `closed_loop` in a YAML closes them'
TINY = 1e-300  # kg, in place of no mass
SLACK = 1e-6  # of an inertia, relative, that rounding may cost
LEAST = 1e-12  # least eigenvalue of the inertia matrix, relative to the greatest


def lumped_inertia(
    description: Description, tree: Tree, factor: float, load: float, tool: Frame
) -> Inertia:
    """The masses of all bodies on the links that carry them.

    Args:
        description: The robot.
        tree: Its links.
        factor: By which all masses and inertias are multiplied.
        load: A point of mass at the tool [kg].
        tool: The tool on its link.
    """
    count = len(tree.links)
    total = Inertia(np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3)))
    for body, host in zip(description.bodies, tree.hosts, strict=True):
        if host.body != BASE:
            centre = host.position + host.rotation @ body.centre
            turned = host.rotation @ body.inertia @ host.rotation.T
            _add(total, host.body, factor * body.mass, centre, factor * turned)
    if load and tool.body != BASE:
        _add(total, tool.body, load, tool.position, np.zeros((3, 3)))
    return total


def _add(total: Inertia, link: int, mass: float, centre: Array, inertia: Array) -> None:
    """Add a mass to those of a link."""
    whole = total.mass[link] + mass
    common = (total.mass[link] * total.centre[link] + mass * centre) / max(whole, TINY)
    total.inertia[link] += (
        inertia + _shift(mass, centre - common)
        + _shift(total.mass[link], total.centre[link] - common)
    )  # fmt: skip
    total.mass[link], total.centre[link] = whole, common


def _shift(mass: float, arm: Array) -> Array:
    return np.asarray(mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))


def mass_warnings(description: Description, tree: Tree) -> list[str]:
    """What is doubtful in the masses of bodies that move.

    Raises:
        InputError: a mass is negative, or an inertia is not positive.
    """
    hosted = zip(description.bodies, tree.hosts, strict=True)
    moving = [body for body, host in hosted if host.body != BASE]
    spots = [*(body.centre for body in moving), *(body.position for body in description.bodies)]
    size = max(float(np.linalg.norm(spot)) for spot in spots) if spots else 0.0
    warnings = [
        warning for body in moving for warning in _body_warnings(description.source, body, size)
    ]
    heavy = any(body.mass > 1000.0 * LIGHT for body in moving)
    dummies = [body.name for body in moving if heavy and 0.0 < body.mass < LIGHT]
    if dummies:
        warnings.append(f'bodies of less than {LIGHT:g} kg: {listed(dummies)}')
    return warnings


def _body_warnings(source: str, body: Body, size: float) -> list[str]:
    name = printable(body.name)
    if not (0.0 <= body.mass < np.inf and np.isfinite(body.inertia).all()):
        raise InputError(f'{source}: body {name!r}: mass={body.mass:g} must be finite, 0 or more')
    first, second, third = moments = np.linalg.eigvalsh(body.inertia)
    if first < -SLACK * max(abs(moments)):
        raise InputError(f'{source}: body {name!r}: its inertia has the moment {first:.3g} kg m^2')
    warnings = []
    if first + second < third * (1.0 - SLACK):
        warnings.append(
            f'body {name!r}: no body has moments of inertia of {first:.3g}, {second:.3g} and '
            f'{third:.3g} kg m^2: the greatest exceeds the sum of the others'
        )
    radius = np.sqrt(max(third, 0.0) / max(body.mass, TINY))
    if 0.0 < WIDE * size < radius and body.mass:
        warnings.append(
            f'body {name!r}: {third:.3g} kg m^2 is the inertia of its {body.mass:.3g} kg at '
            f'{radius:.3g} m, and the machine has {size:.3g} m: if it is in g mm^2, it must be '
            f'{1e-9 * third:.3g} kg m^2'
        )
    elif body.mass >= GRAM and 0.0 < ROUND * SOLID * radius**3 < body.mass:
        warnings.append(
            f'body {name!r} weighs {body.mass:.4g} kg, too much for its inertia: if that is in g, '
            f'it must be {1e-3 * body.mass:.4g} kg'
        )
    if body.mass > HEAVY:
        warnings.append(f'body {name!r} weighs {body.mass:.0f} kg')
    return warnings


def _check_felt(
    description: Description, parts: Assembly, freedoms: Freedoms, inertia: Inertia
) -> None:
    """Refuse a machine with a motion that nothing with a mass takes part in."""
    places = link_frames(parts.tree, parts.home)
    whole = np.diag([link.joint.armature for link in parts.tree.links])
    for i, mass in enumerate(inertia.mass):
        rate, turning = places.rates(Frame(i, position=inertia.centre[i]))
        turned = places.rotation[i] @ inertia.inertia[i] @ places.rotation[i].T
        whole = whole + mass * rate.T @ rate + turning.T @ turned @ turning
    motion = joint_map(parts.closures(scaled=False), freedoms)
    matrix = motion.T @ whole @ motion  # in the actuated joints at home [kg m^2 or kg]
    own = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scaled = matrix / np.outer(own, own) if own.all() else np.diag(own)
    sizes, motions = np.linalg.eigh(scaled)
    if sizes[0] <= LEAST:
        taking = np.abs(motions[:, 0]) > 0.1  # part in the motion
        names = (parts.tree.links[i].name for i in np.array(freedoms.actuated)[taking])
        lost = [line for line in description.doubts if line.startswith(('left out', 'nothing'))]
        hints = ['' if parts.equations else NO_LOOP, *(f'; {line}' for line in lost)]
        raise InputError(
            f'{description.source}: nothing with a mass moves with joint {listed(names)}: the '
            f'inertia matrix is not positive definite{"".join(hints)}'
        )


FEW = 0.1  # of the radius of gyration of a link: its centre of mass is on the axis of its spin


def _check_driven(
    source: str, parts: Assembly, freedoms: Freedoms, stopped: list[int], inertia: Inertia
) -> None:
    """Refuse joints that nothing drives and that do more than spin links about their centres."""
    idle = [i for i in freedoms.held if i not in stopped]
    if not idle:
        return
    joints = sorted([*idle, *freedoms.passive])
    null = null_space(parts.closures()[:, joints])
    places, heavy = link_frames(parts.tree, parts.home), np.flatnonzero(inertia.mass > LIGHT)
    rates = [places.rates(Frame(int(i), position=inertia.centre[i]))[0] for i in heavy]
    sizes = np.linalg.eigvalsh(inertia.inertia[heavy])[:, -1] / inertia.mass[heavy]  # m^2
    moved = [
        (rate * parts.steps)[:, joints] @ null / max(size, TINY) ** 0.5
        for rate, size in zip(rates, sizes, strict=True)
    ]
    _, much, motions = np.linalg.svd(np.concatenate([np.zeros((0, null.shape[1])), *moved]))
    if count := int(np.sum(much > FEW)):
        rows = independent(null @ motions[:count].T, count)
        names = listed(parts.tree.links[joints[i]].name for i in rows)
        raise InputError(
            f'{source}: no actuator that was read drives {names}, and masses move with it: name '
            'it in robot.actuated or in robot.held'
        )


def _weak(parts: Assembly, freedoms: Freedoms, inertia: Inertia, gravity: Array) -> Iterator[str]:
    """Joints that cannot hold the machine against gravity at home."""
    places, links = link_frames(parts.tree, parts.home), parts.tree.links
    needed = -sum(
        mass * gravity @ places.rates(Frame(i, position=inertia.centre[i]))[0]
        for i, mass in enumerate(inertia.mass)
    )
    held = needed @ joint_map(parts.closures(scaled=False), freedoms)
    for i, load in zip(freedoms.actuated, held, strict=True):
        limit = links[i].joint.effort[int(load > 0.0)]
        if abs(load) > abs(limit) or (load > 0.0) == (limit < 0.0):
            unit = links[i].kind.units.of('N m')
            yield (
                f'gravity takes {abs(load):.4g} {unit} at {printable(links[i].name)} at home, '
                f'above its limit, {abs(limit):.4g} {unit}'
            )


MOST = 200  # joints
NO_TOOL = 'robot.tool is not given; the tool taken is {}'
IDLE = 'held where they are at home, as nothing drives them: {}'
JOINTS_AS_POSE = (
    'the tool has not as many independent motions at home as there are actuated joints: the pose '
    'is these joints'
)

NO_PLACE = (
    'the tool moves neither in a plane of two axes nor along all three at home: it has no place, '
    'so no circle, workspace or end-effector error'
)


class Machine(NamedTuple):
    """A mechanism and what people call its parts."""

    mechanism: Mechanism  # the value that kernels take
    names: tuple[str, ...]  # of all N joints; a ball is three
    actuated: tuple[str, ...]  # names of the n actuated joints
    passive: tuple[str, ...]  # names of those that follow by the closures
    held: tuple[str, ...]  # names of those that stay where they are at home
    units: tuple[str, ...]  # of the actuated joints, ``'rad'`` or ``'m'``
    viscous: tuple[float, ...]  # viscous friction of the actuated joints [N m s/rad or N s/m]
    coulomb: tuple[float, ...]  # their dry friction [N m or N]
    lag: tuple[float, ...]  # time constants of their torques [s]
    delay: float  # of commands [s]
    lower: tuple[float, ...]  # ends of their travel [rad or m]; infinite if there is none
    upper: tuple[float, ...]  # the others
    # their least and greatest torques or forces [N m or N]; infinite if there is none
    least_effort: tuple[float, ...]
    effort: tuple[float, ...]
    velocity: tuple[float, ...]  # their greatest rates [rad/s or m/s]; infinite if there is none
    tool: str  # name of the frame that is controlled
    # names and units of the m coordinates of the tool; empty: the pose is the actuated joints
    coordinates: tuple[tuple[str, str], ...]
    planar: bool  # whether the tool moves in the plane of the first two of them
    home_moved: float  # by how much the loops were open at the home that was asked for [m]
    warnings: tuple[str, ...]  # what is left out of the file, or is doubtful in it, one line each
    remarks: tuple[str, ...]  # what else was decided, one line each


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
    description = with_actuators(description)
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
        what = f'held: {printable(names[both[0]])} is actuated'
        raise InputError(f'{what}; robot.actuated names those that are')

    start = assembled(description, tree, at)
    closed = on_grid(close(start, driven, stopped), start.home)
    check_closed(description.source, start, closed)
    parts = rebased(start, closed)
    check_singular(description.source, parts, stopped)
    found = named(description, tree, tool) if tool else guessed(description, parts, driven)
    motion, closures = parts.motion_of(found.frame), parts.closures()
    freedoms = divide(description.source, names, closures, motion, driven, stopped)
    parts = with_spins(parts, freedoms)
    if any(link.spins for link in parts.tree.links):
        motion, closures = parts.motion_of(found.frame), parts.closures()
        freedoms = divide(description.source, names, closures, motion, driven, stopped)
    exact = polished(parts, freedoms.rows, freedoms.passive)
    parts = parts._replace(home=exact, tool=found)
    inertia = lumped_inertia(description, parts.tree, mass_factor, payload, found.frame)
    _check_driven(description.source, parts, freedoms, stopped, inertia)
    _check_felt(description, parts, freedoms, inertia)
    chosen, coordinates, planar = coordinates_of(motion @ joint_map(closures, freedoms))
    links = parts.tree.links
    still = [names[i] for i in freedoms.held if i not in stopped]
    joints = [links[i].joint for i in freedoms.actuated]
    motors = [[m for m in description.actuators if m.joint == joint.name] for joint in joints]
    return Machine(
        mechanism=as_mechanism(description, parts, freedoms, inertia, chosen, mass_factor),
        names=names,
        actuated=tuple(names[i] for i in freedoms.actuated),
        passive=tuple(names[i] for i in freedoms.passive),
        held=tuple(names[i] for i in freedoms.held),
        units=tuple(links[i].kind.units.of('rad') for i in freedoms.actuated),
        viscous=tuple(sum(joint.damping[:1]) for joint in joints),
        coulomb=tuple(joint.coulomb for joint in joints),
        lag=tuple(max((motor.lag for motor in own), default=0.0) for own in motors),
        delay=max((motor.delay for own in motors for motor in own), default=0.0),
        lower=tuple(-np.inf if joint.lower >= joint.upper else joint.lower for joint in joints),
        upper=tuple(np.inf if joint.lower >= joint.upper else joint.upper for joint in joints),
        least_effort=tuple(joint.effort[0] for joint in joints),
        effort=tuple(joint.effort[1] for joint in joints),
        velocity=tuple(joint.velocity for joint in joints),
        tool=found.name,
        coordinates=coordinates,
        planar=planar,
        home_moved=start.distance(start.home),
        warnings=(
            *description.doubts,
            *mass_warnings(description, parts.tree),
            *remarks(start, closed, parts, freedoms),
            *_weak(parts, freedoms, inertia, description.gravity),
        ),
        remarks=(
            *([] if tool else [NO_TOOL.format(printable(found.name))]),
            *([] if coordinates else [JOINTS_AS_POSE]),
            *([] if planar or chosen[:3] == (0, 1, 2) else [NO_PLACE]),
            *([IDLE.format(', '.join(map(printable, still)))] if still else []),
        ),
    )


def with_actuators(description: Description) -> Description:
    """The same with the rotors, damping and limits of actuators at the joints that they drive."""
    joints = {joint.name: joint for joint in description.joints}
    efforts: dict[str, Array] = {}
    for each in description.actuators:
        joint = joints[each.joint]
        joints[each.joint] = joint._replace(
            armature=joint.armature + each.armature,
            damping=added(joint.damping, each.damping),
        )
        efforts[each.joint] = efforts.get(each.joint, np.zeros(2)) + each.effort
    for tendon in description.tendons:  # the friction of one that is of one joint is that joint's
        for name, ratio in tendon.ratios.items() if len(tendon.ratios) == 1 else ():
            coulomb = joints[name].coulomb + abs(ratio) * tendon.coulomb
            joints[name] = joints[name]._replace(coulomb=coulomb)
    for name, (least, greatest) in efforts.items():
        low, high = joints[name].effort
        limits = max(low, float(least)), min(high, float(greatest))
        joints[name] = joints[name]._replace(effort=limits)
    return description._replace(joints=tuple(joints.values()))


def _by_file(description: Description) -> Sequence[str]:
    """The joints that a file actuates, or that it must mean."""
    if description.actuators:
        return tuple(dict.fromkeys(actuator.joint for actuator in description.actuators))
    bound = {coupling.joint for coupling in description.couplings} | _floats(description)
    single = (joint.name for joint in description.joints if joint.kind.single)
    movable = [name for name in single if name not in bound]
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


def _floats(description: Description) -> set[str]:
    """Names of the slides of bodies that float."""
    slides = {joint.name for joint in description.joints if joint.kind == SLIDE}
    balls = [slides_of(joint.name) for joint in description.joints if not joint.kind.single]
    return {name for names in balls if slides.issuperset(names) for name in names}


def _check_floating(description: Description) -> None:
    """Refuse bodies that float, with what they carry, and that no loop holds."""
    slides, held = _floats(description), held_by_loops(description)
    for joint in description.joints:
        if slides.issuperset(slides_of(joint.name)) and joint.body not in held:
            raise InputError(
                f'{description.source}: body {printable(description.bodies[joint.body].name)!r} '
                'floats, and no loop holds it; a robot must be fixed to the world'
            )


def _check_names(description: Description) -> None:
    """Refuse couplings of joints that do not exist, or are balls."""
    known = {joint.name for joint in description.joints if joint.kind.single}
    for coupling in description.couplings:
        for name in filter(None, (coupling.joint, coupling.other)):
            if name not in known:
                raise UnknownNameError('joint', name, known)


# The description of a robot from its text.

READERS = {'robot': urdf_sdf.read_urdf, 'sdf': urdf_sdf.read_sdf}


def read(text: str, source: str = 'description') -> Description:
    """Read what `configuration.robot_file.text_of` made of a file.

    Args:
        text: MJCF, URDF or SDF without other files.
        source: What it is called in messages.

    Raises:
        InputError: the text is none of these, or the robot has what this suite does not know.
    """
    root, merged = parsed(text, source)
    if root.tag not in ('mujoco', *READERS):
        raise InputError(
            f'{source} begins with <{printable(root.tag)}>; the description of a robot begins '
            'with <mujoco>, <robot> or <sdf>'
        )
    with np.errstate(all='ignore'):  # of numbers that are refused next
        if root.tag == 'mujoco':
            description = mjcf.read(root, source, merged)
        else:
            description = READERS[str(root.tag)](root, root.source)
    return checked(description)


def checked(description: Description) -> Description:
    """A description as it is, if its numbers can be those of a machine and it is fixed.

    Raises:
        InputError: they cannot, or it floats.
    """
    check_bounds(description)
    _check_floating(description)
    return description


def parsed(text: str, source: str) -> tuple[Node, bool]:
    """The first element of a description, and whether it was made of several files.

    Raises:
        InputError: the text is no XML.
    """
    return robot_file.parse_xml(text, source), text.startswith(f'<?{robot_file.MERGED_MARK}?>')
