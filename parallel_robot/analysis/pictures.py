"""Pictures: their colours, how they begin, and how they become files."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple

from parallel_robot.bags import output
from parallel_robot.bags.output import without_mathematics
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.errors import InputError, UnknownNameError

FORMATS = ('.png', '.pdf', '.svg')
UNDATED: dict[str, dict[str, Any]] = {'pdf': {'CreationDate': None}, 'svg': {'Date': None}}

# Colours and dashes of curves, distinct for the colour-blind and in grey.


class Style(NamedTuple):
    """How a curve looks."""

    light: str  # colour on white paper
    dark: str  # colour on a dark screen
    # lengths of dash, gap, ... in units of the line width; empty for a solid line
    dash: tuple[float, ...] = ()
    width: float = 1.0  # width of the line [pt]
    marker: bool = False  # whether points are drawn instead of a line


RUNS = (
    Style('#e69f00', '#f0b429', (2.0, 1.2)),  # the paper's laws first, in the order of LAWS
    Style('#009e73', '#2bc49a', (6.0, 1.5, 1.5, 1.5)),
    Style('#aa3377', '#e27bb1', (5.0, 2.0)),
    Style('#004488', '#7fb0f5'),
    Style('#56b4e9', '#56b4e9', (8.0, 1.5)),
    Style('#7a4a1e', '#c8945f', (3.0, 1.0)),
    Style('#999933', '#c9c95c', (6.0, 1.2, 1.2, 1.2, 1.2, 1.2)),
    Style('#555555', '#b5b5b5', (1.2, 1.2)),
)
COLOURS = ('#2952a3', '#d1495b', '#3a8f5c', '#e09f3e', '#7d4f9e', '#3fa7bd')
DASHES = ('-', '--')  # of as many joints as there are colours each
JOINT_COLOURS = (
    ('#333333', '#e6e6e6'),
    ('#4477aa', '#6ea6df'),
    ('#ee99aa', '#ee99aa'),
    ('#882255', '#d0669a'),
    ('#228866', '#5cc9a5'),
    ('#ccaa33', '#ddcc66'),
)
JOINT_DASHES: tuple[tuple[float, ...], ...] = ((), (5.0, 1.5), (6.0, 1.5, 1.5, 1.5), (1.5, 1.2))
JOINTS = 12  # styles, from the first again beyond them
STYLES = {
    **{f'run{slot}': style for slot, style in enumerate(RUNS)},
    **{  # each three of one dash differ in lightness
        f'joint{k}': Style(*JOINT_COLOURS[k % 6], JOINT_DASHES[k // 3], width=0.7)
        for k in range(JOINTS)
    },
    'reference': Style('#c4c4c4', '#5c6370', width=3.0),
    'start': Style('#333333', '#e6e6e6', marker=True),
}


def joint_style(joint: int) -> str:
    """Key in STYLES for a joint, by its 0-based index."""
    return f'joint{joint % JOINTS}'


def slots(laws: list[str]) -> list[int]:
    """Choose a style for each run by its law; the next free one where two runs share a law.

    Args:
        laws: Laws of at most len(RUNS) runs.

    Returns:
        Indices into RUNS, all different.
    """
    known = list(LAWS)
    free = list(range(len(RUNS)))
    chosen = []
    for law in laws:
        wanted = known.index(law) % len(RUNS) if law in known else 0
        slot = min(free, key=lambda candidate: (candidate - wanted) % len(RUNS))
        free.remove(slot)
        chosen.append(slot)
    return chosen


def look_of(column: int) -> dict[str, Any]:
    """Colour and dashes of one of several curves, by its 0-based index."""
    dashes = DASHES[column // len(COLOURS) % len(DASHES)]
    return {'color': COLOURS[column % len(COLOURS)], 'linestyle': dashes, 'lw': 0.8}


def run_look(slot: int) -> dict[str, Any]:
    """Colour and dashes of the run of a slot."""
    style = RUNS[slot]
    return {'color': style.light, 'linestyle': (0, style.dash) if style.dash else '-'}


def law_look(k: int, bold: bool) -> dict[str, Any]:
    """The look of one of many laws by its 0-based index; each turn of colours has other dashes."""
    dash = RUNS[(k + k // len(RUNS)) % len(RUNS)].dash
    return {
        'color': RUNS[k % len(RUNS)].light,
        'linestyle': (0, dash) if dash else '-',
        'linewidth': 2.2 if bold else 0.9,
    }


def new(
    size: tuple[float, float],
    title: str = '',
    layout: Literal['constrained'] | None = 'constrained',
) -> Any:
    """An empty figure of matplotlib.

    Args:
        size: Width and height [in].
        title: Its title, of whatever letters; empty for none.
        layout: How its panels find their places; None: by their margins.
    """
    from matplotlib.figure import Figure  # slow to import: only when drawn

    figure = Figure(figsize=size, layout=layout)
    if title:
        figure.suptitle(without_mathematics(title), fontweight='bold')
    return figure


def stacked(width: float, heights: list[float]) -> tuple[Any, Any]:
    """A figure with panels of some heights [in] one above the other; and the panels."""
    figure = new((width, sum(heights)))
    panels = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)
    return figure, panels[:, 0]


def save(figure: Any, path: str | Path) -> None:
    """Write a figure to a file that must not exist; its suffix chooses the format.

    Raises:
        InputError: the suffix is of no picture format, or the file cannot be written.
    """
    check_format(path)
    content = io.BytesIO()
    figure.savefig(content, format=Path(path).suffix[1:], dpi=130)
    with output.asked_for(Path(path), InputError), output.in_its_folder(Path(path)):
        output.write_new(Path(path), content.getbuffer())


def encoded(figure: Any, suffixes: Iterable[str]) -> dict[str, bytes]:
    """A figure by suffix, of the same bytes at all times."""
    from matplotlib import rc_context  # slow to import: only when drawn

    pictures = {}
    with rc_context({'svg.hashsalt': 'front'}):
        for suffix in suffixes:
            stream = io.BytesIO()
            figure.savefig(stream, format=suffix, dpi=150, metadata=UNDATED.get(suffix))
            pictures[suffix] = stream.getvalue()
    return pictures


def check_new(path: Path) -> None:
    """Refuse a file of a picture that exists, cannot be made, or is of no picture format.

    Raises:
        InputError: with the reason.
    """
    check_format(path)
    output.check_new(path, '--figure')


def check_format(path: str | Path) -> None:
    """Refuse a file whose suffix is of no picture format.

    Raises:
        UnknownNameError: with the formats.
    """
    suffix = Path(path).suffix
    if suffix not in FORMATS:
        raise UnknownNameError('picture format', suffix, FORMATS)
