"""A YAML file of a user: read once, with limits, into flat dotted keys."""

from __future__ import annotations

import contextlib
import datetime
import math
import re
from pathlib import Path
from typing import Any

import yaml

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.configuration.hazards import KEY as HAZARDS
from parallel_robot_model.configuration.plain_data import LOADER, Place, Placed

TEXT, STRING = 'tag:yaml.org,2002:str', 40  # tag of a text; characters of a value in a message


# YAML 1.1 takes 1e6, which has no decimal point, for a text; nobody means that.
FLOAT = (
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
    list('-+.0123456789'),
)
Loader: Any = type('Loader', (LOADER,), {})
Loader.add_implicit_resolver(*FLOAT)


def _whole(loader: Any, node: Any) -> int:
    """A whole number; one that YAML 1.1 takes for octal is hardly meant so."""
    number: int = loader.construct_yaml_int(node)
    digits = node.value.replace('_', '').lstrip('+-')
    if digits.isdecimal() and int(digits) != abs(number):
        raise ValueError(
            f'{node.value} is octal for YAML, {number}; write {number} or {digits.lstrip("0")}'
        )
    return number


Loader.add_constructor('tag:yaml.org,2002:int', _whole)
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


def read(path: Path) -> Placed:
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
        values = Placed()
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


def places(text: str, file: str) -> dict[str, Place]:
    """Where the keys of a text stand, those of groups, too.

    Args:
        text: A text that was already read as YAML, with mappings whose keys are texts.
        file: What its file is called.

    Returns:
        Dotted key to place.
    """
    places: dict[str, Place] = {}

    def note(node: Any, prefix: str) -> None:
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            places[f'{prefix}{key.value}'] = Place(file, key.start_mark.line + 1)
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


def _flatten(path: Path, loader: Any, node: Any, prefix: str, values: Placed) -> None:
    """Add the keys of a mapping to those found.

    Raises:
        InputError: a key stands twice or is not a text, or a value is not plain.
    """
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
        values.places[key] = Place(str(path), key_node.start_mark.line + 1)
