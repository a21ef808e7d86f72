"""Colours and dashes of curves, distinct for the colour-blind and in grey."""

from __future__ import annotations

from typing import NamedTuple

from parallel_robot_control.laws import LAWS


class Style(NamedTuple):
    """How a curve looks.

    Attributes:
        light: Colour on white paper.
        dark: Colour on a dark screen.
        dash: Lengths of dash, gap, ... in units of the line width; empty for a solid line.
        width: Width of the line [pt].
        marker: Whether points are drawn instead of a line.
    """

    light: str
    dark: str
    dash: tuple[float, ...] = ()
    width: float = 1.0
    marker: bool = False


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
