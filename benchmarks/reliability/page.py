"""Sections of docs/safety.md, each written by its own command."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from pathlib import Path

from reliability.endurance import Soak
from reliability.judging import BOUND, Outcome

PAGE = Path(__file__).parents[2] / 'docs' / 'safety.md'


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
    rows = [row(outcome) for outcome in brief if outcome not in quiet]
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


def ridden_through(quiet: Sequence[Outcome]) -> str:
    """The faults of which nothing came, in one sentence; those that differ in a number as one."""
    worst = length(max(outcome.worst for outcome in quiet))
    torque = max(outcome.torque for outcome in quiet)
    kinds: dict[str, list[str]] = {}
    for outcome in quiet:
        number = re.search(r'\d+', outcome.fault)
        kind = re.sub(r'\d+', '#', outcome.fault, count=1)
        kinds.setdefault(kind, []).append(number[0] if number else '')
    names = '; '.join(kind.replace('#', ', '.join(numbers)) for kind, numbers in kinds.items())
    return f'Ridden through with at most {worst} and {torque:.1f} N m: {names}.'


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
        f'Measured on {machine()}: {found.duration:g} s of motion.\n',
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
        size = f'{memory.first / 2**20:.1f} MB after the first minute'
        lines.append(f'| memory of {name} | {size}, {grown} until the end |')
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
    model = ''
    for line in Path('/proc/cpuinfo').read_text().splitlines():
        if line.startswith('model name'):
            model = f' ({line.partition(":")[2].strip()})'
            break
    cores = len(os.sched_getaffinity(0))
    python = platform.python_version()
    return (
        f'{cores} cores {platform.machine()}{model}, Linux {platform.release()}, Python {python}'
    )


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
