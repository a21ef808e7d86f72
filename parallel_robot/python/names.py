"""What there is by name, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from parallel_robot_control.configuration import available, resolve
from parallel_robot_control.laws import title
from parallel_robot_model.common.errors import Frame, InputError, pandas
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import parameters

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
    frame: Frame = frames.DataFrame(rows, index=list(known))
    return frame


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
    frame: Frame = frames.DataFrame(rows, index=list(found))
    return frame
