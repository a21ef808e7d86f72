"""Scenarios: shipped ones by name, others by the path of a YAML file or of a described robot."""

from __future__ import annotations

from pathlib import Path

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import given_files, robot_names, yaml_file
from parallel_robot_model.configuration.plain_data import Placed, locating

SUFFIXES = ('.yaml', '.yml')
MAX_NAME_LENGTH = 200  # characters of a name
MAX_BASES = 20  # scenarios, each the base of the next


def is_path(scenario: str) -> bool:
    """Whether a scenario is given as a path, not by the name of a shipped one."""
    return '/' in scenario or scenario.endswith(SUFFIXES) or is_robot(scenario)


def is_robot(scenario: str) -> bool:
    """Whether a scenario is given as the description of a robot, whose motion is its default."""
    return scenario.lower().endswith(robot_names.SUFFIXES)


def absolute(scenario: str, start: Path | None = None) -> str:
    """A path made absolute, for processes with other current directories; a name as it is.

    Args:
        scenario: Name or path of a scenario.
        start: Directory from which a relative path counts; None: the current one.
    """
    return str(_place(scenario, start)) if is_path(scenario) else scenario


def stem(scenario: str) -> str:
    """Name of a scenario that is given by name or path, whether or not it exists."""
    path = Path(scenario)
    if not is_path(scenario):
        return scenario
    return path.stem if path.suffix in SUFFIXES or is_robot(scenario) else path.name


def names(shipped: Path) -> list[str]:
    """Names of the shipped scenarios.

    Args:
        shipped: Their directory.
    """
    return sorted(path.stem for path in shipped.glob('*.yaml'))


def name_of(scenario: str, shipped: Path) -> str:
    """Name of a scenario: that of its file without the suffix.

    Raises:
        UnknownNameError: no such scenario is shipped.
        InputError: a file has the name of a shipped scenario, or one that bags cannot hold.
    """
    if not is_path(scenario):
        if scenario not in names(shipped):
            raise UnknownNameError('scenario', scenario, names(shipped), 'scenario')
        return scenario
    place = _place(scenario)
    name = stem(str(place))
    if name in names(shipped) and place != _shipped(name, shipped):
        raise InputError(f'{scenario}: there is already a scenario {name}; rename the file')
    if len(name) > MAX_NAME_LENGTH or not name.isprintable():
        what = f'at most {MAX_NAME_LENGTH} characters, all of which can be printed'
        raise InputError(f'{scenario}: the name of a scenario has {what}; rename the file')
    return name


def layers(scenario: str, shipped: Path) -> tuple[str, list[tuple[Path, Placed]]]:
    """Name of a scenario, and its files with their values: the first base first, itself last.

    Args:
        scenario: Name of a shipped scenario, or the path of a file. The ``base`` of a file is one
            or the other, too; its path is relative to the file.
        shipped: Directory of the shipped scenarios.

    Raises:
        UnknownNameError: no such scenario is shipped.
        InputError: a file cannot be read, names code, or has another name of the scenario, or
            bases lead back to where they began.
    """
    name = name_of(scenario, shipped)
    place = _place(scenario) if is_path(scenario) else _shipped(name, shipped)
    if is_robot(scenario):
        return name, [(place, given_files.filled(Placed({robot_names.MODEL: str(place)})))]
    files: list[tuple[Path, Placed]] = []
    while True:
        way = [path for path, _ in files]
        if place in way or len(way) == MAX_BASES:
            steps = ' -> '.join(path.name for path in [*way, place])
            what = 'lead in a circle' if place in way else f'are more than {MAX_BASES}'
            raise InputError(f'{way[0]}: the bases of a scenario {what}: {steps}')
        values = yaml_file.read(place)
        if yaml_file.is_ros_parameter_file(values):
            raise InputError(f'{place} is a parameter file of ROS: give it by --param-file')
        with locating(values):
            base = values.pop('base', None)
            _check(place, values)
            files.append((place, given_files.filled(values)))
            if base is None:
                return name, files[::-1]
            if not isinstance(base, str):
                raise InputError('base must be the name or the path of a scenario', 'base')
            if is_path(base):
                place = _place(base, place.parent)
            elif base in names(shipped):
                place = _shipped(base, shipped)
            else:
                raise UnknownNameError('base', base, names(shipped), 'base')


def _check(path: Path, values: Placed) -> None:
    """Refuse what a scenario may not say."""
    for key in yaml_file.CODE & values.keys():
        raise InputError(f'{key} is given on a command line alone: it is code', key)
    if values.pop('scenario', path.stem) != path.stem:
        raise InputError('a scenario has the name of its file; remove its scenario', 'scenario')


def _shipped(name: str, shipped: Path) -> Path:
    return (shipped / f'{name}.yaml').resolve()


def _place(path: str, start: Path | None = None) -> Path:
    """Absolute path of a file, from a directory; None: from the current one.

    Raises:
        InputError: nothing can have this path.
    """
    try:
        return ((start or Path()) / Path(path).expanduser()).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # too long, home of an unknown user
        raise InputError(f'scenario {path}: {getattr(error, "strerror", None) or error}') from None
