"""Machines of a folder beside MuJoCo, or Pinocchio for URDF: what agrees, differs or is refused.

Usage: python benchmarks/descriptions.py FOLDER_OR_FILE ... [--format markdown]

Each file is read as `parallel_robot verify` reads it, and held at six postures against what the
engine makes of it; where it is refused for joints that nothing drives, these are held. A row has
the largest differences relative to the largest element of inertia, gravity with springs, and
dampers; then what differs by more than 1e-9, or why it is not read. The exit code is 1 where
something differs.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import checkout  # noqa: F401

from parallel_robot.studies.file_in_engine import Compared, compare
from parallel_robot.studies.verification import values_of
from parallel_robot_model.common.errors import InputError, ParallelRobotError
from parallel_robot_model.common.tables import FORMATS, Table, text
from parallel_robot_model.configuration.robot_file import text_of
from parallel_robot_model.mechanisms.description.machine import read
from parallel_robot_model.mechanisms.joint_kinds import BALL
from parallel_robot_model.robots.registry import robot_of

KINDS = '.xml', '.urdf', '.mjcf'
FIGURES = 'inertia', 'gravity and springs', 'dampers'
HEAD = 'file', *FIGURES, 'differs, or is refused'


class Row(NamedTuple):
    """A file beside an engine."""

    file: str  # below the folder
    compared: tuple[Compared, ...]  # the quantities; none where it is refused
    refused: str = ''  # why it is not read, or not compared

    @property
    def agrees(self) -> bool:
        """Whether nothing differs."""
        return all(each.agrees for each in self.compared)

    @property
    def cells(self) -> Sequence[str]:
        """Of the table."""
        shares = {each.what: f'{each.share:.0e}' if each.share else '0' for each in self.compared}
        differing = '; '.join(each.text() for each in self.compared if not each.agrees)
        return [self.file, *(shares.get(what, '') for what in FIGURES), self.refused or differing]


def row_of(path: Path, folder: Path) -> Row:
    """Hold one file against its engine."""
    name = str(path.relative_to(folder)) if path != folder else path.name
    try:
        text = text_of(path)
        try:
            found = _held_against(path, text, [])
        except InputError:
            if not (idle := _idle(text)):
                raise
            found = _held_against(path, text, idle)
    except ParallelRobotError as error:
        return Row(name, (), str(error).replace(f'{path}', path.name))
    return Row(name, tuple(found))


def _held_against(path: Path, text: str, held: list[str]) -> list[Compared]:
    given = {'robot_model': 'machine', 'robot_description': text, 'robot.held': held}
    return compare(robot_of(values_of(given)), path)[1]


def _idle(text: str) -> list[str]:
    """Joints that nothing drives, of a machine without loops some of whose joints are driven."""
    found = read(text)
    if found.loops or not found.actuators:
        return []
    led = {each.joint for each in found.actuators}
    for first, second in 2 * [(each.joint, each.other) for each in found.couplings]:
        led |= {first, second} if {first, second} & led else set()
    led |= {each.joint for each in found.couplings}
    axes = {BALL: ('.x', '.y', '.z')}
    loose = [joint for joint in found.joints if joint.name not in led]
    return [joint.name + axis for joint in loose for axis in axes.get(joint.kind, ('',))]


def files(places: Sequence[Path]) -> Iterator[tuple[Path, Path]]:
    """Descriptions, each with the folder that it was found in."""
    for place in places:
        found = [place] if place.is_file() else sorted(place.rglob('*'))
        yield from ((path, place) for path in found if path.suffix in KINDS)


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('places', nargs='+', type=Path, metavar='FOLDER_OR_FILE')
    parser.add_argument('--format', choices=FORMATS)
    given = parser.parse_args(words)
    warnings.simplefilter('ignore')  # of what is left out of a file: what differs is told
    rows = [row_of(path, folder) for path, folder in files(given.places)]
    refused = sum(bool(row.refused) for row in rows)
    differ = sum(not row.agrees for row in rows)
    counts = f'{len(rows) - refused - differ} agree, {differ} differ, {refused} are refused'
    table = Table(HEAD, [row.cells for row in rows], 'lrrrl')
    print(FORMATS.get(given.format, text)([f'{len(rows)} files: {counts}', table]))
    return 1 if differ else 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
