"""Whether the code that a bag holds may run here."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from parallel_robot.bags.custom_code import near_modules, shown_code
from parallel_robot.bags.custom_code.custom_sources import KINDS, Sources
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.processes import custom_module

TRUSTED = Path('parallel_robot', 'trusted_laws')  # in the user's configuration


def add_trust_argument(
    parser: argparse.ArgumentParser, what: str = 'the laws, the robot and the trajectory'
) -> None:
    """Declare the argument that lets the code of a bag run; `what` of it."""
    parser.add_argument(
        '--trust',
        action='store_true',
        help=f'run {what} whose code the bag holds; on a terminal, show it first',
    )


def custom_files(
    bag: Path,
    sources: Sources,
    values: Mapping[str, Any],
    directory: Path,
    trust: bool,
    told: bool = True,
) -> dict[str, list[str]]:
    """Write the custom laws, robot and trajectory of a bag to files, if they may run.

    They may run when the user says so or has noted their digests: the first words of the lines of
    ``~/.config/parallel_robot/trusted_laws``, as ``sha256sum`` writes them.

    Args:
        bag: The bag, for error messages.
        sources: What it holds; all laws are written, since any may become active.
        values: Its configuration: other robots and trajectories than it names are left out.
        directory: Where to write them.
        trust: Whether the user allowed it.
        told: Whether the user is told what runs and, on a terminal, asked once more.

    Returns:
        The files by key of the configuration.

    Raises:
        BagError: they may not run.
    """
    chosen = {
        'custom_robots': values['robot_model'],
        'custom_trajectories': values['trajectory.shape'],
    }
    used = {
        key: {
            name: source
            for name, source in sources.get(key, {}).items()
            if chosen.get(key, name) == name
        }
        for key in KINDS
    }
    noted = _noted()
    strange = {
        key: {
            name: source
            for name, source in found.items()
            if hashlib.sha256(source).hexdigest() not in noted
        }
        for key, found in used.items()
    }
    count = sum(map(len, strange.values()))
    if count and not trust:
        raise BagError(
            f'{bag} holds the code of {_words(strange)}, which would run with all your '
            f'rights; --trust runs {"it" if count == 1 else "them"}'
        )
    texts = {}
    for name, source in (pair for found in strange.values() for pair in found.items()):
        texts[f'{name}.py, sha256 {hashlib.sha256(source).hexdigest()}'] = shown_code.decoded(
            f'{bag}: {name}.py', source
        )
    near_modules.refuse(bag, texts)
    if told and count and sys.stdin.isatty() and sys.stderr.isatty():
        _ask(texts)
    names = [name for found in used.values() for name in found]
    if told and names:
        print(f'runs the code of {", ".join(names)}, which the bag holds', file=sys.stderr)
    return {key: _write(found, directory / key) for key, found in used.items()}


def _words(sources: Sources) -> str:
    groups = [
        f'the {KINDS[key]}{"s" if len(found) > 1 else ""} {", ".join(found)}'
        for key, found in sources.items()
        if found
    ]
    return ' and '.join(groups)


def _write(sources: Mapping[str, bytes], directory: Path) -> list[str]:
    """Write sources by name into a new directory and return the files.

    What runs is what was shown, whatever becomes of the files.
    """
    directory.mkdir()
    files = {directory / f'{name}.py': source for name, source in sources.items()}
    for file, source in files.items():
        file.write_bytes(source)
        custom_module.hold(file, source)
    return list(map(str, files))


def _noted() -> set[str]:
    """Digests of the files that the user trusts."""
    home = os.environ.get('XDG_CONFIG_HOME') or os.path.expanduser('~/.config')
    if not os.path.isabs(home):  # as it is where there is no home
        return set()
    try:
        lines = (Path(home) / TRUSTED).read_text(errors='replace').splitlines()
    except OSError:
        return set()
    return {line.split()[0].lower() for line in lines if line.strip()}


def _ask(texts: Mapping[str, str]) -> None:
    """Show code on the terminal and ask whether to run it.

    Args:
        texts: The code by title.

    Raises:
        BagError: the user refuses.
    """
    encoding = getattr(sys.stderr, 'encoding', None) or 'ascii'
    for title, text in texts.items():
        print(f'---- {shown_code.spelled(title, encoding)[0]}', file=sys.stderr)
        for line in shown_code.lines(text, encoding):
            print(line, file=sys.stderr)
    count = sum(len(shown_code.ENDS.split(text)) for text in texts.values())
    question = f'---- run this code, {count} lines? [y/N] '
    print(question, end='', file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ('y', 'yes'):
        raise BagError('the code of the bag is not run')
