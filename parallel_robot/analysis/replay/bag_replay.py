"""The torques of a bag computed again, by its law or another, and what comes of it in words."""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis import pictures
from parallel_robot.analysis.replay import replayed
from parallel_robot.analysis.replay.replayed import Replay, Totals
from parallel_robot.analysis.report import figures
from parallel_robot.analysis.thinned import Curves
from parallel_robot.bags import experiment
from parallel_robot.bags.bag_reader import AS_RECORDED, OF_BAG, BagView, view
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recording, run_log
from parallel_robot.bags.run.recorded_robot import SECONDS
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.bags.run.run_windows import AlikeLines
from parallel_robot.bags.trust import check_held_code, custom_files
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import available, configure, load
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.errors import BagError, InputError, WholeNeededError
from parallel_robot_model.common.options import named, optional_path, path
from parallel_robot_model.common.tables import Part, ShownResult
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.config import Place, changes
from parallel_robot_model.configuration.plain_data import LocatedDict

# Beginnings of keys on which torques depend, beside those of the laws.
GROUPS = ('controller', 'estimator', 'lock_in', 'approach', 'repetition', 'safety')
USED = ('law', *config.CUSTOM, 'robot', *GROUPS)


@dataclass(frozen=True, repr=False)
class BagReplay(ShownResult):
    """Torques of a bag that were computed again: N states, n joints."""

    log: RunLog  # the run of the bag
    law: str  # the law that computed them
    result: Replay  # the torques
    changed: bool  # whether it was another law, or other gains
    warnings: tuple[str, ...]  # what to know of the bag and of differences, one line each

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
        return parts_of(self.log, self.law, self._totals, self.changed)

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        return data_of(self.log, self.law, self._totals)

    @property
    def _totals(self) -> Totals:
        return replayed.totals_of(self.time, self.result)

    def save_figure(self, path: Path) -> None:
        """Draw both torques into a file, which must not exist.

        Raises:
            InputError: it cannot be written.
        """
        figures.draw_torques(self.log, self.torque, self.law, path)


@dataclass(frozen=True, repr=False)
class ReplayFigures(ShownResult):
    """What came of torques of a bag that were computed again, without them."""

    log: RunLog  # the first part of the run
    law: str  # the law that computed them
    totals: Totals  # the figures
    changed: bool  # whether it was another law, or other gains
    warnings: tuple[str, ...]  # what to know of the bag and of differences, one line each
    # time [s], recorded commands and torques [N m], as far as they can be seen
    curves: tuple[Array, Array, Array]
    figure: str = ''  # where it is drawn, in words

    def file_lines(self) -> list[str]:
        """The picture."""
        return [f'figure  {self.figure}'] if self.figure else []

    @property
    def failed(self) -> bool:
        """Whether commands differ that should not."""
        return not self.changed and self.totals.remembered and self.totals.differing > 0

    def parts(self) -> list[Part]:
        """What came of it."""
        return parts_of(self.log, self.law, self.totals, self.changed)

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        return data_of(self.log, self.law, self.totals)

    def save_figure(self, path: Path) -> None:
        """Draw both torques into a file, which must not exist.

        Raises:
            InputError: it cannot be written.
        """
        time, recorded, torque = self.curves
        figures.draw_torques(self.log._replace(time=time, answer=recorded), torque, self.law, path)


@dataclass(frozen=True)
class Prepared:
    """A bag that is to be replayed, and the configuration of its controller."""

    bag: Path
    log: RunLog  # the run, or the first window of it
    past: History  # what happened beside the motion
    values: Mapping[str, Any]  # the configuration
    changed: bool  # whether it is another than the recorded one
    # first and last time of the part that is compared [s], None: of the run
    window: tuple[float | None, float | None] = (None, None)
    # the windows after the first one; None: the log is the whole run
    rest: Iterator[Recording] | None = None

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
            warnings += tuple(filter(None, [experiment.arithmetic_doubt(self.past.facts)]))
        return BagReplay(log, self.law, result, self.changed, warnings)

    def add_up(self) -> ReplayFigures:
        """Compute the torques window by window and keep the figures alone.

        Raises:
            BagError: a state has no pose, or there is none in the part that is compared.
            WholeNeededError: the bag cannot be read in windows.
            InputError: a value is wrong.
        """
        parts = replayed.InParts(self.past, configure(self.values), not self.changed)
        found: Totals | None = None
        curves, told = Curves(), AlikeLines()
        first, last = (
            end or sign * math.inf for end, sign in zip(self.window, (-1, 1), strict=True)
        )
        for log, is_last in with_last(self.log, self.rest or iter(())):
            told.take(self.bag, log)
            log, result = parts.answered(log, is_last)
            if not len(log.time):
                continue
            shown = (log.time >= first) & (log.time <= last)
            result = result._replace(torque=result.torque[shown], recorded=result.recorded[shown])
            part = replayed.totals_of(log.time[shown], result)
            found = part if found is None else found.and_then(part)
            curves.add(log.time[shown], np.hstack([result.recorded, result.torque]))
        if found is None or not found.states:
            if self.rest is None:
                run_log.between(self.bag, self.log, *self.window)  # says what there is
            raise WholeNeededError(f'{self.bag} has no state between --from and --to')
        warnings = told.lines
        if not self.changed and found.differing:
            warnings += tuple(filter(None, [experiment.arithmetic_doubt(self.past.facts)]))
        time, both = curves.time, curves.values
        recorded, torque = np.hsplit(both, 2)
        return ReplayFigures(
            self.log, self.law, found, self.changed, warnings, (time, recorded, torque)
        )


def with_last(first: RunLog, rest: Iterator[Recording]) -> Iterator[tuple[RunLog, bool]]:
    """The windows of a run, each with whether it is the last one."""
    for after in rest:
        yield first, False
        first = after.log
    yield first, True


def parts_of(log: RunLog, law: str, found: Totals, is_changed: bool) -> list[Part]:
    """What came of a replay: of a run by a law, and whether that is another one."""
    head = f'{log.scenario}, {log.law}: {found.answered} states answered again by {law}'
    if is_changed:
        return [head, found.table(log.joints, log.units)]
    return [head, *found.verdict(log.used is not None, log.units)]


def data_of(log: RunLog, law: str, found: Totals) -> dict[str, Any]:
    """The same as plain data."""
    return {
        'scenario': log.scenario,
        'law': log.law,
        'answered_by': law,
        'states': found.states,
        'commands': found.known,
        'differing': found.differing,
        'late': found.late,
        log.units.key('difference_nm'): {
            name: dict(zip(log.joints, map(float, values), strict=True))
            for name, values in found.differences().items()
        },
    }


def replay(
    bag: Place,
    *,
    law: Place | None = None,
    figure: Place | None = None,
    trust: bool = False,
    memory: int = MEMORY,
    **options: Any,
) -> BagReplay:
    """Compute the torques of a bag again, as ``parallel_robot replay`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/replayed')
    >>> pr.replay('runs/replayed')
    paper_circle, smc: 501 states answered again by smc
    identical: 501 commands
    >>> pr.replay('runs/replayed', **{'smc.z': 20}).torque.shape
    (501, 3)

    Args:
        bag: Directory of a bag, or one file of it.
        law: Control law, or its file; default: the recorded one.
        figure: Picture of both torques, .png, .pdf or .svg, which must not exist; default: of the
            command, with another law or other gains, BAG/replay_LAW.png in a bag of the suite.
        trust: Whether the code of laws, robot and trajectory that the bag holds runs, with all
            your rights; on a terminal, it is shown first.
        memory: What may be held of the bag [bytes].
        options: Keys of the configuration of the controller that change, and their values; and
            what the bag does not say itself, see ``load``.

    Returns:
        Its ``torque`` beside the ``recorded`` one, and how many are ``differing``.

    Raises:
        BagError: not a bag of a run, or it needs code that it does not hold or that may not run.
        InputError: a key or a value is wrong, or the figure cannot be written.
    """
    place, changed, asked, picture = _asked(bag, law, figure, options)
    with prepared(place, changed, trust, memory, asked) as ready:
        found = ready.compute()
    if picture:
        found.save_figure(picture)
    return found


@functools.wraps(replay, assigned=())
def replayed_in_windows(
    bag: Place, *, law: Any = None, figure: Any = None, trust: bool = False, **options: Any
) -> ReplayFigures:
    """The same of a bag of any length, window by window, for the command."""
    place, changed, asked, picture = _asked(bag, law, figure, options)

    def figures_of(seconds: float | None) -> tuple[ReplayFigures, Path | None, str]:
        where, place_of = picture, place if place.is_dir() else place.parent
        with prepared(place, changed, trust, MEMORY, asked, seconds) as ready:
            if ready.changed and where is None:
                if ready.log.foreign:
                    return ready.add_up(), None, figures.NOT_IN_FOREIGN
                where = place_of / f'replay_{ready.law}.png'
                pictures.check_new(where)
            return ready.add_up(), where, str(where or '')

    try:
        found, where, told = figures_of(SECONDS)
    except WholeNeededError:
        found, where, told = figures_of(None)
    if where is not None:
        found.save_figure(where)
    return replace(found, figure=told)


def _asked(
    bag: Place, law: Place | None, figure: Place | None, options: dict[str, Any]
) -> tuple[Path, LocatedDict, BagView, Path | None]:
    """Bag, what changes, how the bag is read, and the picture, checked."""
    asked = view(**{name: options.pop(name) for name in OF_BAG if name in options})
    changed = changes(options.pop('param_file', None), options)
    if law is not None:
        of_law = law_loader.chosen(named('law', law), changed)
        if changed.get('law', of_law['law']) != of_law['law']:
            raise InputError(f'--law is {law}, but --set law={changed["law"]}')
        changed |= of_law
    picture = optional_path('figure', figure)
    if picture:
        pictures.check_new(picture)
    return path('a bag', bag), changed, asked, picture


@contextmanager
def prepared(
    bag: Path,
    changes: Mapping[str, Any],
    trust: bool = False,
    memory: int = MEMORY,
    view: BagView = AS_RECORDED,
    seconds: float | None = None,
) -> Iterator[Prepared]:
    """Read a bag that is to be replayed; the code that it holds stands in files meanwhile.

    Args:
        bag: Directory of the bag, or its MCAP file.
        changes: Key to value, of what changes in the configuration of its controller.
        trust: Whether its code may run.
        memory: What may be held of it [bytes].
        view: What it does not say itself, and which part is compared.
        seconds: Length of the windows in which it is read [s]; None: at once.

    Raises:
        WholeNeededError: it cannot be read in windows.
        BagError: it is no bag of a run, no command answers a state, or it needs code that it does
            not hold or that may not run.
        InputError: a change is wrong.
    """
    spare = {key: value for key, value in changes.items() if key != 'law'}
    whole = view._replace(whole=True, spare=spare)  # a law remembers what was before
    rest = None
    if seconds is None:
        log, past, _ = recording.read(bag, memory=memory, view=whole)
    else:
        rest = recording.chunks(
            bag, seconds, memory=memory, view=whole._replace(start=None, stop=None)
        )
        log, past, _ = next(rest)
    if not past.facts:  # the others say of what robot the bag is
        changes = {key: value for key, value in changes.items() if _is_used(key, changes)}
    if np.isnan(log.answer).all() or not (log.used is None or log.used.stamps.any()):
        kind = BagError if seconds is None else WholeNeededError
        raise kind(f'{bag}: no command answers a state')
    with tempfile.TemporaryDirectory() as directory:
        needed = {key: found for key, found in past.sources.items() if key not in changes}
        if changes.get('law') in LAWS:
            needed.pop('custom_laws', None)
        files = custom_files(bag, needed, log.config, Path(directory), trust)
        values = configuration(log, past, files, changes)
        law = str(values['law'])
        if law not in available(values['custom_laws']) and not changes:
            what = 'say which law ran' if law == 'unknown' else f'hold the law {law}'
            raise BagError(
                f'{bag} does not {what}; --law tries one, --set custom_laws=[FILE] adds one'
            )
        check_held_code(bag, values, addable=True)
        yield Prepared(bag, log, past, values, bool(changes), (view.start, view.stop), rest)


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
