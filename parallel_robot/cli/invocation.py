"""How the user started the command line, for commands that are told to be typed next."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

NAME = 'parallel_robot'


def words() -> list[str]:
    """The words before the subcommand; the name of the program when they cannot be known."""
    given = Path(sys.argv[0])
    if given.name == '__main__.py' and given.parent.name == 'parallel_robot':
        return ['python', '-m', __name__.partition('.')[0]]
    if given.name != NAME:
        return [NAME]
    if given.parts[-3:-1] == ('lib', NAME):
        return ['ros2', 'run', NAME, NAME]
    return [NAME] if shutil.which(NAME) == str(given) else [str(given)]
