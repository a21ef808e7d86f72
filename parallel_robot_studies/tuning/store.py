"""The directory of a tuning: its trials, each kept as soon as it has ended, whatever happens.

They stand in a journal of optuna, so that its tools show them; error and effort are the two
objectives of each.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from parallel_robot_base.errors import InputError, RunError, first_line
from parallel_robot_studies.tuning.sampler import FRONT, distributions, frozen, library
from parallel_robot_studies.tuning.space import Space
from parallel_robot_studies.tuning.trial import Trial

FORMAT = 'parallel_robot tune 1'
MANIFEST, JOURNAL, LOCK = 'tune.json', 'journal.log', 'lock'
UNFINISHED = '.unfinished'  # suffix of a file that is being written
STUDY = 'tuning'  # name of the study in the journal


class _Locked:
    """A lock for the journal that does nothing: the lock of the directory is enough.

    That of optuna would outlive a process that is killed, for half a minute.
    """

    def acquire(self) -> bool:
        """Succeed."""
        return True

    def release(self) -> None:
        """Do nothing."""


class Store:
    """The directory of a tuning; a context manager that holds its lock.

    Attributes:
        directory: The directory.
        trials: Finished trials by number.
    """

    def __init__(self, directory: Path, space: Space, identity: Mapping[str, Any]) -> None:
        """Prepare the directory for a tuning, or to go on in it.

        Args:
            directory: The directory.
            space: The search space.
            identity: What the trials depend on, plain data by name; another one is refused.

        Raises:
            InputError: the directory holds something else, or cannot be written; when it is
                entered.
        """
        self.directory = directory
        self.trials: dict[int, Trial] = {}
        self._space = space
        self._identity = json.loads(json.dumps(dict(identity)))
        self._lock: IO[str] | None = None
        self._study: Any = None

    def __enter__(self) -> Store:
        """Open the directory; see the constructor for errors."""
        try:
            self._open()
        except OSError as error:
            self.__exit__(None, None, None)
            raise InputError(f'cannot write to {self.directory}: {error.strerror}') from None
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Release the lock."""
        if self._lock is not None:
            self._lock.close()

    def add(self, trial: Trial) -> None:
        """Keep a finished trial.

        Raises:
            RunError: it cannot be written.
        """
        entry = frozen(trial, distributions(self._space), FRONT)
        entry.set_user_attr('number', trial.number)
        entry.set_user_attr('gains', dict(trial.gains))
        if trial.reason:
            entry.set_user_attr('reason', trial.reason)
        try:
            self._study.add_trial(entry)
        except OSError as error:
            raise self._full(self.directory / JOURNAL, error) from None
        self.trials[trial.number] = trial

    def write(self, name: str, content: bytes) -> None:
        """Write a file in place of an older one; it is complete or as it was.

        Raises:
            RunError: it cannot be written.
        """
        try:
            self._replace(self.directory / name, content)
        except OSError as error:
            raise self._full(self.directory / name, error) from None

    def _full(self, path: Path, error: OSError) -> RunError:
        kept = f'{len(self.trials)} trials are kept, the same command continues'
        return RunError(f'cannot write {path}: {error.strerror}; {kept}')

    def _open(self) -> None:
        manifest = self.directory / MANIFEST
        if self.directory.exists() and not manifest.exists():
            others = {path.name for path in self.directory.iterdir()}
            if others - {LOCK, MANIFEST + UNFINISHED}:
                raise InputError(
                    f'{self.directory} is not the directory of a tuning; choose another --out'
                )
        self.directory.mkdir(parents=True, exist_ok=True)
        self._lock = (self.directory / LOCK).open('w')
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f'another tuning is writing to {self.directory}') from None
        if manifest.exists():
            self._check(manifest)
        else:
            content = {'format': FORMAT, **self._identity}
            self._replace(manifest, json.dumps(content, indent=1).encode())
        for path in self.directory.glob(f'*{UNFINISHED}'):
            path.unlink()
        self._load()

    def _check(self, manifest: Path) -> None:
        """Refuse to mix trials that depend on different things.

        Raises:
            InputError: the tuning in the directory is another one.
        """
        try:
            found: Any = json.loads(manifest.read_text())
        except ValueError:
            found = None
        if not isinstance(found, dict) or found.get('format') != FORMAT:
            raise InputError(f'{manifest} is not that of a tuning; choose another --out')
        for key, value in self._identity.items():
            if found.get(key) != value:
                raise InputError(
                    f'{self.directory} holds a tuning with another {key}; choose another --out'
                )

    def _load(self) -> None:
        """Read the trials of the journal, without a last line that a kill or a full disk cut."""
        optuna = library()
        journal = self.directory / JOURNAL
        with journal.open('ab+') as stream:
            stream.seek(0)
            content = stream.read()
            stream.truncate(content.rfind(b'\n') + 1)
        backend = optuna.storages.journal.JournalFileBackend(str(journal), lock_obj=_Locked())
        try:
            self._study = optuna.create_study(
                storage=optuna.storages.JournalStorage(backend),
                study_name=STUDY,
                directions=['minimize', 'minimize'],
                load_if_exists=True,
            )
            for entry in self._study.trials:
                trial = _read(entry)
                self.trials.setdefault(trial.number, trial)
        except OSError:
            raise
        except Exception as error:  # optuna raises anything on a line that it did not write
            what = f'{journal} cannot be read ({first_line(error)})'
            raise InputError(f'{what}; choose another --out') from None

    @staticmethod
    def _replace(path: Path, content: bytes) -> None:
        unfinished = path.with_name(path.name + UNFINISHED)
        try:
            with unfinished.open('wb') as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(unfinished, path)
        except OSError:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise


def _read(entry: Any) -> Trial:
    """A trial of the journal."""
    attributes = entry.user_attrs
    number, gains = attributes['number'], attributes['gains']
    chosen = dict(entry.params) or None
    if 'reason' in attributes:
        violation = sum(entry.constraints.values())
        return Trial(number, chosen, gains, violation=violation, reason=attributes['reason'])
    return Trial(number, chosen, gains, *entry.values)
