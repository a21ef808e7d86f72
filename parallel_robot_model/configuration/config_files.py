"""The files of ``config/``: where they are, and what they hold."""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import points, robot_file, yaml_file
from parallel_robot_model.configuration.plain_data import LOADER, LocatedDict, with_location

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


class BuiltinFiles(NamedTuple):
    """The parameters that the suite ships, each file as a layer: label, keys and values."""

    defaults: Layer  # defaults of all that has no file of its own
    laws: dict[str, Layer]  # by name of the law
    robots: dict[str, Layer]  # by name of the robot


def builtin_files() -> BuiltinFiles:
    """The shipped parameters.

    Raises:
        InputError: a file is not YAML, or holds no keys and values.
    """
    root = directory()
    laws, robots = (
        {file.stem: _layer(file) for file in sorted((root / folder).glob('*.yaml'))}
        for folder in ('laws', 'robots')
    )
    return BuiltinFiles(_layer(root / DEFAULTS), laws, robots)


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


# Descriptions of machines, whose text takes the place of the name of their file.

MODEL, DESCRIPTION = 'robot_model', 'robot_description'
COMPILED = 'robot_compiled'  # beside the text of a shipped machine, and in bags
ROBOT_SUFFIXES = ('.xml', '.mjcf', '.urdf', '.sdf', '.xacro')
MACHINES = 'machines'  # of the shipped ones, in config/


def is_robot_path(model: str) -> bool:
    """Whether a robot is given as the path of a description."""
    return '/' in model or model.lower().endswith(ROBOT_SUFFIXES)


def builtin_machines() -> list[str]:
    """Names of the machines that the suite ships as descriptions."""
    return sorted(path.stem for path in (directory() / MACHINES).glob('*.xml'))


def _with_machine(values: LocatedDict) -> LocatedDict:
    """Values with the text of the machine that they name, if any, and its name.

    A path counts from the file in which it stands, or else from the current directory.
    """
    model = values.get(MODEL)
    if not isinstance(model, str) or values.get(DESCRIPTION):
        return values
    location = values.locations.get(MODEL)
    compiled = ''
    if not is_robot_path(model):
        path = machine_path(model)
        if text := robot_file.text_of(path) if model in builtin_machines() else '':
            compiled = yaml_file.text(path.with_suffix('.json'))
        name = model
    else:
        with with_location(values):
            try:
                path = _file_of(values, model)
                text, name = robot_file.text_of(path), path.stem
            except (RuntimeError, InputError) as error:  # home of an unknown user
                raise InputError(f'{MODEL}: {error}', MODEL) from None
            taken = {*builtin_files().robots, *builtin_machines()}
            if name in taken and path.resolve() != machine_path(name).resolve():
                what = f'there is already a robot {name}; rename the file'
                raise InputError(f'{MODEL}: {path}: {what}', MODEL)
            if name in taken:
                compiled = yaml_file.text(path.with_suffix('.json'))
    entries = {MODEL: name, DESCRIPTION: text}
    if compiled:  # else it is compiled when it is read
        entries[COMPILED] = compiled
    return values | LocatedDict(entries, dict.fromkeys(entries, location) if location else {})


def _file_of(values: LocatedDict, model: str) -> Path:
    location = values.locations.get(MODEL)
    return Path(location.file if location else '').parent / Path(model).expanduser()


def machine_file(values: LocatedDict) -> Path | None:
    """File of the machine that values name, if they name one."""
    model = values.get(MODEL)
    if not isinstance(model, str):
        return None
    shipped_one = machine_path(model) if model in builtin_machines() else None
    return _file_of(values, model) if is_robot_path(model) else shipped_one


def scenario_of(name: str) -> str:
    """The scenario that is called so, or the description of the shipped machine of that name."""
    return str(machine_path(name)) if name in builtin_machines() else name


def machine_path(name: str) -> Path:
    """Place of a shipped machine."""
    return directory() / MACHINES / f'{name}.xml'


# Files that a configuration names, whose content takes the place of their names.


def with_file_contents(values: LocatedDict) -> LocatedDict:
    """Values with the content of the files that they name: points of a motion, a machine.

    Raises:
        InputError: a file cannot be read, or is no such file.
    """
    return _with_machine(points.with_points(values))


# Scenarios: shipped ones by name, others by the path of a YAML file or of a described robot.

SUFFIXES = ('.yaml', '.yml')
MAX_NAME_LENGTH = 200  # characters of a name
MAX_BASES = 20  # scenarios, each the base of the next


def is_scenario_path(scenario: str) -> bool:
    """Whether a scenario is given as a path, not by the name of a shipped one."""
    return '/' in scenario or scenario.endswith(SUFFIXES) or is_robot_scenario(scenario)


def is_robot_scenario(scenario: str) -> bool:
    """Whether a scenario is given as the description of a robot, whose motion is its default."""
    return scenario.lower().endswith(ROBOT_SUFFIXES)


def absolute_scenario(scenario: str, start: Path | None = None) -> str:
    """A path made absolute, for processes with other current directories; a name as it is.

    Args:
        scenario: Name or path of a scenario.
        start: Directory from which a relative path counts; None: the current one.
    """
    return str(_absolute_path(scenario, start)) if is_scenario_path(scenario) else scenario


def scenario_stem(scenario: str) -> str:
    """Name of a scenario that is given by name or path, whether or not it exists."""
    path = Path(scenario)
    if not is_scenario_path(scenario):
        return scenario
    return path.stem if path.suffix in SUFFIXES or is_robot_scenario(scenario) else path.name


def scenario_names(directory: Path) -> list[str]:
    """Names of the shipped scenarios.

    Args:
        directory: Their directory.
    """
    return sorted(path.stem for path in directory.glob('*.yaml'))


def _scenario_name(scenario: str, directory: Path) -> str:
    """Name of a scenario: that of its file without the suffix."""
    if not is_scenario_path(scenario):
        if scenario not in scenario_names(directory):
            raise UnknownNameError('scenario', scenario, scenario_names(directory), 'scenario')
        return scenario
    place = _absolute_path(scenario)
    name = scenario_stem(str(place))
    if name in scenario_names(directory) and place != _builtin_path(name, directory):
        raise InputError(f'{scenario}: there is already a scenario {name}; rename the file')
    if len(name) > MAX_NAME_LENGTH or not name.isprintable():
        what = f'at most {MAX_NAME_LENGTH} characters, all of which can be printed'
        raise InputError(f'{scenario}: the name of a scenario has {what}; rename the file')
    return name


def scenario_layers(scenario: str, directory: Path) -> tuple[str, list[tuple[Path, LocatedDict]]]:
    """Name of a scenario, and its files with their values: the first base first, itself last.

    Args:
        scenario: Name of a shipped scenario, or the path of a file. The ``base`` of a file is one
            or the other, too; its path is relative to the file.
        directory: Directory of the shipped scenarios.

    Raises:
        UnknownNameError: no such scenario is shipped.
        InputError: a file cannot be read, names code, or has another name of the scenario, or
            bases lead back to where they began.
    """
    name = _scenario_name(scenario, directory)
    place = (
        _absolute_path(scenario) if is_scenario_path(scenario) else _builtin_path(name, directory)
    )
    if is_robot_scenario(scenario):
        return name, [(place, with_file_contents(LocatedDict({MODEL: str(place)})))]
    files: list[tuple[Path, LocatedDict]] = []
    while True:
        way = [path for path, _ in files]
        if place in way or len(way) == MAX_BASES:
            steps = ' -> '.join(path.name for path in [*way, place])
            what = 'lead in a circle' if place in way else f'are more than {MAX_BASES}'
            raise InputError(f'{way[0]}: the bases of a scenario {what}: {steps}')
        values = yaml_file.read(place)
        if yaml_file.is_ros_parameter_file(values):
            raise InputError(f'{place} is a parameter file of ROS: give it by --param-file')
        with with_location(values):
            base = values.pop('base', None)
            _check(place, values)
            files.append((place, with_file_contents(values)))
            if base is None:
                return name, files[::-1]
            if not isinstance(base, str):
                raise InputError('base must be the name or the path of a scenario', 'base')
            if is_scenario_path(base):
                place = _absolute_path(base, place.parent)
            elif base in scenario_names(directory):
                place = _builtin_path(base, directory)
            else:
                raise UnknownNameError('base', base, scenario_names(directory), 'base')


def _check(path: Path, values: LocatedDict) -> None:
    """Refuse what a scenario may not say."""
    for key in yaml_file.CODE & values.keys():
        raise InputError(f'{key} is given on a command line alone: it is code', key)
    if values.pop('scenario', path.stem) != path.stem:
        raise InputError('a scenario has the name of its file; remove its scenario', 'scenario')


def _builtin_path(name: str, directory: Path) -> Path:
    return (directory / f'{name}.yaml').resolve()


def _absolute_path(path: str, start: Path | None = None) -> Path:
    """Absolute path of a file, from a directory; None: from the current one."""
    try:
        return ((start or Path()) / Path(path).expanduser()).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # too long, home of an unknown user
        raise InputError(f'scenario {path}: {getattr(error, "strerror", None) or error}') from None
