"""A study that starts from another one, its base, and says only what differs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.plain_data import Place

GROUPS = ('set', 'uncertainty')  # are merged key by key; a key is in one of them


def merged(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """What a study says with what its base says; whatever is malformed is left to be refused.

    Args:
        base: Content of the base.
        own: Content of the study, whose keys win.
    """
    found = {**base, **own}
    below, above = ({key: _keys(each, key) for key in GROUPS} for each in (base, own))
    said = {key for group in above.values() for key in group}
    for key in GROUPS:
        if own.get(key) is None or isinstance(own[key], dict):
            kept = {name: value for name, value in below[key].items() if name not in said}
            found[key] = kept | above[key]
    if isinstance(own.get('laws'), list):
        found['laws'] = chosen(base.get('laws'), own['laws'])
    return found


def chosen(known: Any, names: Sequence[Any]) -> Any:
    """Laws of a study by name.

    Args:
        known: Laws of the study, a list of names or names with gains.
        names: A name of these keeps its gains; another is that of a law.
    """
    if not isinstance(known, dict) or len({*map(str, names)}) < len(names):
        return [*names]
    return {name: known.get(name, {}) for name in names}


def places(
    base: Mapping[str, Place], own: Mapping[str, Place], content: Mapping[str, Any]
) -> dict[str, Place]:
    """Where the keys of a study with a base stand; `content` is that of the study alone."""
    replaced = content.keys() - {*GROUPS}
    kept = {key: place for key, place in base.items() if key.partition('.')[0] not in replaced}
    return {**kept, **own}


def _keys(content: Mapping[str, Any], group: str) -> dict[str, Any]:
    """Dotted keys of `set` or `uncertainty`, and their values."""
    found = content.get(group)
    if not isinstance(found, dict):
        return {}
    return config.flat(found) if group == 'set' else found
