"""Configuration: every number of the suite, from ``config/``, as one flat dotted dictionary."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.common.options import named
from parallel_robot_model.configuration import config_files, hazards, yaml_file
from parallel_robot_model.configuration.config_files import DEFAULTS as DEFAULTS
from parallel_robot_model.configuration.config_files import (
    DESCRIPTION,
    BuiltinFiles,
    builtin_files,
    label,
)
from parallel_robot_model.configuration.config_files import PACKAGE as PACKAGE
from parallel_robot_model.configuration.config_files import Layer as Layer
from parallel_robot_model.configuration.config_files import directory as directory
from parallel_robot_model.configuration.config_files import flat as flat
from parallel_robot_model.configuration.fields import plain
from parallel_robot_model.configuration.plain_data import (
    LocatedDict,
    locations_of,
    merged,
    with_location,
)
from parallel_robot_model.configuration.yaml_file import CODE as CODE

# Modules of users that a configuration names: their files, and the defaults that they bring.

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


def module_names(values: Mapping[str, Any], key: str) -> set[str]:
    """Names of the modules of a kind, e.g. ``custom_laws``."""
    return {Path(path).stem for path in values[key]}


def module_files(values: Mapping[str, Any], key: str) -> list[str]:
    """Files of the modules of a kind that a configuration, or a change of one, names.

    Raises:
        InputError: it is no list of texts.
    """
    paths = plain(values.get(key, []))
    _check_module_paths(key, paths)
    return list(paths)


def _check_modules(values: Mapping[str, Any]) -> None:
    """Refuse what is not a list of texts."""
    for key in CODE & values.keys():
        _check_module_paths(key, values[key])


def absolute_modules(key: str, paths: Any) -> list[str]:
    """Absolute paths of modules.

    Args:
        key: Key of CODE, for messages.
        paths: Its value.

    Raises:
        InputError: it is no list of texts, or one is no path.
    """
    _check_module_paths(key, paths)
    return [_absolute_module(key, path) for path in paths]


def _check_module_paths(key: str, paths: Any) -> None:
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        raise InputError(f'{key} must be a list of texts, not {paths!r}')


def _absolute_module(key: str, path: str) -> str:
    """Absolute path of a module: nodes may have other current directories."""
    try:
        return str(Path(path).expanduser().resolve())
    except (OSError, RuntimeError, ValueError):  # too long, home of an unknown user, not a text
        raise InputError(f'{key}: {path} does not exist') from None


CUSTOM = CODE
PRESET = 'paper'  # the gains in config/laws
CUSTOM_DEFAULT = 'custom module'  # source of a default in a Python file of a user
DESCRIBED = DESCRIPTION  # source of a default in the description of a machine
OVERRIDE = '--set'  # source of a value that somebody gave beside the scenario


def scenarios() -> list[str]:
    """Names of the shipped scenarios."""
    return config_files.scenario_names(directory() / 'scenarios')


def default(key: str) -> Any:
    """Default of a key of ``defaults.yaml``."""
    return builtin_files().defaults[1][key]


def resolve(
    scenario: str, overrides: Mapping[str, Any] | None = None, loaded: Modules = NONE
) -> dict[str, Any]:
    """Merge defaults, a scenario and overrides.

    Later wins: ``defaults.yaml``, ``laws/*.yaml``, the file of the robot in ``robots/``, the
    defaults of custom modules, the scenario's ``base``, the scenario, `overrides`. A
    ``true_robot`` key that is not set equals its ``robot`` key; ``preset`` says whether the gains
    are those of the preset; the files of custom modules are absolute.

    Args:
        scenario: Name of a file in ``config/scenarios``, or the path of a YAML file, whose name
            is that of the scenario.
        overrides: Dotted key to value; NumPy's numbers and arrays are accepted, too.
        loaded: Defaults of the custom modules. Gains of custom laws and parameters of custom
            trajectories that are not loaded are taken as they are.

    Returns:
        Every key of the suite with its value, plain numbers, texts and lists.

    Raises:
        UnknownNameError: no such scenario or robot, or a key that the defaults do not have.
        InputError: a file cannot be read, or the preset is asked for together with other gains.
    """
    return resolve_with_sources(scenario, overrides, loaded)[0]


def resolve_with_sources(
    scenario: str, overrides: Mapping[str, Any] | None = None, loaded: Modules = NONE
) -> tuple[dict[str, Any], dict[str, str]]:
    """A configuration as of :func:`resolve`, and where the value of each key comes from.

    Returns:
        Key to value, and key to source: a file of ``config/``, the path of another file,
        OVERRIDE, or for what follows from other keys, what it follows from.
    """
    # 1. All that is read.
    files = builtin_files()
    name, given = _scenario(scenario)
    source_of_name = given[-1][0]
    changes = config_files.with_file_contents(_plain(overrides or {}))
    _check_scenario(name, scenario, str(changes.pop('scenario', name)))
    given.append((OVERRIDE, changes))
    # 2. Merged, first to what names robot, laws and motions, then with the defaults of these.
    requested = merged([files.defaults[1], *(values for _, values in given)])
    _check_modules(requested)
    own = loaded.defaults(requested)
    with with_location(requested):
        layers = [files.defaults, *_robot(files, requested, own)]
    gains = _gains(files, requested, own)
    _check_names(requested, layers, gains)
    laws, shapes = (module_names(requested, key) for key in ('custom_laws', 'custom_trajectories'))
    layers += [*gains, (CUSTOM_DEFAULT, _of(shapes, own))]
    allowed, opaque = merged(values for _, values in layers), (laws | shapes) - _groups(layers)
    layers += [*given, (source_of_name, {'scenario': name})]
    config = merged(values for _, values in layers)
    sources = {key: source for source, values in layers for key in values}
    # 3. Checked, and completed by what follows from it.
    names = {*allowed, *(f'true_{key}' for key in allowed if key.startswith('robot.'))}
    for _, values in given:
        for key in values:
            if key not in names and key.partition('.')[0] not in opaque:
                with with_location(values):
                    raise UnknownNameError('parameter', key, names, key)
    _complete(config)
    sources[DESCRIPTION] = sources[config_files.COMPILED] = config_files.MODEL
    for key in [key for key in config if key.startswith('robot.')]:
        if f'true_{key}' not in config:
            config[f'true_{key}'], sources[f'true_{key}'] = config[key], key
    preset = merged(values for _, values in gains)
    other = next((key for key, value in preset.items() if config[key] != value), None)
    if other and changes.get('preset') == PRESET:
        raise InputError(
            f'preset is {PRESET}, but {other} is {config[other]!r}, not {preset[other]!r}'
        )
    config['preset'], sources['preset'] = 'custom' if other else PRESET, other or 'laws/*.yaml'
    return config, sources


def _check_scenario(name: str, scenario: str, given: str) -> None:
    """Refuse a change of the scenario to another one."""
    same = name, config_files.absolute_scenario(scenario)
    if config_files.absolute_scenario(given) not in same:
        raise InputError(f'the scenario is {name}; it cannot be changed by a parameter')


def _complete(config: LocatedDict) -> None:
    """Write files as absolute paths, and hazards as texts."""
    for key in CUSTOM:
        config[key] = absolute_modules(key, config[key])
    with with_location(config):
        config[hazards.KEY] = hazards.texts(config[hazards.KEY])


def _check_names(
    requested: Mapping[str, Any], layers: Iterable[Layer], gains: list[Layer]
) -> None:
    """Refuse custom laws and trajectories whose groups exist already: they bear their names."""
    taken = _groups(layers)
    for key, others in (('custom_laws', gains), ('custom_trajectories', [])):
        for name in (Path(path).stem for path in requested[key]):
            if name in taken:
                raise InputError(f'{key}: {name} is a group of parameters; rename the file')
            taken.add(name)
        taken |= _groups(others)


def _groups(layers: Iterable[Layer]) -> set[str]:
    return {key.partition('.')[0] for _, values in layers for key in values}


def scenario_values(scenario: str) -> dict[str, Any]:
    """What a scenario and its bases set, by key.

    Raises:
        UnknownNameError: no such scenario.
        InputError: one of its files cannot be read.
    """
    return merged(values for _, values in _scenario(scenario)[1])


def _scenario(scenario: str) -> tuple[str, list[Layer]]:
    """Name of a scenario, and what its files set, the bases first."""
    name, files = config_files.scenario_layers(scenario, directory() / 'scenarios')
    return name, [(label(path), values) for path, values in files]


def changed(
    values: Mapping[str, Any], changes: Mapping[str, Any], loaded: Modules = NONE
) -> dict[str, Any]:
    """A resolved configuration with some keys changed; `loaded` as of :func:`resolve`.

    Raises:
        UnknownNameError: a key that it does not have.
        InputError: a value that cannot be one of its key.
    """
    changes = config_files.with_file_contents(_plain(changes))
    _check_modules(changes)
    requested = {**values, **changes}
    own = loaded.defaults(requested)
    gains = merged(values for _, values in _gains(builtin_files(), requested, own))
    allowed = gains | _of(module_names(requested, 'custom_trajectories'), own) | dict(values)
    for key in changes:
        if key not in allowed:
            with with_location(changes):
                raise UnknownNameError('parameter', key, allowed, key)
    config = merged((allowed, changes))
    _complete(config)
    same = all(config[key] == value for key, value in gains.items())
    return config | {'preset': PRESET if same else 'custom'}


def preset(values: Mapping[str, Any], loaded: Modules = NONE) -> dict[str, Any]:
    """Gains of all laws from the files: Table 2 for the laws of the paper.

    Args:
        values: Keys that name the robot and the custom modules.
        loaded: See :func:`resolve`.

    Raises:
        InputError: a custom module has the name of one that exists.
    """
    own = loaded.defaults(values)
    return merged(gains for _, gains in _gains(builtin_files(), values, own))


def _gains(files: BuiltinFiles, values: Mapping[str, Any], own: Mapping[str, Any]) -> list[Layer]:
    """Gains of all laws by their source; `own` are the defaults of custom modules."""
    laws = {*files.laws}
    for path in values['custom_laws']:
        name = Path(path).stem
        if name in laws:
            what = f'there is already a law {name}; rename the file'
            raise InputError(f'custom_laws: {path}: {what}')
        laws.add(name)
    layers = [*files.laws.values(), (CUSTOM_DEFAULT, _of(laws, own))]
    source, of_robot = files.robots.get(str(values['robot_model']), ('', {}))
    if source:
        layers.append((source, _of(laws, of_robot)))
    return layers


def robot_models() -> list[str]:
    """Names of the robots of the suite."""
    return [*builtin_files().robots]


def _robot(files: BuiltinFiles, values: Mapping[str, Any], own: Mapping[str, Any]) -> list[Layer]:
    """Defaults of the robot; `own` are those of custom modules and of a description."""
    name = str(values['robot_model'])
    custom = [Path(path).stem for path in values['custom_robots']]
    taken = sorted({*custom} & {*files.robots})
    if taken:
        raise InputError(f'custom_robots: there is already a robot {taken[0]}; rename the file')
    if name in custom or values[DESCRIPTION]:
        laws, shapes = (
            module_names(values, f'custom_{kind}') for kind in ('laws', 'trajectories')
        )
        others = _of(laws | shapes, own)
        of_robot = {key: value for key, value in own.items() if key not in others}
        if values[DESCRIPTION]:
            more = [files.robots[name]] if name in files.robots else []
            return [(DESCRIBED, of_robot), *more]
        return [(CUSTOM_DEFAULT, of_robot)]
    if name not in files.robots:
        names = {*files.robots, *config_files.builtin_machines(), *custom}
        raise UnknownNameError('robot_model', name, sorted(names), 'robot_model')
    return [files.robots[name]]


def _of(groups: set[str], values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of some groups: gains of laws, parameters of shapes."""
    return {key: value for key, value in values.items() if key.partition('.')[0] in groups}


Place = str | Path
Places = Place | Iterable[Place]
Changes = Place | Mapping[str, Any] | Iterable[Place | Mapping[str, Any]] | None


def changes(param_file: Changes, values: Mapping[str, Any] = MappingProxyType({})) -> LocatedDict:
    """What files of parameters and values change in a configuration.

    Args:
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys and their values; they win over the files.

    Raises:
        InputError: a file cannot be read, or something is no file.
    """
    return merged(map(config_files.with_file_contents, layers(param_file, values)))


def layers(param_file: Changes, values: Mapping[str, Any]) -> list[LocatedDict]:
    """The same one by one, with the names of files, not what is in them."""
    single = param_file is None or isinstance(param_file, str | Path | Mapping)
    several = param_file if isinstance(param_file, Iterable) and not single else [param_file]
    found = [
        each
        if isinstance(each, Mapping)
        else yaml_file.read_parameter_file(Path(named('param_file', each)))
        for each in several
        if each is not None
    ]
    return [_plain(each) for each in (*found, values)]


def _plain(values: Mapping[str, Any]) -> LocatedDict:
    return LocatedDict({key: plain(value) for key, value in values.items()}, locations_of(values))
