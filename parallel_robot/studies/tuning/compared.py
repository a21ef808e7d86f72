"""Fronts of several tunings from what is asked of them to the file, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from parallel_robot.bags import output
from parallel_robot.studies.tuning import equal_effort, held_out, trial
from parallel_robot.studies.tuning.front import (
    FORMATS,
    Front,
    check_fronts,
    draw_fronts,
    fronts_data,
    fronts_table,
    read_front,
)
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.tables import Part, ShownResult


@dataclass(frozen=True, repr=False)
class Compared(ShownResult):
    """Fronts of several tunings.

    Attributes:
        fronts: The fronts.
        effort: At which effort laws are compared [unit of its column]; None: at none.
        out: The file that was written.
    """

    fronts: Sequence[Front]
    effort: float | None
    out: Path

    def parts(self) -> list[Part]:
        """The trials that were taken, or the laws at the effort."""
        if self.effort is None:
            return [fronts_table(self.fronts)]
        return equal_effort.parts(equal_effort.reached(self.fronts, self.effort), self.effort)

    def as_data(self) -> list[dict[str, Any]]:
        """The same as plain data; without an effort, all points of the fronts."""
        if self.effort is None:
            return fronts_data(self.fronts)
        return equal_effort.as_data(equal_effort.reached(self.fronts, self.effort), self.effort)


def compare(
    directories: Sequence[Path],
    out: Path,
    effort: str | None = None,
    study: str | None = None,
    sweep: Path | None = None,
    option: str = 'out',
) -> Compared:
    """Compare the fronts of some tunings.

    Args:
        directories: Each the results of a tuning that has ended.
        out: A picture, or with `study` a file of a study; must not exist.
        effort: ``MEASURE=VALUE``, at which laws are compared.
        study: Study whose samples are to judge the trials around the effort.
        sweep: Directory of a sweep of those, whose medians take the place of the searches'.
        option: What `out` is called in messages.

    Raises:
        InputError: one has no front, they cannot be compared, or the file cannot be written.
        RunError: the disk is full.
    """
    formats = FORMATS if study is None else ('.yaml', '.yml')
    if out.suffix not in formats:
        raise InputError(f'{option} must end with {" or ".join(formats)}, not {out.name!r}')
    output.check_new(out, option)
    if not directories:
        raise InputError('directories of tunings are needed')
    found = [read_front(directory) for directory in directories]
    check_fronts(found)
    if sweep is not None:
        found = held_out.judged(found, sweep)
    limit = None if effort is None else _limit(effort, found[0])
    compared = Compared(found, limit, out)
    compared.parts()  # may refuse them
    if study is None:
        content = draw_fronts(found, limit)[out.suffix.removeprefix('.')]
    elif limit is None or sweep is not None:
        raise InputError('--study needs --effort MEASURE=VALUE, and no --sweep')
    else:
        content = held_out.study_of(found, limit, study).encode()
    output.save(out, content)
    return compared


def _limit(text: str, front: Front) -> float:
    """The effort that is asked for."""
    asked = trial.parse_effort(text)
    measure = front.manifest['measure of effort']
    if asked.measure != measure or asked.limit is None:
        raise InputError(f'--effort must be {measure}=VALUE, as the tunings have it, not {text!r}')
    return asked.limit
