"""The files of a bag: which they are, each opened safely, and what metadata.yaml says."""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
import re
import shutil
import stat
import tempfile
from pathlib import Path
from typing import IO, NamedTuple

import zstandard

from parallel_robot.bags.limits import CHUNK, MEMORY, RATIO, YAML, Allowance
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.configuration import plain_data

SUFFIXES = ('.mcap', '.db3', '.bag')  # which of them are there decides
FEW = 5  # bags of a directory that are named
PIECE = 1 << 20  # bytes that are unpacked at once


class File(NamedTuple):
    """Content of a file of a bag, and the allowance for reading it."""

    data: memoryview
    allowance: Allowance


def files(bag: Path) -> list[Path]:
    """The files of a bag, in the order of recording: MCAP, else of other kinds.

    Raises:
        BagError: there are none.
    """
    try:
        names = {path.name for path in bag.iterdir()} if bag.is_dir() else set()
        there = bag.is_file()
        exists = bag.exists()
    except OSError as error:
        raise BagError(f'{bag} cannot be read: {error.strerror}') from None
    if not exists:
        raise BagError(f'{bag} does not exist')
    if there:
        return [bag]
    for suffix in SUFFIXES:
        packed = f'{suffix}.zstd'
        found = {name for name in names if name.endswith(suffix)}
        found |= {name for name in names if name.endswith(packed) and name[:-5] not in names}
        if found:
            return [bag / name for name in sorted(found, key=_numbers_by_value)]
    inside = sorted(path.name for path in bag.glob('*') if _holds_files(path))
    if inside:
        several = f'{", ".join(inside[:FEW])}{" ..." if len(inside) > FEW else ""}'
        raise BagError(f'{bag} is not a bag, but holds bags: {several}; give one of them')
    raise BagError(f'{bag} is not a bag: no MCAP file there')


def open_file(path: Path, memory: int = MEMORY) -> File:
    """Open a file of a bag: map it into memory, after unpacking it if it is compressed as a whole.

    Args:
        path: The file.
        memory: What may be held of it [bytes].

    Raises:
        BagError: it cannot be read, or takes more than is allowed.
    """
    try:
        with _regular(path) as stream:
            size = os.fstat(stream.fileno()).st_size
            allowance = Allowance(path, size, memory)
            if path.suffix != '.zstd':
                return File(_mapped(stream), allowance)
            with tempfile.TemporaryFile() as unpacked:
                _unpack(path, stream, max(CHUNK, RATIO * size), unpacked)
                return File(_mapped(unpacked), allowance)
    except OSError as error:
        raise BagError(f'{path} cannot be read: {error.strerror}') from None


def release(data: memoryview) -> None:
    """Give up the memory that reading a file took; what is needed again is read again."""
    if isinstance(data.obj, mmap.mmap):
        data.obj.madvise(mmap.MADV_DONTNEED)


def custom_data(bag: Path) -> dict[str, str]:
    """What metadata.yaml says about the experiment; empty when it is missing or broken."""
    directory = bag if bag.is_dir() else bag.parent
    try:
        with _regular(directory / 'metadata.yaml') as stream:
            text = stream.read(YAML + 1).decode()
        found = plain_data.load(text, YAML)
        facts = found['rosbag2_bagfile_information']['custom_data']
        return {key: str(value) for key, value in facts.items()} if 'config' in facts else {}
    except Exception:  # a broken file can hold anything
        return {}


def _holds_files(path: Path) -> bool:
    """Whether it is a directory with files of a bag."""
    try:
        return path.is_dir() and any(
            file.name.removesuffix('.zstd').endswith(SUFFIXES) for file in path.iterdir()
        )
    except OSError:
        return False


def _regular(path: Path) -> IO[bytes]:
    """Open a regular file and nothing else: reading a pipe would block."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(errno.EINVAL, 'not a file', str(path))
    return open(number, 'rb')


def _unpack(path: Path, packed: IO[bytes], most: int, unpacked: IO[bytes]) -> None:
    """Unpack a file up to where it is broken."""
    free = shutil.disk_usage(tempfile.gettempdir()).free // 2
    with contextlib.suppress(zstandard.ZstdError):  # the rest is lost
        pieces = zstandard.ZstdDecompressor().read_to_iter(packed, write_size=PIECE)
        for piece in pieces:
            unpacked.write(piece)
            if unpacked.tell() > most:
                raise BagError(f'{path} unpacks to more than {RATIO} times its size')
            if unpacked.tell() > free:
                where = tempfile.gettempdir()
                raise BagError(f'{path} unpacks to more than half of what is free in {where}')
    unpacked.flush()


def _mapped(stream: IO[bytes]) -> memoryview:
    if stream.seek(0, 2) == 0:  # an empty file cannot be mapped
        return memoryview(b'')
    return memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))


def _numbers_by_value(name: str) -> list[tuple[int, str]]:
    """Key that sorts bag_10 after bag_9."""
    return [(int(part or 0), text) for text, part in re.findall(r'(\D*)(\d*)', name)]


# What a bag certifies of each topic: how many messages were written, and how many were lost.


class Certificate(NamedTuple):
    """Messages of one topic."""

    written: int  # how many are in the bag
    lost: int | None  # how many are known to be missing; None when that is not known

    def __str__(self) -> str:
        return f'written {self.written}, lost {"unknown" if self.lost is None else self.lost}'

    def dump(self) -> str:
        """As a bag holds it: JSON."""
        return plain_data.dump(self._asdict())


def lost(text: str) -> int:
    """Number of lost messages from the text in a bag; 0 when it does not say."""
    number = plain_data.mapping(text).get('lost')
    return number if type(number) is int and number > 0 else 0


# Names of the metadata records that the suite writes into a bag.

ROSBAG2 = 'rosbag2'  # what is in metadata.yaml, as ROS's recorder writes it
METADATA = 'parallel_robot'  # facts of the experiment; prefix of all the others
MESSAGES = 'parallel_robot_messages'  # written and lost messages by topic
PARAMETERS = 'parallel_robot_parameters'  # parameters of a node at the start
CHANGES = 'parallel_robot_changes'  # a later change of parameters
MISSING = {  # why the file of a custom module is not attached, by file
    'custom_laws': 'parallel_robot_missing_laws',
    'custom_robots': 'parallel_robot_missing_robots',
    'custom_trajectories': 'parallel_robot_missing_trajectories',
}
