"""Configuration: every number of the suite, from ``config/``, as one flat dotted dictionary."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from parallel_robot_base.errors import InputError, UnknownNameError
from parallel_robot_base.fields import build, parameters, plain

Group = TypeVar('Group')

PACKAGE = 'parallel_robot'
PRESET = 'paper'  # the gains in config/laws
CUSTOM = {'custom_laws', 'custom_robots'}  # keys that name Python files
RENAMED = {'own_laws': 'custom_laws'}  # keys of older versions


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
    return flat(_read(directory() / 'defaults.yaml'))[key]


Extend = Callable[[Mapping[str, Any]], Mapping[str, Any]]


def resolve(
    scenario: str, overrides: Mapping[str, Any] | None = None, extend: Extend | None = None
) -> dict[str, Any]:
    """Merge defaults, a scenario and overrides.

    Later wins: ``defaults.yaml``, ``laws/*.yaml``, the file of the robot in ``robots/``, the
    defaults of custom modules, the scenario's ``base``, the scenario, `overrides`. A
    ``true_robot`` key that is not set equals its ``robot`` key; ``preset`` says whether the gains
    are those of the preset; the files of ``custom_laws`` and ``custom_robots`` are absolute.

    Args:
        scenario: Name of a file in ``config/scenarios``.
        overrides: Dotted key to value; NumPy's numbers and arrays are accepted, too.
        extend: Returns the defaults of the custom modules that a configuration names. Gains of
            custom laws for which it has none are taken as they are.

    Returns:
        Every key of the suite with its value, plain numbers, texts and lists.

    Raises:
        UnknownNameError: no such scenario or robot, or a key that the defaults do not have.
        InputError: the preset is asked for together with other gains, or a custom module cannot
            be loaded.
    """
    config = flat(_read(directory() / 'defaults.yaml'))
    changed = renamed(_plain(overrides or {}))
    if changed.pop('scenario', scenario) != scenario:
        raise InputError(f'the scenario is {scenario}; it cannot be changed by a parameter')
    of_scenario = _scenario(scenario)
    asked = {**config, **of_scenario, **changed}
    for key in CUSTOM:
        _check_paths(key, asked[key])
    of_robot, gains = _robot(asked, extend), preset(asked, extend)
    custom_laws = {Path(path).stem for path in asked['custom_laws']}
    taken = custom_laws & {key.partition('.')[0] for key in config | of_robot}
    if taken:
        raise InputError(f'custom_laws: {min(taken)} is a group of parameters; rename the file')
    config |= of_robot | gains
    known = set(config) | {f'true_{key}' for key in config if key.startswith('robot.')}
    opaque = custom_laws - {key.partition('.')[0] for key in gains}  # not loaded on this floor
    for values in (of_scenario, {'scenario': scenario}, changed):
        for key in values:
            if key not in known and key.partition('.')[0] not in opaque:
                raise UnknownNameError('parameter', key, known)
        config.update(values)
    for key in CUSTOM:
        config[key] = [_absolute(key, path) for path in config[key]]
    for key in [key for key in config if key.startswith('robot.')]:
        config.setdefault(f'true_{key}', config[key])
    other = next((key for key, value in gains.items() if config[key] != value), None)
    if other and changed.get('preset') == PRESET:
        raise InputError(
            f'preset is {PRESET}, but {other} is {config[other]!r}, not {gains[other]!r}'
        )
    config['preset'] = 'custom' if other else PRESET
    return config


def renamed(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by the present names of their keys, with a hint for each older name."""
    for old in RENAMED.keys() & values.keys():
        logging.getLogger('parallel_robot').warning(f'{old} is called {RENAMED[old]} now')
    return {RENAMED.get(key, key): value for key, value in values.items()}


def changed(
    values: Mapping[str, Any], changes: Mapping[str, Any], extend: Extend | None = None
) -> dict[str, Any]:
    """A resolved configuration with some keys changed.

    Raises:
        UnknownNameError: a key that it does not have.
        InputError: a custom module cannot be loaded.
    """
    changes = renamed(_plain(changes))
    for key in CUSTOM & changes.keys():
        _check_paths(key, changes[key])
    gains = preset({**values, **changes}, extend)
    known = gains | dict(values)
    for key in changes:
        if key not in known:
            raise UnknownNameError('parameter', key, known)
    merged = known | changes
    for key in CUSTOM:
        merged[key] = [_absolute(key, path) for path in merged[key]]
    same = all(merged[key] == value for key, value in gains.items())
    return merged | {'preset': PRESET if same else 'custom'}


def preset(values: Mapping[str, Any], extend: Extend | None = None) -> dict[str, Any]:
    """Gains of all laws from the files: Table 2 for the laws of the paper.

    Args:
        values: Keys that name the robot and the custom modules.
        extend: See :func:`resolve`.

    Raises:
        InputError: a custom module cannot be loaded, or has the name of one that exists.
    """
    files = sorted((directory() / 'laws').glob('*.yaml'))
    laws = {file.stem for file in files}
    for path in values['custom_laws']:
        name = Path(path).stem
        if name in laws:
            what = f'there is already a law {name}; rename the file'
            raise InputError(f'custom_laws: {path}: {what}')
        laws.add(name)
    gains: dict[str, Any] = {}
    for file in files:
        gains |= flat(_read(file))
    if extend:
        gains |= {key: value for key, value in extend(values).items() if _is_of(laws, key)}
    if _robot_file(values).is_file():
        of_robot = flat(_read(_robot_file(values)))
        gains |= {key: value for key, value in of_robot.items() if _is_of(laws, key)}
    return gains


def robot_models() -> list[str]:
    """Names of the robots of the suite."""
    return sorted(path.stem for path in (directory() / 'robots').glob('*.yaml'))


def _robot_file(values: Mapping[str, Any]) -> Path:
    return directory() / 'robots' / f'{values["robot_model"]}.yaml'


def _robot(values: Mapping[str, Any], extend: Extend | None) -> dict[str, Any]:
    """Defaults of the robot, without gains.

    Raises:
        UnknownNameError: no such robot.
        InputError: a custom robot has the name of one that exists.
    """
    name, custom = values['robot_model'], [Path(path).stem for path in values['custom_robots']]
    taken = sorted({*custom} & {*robot_models()})
    if taken:
        raise InputError(f'custom_robots: there is already a robot {taken[0]}; rename the file')
    if name in custom:
        laws = {Path(path).stem for path in values['custom_laws']}
        found = extend(values) if extend else {}
        return {key: value for key, value in found.items() if not _is_of(laws, key)}
    if name not in robot_models():
        raise UnknownNameError('robot_model', str(name), robot_models() + custom)
    return flat(_read(_robot_file(values)))


def _is_of(laws: set[str], key: str) -> bool:
    return key.partition('.')[0] in laws


def _check_paths(key: str, paths: Any) -> None:
    """Refuse what is not a list of texts.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise InputError(f'{key} must be a list of texts, not {paths!r}')


def _absolute(key: str, path: str) -> str:
    """Absolute path of a custom module: nodes may have other current directories."""
    try:
        return str(Path(path).expanduser().resolve())
    except (OSError, RuntimeError, ValueError):  # too long, home of an unknown user, not a text
        raise InputError(f'{key}: {path} does not exist') from None


def group(config: Mapping[str, Any], kind: type[Group], prefix: str) -> Group:
    """Build one typed group, e.g. of keys ``friction.*``; prefix '' takes top-level keys.

    Keys of the prefix that belong to another group are left to it.

    Raises:
        InputError: a value is missing or wrong.
    """
    start = f'{prefix}.' if prefix else ''
    keys = [parameter.key for parameter in parameters(kind)]
    values = {key: config[start + key] for key in keys if start + key in config}
    return build(kind, values, start, len(config['joints']) if 'joints' in config else None)


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: plain(value) for key, value in values.items()}


def _scenario(name: str) -> dict[str, Any]:
    path = directory() / 'scenarios' / f'{name}.yaml'
    if name not in scenarios():
        raise UnknownNameError('scenario', name, scenarios())
    values = flat(_read(path))
    for key in CUSTOM & renamed(values).keys():
        raise InputError(f'{path}: {key} is given on a command line alone: it is code')
    base = values.pop('base', None)
    return {**(_scenario(base) if base else {}), **values}


# The loader written in C, if installed, is seven times faster.
LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = yaml.load(path.read_text(), LOADER)
    except yaml.YAMLError as error:
        raise InputError(f'{path} is not valid YAML: {error}') from None
    if not isinstance(content, dict):
        raise InputError(f'{path} must hold keys and values')
    return content


def flat(tree: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Nested groups as one dictionary with dotted keys."""
    found: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            found.update(flat(value, f'{prefix}{key}.'))
        else:
            found[f'{prefix}{key}'] = value
    return found
