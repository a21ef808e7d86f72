"""URDF, with what closes loops (mimic, constraint, loop, coupling, closed_loop), and SDF."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.robot_file import TEXT, Node, children, refused
from parallel_robot_model.mechanisms.description.graph import (
    AXES,
    ZERO,
    Edge,
    Notes,
    attribute,
    build_description,
    check_held,
    child,
    followers,
    inverse,
    is_true,
    link,
    mark_used,
    name_of,
    number,
    numbers,
    of_attribute,
    of_element,
    of_quaternion,
    rotation_rpy,
    steps,
    unique,
    unknown,
    unused_elements,
    vector,
    with_limits,
)
from parallel_robot_model.mechanisms.description.parts import (
    INFINITY,
    UNLIMITED,
    WORLD,
    Actuator,
    Body,
    Coupling,
    Description,
    Frame,
    Joint,
    Loop,
    Range,
    listed,
)
from parallel_robot_model.mechanisms.description.tree import compose
from parallel_robot_model.mechanisms.joint_kinds import OF_FILES

# What closes loops in URDF, of several authors.
#
# Sources:
#     `constraint`: pull requests ros/urdfdom_headers#108 and ros/urdfdom#264 (2026): joints of
#     which both ends have an origin. `loop` and `coupling`: Chignoli, Slotine, Wensing, Kim
#     (2024), URDF+, arXiv 2411.19753. `closed_loop`: see `configuration.robot_file`. `joint` in
#     `gazebo`: a joint as in SDF, see gazebosim.org, kinematic_loop.

ENDS = {'constraint': ('parent', 'child'), 'loop': ('predecessor', 'successor')}
X = (1.0, 0.0, 0.0)  # the axis where none is written


def _kinds_beyond_urdf(robot: Node, joints: Collection[str]) -> dict[str, tuple[Joint, ...]]:
    """The joints that are of another kind than URDF can say."""
    found: dict[str, tuple[Joint, ...]] = {}
    for node in children(robot, 'joint_type'):
        name, kind = attribute(node, 'joint'), attribute(node, 'type').upper()
        if name not in joints:
            raise unknown(node, 'joint', name)
        letters = ['XYZ'.find(letter) for letter in kind[-2:]]
        if kind in ('SPHERICAL', 'FIXED'):
            found[name] = steps(node, kind.lower(), ())
        elif kind.startswith('UJOINT_') and len(kind) == 9 and min(letters) >= 0:
            both = steps(node, 'universal', [AXES[letter] for letter in letters])
            found[name] = tuple(
                step._replace(name=f'.{letter.lower()}')
                for step, letter in zip(both, kind[-2:], strict=True)
            )
        else:
            raise refused(
                node, f'type={printable(kind)!r} must be SPHERICAL, FIXED or such as UJOINT_XY'
            )
    return found


def _closing_edge(node: Node, links: Collection[str], notes: Notes) -> Edge:
    """A joint that closes a loop, both ends of which have a place."""
    names, origins = [], []
    for tag in ENDS[str(node.tag)]:
        names.append(_link_of(node, tag, links))
        of_loop = node.tag == 'loop'
        place = child(child(node, tag), 'origin') if of_loop else child(node, f'{tag}_origin')
        origins.append(_origin(place, notes))
    keys = ('axis',) if node.tag == 'loop' else ('parent_axis', 'child_axis')
    axes = [vector(child(node, key), 'xyz', X) for key in keys]
    how = steps(node, attribute(node, 'type').lower(), axes)
    return Edge(node, name_of(node), names[0], names[1], origins[0], origins[1], how)


def _link_of(node: Node, tag: str, known: Collection[str]) -> str:
    """The name of the link that an element in an element names."""
    name = of_attribute(child(node, tag), 'link') or ''
    if name not in known:
        raise unknown(node, f'{tag} link', name)
    return name


def _gazebo_edges(robot: Node, edges: Sequence[Edge], roots: Sequence[str]) -> list[Edge]:
    """The joints in elements <gazebo>, which are joints as in SDF."""
    nodes = [joint for node in children(robot, 'gazebo') for joint in children(node, 'joint')]
    reached = [*roots, BASE]
    places = dict.fromkeys(reached, Frame(WORLD))
    for name in reached if nodes else ():  # it grows
        for edge in edges:
            if edge.parent == name and edge.child not in places:
                places[edge.child] = compose(places[name], edge.at)
                reached.append(edge.child)
    poses = Poses(Node('model'), False, nodes, places)
    return [_sdf_edge(node, poses, defaultdict(list)) for node in nodes]


def _closing_frames(robot: Node, frames: Mapping[str, Frame]) -> list[Loop]:
    """The pairs of frames that coincide."""
    found = []
    for node in children(robot, 'closed_loop'):
        names = attribute(node, 'first'), attribute(node, 'second')
        for name in names:
            if name not in frames:
                raise unknown(node, 'link or joint', name)
        kind = attribute(node, 'type').lower()
        if kind not in ('3d', '6d'):
            raise refused(node, f'type={printable(kind)!r} must be 3d or 6d')
        found.append(Loop(' '.join(names), frames[names[0]], frames[names[1]], kind == '6d'))
    return found


def _couplings(robot: Node, edges: Sequence[Edge]) -> list[Coupling]:
    """The joints that gears tie together: successor = ratio * predecessor."""
    above = {edge.child: edge for edge in edges if edge.node.tag == 'joint'}
    found = []
    for node in children(robot, 'coupling'):
        one, other = ({*_moving(above, _link_of(node, tag, above))} for tag in ENDS['loop'])
        first, second = one - other, other - one
        if len(first) != 1 or len(second) != 1:
            raise refused(node, 'must tie one joint to one other')
        ratio = number(child(node, 'ratio'), 'value', 1.0)
        found.append(Coupling(name_of(node), second.pop(), first.pop(), ratio))
    return found


def _moving(above: Mapping[str, Edge], link: str) -> list[str]:
    """The joints that move a link, up to the base."""
    moving: list[str] = []
    while link in above and above[link].name not in moving:
        edge = above[link]
        moving += [edge.name] if edge.steps else []
        link = edge.parent
    return moving


class Beside(NamedTuple):
    """What stands outside of links and joints, by their names."""

    commanded: dict[str, dict[str, Range]]  # least and greatest commands by interface
    rotors: dict[str, float]  # inertia of rotors, as felt at the joint [kg m^2 or kg]
    springs: dict[str, Range]  # stiffness and position where they are slack
    lifted: set[str]  # links without weight
    notes: Notes  # what people should know


CLOSING = re.compile('closing|closed_?loop', re.IGNORECASE)  # what exporters name ends of loops
GRAVITY = 0.0, 0.0, -9.81  # m/s^2
ONE_ENDED = 'an end of travel that is missing is 0, as specified; other readers have none'
ENDLESS = 'neither lower nor upper, which are 0 as specified: no ends of travel'


def read_urdf(robot: Node, source: str) -> Description:
    """A description from URDF."""
    robot.get('version')
    joints = unique(children(robot, 'joint') + children(robot, 'drake:joint'))
    named = unique(children(robot, 'link'))
    beside = _beside(robot, named, joints)
    notes = beside.notes
    links = {name: _link(node, beside) for name, node in named.items()}
    kinds = _kinds_beyond_urdf(robot, joints)
    edges = [_edge(node, links, kinds.get(name), beside) for name, node in joints.items()]
    carried = {edge.child for edge in edges}
    roots = [name for name in links if name not in carried]
    closing = _gazebo_edges(robot, edges, roots)
    closing += [_closing_edge(node, links, notes) for tag in ENDS for node in children(robot, tag)]
    edges, tree = [*edges, *closing], edges
    if BASE not in links and any(BASE in (each.parent, each.child) for each in edges):
        links[BASE] = Body(BASE, WORLD, np.eye(3), np.zeros(3))
        roots.append(BASE)
    mimics = followers(joints, of_attribute)
    actuators = _actuators(robot, joints, {mimic.joint for mimic in mimics})
    driven = {actuator.joint for actuator in actuators}
    found = build_description(source, list(links.values()), tree, roots, False, driven, closing)
    ends = {edge.name: found.frames[edge.child] for edge in edges} | found.frames
    found = found._replace(
        loops=(*found.loops, *_closing_frames(robot, ends)),
        couplings=(*mimics, *_couplings(robot, edges)),
        actuators=tuple(actuators),
        gravity=np.array(GRAVITY),
    )
    check_held(found, edges)
    lines = [f'{what}: {listed(names)}' for what, names in notes.items()]
    if len(alone := [name for name in roots if name != BASE]) > 1:
        lines.insert(0, f'links without a parent are fixed to the world: {listed(alone)}')
    if not found.loops and (tips := [name for name in found.frames if CLOSING.search(name)]):
        lines.append(f'nothing closes the loops that links are named after: {listed(tips)}')
    return found._replace(doubts=(*lines, *unused_elements(robot)))


def _origin(node: Node | None, notes: Notes) -> Frame:
    """The frame that an element <origin> gives."""
    rotation = rotation_rpy(*vector(node, 'rpy', ZERO))
    if node is not None and of_attribute(node, 'quat_xyzw') is not None:
        by_quaternion = of_quaternion(node, vector(node, 'quat_xyzw', (0.0, 0.0, 0.0, 1.0)))
        if 'rpy' in node.attrib and not np.allclose(rotation, by_quaternion, atol=1e-3):
            raise refused(node, 'has an rpy and another quat_xyzw; keep one of them')
        notes['quat_xyzw is read; readers older than URDF 1.2 ignore it'].append(
            f'line {node.line}'
        )
        rotation = by_quaternion
    return Frame(WORLD, rotation, vector(node, 'xyz', ZERO))


def _link(node: Node, beside: Beside) -> Body:
    node.get('type')
    inertial = child(node, 'inertial')
    frame = _origin(child(inertial, 'origin'), beside.notes)
    mass = number(child(inertial, 'mass'), 'value')
    lifted = inertial is not None and name_of(node) in beside.lifted
    return link(node, inertial, frame, mass, of_attribute, 0.0, lifted)


def _edge(
    node: Node, links: Collection[str], own: tuple[Joint, ...] | None, beside: Beside
) -> Edge:
    ends = []
    for tag in ('parent', 'child'):
        end = child(node, tag)
        if end is None:
            raise refused(node, f'has no {tag}')
        name = attribute(end, 'link')
        if name not in links and name != BASE:  # which need not be written
            raise unknown(node, 'link', name)
        ends.append(name)
    if ends[0] == ends[1]:
        raise refused(node, f'joins the link {printable(ends[0])!r} with itself')
    at, kind = _origin(child(node, 'origin'), beside.notes), attribute(node, 'type')
    axes = [vector(child(node, 'axis'), 'xyz', X)]
    how = steps(node, kind, axes) if own is None else own
    if len(how) == 1 and how[0].kind.single:
        how = (_limited(node, kind, how[0], beside),)
    elif not how:  # exporters write them of fixed joints, too
        for tag in ('limit', 'dynamics', 'safety_controller', 'mimic'):
            mark_used(child(node, tag))
    return Edge(node, name_of(node), ends[0], ends[1], at, Frame(WORLD), how)


def _limited(node: Node, kind: str, step: Joint, beside: Beside) -> Joint:
    """A hinge or a slide with what acts on it, and its limits, of two the narrower."""
    limit, name, notes = child(node, 'limit'), name_of(node), beside.notes
    step = with_limits(step, name, limit, child(node, 'dynamics'), of_attribute, notes)
    travel = _ends(node, limit, '{}', notes)
    if kind == 'continuous':
        if -INFINITY < travel[0] < travel[1]:
            notes['travel of a continuous joint is left out'].append(name)
        travel = UNLIMITED
    elif limit is None:
        notes[f'{kind} without the <limit> that is specified: no ends of travel'].append(name)
    soft = _ends(node, child(node, 'safety_controller'), 'soft_{}_limit', notes)
    if soft[0] < soft[1]:
        travel = _narrower(node, 'travel', travel, soft, '<safety_controller>', notes)
    else:
        notes['soft limits without an extent are left out'].append(name)
    commands, control = beside.commanded.get(name, {}), '<ros2_control>'
    speed = min((abs(end) for end in commands.get('velocity', ()) if end), default=INFINITY)
    least, most = commands.get('effort', UNLIMITED)
    effort = -abs(least), abs(most)  # as its interface has it: no motor pushes one way at least
    travel = _narrower(node, 'travel', travel, commands.get('position', UNLIMITED), control, notes)
    _, velocity = _narrower(node, 'velocity', (0.0, step.velocity), (0.0, speed), control, notes)
    stiffness, rest = beside.springs.get(name, (0.0, 0.0))
    return step._replace(
        lower=travel[0],
        upper=travel[1],
        effort=_narrower(node, 'effort', step.effort, effort, control, notes),
        velocity=velocity,
        armature=beside.rotors.get(name, 0.0),
        stiffness=(stiffness,) if stiffness else (),
        rest=rest,
    )


def _narrower(
    node: Node, what: str, of_limit: Range, other: Range, where: str, notes: Notes
) -> Range:
    """What two ranges share; where that is less than the first, it is noted."""
    lower, upper = max(of_limit[0], other[0]), min(of_limit[1], other[1])
    if lower > upper and of_limit[0] <= of_limit[1]:
        ends = f'{other[0]:g} to {other[1]:g} in {where}, {of_limit[0]:g} to {of_limit[1]:g}'
        raise refused(node, f'has no {what} that all its limits allow: {ends} in <limit>')
    if (lower, upper) != of_limit:
        notes[f'{what} in {where} is narrower than in <limit>, and taken'].append(name_of(node))
    return lower, upper


def _ends(node: Node, limit: Node | None, keys: str, notes: Notes) -> Range:
    """Ends of travel; if one of them is missing, it is zero."""
    names = keys.format('lower'), keys.format('upper')
    lower, upper = number(limit, names[0], -INFINITY), number(limit, names[1], INFINITY)
    missing = [key for key in names if limit is not None and key not in limit.attrib]
    if len(missing) == 1:
        lower, upper = (0.0, upper) if missing[0] == names[0] else (lower, 0.0)
        if lower > upper:
            raise refused(node, f'has no {missing[0]}, which is then 0: beyond the other end')
        notes[ONE_ENDED].append(name_of(node))
    elif missing and names[0] == 'lower' and node.get('type') != 'continuous':
        notes[ENDLESS].append(name_of(node))
    return lower, upper


def _beside(robot: Node, links: Collection[str], joints: Collection[str]) -> Beside:
    """What transmissions, <ros2_control> and <gazebo> say of links and joints."""
    found = Beside({}, {}, {}, set(), defaultdict(list))
    for control in children(robot, 'ros2_control'):
        for key in ('type', 'rw_rate', 'is_async'):
            control.get(key)
        for node in children(control, 'transmission'):  # from motors to joints
            mark_used(node)
        for node in children(control, 'joint'):
            found.commanded.setdefault(name_of(node), {}).update(_commanded(node))
    for node in children(robot, 'transmission'):
        node.get('type')
        of_element(node, 'type')
        actuators = children(node, 'actuator')
        for i, joint in enumerate(children(node, 'joint')):
            for each in (joint, *actuators[i : i + 1]):  # of a motor's own position
                mark_used(child(each, 'role'))
                mark_used(child(each, 'offset'))
            of = {}
            for key, default in (('rotor_inertia', 0.0), ('gear_ratio', 1.0)):
                owners = (child(each, f'drake:{key}') for each in (*actuators[i : i + 1], node))
                said = next((each for each in owners if each is not None), None)
                of[key] = number(said, 'value', default)
            found.rotors[name_of(joint)] = of['rotor_inertia'] * of['gear_ratio'] ** 2
    for node in children(robot, 'gazebo'):
        name = node.get('reference', '')
        if name in links:
            off, on = of_element(node, 'turnGravityOff'), of_element(node, 'gravity')
            if is_true(off or '0') or not is_true(on or '1'):
                found.lifted.add(name)
        elif name in joints:
            keys = 'springStiffness', 'springReference'
            stiffness, rest = (number(node, key, 0.0, of_element) for key in keys)
            found.springs[name] = stiffness, rest
        elif name:
            found.notes['<gazebo> names neither link nor joint'].append(name)
    return found


def _commanded(node: Node) -> dict[str, Range]:
    """Least and greatest commands of a joint by interface."""
    found = {}
    for each in children(node):  # of drivers, but for those that couple joints
        if each.tag == 'param' and each.get('name') not in ('mimic', 'multiplier', 'offset'):
            mark_used(each)
    for interface in children(node, 'command_interface'):
        ends = {'min': -INFINITY, 'max': INFINITY}
        for each in children(interface, 'param'):
            each.requested.add(TEXT)
            if (key := each.get('name')) in ends:
                ends[key] = float(numbers(each, each.text or '', key, 1)[0])
        enabled = [child(each, 'limits') for each in (node, interface)]
        if all(each is None or is_true(each.get('enable', '1')) for each in enabled):
            found[name_of(interface)] = ends['min'], ends['max']
    return found


def _actuators(robot: Node, joints: dict[str, Node], following: Collection[str]) -> list[Actuator]:
    """What drives joints: name_mot, command interfaces and transmissions, or `independent`."""
    named = [(node, attribute(node, 'joint')) for node in children(robot, 'name_mot')]
    if not named:
        named = [
            (node, name_of(node))
            for parent in children(robot, 'transmission') + children(robot, 'ros2_control')
            for node in children(parent, 'joint')
            if parent.tag == 'transmission' or children(node, 'command_interface')
        ]
    independent = {name: node.get('independent') for name, node in joints.items()}
    if not named and any(independent.values()):
        named = [
            (joints[name], name) for name, is_so in independent.items() if is_so in (None, 'true')
        ]
    for node, name in named:
        if name not in joints:
            raise unknown(node, 'joint', name)
    single = {
        name for name, node in joints.items() if len(OF_FILES.get(node.get('type'), ())) == 1
    }
    names = dict.fromkeys(name for _, name in named if name in single and name not in following)
    return [Actuator(name, name) for name in names]


# Where the links, joints and frames of an SDF model are, each relative to another.

OWN = '__model__'  # the frame of the model
BASE = 'world'  # what SDF calls the world


def pose(node: Node | None) -> Frame:
    """The frame that an element <pose> gives."""
    if node is None:
        return Frame(WORLD)
    node.requested |= {TEXT, 'relative_to', 'frame'}
    way, text = node.get('rotation_format', 'euler_rpy'), node.text or ''
    degrees = is_true(node.get('degrees', 'false'))
    if way == 'quat_xyzw':
        found = numbers(node, text or '0 0 0 0 0 0 1', 'pose', 7)
        return Frame(WORLD, of_quaternion(node, found[3:]), found[:3])
    if way != 'euler_rpy':
        raise refused(node, f'rotation_format={printable(way)!r} must be euler_rpy or quat_xyzw')
    x, y, z, *angles = numbers(node, text or '0 0 0 0 0 0', 'pose', 6)
    if degrees:
        angles = [float(np.radians(angle)) for angle in angles]
    return Frame(WORLD, rotation_rpy(*angles), np.array([x, y, z]))


class Poses:
    """Frames of a model in the world at the zero of its joints."""

    def __init__(
        self,
        model: Node,
        axes_in_model: bool,
        nodes: Sequence[Node] = (),
        places: Mapping[str, Frame] | None = None,
    ) -> None:
        """Note what has a name."""
        self._own = [each for tag in TAGS for each in children(model, tag)]
        self._nodes = {name_of(node): node for node in (*self._own, *nodes)}
        self._found: dict[str, Frame] = dict(places or {})
        self._links = [name_of(each) for each in self._own if each.tag == 'link']
        self._links += self._found
        self._canonical = model.get('canonical_link') or next(iter(self._links), '')
        self.model, self.axes_in_model = Frame(WORLD), axes_in_model

    def move(self, model: Node, world: Poses) -> None:
        """Place the model in the world as it says."""
        at, placed = child(model, 'pose'), model.get('placement_frame')
        start = _named(at)
        first = world.of(model, start) if start else Frame(WORLD)
        here = compose(first, pose(at))
        if placed:
            here = compose(here, inverse(self.of(model, placed)))
        self._found.clear()
        self.model = here

    def of(self, asking: Node, name: str) -> Frame:
        """What has a name."""
        chain: list[Node] = []
        while name not in self._found and name not in (OWN, BASE):
            node = self._nodes.get(name)
            if node is None:
                raise unknown(chain[-1] if chain else asking, 'frame', name)
            if node in chain:
                raise refused(node, 'has a pose that is relative to itself')
            chain.append(node)
            name = _relative(node)
        frame = Frame(WORLD) if name == BASE else self._found.get(name, self.model)
        for node in reversed(chain):
            frame = compose(frame, pose(child(node, 'pose')))
            self._found[name_of(node)] = frame
        return frame

    def carrier(self, asking: Node, name: str) -> str:
        """The link that carries a link, frame or joint, or the world."""
        seen = set()
        while name != BASE and name not in self._links:
            node = self._nodes.get(name)
            if node is None and name != OWN:
                raise unknown(asking, 'link or frame', name)
            if name in seen:
                raise refused(asking, f'hangs on {printable(name)!r}, which hangs on itself')
            seen.add(name)
            if node is None:
                name = self._canonical
            elif node.tag == 'joint':
                name = of_element(node, 'child') or ''
            else:
                name = node.get('attached_to') or OWN
        return name


TAGS = 'frame', 'joint', 'link'


def _named(at: Node | None) -> str:
    """The name of what a pose is relative to, if it says so."""
    return '' if at is None else at.get('relative_to') or at.get('frame') or ''


def _relative(node: Node) -> str:
    """The name of what the pose of an element is relative to."""
    named = _named(child(node, 'pose'))
    if named or node.tag == 'link':
        return named or OWN
    if node.tag == 'joint':
        return of_element(node, 'child') or OWN
    return node.get('attached_to') or OWN


SDF_GRAVITY = 0.0, 0.0, -9.8  # m/s^2, of SDF
FAR_END = 1e16  # for SDF
AXES_IN_JOINTS = 1, 5  # version since which axes are seen from joints, not from the model
OFTEN_OFF = 'enable_wind', 'kinematic', 'wind', 'velocity_decay'  # zero: without effect


def read_sdf(root: Node, source: str) -> Description:
    """A description from SDF."""
    world = child(root, 'world')
    model = _model(root if world is None else world, source)
    notes: Notes = defaultdict(list)
    words = root.get('version', '').split('.')  # by default the newest
    old = all(map(str.isdecimal, words)) and tuple(map(int, words)) < AXES_IN_JOINTS
    poses = Poses(model, old)
    poses.move(model, Poses(Node('world') if world is None else world, False))
    weightless = not is_true(of_element(model, 'gravity') or '1')
    nodes = unique(children(model, 'link')).values()
    links = [_sdf_link(node, weightless) for node in nodes]
    joints = unique(children(model, 'joint'))
    edges = [_sdf_edge(node, poses, notes) for node in joints.values()]
    if links and BASE not in {end for each in edges for end in (each.parent, each.child)}:
        first = links[0].name
        notes['no joint fixes a link to the world, held is'].append(first)
        edges.append(Edge(model, BASE, BASE, first, poses.of(model, first), Frame(WORLD), ()))
    base = Body(BASE, WORLD, np.eye(3), np.zeros(3))
    found = build_description(source, [base, *links] if links else [], edges, [BASE], True)
    check_held(found, edges)
    for node in children(model, 'frame'):
        name = name_of(node)
        carrier = poses.carrier(node, name)
        here = compose(inverse(poses.of(node, carrier)), poses.of(node, name))
        found.frames.setdefault(name, compose(found.frames[carrier], here))
    physics = [] if world is None else children(world, 'physics')
    owners = [each for each in (world, *physics) if each is not None]
    owner = next((each for each in owners if each.find('gravity') is not None), None)
    gravity = vector(owner, 'gravity', SDF_GRAVITY, of_element)
    for each in physics:  # gravity stood there before SDF 1.6
        mark_used(each)
    warnings = [f'{what}: {listed(names)}' for what, names in notes.items()]
    return found._replace(
        couplings=tuple(followers(joints, of_element)),
        gravity=gravity,
        doubts=(*warnings, *unused_elements(root)),
    )


def _model(parent: Node, source: str) -> Node:
    """The one model that moves."""
    for tag in ('include', 'population'):
        found = next(parent.iter(tag), None)
        if found is not None:  # an element without children counts as false
            assert isinstance(found, Node)
            raise refused(found, 'is another file; write its model in its place')
    for node in children(parent, 'joint'):
        raise refused(node, 'joins models; write it and its links in one model')
    models = children(parent, 'model')
    still = [node for node in models if is_true(of_element(node, 'static') or '0')]
    moving = [node for node in models if node not in still]
    for node in still:
        mark_used(node)
    if not moving:
        raise InputError(f'{source} has no model that moves')
    if len(moving) > 1:
        names = listed(node.get('name', '') for node in moving)
        raise InputError(f'{source} has {len(moving)} models that move; keep one of {names}')
    nested = child(moving[0], 'model')
    if nested is not None:
        raise refused(nested, 'is a model in a model; write its links in the outer one')
    for node in parent, moving[0], *children(moving[0], 'link'):
        for each in (each for each in children(node) if each.tag in OFTEN_OFF):
            words = ' '.join(each.itertext()).lower().split()
            if all(word.strip('-0.') in ('', 'false') for word in words):
                mark_used(each)
    return moving[0]


def _sdf_link(node: Node, weightless: bool) -> Body:
    inertial = child(node, 'inertial')
    frame = pose(child(inertial, 'pose'))
    if inertial is not None and inertial.get('auto') == 'true':
        raise refused(node, 'has an inertia that follows from its shapes; write its numbers')
    mass = number(inertial, 'mass', 1.0, of_element)  # the defaults of SDF
    weightless = weightless or not is_true(of_element(node, 'gravity') or '1')
    return link(node, inertial, frame, mass, of_element, 1.0, weightless)


def _sdf_edge(node: Node, poses: Poses, notes: Notes) -> Edge:
    """A joint."""
    ends = []
    for tag in ('parent', 'child'):
        name = of_element(node, tag)
        if not name:
            raise refused(node, f'has no {tag}')
        ends.append(poses.carrier(node, name))
    if ends[0] == ends[1]:
        raise refused(node, f'joins the link {printable(ends[0])!r} with itself')
    kind, name = attribute(node, 'type'), name_of(node)
    here = compose(poses.of(node, _relative(node)), pose(child(node, 'pose')))
    sides = [compose(inverse(poses.of(node, end)), here) for end in ends]
    axes = [each for tag in ('axis', 'axis2') if (each := child(node, tag)) is not None]
    how = list(steps(node, kind, [_direction(node, axis, poses, here) for axis in axes]))
    for i, (step, axis) in enumerate(zip(how, axes, strict=False)):
        how[i] = _sdf_limited(step, name, axis, kind, notes)
    for axis in axes[len(how) :]:  # of a fixed joint
        mark_used(axis)
    child(node, 'physics')
    rotor, ratio = (
        number(node, f'drake:{key}', default, of_element)
        for key, default in (('rotor_inertia', 0.0), ('gear_ratio', 1.0))
    )
    if how and rotor:
        how[0] = how[0]._replace(armature=rotor * ratio**2)
    return Edge(node, name, ends[0], ends[1], sides[0], sides[1], tuple(how))


def _direction(node: Node, axis: Node, poses: Poses, here: Frame) -> Array:
    """An axis in the frame of its joint."""
    of_model = is_true(of_element(axis, 'use_parent_model_frame') or '0')
    direction, vertical = child(axis, 'xyz'), (0.0, 0.0, 1.0)
    if direction is None:
        return np.array(vertical)
    seen_from = direction.get('expressed_in', '')
    found = vector(axis, 'xyz', vertical, of_element)
    if poses.axes_in_model or of_model:
        found = here.rotation.T @ poses.model.rotation @ found
    elif seen_from:
        found = here.rotation.T @ poses.of(node, seen_from).rotation @ found
    return found


def _sdf_limited(step: Joint, name: str, axis: Node, kind: str, notes: Notes) -> Joint:
    """A joint with what acts on it, and its limits."""
    limit = child(axis, 'limit')
    step = with_limits(step, name, limit, child(axis, 'dynamics'), of_element, notes)
    for key in ('stiffness', 'dissipation'):  # of the stops
        mark_used(child(limit, key))
    lower = number(limit, 'lower', -INFINITY, of_element)
    upper = number(limit, 'upper', INFINITY, of_element)
    if kind == 'continuous' or not step.kind.single:
        lower, upper = UNLIMITED
    return step._replace(
        lower=lower if lower > -FAR_END else -INFINITY,
        upper=upper if upper < FAR_END else INFINITY,
    )
