"""What the suite writes: new files, printable text, the progress of long work."""

from __future__ import annotations

import codecs
import contextlib
import errno
import io
import os
import re
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, TextIO, TypeVar

from parallel_robot_model.common.errors import (
    BagError,
    InputError,
    ParallelRobotError,
    RunError,
    printable,
)

# New files and directories: complete or not at all, and never in place of existing ones.

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def check_new(path: Path, option: str) -> None:
    """Refuse a file that exists or cannot be made; the message names the option.

    Raises:
        InputError: with the reason.
        RunError: the disk is full.
    """
    with asked_for(path):
        if path.exists() or path.is_symlink():
            raise InputError(f'{path} exists; nothing is overwritten, choose another {option}')
        _check_place(path)


def _check_place(path: Path) -> None:
    """Refuse a place where nothing can be made, without leaving a trace; an OSError says why."""
    parent = next(parent for parent in path.absolute().parents if parent.exists())
    with tempfile.TemporaryDirectory(dir=parent):
        pass


def write_new(path: Path, content: bytes | memoryview) -> None:
    """Write a file that must not exist.

    Raises:
        OSError: it exists or cannot be written; with its name.
    """
    file = path.open('xb')
    try:
        with file:
            file.write(content)
    except OSError as error:
        path.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from None
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def save(path: Path, content: bytes | memoryview) -> None:
    """Write the file that a command was asked for, which must not exist.

    Raises:
        InputError: it exists or cannot be written there.
        RunError: the disk is full.
    """
    with asked_for(path), in_its_folder(path):
        write_new(path, content)


@contextlib.contextmanager
def asked_for(path: Path, full: type[ParallelRobotError] = RunError) -> Iterator[None]:
    """Say in a line why what a command was asked for cannot be written; `full`: of a full disk."""
    try:
        yield
    except OSError as error:
        kind = full if error.errno in FULL else InputError
        raise kind(f'cannot write {path}: {error.strerror}') from None


@contextlib.contextmanager
def in_its_folder(path: Path) -> Iterator[None]:
    """Make the folder of what is written in the block; it goes again when that fails."""
    folder = path.absolute().parent
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        if made:
            folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for each in made:
            with contextlib.suppress(OSError):  # somebody else has put something there
                each.rmdir()
        raise


@contextlib.contextmanager
def growing(path: Path) -> Iterator[IO[bytes]]:
    """Write the file that a command was asked for, which must not exist, piece by piece.

    It is there when the block ends well; until then, a file beside it grows.

    Raises:
        InputError: it exists or cannot be written there.
        RunError: the disk is full.
    """
    with asked_for(path), in_its_folder(path):
        draft = path.with_name(f'.{path.name}.{os.getpid()}.part')
        file = draft.open('xb')
        try:
            with file:
                yield file
            _rename(draft, path)
        finally:
            draft.unlink(missing_ok=True)


def _rename(draft: Path, path: Path) -> None:
    """Give a file another name, which must not be that of a file."""
    try:
        path.hardlink_to(draft)
    except FileExistsError:
        raise
    except OSError:  # no file system knows links
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST)) from None
        draft.rename(path)


def save_directory(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write the directory that a command was asked for, which must not exist.

    Raises:
        InputError: it exists or cannot be written there.
        RunError: the disk is full.
    """
    with (
        asked_for(path),
        in_its_folder(path),
        tempfile.TemporaryDirectory(dir=path.absolute().parent) as folder,
    ):
        draft = Path(folder) / path.name
        for name, content in contents.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            write_new(draft / name, content)
        path.mkdir()  # none that exists, not even an empty one, is replaced
        draft.rename(path)


@contextlib.contextmanager
def written(path: Path, content: bytes) -> Iterator[None]:
    """Write a file that stays only when the block succeeds.

    Raises:
        InputError: it exists or cannot be written.
        RunError: the disk is full.
    """
    with contextlib.ExitStack() as folder:
        with asked_for(path):
            folder.enter_context(in_its_folder(path))
            write_new(path, content)
        try:
            yield
        except BaseException:
            path.unlink(missing_ok=True)
            raise


def create_directory(directory: str | Path) -> Path:
    """Make the directory of a new bag.

    Raises:
        BagError: it exists or cannot be created.
    """
    directory = Path(directory)
    check_directory(directory)
    try:
        directory.mkdir(parents=True)
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None
    return directory


def check_directory(directory: str | Path, option: str = '--out') -> None:
    """Refuse a directory that exists or cannot be made; the message names the option.

    Raises:
        BagError: with the reason.
    """
    directory = Path(directory)
    try:
        if directory.exists():
            raise BagError(f'{directory} exists; nothing is overwritten, choose another {option}')
        _check_place(directory)
    except OSError as error:
        raise BagError(f'cannot write to {directory}: {error.strerror}') from None


# Output without the control characters of untrusted texts.

MAX_LINE_LENGTH = 2000  # characters of what a terminal gets
ASCII = re.compile(r'[ -~\n]*')
SPELLED, REPLACED = 'parallel_robot.spelled', {'µ': 'u'}  # a handler of codecs, what it spells


def without_mathematics(text: str) -> str:
    """The text as matplotlib draws it literally, dollar signs included."""
    return text.replace('$', r'\$')


class PrintableStream:
    """A stream that removes control characters from lines; everything else is delegated."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream  # where the lines go

    def write(self, text: str) -> int:
        """Write lines."""
        if len(text) > MAX_LINE_LENGTH or ASCII.fullmatch(text) is None:
            text = '\n'.join(printable(line, MAX_LINE_LENGTH) for line in text.split('\n'))
        self.stream.write(text)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def spell(stream: TextIO) -> None:
    """Make a stream write what its encoding lacks in other letters, um for µm, or as ``?``."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors=SPELLED)


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return ''.join(REPLACED.get(letter, '?') for letter in lacking), error.end


codecs.register_error(SPELLED, _spelled)


def as_it_is(stream: TextIO) -> TextIO:
    """The stream behind a PrintableStream, for escape sequences of our own."""
    return stream.stream if isinstance(stream, PrintableStream) else stream


interactive = False  # whether a command runs, whose user is told what Python's is not


@contextlib.contextmanager
def printable_output() -> Iterator[None]:
    """Keep escape sequences in untrusted names and texts off the terminal of a command."""
    global interactive
    out, err, before = PrintableStream(sys.stdout), PrintableStream(sys.stderr), interactive
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        interactive = True
        try:
            yield
        finally:
            interactive = before


# Progress of long work: a bar on a terminal that is removed at the end, nothing in a pipe.

Item = TypeVar('Item')

QUIET = 1.0  # s of work before a bar appears
UPDATE_INTERVAL = 0.1  # s between two updates
WIDTH = 30  # characters of the bar
CLEAR = '\r\x1b[K'


class Progress:
    """A progress bar; use as a context manager, so that it is removed at the end."""

    def __init__(self, total: float | None, unit: str = '') -> None:
        """Prepare; `total` is what :meth:`show` counts up to, in a unit; None: nobody knows."""
        self._total = total
        self._unit = f' {unit}' if unit else ''
        self._stream = as_it_is(sys.stderr)
        self._terminal = self._stream.isatty()
        self._next = time.monotonic() + QUIET
        self._drawn = False

    def show(self, done: float, what: str = '') -> None:
        """Draw how much is done, if an update is due."""
        if not self._terminal or time.monotonic() < self._next:
            return
        line = f'{done:.6g}'
        if self._total is not None:
            share = min(1.0, done / self._total) if self._total else 1.0
            line = f'[{"#" * round(WIDTH * share):<{WIDTH}}] {line} of {self._total:.6g}'
        print(f'{CLEAR}{line}{self._unit} {what}', end='', file=self._stream, flush=True)
        self._next = time.monotonic() + UPDATE_INTERVAL
        self._drawn = True

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._drawn:
            print(CLEAR, end='', file=self._stream, flush=True)


def tracked(items: Iterable[Item], total: int | None, unit: str) -> Iterator[Item]:
    """Pass items on and show how many of them are done, of a total if it is known."""
    with Progress(total, unit) as progress:
        for done, item in enumerate(items):
            progress.show(done)
            yield item
