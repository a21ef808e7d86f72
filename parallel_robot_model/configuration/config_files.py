"""The files of ``config/``: where they are, and what they hold."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.plain_data import LOADER

PACKAGE = 'parallel_robot'
DEFAULTS = 'defaults.yaml'

Layer = tuple[str, Mapping[str, Any]]  # display name of a source, its keys and values


def directory() -> Path:
    """Find ``config/``: beside the packages (source tree) or in a share folder (installed).

    Raises:
        InputError: the package is not installed completely.
    """
    return _directory(__file__, os.environ.get('AMENT_PREFIX_PATH', ''))


@functools.cache
def _directory(module: str, prefixes: str) -> Path:
    """``config/``, which stays where it is while a process runs: a sweep asks very often."""
    here = Path(module).resolve()
    candidates = [parent / 'share' / PACKAGE / 'config' for parent in here.parents]
    candidates.insert(0, here.parents[2] / 'config')
    installed = filter(None, prefixes.split(os.pathsep))
    candidates += [Path(prefix) / 'share' / PACKAGE / 'config' for prefix in installed]
    for candidate in candidates:
        if (candidate / DEFAULTS).is_file():
            return candidate
    raise InputError(f'the configuration of {PACKAGE} is not installed beside {here.parent}')


def label(file: Path) -> str:
    """Display name of a file: its place in ``config/``, or else its path."""
    return _label(file, directory())


@functools.lru_cache(maxsize=256)
def _label(file: Path, root: Path) -> str:
    root, path = root.resolve(), file.resolve()
    return str(path.relative_to(root) if path.is_relative_to(root) else path)


def read(path: Path) -> dict[str, Any]:
    """Read a file of the suite, without the limits for those of users.

    Raises:
        InputError: it is not YAML, or holds no keys and values.
    """
    return _parsed(path, path.stat().st_mtime_ns)


@functools.lru_cache(maxsize=256)
def _parsed(path: Path, _changed: int) -> dict[str, Any]:
    """Content of a file, kept until it changes: a sweep resolves thousands of configurations."""
    try:
        content = yaml.load(path.read_text(), LOADER)
    except yaml.YAMLError as error:
        raise InputError(f'{path} is not valid YAML: {error}') from None
    if not isinstance(content, dict):
        raise InputError(f'{path} must hold keys and values')
    return content


class Shipped(NamedTuple):
    """The parameters that the suite ships, each file as a layer: its label, its keys and values.

    Attributes:
        defaults: Defaults of all that has no file of its own.
        laws: By name of the law.
        robots: By name of the robot.
    """

    defaults: Layer
    laws: dict[str, Layer]
    robots: dict[str, Layer]


def shipped() -> Shipped:
    """The shipped parameters.

    Raises:
        InputError: a file is not YAML, or holds no keys and values.
    """
    root = directory()
    laws, robots = (
        {file.stem: _layer(file) for file in sorted((root / folder).glob('*.yaml'))}
        for folder in ('laws', 'robots')
    )
    return Shipped(_layer(root / DEFAULTS), laws, robots)


def _layer(file: Path) -> Layer:
    return label(file), _copied(_flat_file(file, file.stat().st_mtime_ns))


@functools.lru_cache(maxsize=256)
def _flat_file(file: Path, changed: int) -> dict[str, Any]:
    return flat(_parsed(file, changed))


def _copied(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value[:] if type(value) is list else value for key, value in values.items()}


def flat(tree: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Nested groups as one dictionary with dotted keys."""
    values: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            values.update(flat(value, f'{prefix}{key}.'))
        else:
            values[f'{prefix}{key}'] = list(value) if isinstance(value, list) else value
    return values
