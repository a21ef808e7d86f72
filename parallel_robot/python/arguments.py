"""Arguments of the functions for Python: paths and bags."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from pathlib import Path
from typing import Any

from parallel_robot.bags.bag_reader import BagView
from parallel_robot.bags.bag_reader import view as checked
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.messages.topics import full
from parallel_robot_sim.scenario_run import changes

OF_BAG = (  # what a bag does not say itself, beside keys of the configuration
    'topic', 'namespace', 'joints', 'scenario', 'param_file', 'override', 'start', 'stop',
)  # fmt: skip


def path(what: str, given: Any) -> Path:
    """A path that is given as text or as a path.

    Args:
        what: What it is, for the error.
        given: What was given.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(given, str | Path):
        raise InputError(f'{what} must be a path, not {given!r}')
    return Path(given)


def optional(what: str, given: Any) -> Path | None:
    """A path, or None where none is given; see :func:`path`."""
    return None if given is None else path(what, given)


def numbers(what: str, given: Any) -> tuple[float, ...]:
    """One number, or several.

    Args:
        what: What they are, for the error.
        given: What was given.

    Raises:
        InputError: it is something else.
    """
    try:
        return tuple(map(float, given if isinstance(given, Iterable) else [given]))
    except (TypeError, ValueError):
        raise InputError(f'{what} must be numbers, not {given!r}') from None


def bags(given: Any) -> list[Path]:
    """Paths of bags, one or several.

    Raises:
        InputError: something among them is no path, or there are none.
    """
    if isinstance(given, str | Path) or not isinstance(given, Iterable):
        return [path('a bag', given)]
    found = [path('a bag', each) for each in given]
    if not found:
        raise InputError('a bag is needed')
    return found


def view(options: Mapping[str, Any]) -> BagView:
    """How a bag is to be read, by options as of ``load``: OF_BAG, and keys of the configuration.

    Raises:
        InputError: one of them is wrong.
    """
    values = {key: value for key, value in options.items() if key not in OF_BAG}
    topic, joints = options.get('topic') or {}, options.get('joints') or ()
    named = isinstance(topic, Mapping) and all(isinstance(name, str) for name in topic.values())
    if not named:
        raise InputError(f'topic must be names with topics of the bag, not {topic!r}')
    if isinstance(joints, str) or not isinstance(joints, Iterable):
        raise InputError(f'joints must be a list of names, not {joints!r}')
    namespace, scenario = options.get('namespace'), options.get('scenario')
    if not isinstance(namespace, str | None):
        raise InputError(f'namespace must be text, not {namespace!r}')
    if not isinstance(scenario, str | Path | None):
        raise InputError(f'scenario must be a name or a path, not {scenario!r}')
    return checked(
        topic,
        None if namespace is None else full(namespace),
        joints,
        None if scenario is None else str(scenario),
        changes(options.get('param_file'), values),
        bool(options.get('override', False)),
        (_time('start', options), _time('stop', options)),
    )


def _time(name: str, options: Mapping[str, Any]) -> float | None:
    given = options.get(name)
    if given is None:
        return None
    if isinstance(given, bool) or not isinstance(given, Real) or not math.isfinite(given):
        raise InputError(f'{name} must be a time in s, not {given!r}')
    return float(given)
