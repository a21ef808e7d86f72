"""The command ``fronts``: the fronts of several tunings in one picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from parallel_robot.bags import new_files
from parallel_robot.studies.tuning import fronts
from parallel_robot.studies.tuning.picture import SUFFIXES
from parallel_robot_model.common.errors import InputError

FORMATS = tuple(f'.{suffix}' for suffix in SUFFIXES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'directories', type=Path, nargs='+', metavar='DIR', help='--out of a `tune` that has ended'
    )
    parser.add_argument(
        '--out',
        type=Path,
        required=True,
        metavar='FILE',
        help=f'picture, {" or ".join(FORMATS)}; must not exist',
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    out: Path = arguments.out
    if out.suffix not in FORMATS:
        raise InputError(f'--out must end with {" or ".join(FORMATS)}, not {out.name!r}')
    new_files.check(out, '--out')
    found = [fronts.read(directory) for directory in arguments.directories]
    fronts.check(found)
    picture = fronts.draw(found)[out.suffix.removeprefix('.')]
    try:
        new_files.write(out, picture)
    except OSError as error:
        raise InputError(f'cannot write {out}: {error.strerror}') from None
    print(f'fronts  {out}')
    return 0
