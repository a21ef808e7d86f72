"""The file of a robot's description as one text that needs no other file: MJCF, URDF, SDF."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import robot_loops, xml_tree, yaml_file
from parallel_robot_model.configuration.xml_tree import Node, children, refused

MOST = 8 << 20  # bytes of a file
FILES = 100  # that one description may include
MACRO = 'holds macros; run `xacro {0} > robot.urdf` and name that file'

PICTURES = {'visual', 'collision', 'material', 'sensor', 'light', 'camera', 'gazebo', 'plugin'}
DROPPED = {
    'mujoco': {
        'asset', 'visual', 'statistic', 'sensor', 'custom', 'size', 'light', 'camera', 'contact',
    },
    'robot': PICTURES,
    'sdf': PICTURES | {'gui', 'scene', 'physics', 'audio', 'wind', 'spherical_coordinates'},
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
        robot_loops.add(root, path)
    return xml_tree.write(root, merged)


def _read(path: Path) -> Node:
    """The outermost element of a file without macros."""
    root = xml_tree.parse(yaml_file.content(path, MOST), str(path))
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
