"""Values that know where in a file they stand, so that a message can say where a mistake is."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from yaml.representer import SafeRepresenter

from parallel_robot_model.common.errors import InputError

INDEX = re.compile(r'\[\d+\]$')  # of one of several numbers


class Place(NamedTuple):
    """A line of a file, from 1, and the columns of the table that was read from there."""

    file: str
    line: int
    columns: tuple[str, ...] = ()


class Placed(dict[str, Any]):
    """Values by key.

    Attributes:
        places: Key to place, of the values that stand in a file of a user.
    """

    def __init__(
        self, values: Mapping[str, Any] | None = None, places: Mapping[str, Place] | None = None
    ) -> None:
        super().__init__(values or {})
        self.places = dict(places or {})

    def __or__(self, others: Mapping[str, Any]) -> Placed:  # type: ignore[override]
        """These values and others, which win."""
        return merged((self, others))


SafeRepresenter.add_representer(Placed, SafeRepresenter.represent_dict)  # YAML: as any dictionary


def places_of(values: Mapping[str, Any]) -> Mapping[str, Place]:
    """Places of some values; of values that know none, nothing."""
    return values.places if isinstance(values, Placed) else {}


def merged(layers: Iterable[Mapping[str, Any]]) -> Placed:
    """Values of several layers; later ones win."""
    values = Placed()
    for layer in layers:
        values.update(layer)
        if values.places:
            kept = values.places.items()
            values.places = {key: place for key, place in kept if key not in layer}
        values.places.update(places_of(layer))
    return values


@contextlib.contextmanager
def locating(values: Mapping[str, Any], file: str = '') -> Iterator[None]:
    """Let an InputError about one of the values, or about a group of them, say where it stands.

    Args:
        values: The values.
        file: What an error names that is about none of them; empty for nothing.
    """
    try:
        yield
    except InputError as error:
        key = INDEX.sub('', error.key)
        known = places_of(values)
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
