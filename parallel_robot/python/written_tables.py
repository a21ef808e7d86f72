"""Results as tables for documents: Markdown, LaTeX, text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from parallel_robot.analysis.readable_metrics import NEVER, titled
from parallel_robot_control.configuration import available, resolve
from parallel_robot_control.laws import title
from parallel_robot_model.common import tables
from parallel_robot_model.common.errors import Frame, InputError, UnknownNameError, pandas
from parallel_robot_model.common.tables import ShownResult, Table
from parallel_robot_model.common.units import BOTH, PRISMATIC
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import parameters

MICRO = 1e-2  # m or rad; where all of a column is smaller, it is in µm or µrad
UNITS = {  # how names of columns end
    'm': 'm', 'um': 'µm', 'rad': 'rad', 'urad': 'µrad', 's': 's', 'ns': 'ns', 'nm': 'N m',
    'j': 'J', 'hz': 'Hz', 'm_per_s': 'm/s', 'rad_per_s': 'rad/s', 'rad_per_s2': 'rad/s²',
    'nm_per_s': 'N m/s', 'nm2_per_hz': '(N m)²/Hz', 'rad2_per_hz': 'rad²/Hz',
    'rad2_per_s2_hz': '(rad/s)²/Hz',
}  # fmt: skip
UNITS |= {
    each.key(name): each.of(unit) for each in (PRISMATIC, BOTH) for name, unit in UNITS.items()
}
MICROS = {'m': 'µm', 'rad': 'µrad', 'rad or m': 'µrad or µm'}
UNIT = re.compile(f'(.+?)_({"|".join(sorted(UNITS, key=len, reverse=True))})')


def table(result: Any, format: str = 'text') -> str:
    r"""A result as a table for a document, with units in its head.

    >>> import parallel_robot as pr
    >>> runs = [pr.simulate('paper_circle', law=law, duration=2) for law in ('smc', 's_smc')]
    >>> print(pr.table(pr.compare(runs)[['law', 'xy_rms_m', 'torque_max_nm']], 'markdown'))
    |        | law    | xy rms [µm] | torque max [N m] |
    | :----- | :----- | ----------: | ---------------: |
    | smc    | smc    |      1129.1 |          8.23565 |
    | s\_smc | s\_smc |     252.435 |          16.9676 |

    Args:
        result: What ``metrics``, ``replay``, ``tune``, ``identify``, ``calibrate``, ``recover`` or
            ``rerun`` returned; or a pandas.DataFrame, as of ``compare``, ``grid``, ``sweep``,
            ``limit``, ``spectrum`` or ``show``.
        format: 'text', 'markdown' or 'latex'; this is a ``tabular`` that needs no package, below
            comments.

    Raises:
        InputError: it is neither, or the format is unknown.
    """
    if format not in tables.FORMATS:
        raise UnknownNameError('format', str(format), tables.FORMATS)
    shown = isinstance(result, ShownResult)
    if not (shown or isinstance(result, pandas().DataFrame)):
        raise InputError(
            f'a table is of a result, such as that of metrics or tune, or of a DataFrame, such as '
            f'that of compare, not of {type(result).__name__}'
        )
    parts = result.parts() if shown else [_of_frame(result)]
    return tables.FORMATS[format](titled(parts) if format == 'latex' else parts)


def _of_frame(frame: Frame) -> Table:
    """A frame as a table; rows that are only numbered have no column for that."""
    numbered = isinstance(frame.index, pandas().RangeIndex) and frame.index.name is None
    frame = frame if numbered else _with_index(frame)
    columns = [_column(_name(name), frame.iloc[:, k]) for k, name in enumerate(frame.columns)]
    rows = zip(*(cells for _, _, cells in columns), strict=True)
    sides = ''.join(side for _, side, _ in columns) or 'l'
    return Table([head for head, _, _ in columns], [list(row) for row in rows], sides)


def _with_index(frame: Frame) -> Frame:
    """A frame with its index in front, a column a level, whatever the names are."""
    levels = frame.index.to_frame(index=False)
    levels.columns = [_name(name) for name in frame.index.names]
    return pandas().concat([levels, frame.reset_index(drop=True)], axis=1)


def _name(name: Any) -> str:
    """The name of a column or of several levels of one."""
    levels = name if isinstance(name, tuple) else (name,)
    return ', '.join(str(level) for level in levels if level is not None and level != '')


def _column(name: str, values: Any) -> tuple[str, str, Sequence[str]]:
    """Heading with unit, side and cells of a column."""
    numeric = pandas().api.types.is_numeric_dtype(values) and values.dtype != bool
    match = UNIT.fullmatch(name) if numeric else None
    words, unit = (match[1], UNITS[match[2]]) if match else (name, '')
    scale, digits = 1.0, 6 if numeric else 10
    if unit in MICROS and values.abs().max() < MICRO:
        unit, scale = MICROS[unit], 1e6
    if unit or '.' not in name:  # else it is a key of the configuration
        words = words.replace('_', ' ').strip()
    cells = [_cell(value, scale, digits) for value in values]
    return f'{words} [{unit}]' if unit else words, 'r' if numeric else 'l', cells


def _cell(value: Any, scale: float, digits: int) -> str:
    """A value for people; what is not known is left empty."""
    if isinstance(value, list | tuple):
        return ', '.join(_cell(each, scale, digits) for each in value)
    if value is None or value != value:
        return ''
    if isinstance(value, float):
        return NEVER if value == math.inf else f'{scale * value:.{digits}g}'
    return str(value)


# What there is by name, as tables.

BASE = 'paper_circle'  # which any law fits


def laws(custom_laws: Sequence[str | Path] = ()) -> Frame:
    """The control laws.

    >>> import parallel_robot as pr
    >>> pr.laws().loc['smc', ['title', 'gains']].tolist()
    ['SMC', ('z', 'G', 'g', 'u')]

    Args:
        custom_laws: Files of laws of yours, which are listed, too.

    Returns:
        A pandas.DataFrame with one row a law: its title, what it is, and the keys of its gains.

    Raises:
        InputError: a file is not a law, or pandas is not installed.
    """
    if isinstance(custom_laws, str | Path):
        raise InputError(f'custom_laws must be a list of files, not {custom_laws!r}')
    frames = pandas()
    files = {'custom_laws': list(map(str, custom_laws))}
    known = available(resolve(BASE, files)['custom_laws'])
    rows = [
        {
            'title': title(name),
            'description': (law.__doc__ or '').partition('\n')[0],
            'gains': tuple(gain.key for gain in parameters(law.Gains)),
        }
        for name, law in known.items()
    ]
    return frames.DataFrame(rows, index=list(known))


def scenarios() -> Frame:
    """The scenarios that are shipped.

    >>> import parallel_robot as pr
    >>> pr.scenarios().loc['axes_step'].tolist()
    ['axes', 'move', 's_fotsmc']

    Returns:
        A pandas.DataFrame with one row a scenario: its robot, its trajectory and its law.

    Raises:
        InputError: pandas is not installed.
    """
    frames = pandas()
    found = {name: resolve(name) for name in config.scenarios()}
    rows = [
        {
            'robot': values['robot_model'],
            'trajectory': values['trajectory.shape'],
            'law': values['law'],
        }
        for values in found.values()
    ]
    return frames.DataFrame(rows, index=list(found))
