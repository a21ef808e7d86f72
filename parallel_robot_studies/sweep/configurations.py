"""Configurations of runs that differ in few keys: what a run does not change is not rebuilt."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from parallel_robot_base import config
from parallel_robot_base.loop import LoopParameters, validate
from parallel_robot_control import configuration as control
from parallel_robot_sim.configuration import Configuration, configure, configure_plant
from trajectory_gen.shapes import shapes_of
from trajectory_gen.trajectory import Trajectory

KEPT = 4  # versions of each part
NOTHING = object()


def _loop(values: Mapping[str, Any]) -> LoopParameters:
    for name, shape in shapes_of(values).items():
        config.group(values, shape.Parameters, name)
    return validate(config.group(values, LoopParameters, ''))


PARTS: dict[str, Callable[[Mapping[str, Any]], Any]] = {  # of a Configuration, beside its values
    'loop': _loop,
    'trajectory': Trajectory,
    'control': control.configure,
    'plant': configure_plant,
}


class _Reads(Mapping[str, Any]):
    """Values that note which of them are read.

    Attributes:
        read: Keys that were read, with their values; NOTHING for keys that do not exist.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = values
        self.read: dict[str, Any] = {}

    def __getitem__(self, key: str) -> Any:
        value = self.read[key] = self._values.get(key, NOTHING)
        if value is NOTHING:
            raise KeyError(key)
        return value

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)


class Configurations:
    """Builds configurations as :func:`configure` does.

    A part is used again, the same object, as long as the values that it was built from are equal.
    """

    def __init__(self) -> None:
        self._known: dict[str, deque[tuple[dict[str, Any], Any]]] = {
            name: deque(maxlen=KEPT) for name in PARTS
        }

    def build(self, values: Mapping[str, Any]) -> Configuration:
        """The configuration of resolved values.

        Raises:
            InputError: a value is wrong.
        """
        if {*PARTS, 'values'} != {*Configuration._fields}:
            return configure(values)  # it has a part that is not known here
        return Configuration(values=values, **{name: self._part(name, values) for name in PARTS})

    def _part(self, name: str, values: Mapping[str, Any]) -> Any:
        for read, part in self._known[name]:
            if all(values.get(key, NOTHING) == value for key, value in read.items()):
                return part
        reads = _Reads(values)
        part = PARTS[name](reads)
        self._known[name].appendleft((reads.read, part))
        return part
