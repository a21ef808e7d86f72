"""Whether two revisions compute alike: what all commands print and write, compared.

Usage: python benchmarks/equality.py REVISION [--keep DIR] [--only NAME ...]

Copies a revision and this tree, uncommitted changes included, runs the cases of
equality_cases.txt in both, side by side, and compares exit codes, texts and files. Ends with 0 if
nothing differs, 1 with what differs first in each file, 2 if it is called wrongly. `--only` takes
names of cases as the shell does, `replay*`, and runs what they need, too.

Nine minutes of processor time in all, and two for each tree whose kernels are not compiled yet.
"""

from __future__ import annotations

import argparse
import collections
import fnmatch
import io
import itertools
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import checkout
import pyarrow.parquet
from equality_given import give
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

LIST = Path(__file__).with_name('equality_cases.txt')
SIDES = ('that', 'this')  # the revision, this tree; of one length, for paths show in texts
ROOMS = ('tree', 'work', 'printed', 'tmp', 'log', 'state')  # of a side
PATIENCE = 600.0  # s, for one case, compiling included
SHOWN = 100  # characters of a difference
FILES = 4  # files of a case that are shown

# What differs from run to run, and what stands in its place. Version, revision and command line in
# bags are alike: neither copy is a working copy of git, and both are called in the same way.
OWN = {
    r'(of motion in )[\d.]+ s \(\d+ times real time\)': r'\1WALL',  # of this run
    r'(?<=<side>/tmp/)tmp\w{8}': 'TEMPORARY',  # code of a bag, unpacked for its run
    r'^((fmu|package) .* parameters, )[\d.]+ s$': r'\1WALL',  # of compiling it
    r'^( +"seconds": )[\d.]+$': r'\1WALL',  # of a benchmark
    r'(guid|instantiationToken)( ?= ?)"[0-9a-f-]{36}"': r'\1\2"ID"',  # a hash of NATIVE
    r"(?<=\.fmu',\n    ')[0-9a-f]{64}": 'ID',  # likewise, in a bag of a law that is an FMU
    r'^parallel_robot run: the nodes are compiling;.*\n': '',  # of new kernels, once
    r'(in ROS domain )\d+': r'\1DOMAIN',  # one for each side
    r'(<dc:date>)[^<]*': r'\1DATE',  # of pictures
    r'(?<=["#])[pm][0-9a-f]{10}(?=[")])': 'ID',  # random names of clips and markers in pictures
    r'\b\d+\.\d+\.\d+ [0-9a-f]{16}(?=, numba )': 'VERSION',  # a hash of the sources
}
MEMBER = re.compile(r' +"[\w/]+": ')  # of an object of JSON, which has no order
# Native code in FMUs is not compared: it has names of modules and counters of types in it, that of
# a plant also five bytes of its process. What it computes is compared: fmpy runs it.
NATIVE = ('.so', '.o')


class Case(NamedTuple):
    """A command; the files that it writes begin with its name."""

    name: str
    code: int
    words: list[str]


Tell = Callable[[Case], bool]


def cases() -> list[Case]:
    """All of the list."""
    found = []
    for line in LIST.read_text().splitlines():
        if line and not line.startswith('#'):
            head, *words = shlex.split(line)
            name, _, code = head.partition('=')
            wrong = 2 if name.startswith('wrong_') else 0
            found.append(Case(name, int(code or wrong), words))
    return found


def chosen(every: list[Case], patterns: list[str]) -> list[Case]:
    """The cases of some names, with those whose files they read."""
    taken: set[str] = set()
    for place, case in reversed([*enumerate(every)]):
        if case.name in taken or any(fnmatch.fnmatch(case.name, each) for each in patterns):
            read = set(re.findall(r'\w+', ' '.join(case.words)))
            taken |= {case.name, *(other.name for other in every[:place] if other.name in read)}
    return [case for case in every if case.name in taken]


def copy_revision(revision: str, folder: Path) -> None:
    """Its files.

    Raises:
        ValueError: git does not know it.
    """
    command = ['git', 'archive', '--format=tar', revision]
    packed = subprocess.run(command, cwd=checkout.ROOT, capture_output=True)
    if packed.returncode:
        raise ValueError(packed.stderr.decode().strip())
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
        archive.extractall(folder, filter='data')


def copy_this(folder: Path) -> None:
    """The files of this tree that git knows or would take."""
    command = ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard']
    listed = subprocess.run(command, cwd=checkout.ROOT, capture_output=True, check=True).stdout
    for name in filter(None, listed.decode().split('\0')):
        if (checkout.ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(checkout.ROOT / name, folder / name)


def environment(folder: Path, domain: int) -> dict[str, str]:
    """Variables of one side; the cache of machine code is that of the user."""
    others = os.environ['PYTHONPATH'].split(os.pathsep)
    others = [word for word in others if word != str(checkout.ROOT)]
    return os.environ | {
        'PYTHONPATH': os.pathsep.join([str(folder / 'tree'), *others]),
        'ROS_DOMAIN_ID': str(domain),
        'ROS_LOG_DIR': str(folder / 'log'),
        'TMPDIR': str(folder / 'tmp'),
        'XDG_STATE_HOME': str(folder / 'state'),
        'COLUMNS': '100',
    }


def check(folder: Path, variables: dict[str, str]) -> None:
    """Check that the code in `tree` is what will run."""
    where = [sys.executable, '-c', 'import parallel_robot; print(parallel_robot.__file__)']
    found = subprocess.run(where, env=variables, cwd=folder, capture_output=True, text=True).stdout
    if not found.startswith(str(folder / 'tree')):
        raise SystemExit(f'{found.strip()} would be run, not {folder / "tree"}')


def run(folder: Path, variables: dict[str, str], todo: list[Case], tell: Tell) -> float:
    """Run cases with the code in `tree`; texts go to `printed`.

    Args:
        folder: Of this side.
        variables: Of its processes.
        todo: The cases.
        tell: Is told the name of each, and whether to go on.

    Returns:
        Processor time [s].
    """
    work, used = folder / 'work', 0.0
    for case in itertools.takewhile(tell, todo):
        first = [] if case.words[0] == '-c' else ['-m', 'parallel_robot']
        printed = folder / 'printed' / case.name
        command = [sys.executable, *first, *case.words]
        with (
            printed.with_suffix('.out').open('wb') as out,
            printed.with_suffix('.err').open('wb') as err,
            subprocess.Popen(
                command, cwd=work, env=variables, stdin=subprocess.DEVNULL, stdout=out, stderr=err
            ) as process,
        ):
            used += ended(process)
        printed.with_suffix('.code').write_text(f'exit code {process.returncode}')
    return used


def ended(process: subprocess.Popen[bytes]) -> float:
    """Wait for a process and those that it waited for; returns their processor time [s]."""
    timer = threading.Timer(PATIENCE, process.kill)
    timer.start()
    _, status, used = os.wait4(process.pid, 0)
    timer.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    return used.ru_utime + used.ru_stime


def plain(data: bytes, folder: Path) -> str:
    """Bytes as text without what differs by itself; what is no UTF-8 stays apart."""
    text = data.replace(bytes(folder), b'<side>').decode(errors='surrogateescape')
    for pattern, stand_in in OWN.items():
        text = re.sub(pattern, stand_in, text, flags=re.MULTILINE)
    return text


def parts(path: Path, data: bytes, folder: Path) -> Iterator[tuple[str, str]]:
    """What a file consists of, as (where, content)."""
    if path.suffix in NATIVE:
        return
    if path.suffix == '.mcap':
        yield from messages(data, folder)
    elif path.suffix == '.parquet':
        table = pyarrow.parquet.read_table(io.BytesIO(data))
        table = table.select(sorted(table.column_names))
        yield 'columns', str(table.schema)
        rows = table.to_pandas().to_csv(index=False).splitlines()
        yield from ((f'row {row}', line) for row, line in enumerate(rows))
    elif path.suffix == '.fmu':
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            for name in sorted(packed.namelist()):
                inside = parts(Path(name), packed.read(name), folder)
                yield from ((f'{name}, {where}', content) for where, content in inside)
    elif b'\0' in data:
        yield 'bytes', data.replace(bytes(folder), b'<side>').hex(' ')
    else:
        lines: list[str] = []
        text = plain(data, folder).splitlines()
        for members, those in itertools.groupby(text, lambda line: bool(MEMBER.match(line))):
            part = list(those)
            lines += sorted(line.rstrip(',') for line in part) if members else part
        yield from ((f'line {line}', content) for line, content in enumerate(lines, 1))


def messages(data: bytes, folder: Path) -> Iterator[tuple[str, str]]:
    """Records of an MCAP file by topic, parameters of nodes by node.

    Only within a topic the order is that of the bag: nodes are not heard in the same order twice.
    """
    schemas: dict[int, Schema] = {}
    topics: dict[int, str] = {}
    found: collections.Counter[str] = collections.Counter()
    notes = []
    try:
        for record in StreamReader(io.BytesIO(data), emit_chunks=False).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                topics[record.id] = record.topic
                kind = schemas[record.schema_id]
                says = (kind.name, kind.encoding, kind.data, record.message_encoding)
                yield f'topic {record.topic}', str((*says, sorted(record.metadata.items())))
            elif isinstance(record, Message):
                topic = topics[record.channel_id]
                found[topic] += 1
                text = plain(record.data, folder).encode(errors='surrogateescape').hex()
                times = f'logged {record.log_time} published {record.publish_time}'
                yield f'{topic}, message {found[topic]}', f'{times} {text}'
            elif isinstance(record, Attachment):
                yield f'attachment {record.name}', plain(record.data, folder)
            elif isinstance(record, Metadata):
                for key, value in record.metadata.items():
                    where = f'metadata {record.name}, {key}'
                    found[where] += 1
                    notes.append((f'{where} {found[where]}', plain(value.encode(), folder)))
    except McapError as error:
        yield 'end', str(error)
    yield from notes


def difference(name: Path, folders: list[Path]) -> str:
    """The first difference of a file; empty if there is none."""
    missing = [folder.name for folder in folders if not (folder / name).is_file()]
    if missing:
        return f'is not in {missing[0]}'
    contents = [(folder / name).read_bytes() for folder in folders]
    if contents[0] == contents[1]:
        return ''
    those, these = (dict(parts(name, *each)) for each in zip(contents, folders, strict=True))
    keys = [*those, *(key for key in these if key not in those)]
    differ = [key for key in keys if those.get(key) != these.get(key)]
    if not differ:
        return ''
    pair = [side.get(differ[0], '(nothing)') for side in (those, these)]
    same = (k for k, (a, b) in enumerate(zip(*pair, strict=False)) if a != b)
    begin = max(0, next(same, min(map(len, pair))) - SHOWN // 3)
    told = [
        f'\n    {side}: {ascii(text[begin : begin + SHOWN])[: 2 * SHOWN]}'
        for side, text in zip(SIDES, pair, strict=True)
    ]
    return f'{differ[0]}, first of {len(differ)}{"".join(told)}'


def compare(folders: list[Path], todo: list[Case]) -> tuple[int, dict[str, list[str]]]:
    """How many files there are, and what differs, by case."""
    names = {
        path.relative_to(folder)
        for folder in folders
        for room in ('printed', 'work')
        for path in (folder / room).rglob('*')
        if path.is_file() and path.relative_to(folder).parts[1] != 'given'
    }
    found: dict[str, list[str]] = {}
    for name in sorted(names):
        told = difference(name, folders)
        if told:
            found.setdefault(name.parts[1].partition('.')[0], []).append(f'{name}: {told}')
    for case in todo:  # a case that fails in both trees compares nothing
        code = (folders[1] / 'printed' / f'{case.name}.code').read_text()
        if code != f'exit code {case.code}':
            found.setdefault(case.name, []).append(f'{code}, not {case.code}')
    return len(names), found


def main() -> int:
    """Copy, run and compare; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('revision', help='of git, that this tree is compared with')
    parser.add_argument('--keep', metavar='DIR', type=Path, help='leave all files here')
    parser.add_argument('--only', metavar='NAME', nargs='+', default=['*'], help='cases')
    words = parser.parse_args()
    todo = chosen(cases(), words.only)
    if not todo:
        parser.error(f'no case is called {" or ".join(words.only)}; see {LIST.name}')
    if words.keep and words.keep.exists():
        parser.error(f'{words.keep} exists')
    folder = words.keep.resolve() if words.keep else Path(tempfile.mkdtemp())
    folders = [folder / side for side in SIDES]
    begun, domain, stopped = time.monotonic(), 10 + os.getpid() % 40, threading.Event()

    def tell(case: Case) -> bool:
        sys.stderr.write(f'\r{time.monotonic() - begun:4.0f} s  {case.name:<20}')
        return not stopped.is_set()

    try:
        for each in folders:
            for room in ROOMS:
                (each / room).mkdir(parents=True)
        try:
            copy_revision(words.revision, folders[0] / 'tree')
        except ValueError as error:
            parser.error(str(error))
        copy_this(folders[1] / 'tree')
        give(folder / 'given')
        sides = [environment(each, domain + 45 * k) for k, each in enumerate(folders)]
        for each, variables in zip(folders, sides, strict=True):
            shutil.copytree(folder / 'given', each / 'work' / 'given')
            check(each, variables)
        with ThreadPoolExecutor(2) as pool:
            try:
                spent = sum(pool.map(run, folders, sides, [todo, todo], [tell, tell]))
            except KeyboardInterrupt:
                stopped.set()
                raise
        taken = time.monotonic() - begun
        sys.stderr.write('\r' + 30 * ' ' + '\r')
        count, found = compare(folders, todo)
    finally:
        if not words.keep:
            shutil.rmtree(folder)
    order = [case.name for case in todo]
    for name, told in sorted(found.items(), key=lambda item: [*order, item[0]].index(item[0])):
        print('\n'.join([name, *(f'  {each}' for each in told[:FILES])]))
        if len(told) > FILES:
            print(f'  and {len(told) - FILES} more files')
    differ = f'{len(found)} of {len(todo)} cases differ' if found else 'nothing differs'
    print(f'{differ}: {len(todo)} cases, {count} files, {taken:.0f} s, processor {spent:.0f} s')
    return 1 if found else 0


if __name__ == '__main__':
    sys.exit(main())
