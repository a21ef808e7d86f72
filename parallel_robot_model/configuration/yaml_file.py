"""Keys and values of a user: a YAML file, read once with limits, or words of a command line."""

from __future__ import annotations

import contextlib
import datetime
import logging
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.configuration.hazards import KEY as HAZARDS
from parallel_robot_model.configuration.plain_data import (
    LOADER,
    LocatedDict,
    SourceLocation,
    with_location,
)

TEXT, STRING = 'tag:yaml.org,2002:str', 40  # tag of a text; characters of a value in a message


# YAML 1.1 takes 1e6, which has no decimal point, for a text; nobody means that.
FLOAT = (
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
    list('-+.0123456789'),
)
Loader: Any = type('Loader', (LOADER,), {})
Loader.add_implicit_resolver(*FLOAT)


def _whole_number(loader: Any, node: Any) -> int:
    """A whole number; one that YAML 1.1 takes for octal is hardly meant so."""
    number: int = loader.construct_yaml_int(node)
    digits = node.value.replace('_', '').lstrip('+-')
    if digits.isdecimal() and int(digits) != abs(number):
        raise ValueError(
            f'{node.value} is octal for YAML, {number}; write {number} or {digits.lstrip("0")}'
        )
    return number


Loader.add_constructor('tag:yaml.org,2002:int', _whole_number)
Dumper: Any = type('Dumper', (yaml.SafeDumper,), {})
Dumper.add_implicit_resolver(*FLOAT)


def text_of(value: Any) -> str:
    """A number, a text, a truth value or a list of those as one line of YAML."""
    text = yaml.dump(
        value,
        Dumper=Dumper,
        default_flow_style=True,
        default_style='"' if isinstance(value, str) and '\n' in value else None,
        width=math.inf,
        allow_unicode=True,
    )
    return str(text).removesuffix('...\n').rstrip('\n')


def kind_of(value: Any) -> str:
    """What a value is that YAML made of something and that no parameter can have."""
    return 'a date' if isinstance(value, datetime.date) else f'a {type(value).__name__}'


def read(path: Path) -> LocatedDict:
    """Read keys and values; nested groups become dotted keys.

    Args:
        path: Its place.

    Returns:
        Key to a number, a text, a truth value, None, or a list of those; hazards may be a list of
        mappings.

    Raises:
        InputError: there is no such file, it cannot be read, is too large or is not YAML; a key
            stands twice or is not a text; a value is none of these.
    """
    content = text(path)
    try:
        plain_data.bound(content)
        loader = Loader(content)
        root = loader.get_single_node()
        values = LocatedDict()
        if not isinstance(root, yaml.MappingNode):
            raise InputError(f'{path} must hold keys and values')
        _flatten(path, loader, root, '', values)
    except yaml.MarkedYAMLError as error:
        where = f', line {error.problem_mark.line + 1}' if error.problem_mark else ''
        what = ', '.join(filter(None, (error.context, error.problem)))
        raise InputError(f'{path}{where}: not valid YAML: {what}') from None
    except yaml.YAMLError as error:
        raise InputError(f'{path}: not valid YAML: {printable(error)}') from None
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f'{path} has what a configuration cannot: {printable(error)}') from None
    return values


def key_locations(text: str, file: str) -> dict[str, SourceLocation]:
    """Where the keys of a text stand, those of groups, too.

    Args:
        text: A text that was already read as YAML, with mappings whose keys are texts.
        file: What its file is called.

    Returns:
        Dotted key to place.
    """
    places: dict[str, SourceLocation] = {}

    def note(node: Any, prefix: str) -> None:
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            places[f'{prefix}{key.value}'] = SourceLocation(file, key.start_mark.line + 1)
            note(value, f'{prefix}{key.value}.')

    with contextlib.suppress(yaml.YAMLError):  # JSON may be none
        note(yaml.compose(text, LOADER), '')
    return places


def text(path: Path, most: int = plain_data.MAX_LENGTH) -> str:
    """Content of a regular file of at most so many bytes.

    Raises:
        InputError: there is none, it cannot be read, is too large or is not a text.
    """
    try:
        return content(path, most).decode('utf-8-sig')
    except UnicodeDecodeError:
        raise InputError(f'{path} is not a text in UTF-8') from None


def content(path: Path, most: int) -> bytes:
    """The bytes of a regular file, at most so many.

    Raises:
        InputError: there is none, it cannot be read or is too large.
    """
    try:
        if not path.is_file():  # a pipe or a device may never end
            what = 'is not a file' if path.exists() else 'does not exist'
            raise InputError(f'{path} {what}')
        with path.open('rb') as stream:
            content = stream.read(most + 1)
    except (OSError, ValueError) as error:  # a name too long, or with a null character
        reason = getattr(error, 'strerror', None) or error
        raise InputError(f'{path} cannot be read: {reason}') from None
    if len(content) > most:
        raise InputError(f'{path} has more than {most} bytes')
    return content


def _flatten(path: Path, loader: Any, node: Any, prefix: str, values: LocatedDict) -> None:
    """Add the keys of a mapping to those found."""
    own = set()
    for key_node, value_node in node.value:
        where = f'{path}, line {key_node.start_mark.line + 1}'
        if key_node.tag != TEXT:
            written = printable(getattr(key_node, 'value', key_node.tag), STRING)
            raise InputError(f'{where}: the key {written} is not a text for YAML; quote it')
        key = f'{prefix}{key_node.value}'
        if key in own or key in values:
            raise InputError(f'{where}: {printable(key)} stands twice')
        own.add(key)
        if isinstance(value_node, yaml.MappingNode):
            _flatten(path, loader, value_node, f'{key}.', values)
            continue
        value = loader.construct_object(value_node, deep=True)
        for item in value if isinstance(value, list) else [value]:
            if isinstance(item, dict) and key_node.value == HAZARDS and isinstance(value, list):
                continue
            if not (item is None or isinstance(item, (bool, int, float, str))):
                scalar = isinstance(value_node, yaml.ScalarNode)
                shown = printable(value_node.value, STRING) if scalar else 'a list'
                what = f'{printable(key)} cannot be {shown}: YAML reads {kind_of(item)} there'
                raise InputError(f'{where}: {what}')
        values[key] = value
        values.locations[key] = SourceLocation(str(path), key_node.start_mark.line + 1)


# Parameter files: keys and values, or the form in which ROS has them, by node.

NODES = ('trajectory', 'plant', 'controller', 'recorder', 'monitor')  # which have a configuration
ROS_PARAMETERS = ('use_sim_time', 'start_type_description_service')  # of every node
OTHER_GROUPS = ('qos_overrides.', 'granted.')  # prefixes of what is not configuration
MOTION = 'granted.motion'  # the newest that the trajectory node took over while it ran, in words
CODE = {'custom_laws', 'custom_robots', 'custom_trajectories'}  # keys that name Python files
MARK = 'ros__parameters'  # between the name of a node and its parameters


def is_configuration(name: str) -> bool:
    """Whether a parameter of a node belongs to the configuration, as far as its name tells."""
    return name not in ROS_PARAMETERS and not name.startswith(OTHER_GROUPS)


def read_parameter_file(path: Path) -> LocatedDict:
    """Read a parameter file.

    In the form of ROS, what is for a node wins over what is for all (``/**``), whatever the
    namespace; other nodes are left out with a warning, and so are parameters of ROS itself.

    Args:
        path: Its place.

    Returns:
        Dotted key to value.

    Raises:
        InputError: it cannot be read, names code, or gives two nodes different values of one key.
    """
    values = read(path)
    if is_ros_parameter_file(values):
        values = _by_node(path, values)
    for key in CODE & values.keys():
        if values[key]:
            with with_location(values):
                raise InputError(f'{key} is code: give it by --set {key}=[FILE]', key)
        del values[key]
    return values


def is_ros_parameter_file(values: Mapping[str, Any]) -> bool:
    """Whether flat keys are those of a parameter file of ROS."""
    return any(MARK in key.split('.') for key in values)


def _by_node(path: Path, values: LocatedDict) -> LocatedDict:
    """Parameters of the nodes of the suite."""
    parameters: dict[
        str, tuple[Any, str, SourceLocation]
    ] = {}  # value, the node that it is for, its place
    strangers = set()
    for own in (False, True):  # a node's own parameters count more than those for all
        for full, value in values.items():
            node, _, key = f'.{full}'.partition(f'.{MARK}.')
            node = node.removeprefix('.').replace('.', '/')
            if not key:
                raise InputError(f'{path}: {printable(full)} stands outside {MARK}')
            if not node:
                raise InputError(f'{path}: {MARK} must stand under the name of a node, or /**')
            name = node.rpartition('/')[2]
            if name not in NODES and '*' not in name:
                strangers.add(printable(node))
            elif (name in NODES) == own and is_configuration(key):
                before, other, _ = parameters.get(key, (value, '', None))
                if before != value and (other.rpartition('/')[2] in NODES or not own):
                    raise InputError(
                        f'{path}: {key} is {before} for {other} and {value} for {node}'
                    )
                parameters[key] = value, node, values.locations[full]
    for name in sorted(strangers):
        text = f'{path}: {name} is not a node of the suite; its parameters are left out'
        logging.getLogger('parallel_robot').warning(text)
    return LocatedDict(
        {key: value for key, (value, *_) in parameters.items()},
        {key: place for key, (*_, place) in parameters.items()},
    )


# Words ``KEY=VALUE`` of a command line.


def parse_assignments(assignments: list[str], option: str = '--set') -> dict[str, Any]:
    """Read ``key=value`` words of a command line; values as in YAML. The option is for messages.

    Raises:
        InputError: a word without '=' or with a value that YAML cannot read.
    """
    values = {}
    for word in assignments:
        key, equals, value = word.partition('=')
        if not equals or not key:
            raise InputError(f'{option} takes KEY=VALUE, not {word!r}')
        try:
            read = yaml.load(value, Loader)  # numbers as in a file
        except (yaml.YAMLError, ValueError, RecursionError) as error:  # the 45th of a month
            shown = printable(value)
            why = f': {printable(error)}' if isinstance(error, ValueError) else ''
            raise InputError(f'{option} {key}: {shown!r} is not a YAML value{why}') from None
        if not isinstance(read, (bool, int, float, str, list, dict, type(None))):
            raise InputError(f'{option} {key}: YAML reads {kind_of(read)}; quote {value}')
        values[key.strip()] = _number(read)
    return values


def _number(value: Any) -> Any:
    """A number that YAML reads as text, such as 1e6, because it expects a decimal point."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value
