"""Typed groups of a configuration: each package declares its own; built once, at the edge."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from parallel_robot_model.configuration import fields
from parallel_robot_model.configuration.placed import locating

Group = TypeVar('Group')  # a NamedTuple whose fields are described, see fields.py
Declared = Iterable[tuple[str, Any]]  # prefix and type of each group; '': keys without a dot


class Groups:
    """Groups of parameters, whose values are checked: ``groups[SafetyParameters]``."""

    def __init__(self, groups: Mapping[tuple[str, Any], Any]) -> None:
        """Hold the groups of prefixes and types."""
        self._found = groups

    def __getitem__(self, kind: type[Group]) -> Group:
        """The group of a type that is declared once."""
        (group_of_kind,) = (group for (_, known), group in self._found.items() if known is kind)
        return group_of_kind

    def at(self, prefix: str, kind: type[Group]) -> Group:
        """The group of a type that has several prefixes, e.g. that of two robots."""
        group_there: Group = self._found[prefix, kind]
        return group_there


def build(values: Mapping[str, Any], declared: Declared) -> Groups:
    """Build the typed groups of a resolved configuration.

    Args:
        values: Dotted key to value. Keys that no group declares are left to others.
        declared: The groups. Several may share a prefix.

    Raises:
        InputError: a value is missing or wrong.
    """
    given = values.get('joints')
    joints = len(given) if isinstance(given, list) else None
    groups: dict[tuple[str, Any], Any] = {}
    for prefix, kind in declared:
        start = f'{prefix}.' if prefix else ''
        keys = [parameter.key for parameter in fields.parameters(kind)]
        own = {key: values[start + key] for key in keys if start + key in values}
        groups[prefix, kind] = fields.build(kind, own, start, joints)
    return Groups(groups)


def group(values: Mapping[str, Any], kind: type[Group], prefix: str) -> Group:
    """Build one group alone, see :func:`build`.

    Raises:
        InputError: a value is missing or wrong; it says where that stands.
    """
    with locating(values):
        return build(values, [(prefix, kind)])[kind]
