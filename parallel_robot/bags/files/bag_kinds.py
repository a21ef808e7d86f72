"""What a file of a bag is: MCAP, which is scanned; sqlite3, likewise; or what it is instead."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from parallel_robot.bags.files import mcap_records, sqlite_records
from parallel_robot.bags.files.bag_files import File
from parallel_robot.bags.files.chunk_table import ChunkTable
from parallel_robot.bags.files.mcap_records import Record
from parallel_robot_model.common.errors import BagError

SQLITE = b'SQLite format 3\0'
POINTER = b'version https://git-lfs.github.com/spec/'
ROS1 = b'#ROSBAG V'
PACKERS = {
    b'\x1f\x8b': 'gzip',
    b'BZh': 'bzip2',
    b'\xfd7zXZ\0': 'xz',
    b'PK\3\4': 'zip',
    b"7z\xbc\xaf'\x1c": '7z',
}
HEADER = 4096  # bytes that hold its header
INDEXED = b'index_pos='  # of the header, before the place of the index
NO_INDEX = INDEXED + bytes(8)


def records(path: Path, file: File, skipped: Collection[int] = ()) -> Iterator[Record]:
    """What a file of a bag holds, as records of MCAP.

    Args:
        path: Its path, for what is beside it, and for error messages.
        file: Its content.
        skipped: Where chunks begin that are not wanted.

    Raises:
        BagError: it is of a kind that is not read, it cannot be read, or takes too much.
    """
    if is_sqlite(file):
        return sqlite_records.scan(path, file, skipped)
    check(path, file)
    return mcap_records.scan(*file, skipped)


def is_sqlite(file: File) -> bool:
    """Whether a file is one of sqlite3."""
    return file.data[: len(SQLITE)] == SQLITE


def index(path: Path, file: File) -> tuple[list[Any], ChunkTable] | None:
    """What the summary of a file without one would hold; None where more is wrong with it.

    Args:
        path: Its path, for what is beside it, and for error messages.
        file: Its content.

    Raises:
        BagError: it takes too much.
    """
    chunks = ChunkTable()
    if is_sqlite(file):
        found = sqlite_records.index(path, file, chunks)
    else:
        found = mcap_records.index(*file, chunks)
    return None if found is None else (found, chunks)


def check(path: Path, file: File) -> None:
    """Refuse a file of another kind than MCAP, with what helps.

    Raises:
        BagError: it is one.
    """
    begin = bytes(file.data[:64])
    if begin.startswith(SQLITE):
        what = 'is a sqlite3 bag, which has no index'
        raise BagError(f'{path} {what}; parallel_robot recover makes an MCAP bag of it')
    if begin.startswith(POINTER):
        what = 'is a pointer of Git LFS in place of the bag'
        raise BagError(f'{path} {what}: git lfs pull, in its repository, gets the bag')
    if begin.startswith(ROS1):
        if INDEXED not in bytes(file.data[:HEADER]) or NO_INDEX in bytes(file.data[:HEADER]):
            what = 'is a bag of ROS 1 without its index'
            raise BagError(f'{path} {what}: rosbag reindex, of ROS 1, first makes it')
        source, new = shlex.quote(str(path)), shlex.quote(f'{path.with_suffix("").name}_ros2')
        convert = f'rosbags-convert --src {source} --dst {new} --dst-storage mcap'
        raise BagError(f'{path} is a bag of ROS 1: {convert} makes one that is read')
    if not begin:
        raise BagError(f'{path} is empty')
    for first, packer in PACKERS.items():
        if begin.startswith(first):
            raise BagError(f'{path} is packed by {packer}: unpack it first')
    if path.name == 'metadata.yaml':
        raise BagError(f'{path} says what a bag holds: give its directory, {path.parent}')
