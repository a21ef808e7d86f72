"""Whether the code that a bag holds may run here."""

from __future__ import annotations

import argparse
import ast
import hashlib
import io
import os
import re
import shutil
import stat
import sys
import tokenize
import warnings
from collections.abc import Iterator, Mapping
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from parallel_robot.bags import output
from parallel_robot.bags.limits import NAME, SOURCE, SOURCES
from parallel_robot_control.foreign import law
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.processes import custom_module
from parallel_robot_model.robots.registry import is_known
from trajectory_gen.shapes import shapes

NARROWEST = 40  # columns of a line
ENDS = re.compile('\r\n|\r|\n')  # of lines, as Python reads them


def _decoded_source(name: str, source: bytes) -> str:
    """The text of a source as Python reads it."""
    try:
        text = source.decode('utf-8-sig')
        lines = io.BytesIO(re.sub(rb'\r\n?', b'\n', source)).readline
        encoding = tokenize.detect_encoding(lines)[0]
        if encoding not in ('utf-8', 'utf-8-sig'):
            raise BagError(f'{name} declares the encoding {encoding}; code of a bag must be UTF-8')
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            same = ast.dump(ast.parse(source)) == ast.dump(ast.parse(text))
    except UnicodeDecodeError as error:
        raise BagError(f'{name} is not UTF-8: byte {error.start} begins no character') from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BagError(f'{name} is no Python: {ascii(str(error))[1:-1]}') from None
    if not same:
        raise BagError(f'{name} is read by Python as another text than its own')
    return text


def code_lines(text: str) -> Iterator[str]:
    """Lines of code for a terminal, which has nothing to obey, hide or draw over its neighbours.

    Each has its number, so that no text of the code looks like one of the suite's, and escapes for
    all that is not ASCII; a long one goes on in the next.
    """
    width = max(shutil.get_terminal_size().columns - 8, NARROWEST)
    for number, line in enumerate(ENDS.split(text), 1):
        plain = line.encode('unicode_escape').decode()
        yield f'{number:5} | {plain[:width]}'
        for start in range(width, len(plain), width):
            yield f'      + {plain[start : start + width]}'


# Sources of custom modules: which files go into a bag, and under which names.

KINDS = {  # by the key that names the files
    'custom_laws': 'law',
    'custom_robots': 'robot',
    'custom_trajectories': 'trajectory',
}

Sources = Mapping[str, Mapping[str, bytes]]  # source by key of KINDS and by name


def named_files(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Files of the custom modules in a configuration, or in the parameters of a node.

    Args:
        values: Key to value; what is not a list of files is left out.

    Returns:
        Key and file of each.
    """
    return [
        (key, str(path))
        for key, paths in values.items()
        if key in KINDS and isinstance(paths, list)
        for path in paths[:SOURCES]
    ]


def code_of(path: Path) -> bytes:
    """The source of a file of code; of a foreign law, that which stands for it."""
    return law.source_of(path) if law.is_foreign(path) else path.read_bytes()


def attachment(key: str, path: str) -> tuple[str, bytes]:
    """Name and content of the attachment of a file as it is now; the code is not run.

    Of a foreign law, the source that names it.

    Args:
        key: Key of KINDS.
        path: The file, absolute: a node may have another current directory.

    Raises:
        InputError: there is no such file, it or what a link leads to is no .py file, it cannot
            be read, or it is too large.
    """
    what = f'the {KINDS[key]} file {path}'
    try:
        if not Path(path).is_absolute() or not Path(path).exists():
            raise InputError(f'{what} is not on this machine')
        file = Path(path).resolve(strict=True)  # as it is loaded: a link has no name of its own
        if KINDS[key] == 'law' and law.is_foreign(file):
            return f'{key}/{file.stem}', law.source_of(file)
        if file.suffix != '.py' or not file.is_file():
            raise InputError(f'{what} is no .py file{"" if str(file) == path else f" but {file}"}')
        descriptor = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, 'rb') as stream:
            opened = Path(os.readlink(f'/proc/self/fd/{descriptor}'))
            if opened != file or not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise InputError(f'{what} has been replaced while it was opened')
            source = stream.read(SOURCE + 1)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f'{what} cannot be read: {error}') from None
    if len(source) > SOURCE:
        raise InputError(f'{what} has more than {SOURCE} bytes')
    return f'{key}/{file.stem}', source


def parse_attachment(attachment: str) -> tuple[str, str] | None:
    """Key and name of the custom module in an attachment; None if it is something else."""
    key, _, name = attachment.partition('/')
    good = name.isidentifier() and len(name.encode()) <= NAME
    return (key, name) if key in KINDS and good else None


# Modules beside a bag: whoever made the bag may have put them there, and nobody is shown them.

PATHS = 'PYTHONPATH'  # for the processes that are started


def _refuse_near_modules(bag: Path, texts: Mapping[str, str]) -> None:
    """Let code of a bag import nothing that lies beside the bag or in the current directory.

    The suite itself may lie there.
    """
    if not texts:
        return
    near = {Path.cwd().resolve(), bag.resolve(), bag.resolve().parent}
    near.discard(Path(__file__).resolve().parents[2])
    for title, text in texts.items():
        for module in _imported(text):
            found = _place(module)
            if found is not None and found.parent in near:
                raise BagError(
                    f'{bag}: {title.partition(",")[0]} imports {module} from {found}, which lies '
                    'beside the bag, not in it; a module that is installed can be imported'
                )
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() not in near]
    if os.environ.get(PATHS):
        entries = os.environ[PATHS].split(os.pathsep)
        kept = [entry for entry in entries if Path(entry).resolve() not in near]
        os.environ[PATHS] = os.pathsep.join(kept)


def _imported(text: str) -> Iterator[str]:
    """Names of the outermost packages that code imports."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        nodes = ast.walk(ast.parse(text))
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name.partition('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition('.')[0]


def _place(module: str) -> Path | None:
    """File or folder of an outermost module."""
    if module in sys.builtin_module_names:
        return None
    found = PathFinder.find_spec(module)
    if found is None:
        return None
    for folder in found.submodule_search_locations or ():
        return Path(folder).resolve()
    return Path(found.origin).resolve() if found.origin else None


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
) -> dict[str, list[str]]:
    """Write the custom laws, robot and trajectory of a bag to files, if they may run.

    On a command line the user is told what runs and, on a terminal, asked once more. They may run
    when the user says so or has noted their digests: the first words of the lines of
    ``~/.config/parallel_robot/trusted_laws``, as ``sha256sum`` writes them.

    Args:
        bag: The bag, for error messages.
        sources: What it holds; all laws are written, since any may become active.
        values: Its configuration: other robots and trajectories than it names are left out.
        directory: Where to write them.
        trust: Whether the user allowed it.

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
        texts[f'{name}.py, sha256 {hashlib.sha256(source).hexdigest()}'] = _decoded_source(
            f'{bag}: {name}.py', source
        )
    _refuse_near_modules(bag, texts)
    if output.interactive and count and sys.stdin.isatty() and sys.stderr.isatty():
        _ask(texts)
    names = [name for found in used.values() for name in found]
    if output.interactive and names:
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
        custom_module.pin_source(file, source)
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
    """Show code on the terminal and ask whether to run it."""
    for title, text in texts.items():
        print(f'---- {ascii(title)[1:-1]}', file=sys.stderr)
        for line in code_lines(text):
            print(line, file=sys.stderr)
    count = sum(len(ENDS.split(text)) for text in texts.values())
    question = f'---- run this code, {count} lines? [y/N] '
    print(question, end='', file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ('y', 'yes'):
        raise BagError('the code of the bag is not run')


# Whether a bag holds the robot and the trajectory that its configuration names.


def check_held_code(bag: Path, values: Mapping[str, Any], addable: bool = False) -> None:
    """Refuse a bag whose robot or trajectory is of neither the suite nor the files that are given.

    Args:
        bag: The bag, for error messages.
        values: Its configuration, with the files of its custom code that may run.
        addable: Whether the user may give files of his own.

    Raises:
        BagError: one is not known.
    """
    hint = '; --set {}=[FILE] adds one' if addable else ''
    if not is_known(values):
        lacks = f'{bag} does not hold the robot {values["robot_model"]}'
        raise BagError(lacks + hint.format('custom_robots'))
    shape = values['trajectory.shape']
    if shape not in shapes(values['custom_trajectories']):
        lacks = f'{bag} does not hold the trajectory {shape}'
        raise BagError(lacks + hint.format('custom_trajectories'))
