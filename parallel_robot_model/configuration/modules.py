"""Modules of users that a configuration names: their files, and the defaults that they bring."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import plain
from parallel_robot_model.configuration.yaml_file import CODE as CODE

Defaults = Mapping[str, Mapping[str, Any]]  # key to value, by name of the module


class Modules(NamedTuple):
    """Defaults of the modules that are loaded; what is not loaded here has none."""

    robots: Defaults = MappingProxyType({})
    laws: Defaults = MappingProxyType({})
    shapes: Defaults = MappingProxyType({})
    described: Callable[[Mapping[str, Any]], Mapping[str, Any]] = dict  # of a description

    def defaults(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Those of the robot of a configuration, of all laws and all trajectories, by key."""
        own = self.robots.get(str(values['robot_model']), {})
        if values.get('robot_description'):
            own = self.described(values)
        parts = (*self.shapes.values(), own, *self.laws.values())
        return {key: value for part in parts for key, value in part.items()}


NONE = Modules()


def names(values: Mapping[str, Any], key: str) -> set[str]:
    """Names of the modules of a kind, e.g. ``custom_laws``."""
    return {Path(path).stem for path in values[key]}


def files(values: Mapping[str, Any], key: str) -> list[str]:
    """Files of the modules of a kind that a configuration, or a change of one, names.

    Raises:
        InputError: it is no list of texts.
    """
    paths = plain(values.get(key, []))
    _check(key, paths)
    return list(paths)


def check(values: Mapping[str, Any]) -> None:
    """Refuse what is not a list of texts.

    Raises:
        InputError: a key of CODE has something else.
    """
    for key in CODE & values.keys():
        _check(key, values[key])


def absolute(key: str, paths: Any) -> list[str]:
    """Absolute paths of modules.

    Args:
        key: Key of CODE, for messages.
        paths: Its value.

    Raises:
        InputError: it is no list of texts, or one is no path.
    """
    _check(key, paths)
    return [_absolute(key, path) for path in paths]


def _check(key: str, paths: Any) -> None:
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise InputError(f'{key} must be a list of texts, not {paths!r}')


def _absolute(key: str, path: str) -> str:
    """Absolute path of a module: nodes may have other current directories."""
    try:
        return str(Path(path).expanduser().resolve())
    except (OSError, RuntimeError, ValueError):  # too long, home of an unknown user, not a text
        raise InputError(f'{key}: {path} does not exist') from None
