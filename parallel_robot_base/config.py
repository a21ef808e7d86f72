"""Configuration: every number of the suite, from ``config/``, as one flat dotted dictionary."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml

from parallel_robot_base import plugins
from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_base.fields import build, defaults, parameters, plain

Group = TypeVar('Group')

PACKAGE = 'parallel_robot'
PRESET = 'paper'  # the gains in config/laws


def directory() -> Path:
    """Find ``config/``: beside the packages (source tree) or in a share folder (installed).

    Raises:
        InputError: the package is not installed completely.
    """
    here = Path(__file__).resolve()
    candidates = [parent / 'share' / PACKAGE / 'config' for parent in here.parents]
    candidates.insert(0, here.parents[1] / 'config')
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    candidates += [Path(prefix) / 'share' / PACKAGE / 'config' for prefix in prefixes if prefix]
    for candidate in candidates:
        if (candidate / 'defaults.yaml').is_file():
            return candidate
    raise InputError(f'the configuration of {PACKAGE} is not installed beside {here.parent}')


def scenarios() -> list[str]:
    """Names of the scenarios that exist."""
    return sorted(path.stem for path in (directory() / 'scenarios').glob('*.yaml'))


def default(key: str) -> Any:
    """Default of a key of ``defaults.yaml``."""
    return _flatten(_read(directory() / 'defaults.yaml'))[key]


def resolve(scenario: str, overrides: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Merge defaults, a scenario and overrides.

    Later wins: ``defaults.yaml``, ``robot.yaml``, ``laws/*.yaml`` and the defaults of one's own
    laws, the scenario's ``base``, the scenario, `overrides`. A ``true_robot`` key that nobody sets
    equals its ``robot`` key; ``preset`` says whether the gains are those of the preset; the files
    of ``own_laws`` are absolute.

    Args:
        scenario: Name of a file in ``config/scenarios``.
        overrides: Dotted key to value; NumPy's numbers and arrays are as good as Python's.

    Returns:
        Every key of the suite with its value, plain numbers, texts and lists.

    Raises:
        UnknownNameError: no such scenario, or a key that the defaults do not have.
        InputError: the preset is asked for together with other gains, or a law of one's own
            cannot be loaded.
    """
    root = directory()
    config: dict[str, Any] = {}
    for path in (root / 'defaults.yaml', root / 'robot.yaml'):
        config.update(_flatten(_read(path)))
    changed = _plain(overrides or {})
    if changed.pop('scenario', scenario) != scenario:
        raise InputError(f'the scenario is {scenario}; it cannot be changed by a parameter')
    of_scenario = _scenario(scenario)
    gains = preset({**config, **of_scenario, **changed}['own_laws'])
    taken = {key.partition('.')[0] for key in gains} & {key.partition('.')[0] for key in config}
    if taken:
        raise InputError(f'own_laws: {min(taken)} is a group of parameters; rename the file')
    config.update(gains)
    known = set(config) | {f'true_{key}' for key in config if key.startswith('robot.')}
    for values in (of_scenario, {'scenario': scenario}, changed):
        for key in values:
            if key not in known:
                raise UnknownNameError('parameter', key, known)
        config.update(values)
    config['own_laws'] = [str(Path(path).expanduser().resolve()) for path in config['own_laws']]
    for key in [key for key in config if key.startswith('robot.')]:
        config.setdefault(f'true_{key}', config[key])
    other = next((key for key, value in gains.items() if config[key] != value), None)
    if other and changed.get('preset') == PRESET:
        raise InputError(
            f'preset is {PRESET}, but {other} is {config[other]!r}, not {gains[other]!r}'
        )
    config['preset'] = 'custom' if other else PRESET
    return config


def changed(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A resolved configuration with some keys changed.

    Raises:
        UnknownNameError: a key that it does not have.
        InputError: a law of one's own cannot be loaded.
    """
    changes = _plain(changes)
    gains = preset(changes['own_laws']) if 'own_laws' in changes else {}
    known = gains | dict(values)
    for key in changes:
        if key not in known:
            raise UnknownNameError('parameter', key, known)
    merged = known | changes
    same = all(merged[key] == value for key, value in preset(merged['own_laws']).items())
    return merged | {'preset': PRESET if same else 'custom'}


def preset(own_laws: Any) -> dict[str, Any]:
    """Gains of all laws as the files say: Table 2 for the laws of the paper.

    Args:
        own_laws: Files of one's own laws, whose defaults belong to it.

    Raises:
        InputError: a file is not a law, or has the name of one that exists.
    """
    gains: dict[str, Any] = {}
    laws = sorted((directory() / 'laws').glob('*.yaml'))
    for path in laws:
        gains.update(_flatten(_read(path)))
    if isinstance(own_laws, str) or not isinstance(own_laws, Sequence):
        raise InputError(f'own_laws must be a list of texts, not {own_laws!r}')
    names = {file.stem for file in laws}
    for path in own_laws:
        name, law = plugins.load(str(path))
        if name in names:
            raise InputError(f'own_laws: {path}: there is already a law {name}; rename the file')
        names.add(name)
        gains.update(defaults(law.Gains, f'{name}.'))
    return gains


def group(config: Mapping[str, Any], kind: type[Group], prefix: str) -> Group:
    """Build one typed group, e.g. all keys ``friction.*``; prefix '' takes top-level keys."""
    start = f'{prefix}.' if prefix else ''
    if prefix:
        values = {k.removeprefix(start): v for k, v in config.items() if k.startswith(start)}
    else:
        values = {p.key: config[p.key] for p in parameters(kind)}
    return build(kind, values, start)


def parse_overrides(assignments: list[str]) -> dict[str, Any]:
    """Read ``key=value`` words of a command line; values as in YAML.

    Raises:
        InputError: a word without '=' or with a value that YAML cannot read.
    """
    overrides = {}
    for word in assignments:
        key, equals, value = word.partition('=')
        if not equals or not key:
            raise InputError(f'--set takes KEY=VALUE, not {word!r}')
        try:
            overrides[key.strip()] = _number(yaml.safe_load(value))
        except yaml.YAMLError:
            raise InputError(f'--set {key}: {value!r} is not a YAML value') from None
    return overrides


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: plain(value) for key, value in values.items()}


def _number(value: Any) -> Any:
    """1e6 is a number for everybody but YAML, which wants a point in it."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def _scenario(name: str) -> dict[str, Any]:
    path = directory() / 'scenarios' / f'{name}.yaml'
    if name not in scenarios():
        raise UnknownNameError('scenario', name, scenarios())
    values = _flatten(_read(path))
    if 'own_laws' in values:
        raise InputError(f'{path}: own_laws is given on a command line alone: it is code')
    base = values.pop('base', None)
    return {**(_scenario(base) if base else {}), **values}


# Written in C where that is installed: seven times faster.
LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = yaml.load(path.read_text(), LOADER)
    except yaml.YAMLError as error:
        raise InputError(f'{path} is not valid YAML: {error}') from None
    if not isinstance(content, dict):
        raise InputError(f'{path} must hold keys and values')
    return content


def _flatten(tree: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat.update(_flatten(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat
