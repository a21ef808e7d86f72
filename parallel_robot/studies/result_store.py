"""A directory of results that goes on after a kill: one process writes it, files are whole."""

from __future__ import annotations

import abc
import contextlib
import fcntl
import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, ClassVar, TypeVar

from parallel_robot_model.common.errors import InputError, RunError

LOCK = 'lock'
UNFINISHED = '.unfinished'  # suffix of a file that is being written
Self = TypeVar('Self', bound='ResultStore')  # typing has it from Python 3.11 on


class ResultStore(abc.ABC):
    """A context manager that holds the lock of a directory with a manifest.

    Results are kept as soon as they are added: as lines of JSON, or as files that are complete or
    not there.
    """

    KIND: ClassVar[str]  # what it holds the results of
    MANIFEST: ClassVar[str]  # file that tells whose results these are
    FIRST: ClassVar[Collection[str]] = ()  # what else may be there before the manifest is
    FORMAT: ClassVar[str]  # entry ``format`` of the manifest

    def __init__(self, directory: Path, identity: Mapping[str, Any]) -> None:
        """Prepare to open it, or to go on in it.

        Args:
            directory: The directory.
            identity: What its results depend on, plain data by name; another one is refused.
        """
        self.directory = directory
        self._identity = json.loads(json.dumps(dict(identity)))
        self.new = False  # whether it had no manifest when it was opened
        self._lock: IO[str] | None = None

    def __enter__(self: Self) -> Self:
        """Lock the directory and read it.

        Raises:
            InputError: it holds something else, is locked, or cannot be written.
        """
        try:
            self._claim()
            self._open()
        except OSError as error:
            self.__exit__(type(error), error)
            raise InputError(f'cannot write to {self.directory}: {error.strerror}') from None
        except BaseException as error:
            self.__exit__(type(error), error)
            raise
        return self

    def __exit__(self, kind: object, error: object, *_: object) -> None:
        if self._lock is not None:
            self._lock.close()

    @abc.abstractmethod
    def _open(self) -> None:
        """Read what is there, or write the first files; the directory is locked."""

    @abc.abstractmethod
    def _kept(self) -> str:
        """How much is kept when no more can be written."""

    @contextlib.contextmanager
    def writing(self, path: Path) -> Iterator[IO[bytes]]:
        """Write a file that is complete, or as it was.

        Raises:
            RunError: it cannot be written.
        """
        unfinished = path.with_name(path.name + UNFINISHED)
        try:
            with unfinished.open('wb') as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(unfinished, path)
        except OSError as error:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise self._full(path, error) from None

    def _full(self, path: Path, error: OSError) -> RunError:
        cause = error.strerror or error
        kept = f'{self._kept()} are kept, the same command continues'
        return RunError(f'cannot write {path}: {cause}; {kept}')

    def write(self, name: str, content: bytes) -> None:
        """Write a file in place of an older one; it is complete or as it was.

        Raises:
            RunError: it cannot be written.
        """
        with self.writing(self.directory / name) as stream:
            stream.write(content)

    def _identify(self) -> None:
        """Write what the results depend on, or refuse to mix those that depend on another one."""
        if self.new:
            self._write_manifest()
            return
        found = self.manifest(self.directory)
        for key, value in self._identity.items():
            if found.get(key) != value:
                what = f'{self.directory} holds a {self.KIND} with another {key}'
                raise InputError(f'{what}; choose another --out')

    def _write_manifest(self) -> None:
        text = json.dumps({'format': self.FORMAT, **self._identity}, indent=1)
        self.write(self.MANIFEST, text.encode())

    def append(self, name: str, entries: Iterable[Any]) -> None:
        """Add entries to a file, one line of JSON each.

        Raises:
            RunError: they cannot be written.
        """
        path = self.directory / name
        text = ''.join(json.dumps(entry) + '\n' for entry in entries)
        try:
            with path.open('a') as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise self._full(path, error) from None

    def read(self, name: str, take: Callable[[Any], None]) -> None:
        """Take the entries of a file, without a last one that a kill or a full disk cut.

        Raises:
            InputError: it has others.
        """
        path = self.directory / name
        with path.open('ab+') as stream:
            stream.seek(0)
            content = stream.read()
            whole = content[: content.rfind(b'\n') + 1]
            stream.truncate(len(whole))
        try:
            for line in whole.splitlines():
                take(json.loads(line))
        except (TypeError, ValueError):
            raise InputError(f'{path} cannot be read; choose another --out') from None

    @classmethod
    def manifest(cls, directory: Path) -> dict[str, Any]:
        """Content of the manifest in `directory`.

        Raises:
            InputError: there is none, or it is that of something else.
        """
        path = directory / cls.MANIFEST
        try:
            found: Any = json.loads(path.read_text())
        except OSError as error:
            what = f'{directory} is not the directory of a {cls.KIND}: {error.strerror}'
            raise InputError(what) from None
        except ValueError:
            found = None
        if not isinstance(found, dict) or found.get('format') != cls.FORMAT:
            what = f'{path} is not that of a {cls.KIND} of this version; choose another --out'
            raise InputError(what)
        return found

    def _claim(self) -> None:
        """Make and lock the directory; remove files that a kill left unfinished."""
        known = {self.MANIFEST, *self.FIRST}
        manifest = self.directory / self.MANIFEST
        if self.directory.exists() and not manifest.exists():
            others = {path.name.removesuffix(UNFINISHED) for path in self.directory.iterdir()}
            if others - {LOCK, *known}:
                what = f'{self.directory} is not the directory of a {self.KIND}'
                raise InputError(f'{what}; choose another --out')
        self.directory.mkdir(parents=True, exist_ok=True)
        self._lock = (self.directory / LOCK).open('w')
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f'another {self.KIND} is writing to {self.directory}') from None
        self.new = not manifest.exists()
        for folder in (self.directory, *(self.directory / name for name in self.FIRST)):
            for path in folder.glob(f'*{UNFINISHED}'):
                path.unlink()
