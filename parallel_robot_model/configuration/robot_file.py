"""The file of a robot's description as one text that needs no other file: MJCF, URDF, SDF."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree.ElementTree import Element
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import plain_data, yaml_file

# XML from untrusted sources: read with limits into elements that know their place, and written.

COMMENT, DECLARATION = re.compile(b'<!--.*?-->', re.DOTALL), b'<?xml'
DEEPEST = 200  # elements in one another
MOST_ELEMENTS = 100_000  # elements in all
MERGED_MARK = 'merged'  # the mark of a text whose lines are not those of one file
FILE = 'file'  # the mark of the name of the file that a text is from
TEXT = '#'  # in place of an attribute: the text of an element


class Node(Element):
    """An element of XML, which records what was read of it."""

    line = 0  # on which it begins
    source = ''  # what its file is called
    place = ''  # its file, and the line if that is the one in the file
    used = False  # whether it was read

    def __init__(self, *arguments: Any, **attributes: Any) -> None:
        super().__init__(*arguments, **attributes)
        self.requested: set[str] = set()  # attributes, kinds of elements in it, and TEXT

    def get(self, key: str, default: Any = None) -> Any:
        """An attribute."""
        self.requested.add(key)
        return super().get(key, default)


def parse_xml(content: bytes | str, source: str) -> Node:
    """Read XML without entities.

    Args:
        content: Text, or bytes in the encoding that they declare.
        source: What the text is called in messages.

    Returns:
        The outermost element.

    Raises:
        InputError: it is no XML, declares a document type or entities, is too deep or too long.
    """
    content = _forgiven(content)
    parser = expat.ParserCreate()
    building = _Building(source, parser)
    parser.StartElementHandler = building.start
    parser.EndElementHandler = building.end
    parser.CharacterDataHandler = building.text
    parser.StartDoctypeDeclHandler = building.refuse_doctype
    parser.ProcessingInstructionHandler = building.instruction
    parser.buffer_text = True
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(f'{source}, line {error.lineno}: not valid XML: {reason}') from None
    except (LookupError, ValueError) as error:  # of the encoding
        raise InputError(f'{source}: not valid XML: {printable(error)}') from None
    assert building.root is not None  # expat refuses a text without elements
    return building.root


def write_xml(root: Node, merged: bool = False, name: str = '') -> str:
    """A tree as XML whose elements begin on the lines where they were read.

    Args:
        root: The outermost element.
        merged: Whether the elements come from several files; then lines mean nothing.
        name: Of the file, which messages about the text name.
    """
    parts: list[str] = [f'<?{MERGED_MARK}?>'] if merged else []
    parts += [f'<?{FILE} {printable(name).replace("?>", "")}?>'] if name else []
    _write(root, parts, 1)
    return ''.join(parts) + '\n'


def children(node: Element, tag: str = '') -> list[Node]:
    """The elements in an element; those of one kind, which are then heard, if it is given."""
    found = [
        child for child in node if isinstance(child, Node) and child.tag == (tag or child.tag)
    ]
    if tag and isinstance(node, Node):
        node.requested.add(tag)
        for child in found:
            child.used = True
    return found


def describe(node: Node) -> str:
    """An element as a message calls it: by its kind and name."""
    name = node.get('name')
    return f'{node.tag} {printable(name)!r}' if name else f'<{printable(node.tag)}>'


def refused(node: Node, reason: str) -> InputError:
    """The error that says what is wrong with an element, and where it stands."""
    return InputError(f'{node.place}: {describe(node)} {reason}')


def _forgiven(content: bytes | str) -> bytes | str:
    """A text without what XML forbids and most readers of robots take: -- in comments, ..."""
    if isinstance(content, str):
        return content
    content = COMMENT.sub(lambda found: b'\n' * found[0].count(b'\n'), content)
    start = content.lstrip()
    if len(start) < len(content) and start.startswith(DECLARATION):  # ... and lines before <?xml
        content = content.replace(DECLARATION, b'<?late', 1)
    return content


class _Building:
    """A tree that grows with what the parser finds."""

    def __init__(self, source: str, parser: Any) -> None:
        self.root: Node | None = None
        self._source, self._parser, self._merged = source, parser, False
        self._open: list[Node] = []
        self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        node = Node(tag, attributes)
        node.line, node.source = self._parser.CurrentLineNumber, self._source
        node.place = self._source if self._merged else self._place()
        self._count += 1
        if len(self._open) == DEEPEST:
            raise InputError(f'{node.place}: more than {DEEPEST} elements in one another')
        if self._count > MOST_ELEMENTS:
            raise InputError(f'{node.place}: more than {MOST_ELEMENTS} elements')
        if self._open:
            self._open[-1].append(node)
        else:
            self.root = node
        self._open.append(node)

    def end(self, _: str) -> None:
        self._open.pop()

    def text(self, text: str) -> None:
        node = self._open[-1]
        node.text = (node.text or '') + text if text.strip() else node.text

    def refuse_doctype(self, *_: Any) -> None:
        raise InputError(f'{self._place()}: a robot needs no DOCTYPE and no entities')

    def instruction(self, target: str, data: str) -> None:
        self._merged = self._merged or target == MERGED_MARK
        if target == FILE and self.root is None:
            self._source = data

    def _place(self) -> str:
        return f'{self._source}, line {self._parser.CurrentLineNumber}'


def _write(node: Node, parts: list[str], line: int) -> int:
    """Append an element; return the line on which it ends."""
    if node.line > line:
        parts.append('\n' * (node.line - line))
        line = node.line
    parts.append(f'<{node.tag}')
    parts += (f' {name}={quoteattr(value)}' for name, value in node.items())
    text = (node.text or '').strip()
    if not text and not len(node):
        parts.append('/>')
        return line
    parts.append(f'>{escape(text)}')
    line += text.count('\n')
    for child in children(node):
        line = _write(child, parts, line)
    parts.append(f'</{node.tag}>')
    return line


# What closes the loops of a URDF, from the YAML file beside it.
#
# Source:
#     Batto, de Matteis, Mansard (2025), Extended URDF, arXiv 2504.04767: `closed_loop` are pairs
#     of frames that coincide, `type` says whether in position (3d) or in rotation, too (6d),
#     `name_mot` are the actuated joints, `joint_name` are those that are of the kinds
#     `joint_type`.

LOOP_KEYS = ('closed_loop', 'type', 'name_mot', 'joint_name', 'joint_type')


def _add_loops(robot: Node, path: Path) -> None:
    """Add what stands in the YAML file of the same name, if there is one, to a URDF.

    Elements `closed_loop` with `first`, `second` and `type`, `name_mot` and `joint_type` with
    `joint` and `type`.
    """
    beside = path.with_suffix('.yaml')
    if not beside.exists():
        return
    try:
        data = plain_data.load(yaml_file.text(beside))
    except ValueError as error:
        raise InputError(f'{beside}: {printable(error)}') from None
    if not isinstance(data, dict) or not set(LOOP_KEYS) & set(data):
        return
    lists = {key: _list(beside, key, data.get(key) or []) for key in LOOP_KEYS}
    kinds = lists['type'] or ['6d'] * len(lists['closed_loop'])
    for key, first, second in (
        ('type', lists['closed_loop'], kinds),
        ('joint_type', lists['joint_name'], lists['joint_type']),
    ):
        if len(first) != len(second):
            raise InputError(f'{beside}: {key} has {len(second)} values, not {len(first)}')
    for pair, kind in zip(lists['closed_loop'], kinds, strict=True):
        if not isinstance(pair, list) or len(pair) != 2:
            raise InputError(
                f'{beside}: closed_loop holds pairs of frames, not {printable(pair)!r}'
            )
        _append(robot, beside, 'closed_loop', first=pair[0], second=pair[1], type=kind)
    for joint in lists['name_mot']:
        _append(robot, beside, 'name_mot', joint=joint)
    for joint, kind in zip(lists['joint_name'], lists['joint_type'], strict=True):
        _append(robot, beside, 'joint_type', joint=joint, type=kind)


def _list(path: Path, key: str, value: Any) -> list[Any]:
    if isinstance(value, list):
        return value
    raise InputError(f'{path}: {key} must be a list, not {printable(value)!r}')


def _append(robot: Node, path: Path, tag: str, **attributes: Any) -> None:
    for name, value in attributes.items():
        if not isinstance(value, str):
            raise InputError(f'{path}: {tag}: {name} must be a name, not {printable(value)!r}')
    robot.append(Node(tag, attributes))


MOST_BYTES = 8 << 20  # bytes of a file
FILES = 100  # that one description may include
MACRO = 'holds macros; run `xacro {0} > robot.urdf` and name that file'

IDLE = {  # what of a URDF and an SDF has no effect on motion, wherever it stands
    # for the eye
    'visual', 'material', 'light', 'camera', 'gui', 'scene', 'projector', 'particle_emitter',
    'spherical_coordinates', 'actor', 'road',
    # contact and the way it is solved
    'collision', 'mu1', 'mu2', 'fdir1', 'kp', 'kd', 'selfCollide', 'self_collide', 'maxVel',
    'self_collision_checking', 'minDepth', 'maxContacts', 'max_contacts', 'laserRetro',
    'drake:collision_filter_group', 'ode', 'bullet', 'simbody', 'dart', 'max_step_size',
    'real_time_factor', 'real_time_update_rate', 'stopCfm', 'stopErp', 'cfmDamping',
    'implicitSpringDamper', 'fudgeFactor', 'allow_auto_disable', 'must_be_base_link',
    'preserveFixedJoint', 'disableFixedJointLumping',
    # sensors and software
    'sensor', 'plugin', 'audio', 'audio_sink', 'audio_source', 'battery', 'provideFeedback',
    'provide_feedback', 'state_interface', 'gpio', 'hardware', 'hardwareInterface', 'calibration',
    'magnetic_field', 'atmosphere', 'gripper', 'state', 'robotNamespace',
    # gears between a motor and the joint to which all limits refer
    'mechanicalReduction', 'mechanical_reduction', 'motorTorqueConstant',
}  # fmt: skip
DROPPED = {
    'mujoco': {
        'asset', 'visual', 'statistic', 'sensor', 'custom', 'size', 'light', 'camera', 'contact',
    },
    'robot': IDLE,
    'sdf': IDLE,
}  # fmt: skip


def text_of(path: str | Path) -> str:
    """The description of a robot as one text.

    What it includes from its folder stands in it; pictures, assets and comments are gone. Links
    that the YAML file of the same name beside a URDF closes become elements of it.

    Args:
        path: An MJCF, a URDF or an SDF file.

    Raises:
        InputError: there is no such file, it is no valid XML, holds no robot, or needs files
            outside its folder.
    """
    path = Path(path)
    if path.suffix == '.xacro':
        raise InputError(f'{path} {MACRO.format(path.name)}')
    root = _read(path)
    if root.tag not in DROPPED:
        raise InputError(
            f'{path} begins with <{printable(root.tag)}>; the description of a robot begins with '
            '<mujoco>, <robot> or <sdf>'
        )
    merged = root.tag == 'mujoco' and _Including(path).include(root)
    _drop(root, DROPPED[root.tag])
    if root.tag == 'mujoco':
        _drop_geometry(root)
    if root.tag == 'robot':
        _add_loops(root, path)
    return write_xml(root, merged, '' if root.tag == 'mujoco' else path.name)


def _read(path: Path) -> Node:
    """The outermost element of a file without macros."""
    root = parse_xml(yaml_file.content(path, MOST_BYTES), str(path))
    if any(str(node.tag).startswith('xacro:') for node in root.iter()):
        raise InputError(f'{path} {MACRO.format(path.name)}')
    return root


class _Including:
    """The files that an MJCF file includes, each once and from its own folder."""

    def __init__(self, path: Path) -> None:
        self._folder = path.parent
        self._seen = {path.resolve()}

    def include(self, parent: Node) -> bool:
        """Put the content of files in place of <include>; return whether there is one."""
        found = False
        for child in children(parent):
            if child.tag != 'include':
                found |= self.include(child)
                continue
            content = _read(self._file(child))
            self.include(content)
            place = list(parent).index(child)
            parent[place : place + 1] = list(content)
            found = True
        return found

    def _file(self, node: Node) -> Path:
        name = node.get('file', '')
        where = PurePosixPath(name)
        if not name or where.is_absolute() or '..' in where.parts or '\\' in name:
            raise refused(
                node, f'file={printable(name)!r}: it must name a file in the folder of the robot'
            )
        path = self._folder / where
        try:
            real = path.resolve()
        except (OSError, ValueError, RuntimeError):  # links in a circle, a null character
            raise refused(node, f'file={printable(name)!r} cannot be read') from None
        if not real.is_relative_to(self._folder.resolve()):
            raise refused(node, f'file={printable(name)!r} leads out of the folder of the robot')
        if real in self._seen:
            raise refused(node, f'file={printable(name)!r} is included twice')
        if len(self._seen) > FILES:
            raise refused(node, f'more than {FILES} files are included')
        self._seen.add(real)
        return path


def _drop(node: Node, tags: set[str]) -> None:
    """Remove elements, wherever they stand."""
    for child in children(node):
        if child.tag in tags:
            node.remove(child)
        else:
            _drop(child, tags)


def _drop_geometry(root: Node) -> None:
    """Remove the shapes of bodies whose inertia is written, and of what is fixed to the world."""
    if any(node.get('inertiafromgeom') == 'true' for node in root.iter('compiler')):
        return
    for world in children(root, 'worldbody'):
        _drop_shapes(world, True)


def _drop_shapes(body: Node, known: bool) -> None:
    """Remove the shapes of a body, and of frames in it, where its inertia is known otherwise."""
    for child in children(body):
        if child.tag == 'body':
            _drop_shapes(child, child.find('inertial') is not None)
        elif child.tag == 'geom' and known:
            body.remove(child)
        else:
            _drop_shapes(child, known)
