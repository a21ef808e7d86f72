"""The torques of a bag computed again, by its law or another, and what comes of it in words."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.replay import replayed
from parallel_robot.analysis.replay.replayed import Replay
from parallel_robot.analysis.report import figures
from parallel_robot.bags import arithmetic, held_code, recording, run_log
from parallel_robot.bags.bag_view import AS_RECORDED, BagView
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run_log import RunLog
from parallel_robot.bags.trust import custom_files
from parallel_robot_control.configuration import available, configure, load
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.arrays import Array
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.common.shown_result import ShownResult
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.configuration import config

# Beginnings of keys on which torques depend, beside those of the laws.
GROUPS = ('controller', 'estimator', 'lock_in', 'approach', 'safety')
USED = ('law', *config.CUSTOM, 'robot', *GROUPS)


@dataclass(frozen=True, repr=False)
class BagReplay(ShownResult):
    """Torques of a bag that were computed again: N states, n joints.

    Attributes:
        log: The run of the bag.
        law: The law that computed them.
        result: The torques.
        changed: Whether it was another law, or other gains.
        warnings: What to know of the bag and of differences, one line each.
    """

    log: RunLog
    law: str
    result: Replay
    changed: bool
    warnings: tuple[str, ...]

    @property
    def time(self) -> Array:
        """Since the start [s], shape (N,)."""
        return self.log.time

    @property
    def torque(self) -> Array:
        """Torques computed again, NaN where no command was [N m], shape (N, n)."""
        return self.result.torque

    @property
    def recorded(self) -> Array:
        """The recorded commands, NaN where there is none [N m], shape (N, n)."""
        return self.result.recorded

    @property
    def differing(self) -> int:
        """How many commands are not the recorded ones, bit for bit."""
        return int(self.result.differing.sum())

    @property
    def late(self) -> int:
        """How many states were answered with a reference that came late."""
        return self.result.late

    @property
    def failed(self) -> bool:
        """Whether commands differ that should not."""
        return not self.changed and self.result.remembered and self.differing > 0

    def parts(self) -> list[Part]:
        """What came of it."""
        answered = int((~np.isnan(self.torque[:, 0])).sum())
        head = (
            f'{self.log.scenario}, {self.log.law}: {answered} states answered again by {self.law}'
        )
        if self.changed:
            return [head, table(self.log, self.result)]
        return [head, *verdict(self.log, self.result)]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            'scenario': self.log.scenario,
            'law': self.log.law,
            'answered_by': self.law,
            'states': len(self.torque),
            'commands': int(self.result.known.sum()),
            'differing': self.differing,
            'late': self.late,
            'difference_nm': {
                name: dict(zip(self.log.joints, map(float, values), strict=True))
                for name, values in _differences(self.result).items()
            },
        }

    def save_figure(self, path: Path) -> None:
        """Draw both torques into a file, which must not exist.

        Raises:
            InputError: it cannot be written.
        """
        try:
            figures.draw_torques(self.log, self.torque, self.law, path)
        except OSError as error:
            raise InputError(f'cannot write {path}: {error.strerror}') from None


@dataclass(frozen=True)
class Prepared:
    """A bag that is to be replayed, and the configuration of its controller.

    Attributes:
        bag: The bag.
        log: The run.
        past: What happened beside the motion.
        values: The configuration.
        changed: Whether it is another than the recorded one.
        window: First and last time of the part that is compared [s], None: of the run.
    """

    bag: Path
    log: RunLog
    past: History
    values: Mapping[str, Any]
    changed: bool
    window: tuple[float | None, float | None] = (None, None)

    @property
    def law(self) -> str:
        """The law that is to compute the torques."""
        return str(self.values['law'])

    def compute(self) -> BagReplay:
        """Compute the torques.

        Raises:
            BagError: a state has no pose.
            InputError: a value is wrong.
        """
        compute = replayed.instead if self.changed else replayed.again
        result = compute(self.log, self.past, configure(self.values))
        log, warnings = run_log.between(self.bag, self.log, *self.window), self.log.warnings
        shown = np.isin(self.log.time, log.time)
        result = result._replace(torque=result.torque[shown], recorded=result.recorded[shown])
        if not self.changed and result.differing.any():
            warnings += tuple(filter(None, [arithmetic.doubt(self.past.facts)]))
        return BagReplay(log, self.law, result, self.changed, warnings)


@contextmanager
def prepared(
    bag: Path,
    changes: Mapping[str, Any],
    trust: bool = False,
    memory: int = MEMORY,
    told: bool = True,
    view: BagView = AS_RECORDED,
) -> Iterator[Prepared]:
    """Read a bag that is to be replayed; the code that it holds stands in files meanwhile.

    Args:
        bag: Directory of the bag, or its MCAP file.
        changes: Key to value, of what changes in the configuration of its controller.
        trust: Whether its code may run.
        memory: What may be held of it [bytes].
        told: Whether the user is told what code runs, see :func:`custom_files`.
        view: What it does not say itself, and which part is compared.

    Raises:
        BagError: it is no bag of a run, no command answers a state, or it needs code that it does
            not hold or that may not run.
        InputError: a change is wrong.
    """
    spare = {key: value for key, value in changes.items() if key != 'law'}
    whole = view._replace(whole=True, spare=spare)  # a law remembers what was before
    log, past, _ = recording.read(bag, memory=memory, view=whole)
    if not past.facts:  # the others say of what robot the bag is
        changes = {key: value for key, value in changes.items() if _is_used(key, changes)}
    if np.isnan(log.answer).all() or not (log.used is None or log.used.stamps.any()):
        raise BagError(f'{bag}: no command answers a state')
    with tempfile.TemporaryDirectory() as directory:
        needed = {key: found for key, found in past.sources.items() if key not in changes}
        if changes.get('law') in LAWS:
            needed.pop('custom_laws', None)
        files = custom_files(bag, needed, log.config, Path(directory), trust, told)
        values = configuration(log, past, files, changes)
        law = str(values['law'])
        if law not in available(values['custom_laws']) and not changes:
            what = 'say which law ran' if law == 'unknown' else f'hold the law {law}'
            raise BagError(
                f'{bag} does not {what}; --law tries one, --set custom_laws=[FILE] adds one'
            )
        held_code.check(bag, values, addable=True)
        yield Prepared(bag, log, past, values, bool(changes), (view.start, view.stop))


def configuration(
    log: RunLog, past: History, files: Mapping[str, list[str]], changes: Mapping[str, Any]
) -> dict[str, Any]:
    """Configuration of a bag's controller at the first state, with changes.

    Args:
        log: The run.
        past: What happened beside the motion.
        files: Custom modules by key; files that the bag only names are not loaded.
        changes: Key to value.

    Raises:
        InputError: a key does not exist, is not one of the controller, or its value is wrong.
    """
    known = log.config | {key: [] for key in config.CUSTOM}
    values = config.changed(known, files, load(files))
    for node, parameters in past.parameters.items():
        if node.endswith('/controller'):
            values |= {
                key: value
                for key, value in parameters.items()
                if key in values and key not in config.CUSTOM
            }
    values = config.changed(values, changes, load({**values, **changes}))
    for key in changes:
        if not _is_used(key, values):
            raise InputError(f'{key} does not change the torques on a recorded motion')
    return values


def _is_used(key: str, values: Mapping[str, Any]) -> bool:
    """Whether torques depend on a key of the configuration."""
    return key.partition('.')[0] in (*USED, *available(values.get('custom_laws', [])))


def verdict(log: RunLog, result: replayed.Replay) -> list[str]:
    """Whether the torques are the recorded commands."""
    count, differing = int(result.known.sum()), np.flatnonzero(result.differing)
    lines = []
    if result.late:
        lines.append(f'{result.late} states were answered with a reference that came late')
    if count < len(result.known):
        what = 'have no recorded command' if log.used is None else 'were not answered'
        lines.append(f'{len(result.known) - count} states {what}')
    if not differing.size:
        return [*lines, f'identical: {count} commands']
    difference = np.abs(result.torque - result.recorded)[differing].max()
    if not result.remembered:
        lines.append(
            'not compared: the bag begins while the controller ran, and what law and estimator '
            'remembered then is not in it; with an empty memory:'
        )
    return [
        *lines,
        f'{differing.size} of {count} commands differ, by up to {difference:.3g} N m, '
        f'from t = {log.time[differing[0]]:.3f} s on',
    ]


def table(log: RunLog, result: replayed.Replay) -> Table:
    """Difference to the recorded commands, joint by joint."""
    rows = _differences(result)
    cells = [[name, *(f'{value:.3f}' for value in values)] for name, values in rows.items()]
    return Table(['difference of torques [N m]', *log.joints], cells)


def _differences(result: replayed.Replay) -> dict[str, Array]:
    """Differences to the recorded commands [N m], each shape (n,)."""
    difference = (result.torque - result.recorded)[result.known]
    return {
        'rms': np.sqrt((difference**2).mean(axis=0)),
        'max': np.abs(difference).max(axis=0, initial=0.0),
    }
