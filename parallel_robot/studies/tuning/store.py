"""The directory of a tuning: its trials, each kept as soon as it has ended, whatever happens.

They stand in a journal of optuna, so that its tools show them; error and effort are the two
objectives of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from parallel_robot.studies.locked_directory import LockedDirectory
from parallel_robot.studies.tuning.space import Space
from parallel_robot.studies.tuning.trial import FRONT, Trial, distributions, frozen, library
from parallel_robot_model.common.errors import InputError, first_line

JOURNAL = 'journal.log'
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


class Store(LockedDirectory):
    """The directory of a tuning."""

    KIND = 'tuning'
    MANIFEST = 'tune.json'
    FORMAT = 'parallel_robot tune 1'

    def __init__(self, directory: Path, space: Space, identity: Mapping[str, Any]) -> None:
        """Prepare the directory for a tuning, or to go on in it.

        Args:
            directory: The directory.
            space: The search space.
            identity: What the trials depend on, plain data by name; another one is refused.
        """
        super().__init__(directory, identity)
        self.trials: dict[int, Trial] = {}  # finished trials by number
        self._space = space
        self._study: Any = None

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

    def _kept(self) -> str:
        return f'{len(self.trials)} trials'

    def _open(self) -> None:
        self._identify()
        self._load()

    def _load(self) -> None:
        """Read the trials of the journal, without a last line that a kill or a full disk cut."""
        optuna = library()
        journal = self.directory / JOURNAL
        self._whole_lines(JOURNAL)
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


def _read(entry: Any) -> Trial:
    """A trial of the journal."""
    attributes = entry.user_attrs
    number, gains = attributes['number'], attributes['gains']
    chosen = dict(entry.params) or None
    if 'reason' in attributes:
        violation = sum(entry.constraints.values())
        return Trial(number, chosen, gains, violation=violation, reason=attributes['reason'])
    return Trial(number, chosen, gains, *entry.values)
