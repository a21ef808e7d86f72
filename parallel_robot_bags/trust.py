"""Whether the code that a bag holds may run here."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from parallel_robot_base.errors import BagError

TRUSTED = Path('parallel_robot', 'trusted_laws')  # in the user's configuration


def add_trust_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the argument that lets the code of a bag run."""
    parser.add_argument(
        '--trust',
        action='store_true',
        help='run the laws whose code the bag holds; on a terminal it is shown first',
    )


def custom_laws(bag: Path, laws: Mapping[str, bytes], directory: Path, trust: bool) -> list[str]:
    """Write the laws that a bag holds to files, if they may run.

    They may run when the user says so or has noted their digests: the first words of the lines of
    ``~/.config/parallel_robot/trusted_laws``, as ``sha256sum`` writes them.

    Args:
        bag: The bag, for error messages.
        laws: Name to source of each.
        directory: Where to write them.
        trust: Whether the user allowed it; on a terminal, they are asked once more.

    Returns:
        The files.

    Raises:
        BagError: they may not run.
    """
    noted = _noted()
    strange = {
        name: source
        for name, source in laws.items()
        if hashlib.sha256(source).hexdigest() not in noted
    }
    if strange and not trust:
        one, it = ('the law', 'it') if len(strange) == 1 else ('the laws', 'them')
        raise BagError(
            f'{bag} holds the code of {one} {", ".join(strange)}, which would run with all your '
            f'rights; --trust runs {it}'
        )
    if strange and sys.stdin.isatty() and sys.stderr.isatty():
        _ask(strange)
    if laws:
        print(f'runs the code of {", ".join(laws)}, which the bag holds', file=sys.stderr)
    files = []
    for name, source in laws.items():
        file = directory / f'{name}.py'
        file.write_bytes(source)
        files.append(str(file))
    return files


def _noted() -> set[str]:
    """Digests of the laws that the user trusts."""
    home = os.environ.get('XDG_CONFIG_HOME') or os.path.expanduser('~/.config')
    try:
        lines = (Path(home) / TRUSTED).read_text(errors='replace').splitlines()
    except OSError:
        return set()
    return {line.split()[0].lower() for line in lines if line.strip()}


def _ask(laws: Mapping[str, bytes]) -> None:
    """Show laws on the terminal and ask whether to run them.

    Raises:
        BagError: the user refuses.
    """
    for name, source in laws.items():
        print(f'---- {name}.py, sha256 {hashlib.sha256(source).hexdigest()}', file=sys.stderr)
        print(source.decode(errors='replace'), file=sys.stderr)
    print('---- run this code? [y/N] ', end='', file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ('y', 'yes'):
        raise BagError('the code of the bag is not run')
