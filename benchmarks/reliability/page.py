"""Sections of docs/safety.md, each written by its own command."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from pathlib import Path

from reliability.endurance import Soak
from reliability.judging import BOUND, Outcome

from parallel_robot.bags.experiment import processor

PAGE = Path(__file__).parents[2] / 'docs' / 'safety.md'
NUMBER = re.compile(r'[-+]?\d+(?:\.\d+)?')
SUBJECT = re.compile(r'\b(?:trajectory|plant|controller|commands|references|states)\b')

HEAD = f"""\
| fault | reaction | worst error | below {1e3 * BOUND:g} mm again after | torque |
|---|---|---|---|---|
"""


def faults(outcomes: Sequence[Outcome], changed: Sequence[str]) -> str:
    """The section of the faults.

    Args:
        outcomes: The rows.
        changed: What differs from the defaults, as KEY=VALUE.
    """
    condition = f' with {", ".join(f"`{pair}`" for pair in changed)}' if changed else ''
    brief = [outcome._replace(reaction=said(outcome)) for outcome in outcomes]
    quiet = [outcome for outcome in brief if is_quiet(outcome)]
    rows = [row(outcome) for outcome in together([each for each in brief if each not in quiet])]
    lines = [f'Measured{condition} on {machine()}.\n', HEAD.rstrip(), *rows]
    if quiet:
        lines += ['', ridden_through(quiet)]
    failed = [outcome.fault for outcome in outcomes if outcome.failures]
    verdict = (
        f'What must not happen happened: {"; ".join(failed)}.'
        if failed
        else 'Nothing that must not happen happened.'
    )
    return '\n'.join([*lines, '', verdict])


def said(outcome: Outcome) -> str:
    """The reaction without what the nodes counted besides."""
    parts = outcome.reaction.split('; ')
    return '; '.join(part for part in parts if not part.startswith(('controller: ', 'plant: ')))


def is_quiet(outcome: Outcome) -> bool:
    """Whether nothing came of a fault that is worth a row."""
    return outcome.reaction == 'ridden through' and outcome.worst < BOUND and not outcome.failures


def together(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """One row, of the worst figures, for faults that differ in a number and led to the same."""
    kinds: dict[tuple[str, str, tuple[str, ...]], list[Outcome]] = {}
    for outcome in outcomes:
        kind = NUMBER.sub('#', outcome.fault, count=1)
        kinds.setdefault((kind, outcome.reaction, outcome.failures), []).append(outcome)
    rows = []
    for (_, reaction, failures), some in kinds.items():
        (name,) = joined([each.fault for each in some], NUMBER)
        times = [each.recovery for each in some if each.recovery is not None]
        recovery = max(times) if len(times) == len(some) else None
        worst, torque = max(each.worst for each in some), max(each.torque for each in some)
        rows.append(Outcome(name, reaction, worst, recovery, torque, failures))
    return rows


def joined(texts: Sequence[str], part: re.Pattern[str]) -> list[str]:
    """Texts of which those that differ in the first match of a pattern alone become one."""
    kinds: dict[str, list[str]] = {}
    for text in dict.fromkeys(texts):
        found = part.search(text)
        kinds.setdefault(part.sub('#', text, count=1), []).append(found[0] if found else '')
    return [kind.replace('#', ', '.join(parts)) for kind, parts in kinds.items()]


def ridden_through(quiet: Sequence[Outcome]) -> str:
    """The faults of which nothing came, in one sentence."""
    worst = length(max(outcome.worst for outcome in quiet))
    torque = max(outcome.torque for outcome in quiet)
    names = joined(joined([outcome.fault for outcome in quiet], NUMBER), SUBJECT)
    return f'Ridden through with at most {worst} and {torque:.1f} N m: {"; ".join(names)}.'


def row(outcome: Outcome) -> str:
    """A row of the table."""
    reaction = '; '.join([outcome.reaction, *(f'**{text}**' for text in outcome.failures)])
    cells = [
        outcome.fault,
        reaction,
        length(outcome.worst),
        duration(outcome),
        f'{outcome.torque:.1f} N m',
    ]
    return '| ' + ' | '.join(cell.replace('|', r'\|') for cell in cells) + ' |'


def soak(found: Soak) -> str:
    """The section of the long run."""
    lines = [
        f'Measured on {machine()}: {found.duration:g} s of motion. Memory: after the first minute,'
        ' and by how much it has grown at the end.\n',
        '| figure | value |',
        '|---|---|',
        f'| states in the bag | {found.states} of {found.expected} |',
        f'| rate by the clock of the recorder | {found.rate:.3f} of {found.nominal:g} 1/s |',
        f'| states answered | {found.answered} |',
        f'| messages missing, known to be lost | {found.missing}, {found.lost} |',
        f'| end-effector error over the second half, rms | {length(found.rms)} |',
    ]
    for name, memory in found.memory.items():
        grown = f'{memory.growth / 2**20:+.2f} MB'
        lines.append(f'| memory of {name} | {memory.first / 2**20:.1f} MB, {grown} |')
    verdict = '; '.join(found.failures) or 'Nothing grew, nothing was lost.'
    return '\n'.join([*lines, '', verdict])


def length(metres: float) -> str:
    """A length with two or three digits, as µm, mm or m."""
    if not metres < 1.0:
        return f'{metres:.1f} m'
    return f'{1e6 * metres:.0f} µm' if metres < 1e-3 else f'{1e3 * metres:.1f} mm'


def duration(outcome: Outcome) -> str:
    """Time to recover in words."""
    if outcome.recovery is None:
        return 'not'
    if outcome.worst < BOUND:
        return 'never above'
    return f'{outcome.recovery:.2f} s'


def machine() -> str:
    """What it was measured on."""
    cores, system = len(os.sched_getaffinity(0)), f'Linux {platform.release()}'
    named = f'{platform.machine()} ({processor()})'
    return f'{cores} cores {named}, {system}, Python {platform.python_version()}'


def replaced(page: str, name: str, content: str) -> str:
    """The page with the section between the marks of `name` replaced.

    Raises:
        ValueError: the page does not have these marks.
    """
    mark = re.compile(rf'(<!-- {name} -->\n).*?(<!-- end of {name} -->)', re.DOTALL)
    if not mark.search(page):
        raise ValueError(f'no section {name!r}')
    return mark.sub(lambda found: f'{found[1]}{content.strip()}\n{found[2]}', page, count=1)


def write(name: str, content: str, page: Path = PAGE) -> None:
    """Replace a section of the page on disk; the others stay."""
    page.write_text(replaced(page.read_text(), name, content))
