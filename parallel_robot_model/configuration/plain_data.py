"""Plain values from untrusted text: JSON or YAML."""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import yaml
from yaml.representer import SafeRepresenter

from parallel_robot_model.common.errors import InputError

# The loader written in C, if installed, is seven times faster.
LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)

MAX_LENGTH = 1 << 20  # characters
DEEPEST = 20  # lists and mappings in one another
MERGE = 'tag:yaml.org,2002:merge'
PARTS = 100_000  # values in all, what an alias stands for counted again


class NotFiniteError(ValueError):
    """A number that is infinite or none."""

    def __init__(self, key: str, value: float) -> None:
        self.key = key  # its dotted key; in a list, with the index
        super().__init__(f'{key or "a number"} must be finite, not {value}')


def dump(values: Mapping[str, Any]) -> str:
    """Write a mapping as JSON, in the order of its keys."""
    return json.dumps(dict(values), sort_keys=True, ensure_ascii=False)


def load(text: str, longest: int = MAX_LENGTH) -> Any:
    """Read JSON or YAML.

    Args:
        text: Text of any origin.
        longest: How many characters it may have.

    Returns:
        Null, a truth value, a finite number, a text, a list or a mapping with texts as keys.

    Raises:
        NotFiniteError: a number is not finite.
        ValueError: it is neither, holds anything else, or is too long or too deep.
    """
    if len(text) > longest:
        raise ValueError(f'longer than {longest} characters')
    try:
        data = json.loads(text)
    except RecursionError:  # hundreds of brackets or braces, which YAML would have to nest as well
        raise ValueError('too deep') from None
    except ValueError:
        data = _yaml(text)
    _check(data, DEEPEST)
    return data


def mapping(text: str) -> dict[str, Any]:
    """Read a mapping; empty when there is none.

    Keys whose values are neither plain nor lists of plain values are left out.
    """
    try:
        data = load(text)
    except ValueError:
        return {}
    items = data.items() if isinstance(data, dict) else ()
    return {key: value for key, value in items if flat(value)}


def flat(value: Any) -> bool:
    """Whether a value is a number, a text or a truth value, or a list of those."""
    items = value if isinstance(value, list) else [value]
    return all(isinstance(item, (bool, int, float, str)) for item in items)


def whole_number(text: str, low: int = 0, high: int = (1 << 63) - 1) -> int | None:
    """A whole number in decimal digits, as the suite writes it; None for anything else."""
    digits = text.removeprefix('-')
    if not (digits.isascii() and digits.isdigit() and len(digits) < 20):
        return None
    number = int(text)
    return number if low <= number <= high else None


def _yaml(text: str) -> Any:
    try:
        bound(text)
        return yaml.load(text, LOADER)
    except (yaml.YAMLError, RecursionError, TypeError, OverflowError) as error:
        raise ValueError(type(error).__name__) from None


def bound(text: str) -> None:
    """Refuse YAML that nests too deep, merges or repeats itself, before it is put together.

    The events are checked one by one, because the composer in C has no limits of its own.

    Raises:
        ValueError: it does.
        yaml.YAMLError: it is not YAML.
    """
    open_parts: list[tuple[str | None, int]] = []  # anchor, and the parts before it
    sizes: dict[str, int] = {}  # of finished anchors
    parts = 0
    for event in yaml.parse(text, LOADER):
        parts += 1
        if isinstance(event, yaml.CollectionStartEvent):
            open_parts.append((event.anchor, parts))
            if event.anchor in sizes:
                raise ValueError('an anchor stands twice')
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, begin = open_parts.pop()
            if anchor is not None:
                sizes[anchor] = parts - begin
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError('an alias inside its own anchor')
            parts += sizes[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            if event.tag == MERGE or (event.value == '<<' and event.implicit[0]):
                raise ValueError('a merge key')
            if event.anchor is not None:
                sizes[event.anchor] = 1
        if len(open_parts) > DEEPEST or parts > PARTS:
            raise ValueError('too deep or too many')


def _check(value: Any, depth: int, key: str = '') -> None:
    """Refuse everything that is not a plain value."""
    if isinstance(value, (list, dict)):
        if depth == 0:
            raise ValueError('too deep')
        if isinstance(value, dict) and not all(isinstance(key, str) for key in value):
            raise ValueError('a key that is not a text')
        if isinstance(value, dict):
            for name, item in value.items():
                _check(item, depth - 1, f'{key}.{name}'.removeprefix('.'))
        else:
            for k, item in enumerate(value):
                _check(item, depth - 1, f'{key}[{k}]')
    elif isinstance(value, int) and not isinstance(value, bool):
        if value.bit_length() > 64:
            raise ValueError('a number of more than 64 bits')
    elif not (value is None or isinstance(value, (bool, float, str))):
        raise ValueError(f'{type(value).__name__} is not a plain value')
    elif isinstance(value, float) and not math.isfinite(value):
        raise NotFiniteError(key, value)


# Values that know where in a file they stand, so that a message can say where a mistake is.

INDEX = re.compile(r'\[\d+\]$')  # of one of several numbers


class SourceLocation(NamedTuple):
    """A line of a file, from 1, and the columns of the table that was read from there."""

    file: str
    line: int
    columns: tuple[str, ...] = ()


class LocatedDict(dict[str, Any]):
    """Values by key."""

    def __init__(
        self,
        values: Mapping[str, Any] | None = None,
        places: Mapping[str, SourceLocation] | None = None,
    ) -> None:
        super().__init__(values or {})
        # key to place, of the values that stand in a file of a user
        self.locations = dict(places or {})

    def __or__(self, others: Mapping[str, Any]) -> LocatedDict:  # type: ignore[override]
        """These values and others, which win."""
        return merged((self, others))


# in YAML as any dictionary
SafeRepresenter.add_representer(LocatedDict, SafeRepresenter.represent_dict)


def locations_of(values: Mapping[str, Any]) -> Mapping[str, SourceLocation]:
    """Places of some values; of values that know none, nothing."""
    return values.locations if isinstance(values, LocatedDict) else {}


def merged(layers: Iterable[Mapping[str, Any]]) -> LocatedDict:
    """Values of several layers; later ones win."""
    values = LocatedDict()
    for layer in layers:
        values.update(layer)
        if values.locations:
            entries = values.locations.items()
            values.locations = {key: place for key, place in entries if key not in layer}
        values.locations.update(locations_of(layer))
    return values


@contextlib.contextmanager
def with_location(values: Mapping[str, Any], file: str = '') -> Iterator[None]:
    """Let an InputError about one of the values, or about a group of them, say where it stands.

    Args:
        values: The values.
        file: What an error names that is about none of them; empty for nothing.
    """
    try:
        yield
    except InputError as error:
        key = INDEX.sub('', error.key)
        known = locations_of(values)
        group = [place for name, place in known.items() if name.startswith(f'{key}.')]
        places = [known[key]] if key in known else group
        if key and places:
            name = places[0].file
            lines = sorted({place.line for place in places if place.file == name})
            numbers = ' and '.join(map(str, lines))
            file = f'{name}, line{"s" * (len(lines) > 1)} {numbers}'
        if file:
            error.args, error.key = (f'{file}: {error}',), ''
        raise
