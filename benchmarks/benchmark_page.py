"""docs/benchmarks.md: what was measured in plain words, beside the figures of a run of all.py."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rows import Row, cells

PAGE = Path(__file__).parents[1] / 'docs' / 'benchmarks.md'
HEAD = """\
# Benchmarks

Written by `make bench`, which runs all of [benchmarks/](../benchmarks) in turn and keeps every
figure in `runs/bench_DATE.json`. Each figure is a median, behind it in brackets the smallest, the
largest and the number of rounds; a target is for the median. A peer is measured in the same
process or in turns, a ratio is that of one round.
"""
TEXTS = {
    'kernels': (
        'Plant and closed loop, beside MuJoCo',
        """\
Time of a step of 1 ms, without ROS. *Plant* is the robot alone, with friction; *closed loop* adds
S-FOTSMC, all limits and checks and the record of the run. MuJoCo runs in its own loop in C,
without a controller: the same robot as three legs held to the platform by constraints, with the
viscous friction alone. An hour is run second by second.""",
    ),
    'machines': (
        'Machines from descriptions, beside MuJoCo and Pinocchio',
        """\
Processor time of a call. *Posture and model*: loops closed, M, Q and gravity. `mj_step` steps the
same machine with soft constraints and without control. Pinocchio, if it is installed, computes
the accelerations of the same joints and contacts. *Simulate, real time* is simulated over spent
time of a whole run under S-FOTSMC.""",
    ),
    'calibration': (
        'Calibration',
        """\
24 robots each, off by 1 mm and 2 mrad, measured with 10 um of noise in the poses of `calibrate
--design`.""",
    ),
    'reading': (
        'Reading a bag',
        """\
From a bag on disk to aligned arrays. `AnyReader` of rosbags only deserialises the messages of the
same topics.""",
    ),
    'length': (
        'Long runs',
        """\
Processor time and largest resident memory of commands on an hour of motion at 1 kHz, start
included.""",
    ),
    'sweep': (
        'Sweeps',
        """\
1000 runs of 12 s of motion, with uncertain masses and friction, start and summary included, are
to take 15 s on two idle cores. Each sample's limit is computed once for all laws; with one law,
as here, each run pays for one.""",
    ),
    'laws': (
        'Control laws',
        """\
One cycle of each law, as a kernel and in the controller node, from the bytes of a state to the
published command. The loop has 1000 us.""",
    ),
    'native': (
        'A law as native code',
        """\
The library of the FMU of S-FOTSMC in a host of C at 1 kHz, with SCHED_FIFO and locked memory, and
the controller node, beside two busy processes for each core. In each cycle the host also spins for
as long as a cycle takes, without memory: what the worst spin takes more than its median is the
machine's, and so it is in a cycle.""",
    ),
    'estimators': (
        'Kalman filter',
        """\
Processor time of a control cycle under S-FOTSMC with all limits and checks, over recorded states.
States 3 ms late are predicted over three more periods.""",
    ),
    'player': (
        'Player',
        'What arrives at a subscriber of three topics of 1 kHz, beside what is in the bag.',
    ),
    'recorder': ('Recorder', 'Six topics of 1 kHz, recorded for a minute.'),
    'nodes': (
        'Nodes',
        'The four nodes ([what each figure means](../benchmarks/README.md#the-nodes)).',
    ),
}
BESIDE = {  # figures of one thing that stand in one row: the ends of their names
    'machines': (
        ', posture and model',
        ', acceleration',
        ', margins',
        ', mj_step',
        ', mj_step, times that',
        ', simulate, real time',
    ),
    'calibration': (
        ', truths in their 95 % intervals',
        ', true error before',
        ', true error after 40 poses',
        ', the same, worst robot',
    ),
    'length': ('', ', memory'),
    'laws': (', kernel', ', node, bytes to command'),
    'native': (', median', ', 99.99 %', ', worst'),
}


def page(found: dict[str, Any]) -> str:
    """The page.

    Args:
        found: What all.py has measured.
    """
    parts = [HEAD, f'Measured on {machine(found)}.\n']
    for name, outcome in found['benchmarks'].items():
        title, text = TEXTS[name]
        words = ' '.join(['.venv/bin/python', f'benchmarks/{name}.py', *outcome['arguments']])
        figures = table(outcome['rows'], BESIDE.get(name, ('',)))
        parts.append(f'## {title}\n\n{text}\n\n{figures}\n\n`{words}`\n')
    return '\n'.join(parts)


def machine(found: dict[str, Any]) -> str:
    """Machine, versions and date in a sentence."""
    of = found['machine']
    versions = ', '.join(f'{name} {version}' for name, version in of['versions'].items())
    return (
        f'{of["processor"]}, {of["cores"]} cores, {of["system"]}, at a load of '
        f'{of["load_average"]:.1f} before the start; Python {of["python"]}, {versions}; '
        f'{found["date"][:10]}, revision {of["revision"]}'
    )


def table(rows: list[Row], ends: tuple[str, ...]) -> str:
    """Figures of one thing as one row, or as an item of a list: median, spread and verdict.

    Args:
        rows: Figures.
        ends: What their names end with, a column each; the first also has what ends otherwise.
    """
    units = {end: {row['unit'] for row in rows if _end(row, ends) == end} for end in ends}
    shared = {end: of.pop() for end, of in units.items() if len(of) == 1 < len(ends)}
    told = {end: f' [{unit}]' for end, unit in shared.items() if unit not in ('', 'x')}
    heads = [(end.removeprefix(', ') or 'median') + told.get(end, '') for end in ends]
    lines = [f'| figure | {" | ".join(heads)} |', '|---' * (len(ends) + 1) + '|']
    found: dict[str, dict[str, str]] = {}
    for row in rows:
        end = _end(row, ends)
        median, span, verdict = cells(row | {'unit': ''} if end in shared else row)
        figure = f'{median} ({span}, {row["count"]})' if row['count'] > 1 else median
        beside = found.setdefault(row['name'].removesuffix(end), {})
        beside[end] = f'{figure}; {verdict}' if verdict else figure
    if len(ends) == 1:
        return '\n'.join(f'- {name}: {texts[ends[0]]}' for name, texts in found.items())
    for name, texts in found.items():
        lines.append(f'| {name} | {" | ".join(texts.get(end, "") for end in ends)} |')
    return '\n'.join(lines)


def _end(row: Row, ends: tuple[str, ...]) -> str:
    """The longest of the ends that the name of a figure has, else the first."""
    return max((end for end in ends if row['name'].endswith(end)), key=len, default=ends[0])
