"""Completion of the command line in a shell, by argcomplete."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from typing import Any

from parallel_robot_model.configuration import config, config_files

ASKED = '_ARGCOMPLETE'  # set by the shell while it asks


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell that asks what a word may become, and end this process."""
    import argcomplete  # only a shell needs it

    for action in _actions(parser):
        if action.dest in WORDS:
            action.completer = _completer(WORDS[action.dest])  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser)


def words() -> list[str]:
    """Words of the line that the shell completes."""
    return os.environ.get('COMP_LINE', '').split()


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Arguments of a parser and of its subcommands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for subparser in action.choices.values():
                yield from _actions(subparser)


def _completer(find: Callable[[], list[str]]) -> Callable[..., list[str]]:
    """What argcomplete calls: words, and files, which may stand in their place."""
    from argcomplete.completers import FilesCompleter

    def completer(prefix: str, **_: Any) -> list[str]:
        found = [word for word in find() if word.startswith(prefix)]
        return found + FilesCompleter(('yaml', 'yml'))(prefix)

    return completer


def _scenarios() -> list[str]:
    return config_files.scenario_names(config.directory() / 'scenarios')


def _studies() -> list[str]:
    return config_files.scenario_names(config.directory() / 'studies')


def _laws() -> list[str]:
    return config_files.scenario_names(config.directory() / 'laws')


def _keys() -> list[str]:
    return [f'{key}=' for key in config.resolve('paper_circle')]


WORDS: dict[str, Callable[[], list[str]]] = {  # by the name that argparse gives an argument
    'scenario': lambda: [*_scenarios(), *_studies()],
    'study': _studies,
    'law': _laws,
    'laws': _laws,
    'assignments': _keys,
}
