"""Whether two revisions compute alike: what all commands print and write, compared.

Usage: python benchmarks/equality.py REVISION [--keep DIR] [--only NAME ...]

Copies a revision and this tree, uncommitted changes included, runs the cases of
equality_cases.txt in both, side by side, and compares exit codes, texts and files. Ends with 0 if
nothing differs, 1 with what differs first in each file, 2 if it is called wrongly. `--only` takes
names of cases as the shell does, `replay*`, and runs what they need, too.
"""

from __future__ import annotations

import argparse
import collections
import fnmatch
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import checkout
import numpy as np
import pyarrow.parquet
import yaml
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

LIST = Path(__file__).with_name('equality_cases.txt')
GIVEN = {  # files of this tree that both are given
    'example_law.py': 'docs/example_law.py',
    'example_law_with_memory.py': 'docs/example_law_with_memory.py',
    'example_robot.py': 'docs/example_robot.py',
    'example_trajectory.py': 'docs/example_trajectory.py',
    'example_parameters.yaml': 'docs/example_parameters.yaml',
    'example_motion.csv': 'docs/example_motion.csv',
    'motion.yaml': 'docs/example_motion.yaml',
    'scenario.yaml': 'docs/example_scenario.yaml',
    'machine.xml': 'config/machines/five_bar.xml',
}
PROTOCOL = 'config/benchmarks/protocol_1.yaml'
SIDES = ('that', 'this')  # the revision, this tree; of one length, for paths show in texts
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
    r'(in ROS domain )\d+': r'\1DOMAIN',  # one for each side
    r'(<dc:date>)[^<]*': r'\1DATE',  # of pictures
    r'(?<=["#])[pm][0-9a-f]{10}(?=[")])': 'ID',  # random names of clips and markers in pictures
    r'("worker_id":)"[0-9a-f-]+"': r'\1"ID"',  # who searches, and when, in the journal of tune
    r'("datetime_(start|complete)":)"[^"]*"': r'\1"TIME"',
}
# Native code in FMUs is not compared: it has names of modules and counters of types in it, that of
# a plant also five bytes of its process. What it computes is compared: fmpy runs it.
NATIVE = ('.so', '.o')


class Case(NamedTuple):
    """A command; the files that it writes begin with its name."""

    name: str
    code: int
    words: list[str]


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
    for case in reversed(every):
        if case.name in taken or any(fnmatch.fnmatch(case.name, each) for each in patterns):
            read = set(re.findall(r'\w+', ' '.join(case.words)))
            taken |= {case.name, *(other.name for other in every if other.name in read)}
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


def give(folder: Path) -> None:
    """Write what both trees are given: files, wrong files, and the bag of a stranger's robot."""
    folder.mkdir()
    for name, source in GIVEN.items():
        shutil.copy(checkout.ROOT / source, folder / name)
    (folder / 'wrong.yaml').write_text('base: paper_circle\ncircle: {radius: 0.02\n')
    (folder / 'wrong_type.yaml').write_text('base: paper_circle\ncircle.radius: wide\n')
    (folder / 'junk').mkdir()
    (folder / 'junk' / 'junk_0.mcap').write_bytes(bytes(range(256)) * 8)
    protocol = yaml.safe_load((checkout.ROOT / PROTOCOL).read_text())
    protocol |= {'duration': 0.5, 'scrambles': 2, 'speeds': [3.0]}
    protocol['search'] |= {'trials': 2, 'runs': 1}
    protocol['robots'] = {'planar_3rrr': protocol['robots']['planar_3rrr']}
    (folder / 'protocol.yaml').write_text(yaml.safe_dump(protocol, sort_keys=False))
    stranger(folder / 'foreign')


def stranger(bag: Path) -> None:
    """A bag of others: 200 Hz, other names and order of the joints, other topics."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    head, clock = types['std_msgs/msg/Header'], types['builtin_interfaces/msg/Time']
    names, order = ['axis_3', 'axis_1', 'axis_2'], [2, 0, 1]
    home = np.array([1.45, 3.25, -0.53])  # rad, of a robot like the paper's
    speed, shift = 2.0 * np.pi * np.array([0.5, 0.7, 0.9]), np.array([0.0, 1.0, 2.0])
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ('/arm/joints', 'sensor_msgs/msg/JointState'),
                ('/arm/desired', 'trajectory_msgs/msg/JointTrajectory'),
                ('/arm/efforts', 'std_msgs/msg/Float64MultiArray'),
            )
        }

        def write(topic: str, stamp: int, message: object) -> None:
            kind = topics[topic].msgtype
            writer.write(topics[topic], stamp, bytes(store.serialize_cdr(message, kind)))

        for k in range(400):
            t, stamp = 0.005 * k, 10**18 + 5_000_000 * k
            wave = 0.05 * np.sin(speed * t + shift)
            rate = 0.05 * speed * np.cos(speed * t + shift)
            effort = 2.0 * rate - 0.8 * speed**2 * wave + 0.5 * np.sign(rate)
            off = 1e-4 * np.sin(40.0 * t + shift)
            header = head(clock(*divmod(stamp, 10**9)), '')
            point = types['trajectory_msgs/msg/JointTrajectoryPoint'](
                (home + wave)[order], rate[order], (-(speed**2) * wave)[order], np.zeros(0),
                types['builtin_interfaces/msg/Duration'](0, 0),
            )  # fmt: skip
            motion = types['trajectory_msgs/msg/JointTrajectory'](header, names, [point])
            state = types['sensor_msgs/msg/JointState'](
                header, names, (home + wave + off)[order], rate[order], effort[order]
            )
            layout = types['std_msgs/msg/MultiArrayLayout']([], 0)
            write('/arm/desired', stamp, motion)
            write('/arm/joints', stamp + 100_000, state)
            command = types['std_msgs/msg/Float64MultiArray'](layout, effort)
            write('/arm/efforts', stamp + 400_000, command)


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


def run(folder: Path, todo: list[Case], domain: int, tell: Callable[[str], None]) -> float:
    """Run cases with the code in `tree`; texts go to `printed`.

    Returns:
        Processor time [s].
    """
    variables, work = environment(folder, domain), folder / 'work'
    for name in ('tmp', 'log', 'state', 'printed'):
        (folder / name).mkdir()
    where = [sys.executable, '-c', 'import parallel_robot; print(parallel_robot.__file__)']
    found = subprocess.run(where, env=variables, cwd=work, capture_output=True, text=True).stdout
    if not found.startswith(str(folder / 'tree')):
        raise SystemExit(f'{found.strip()} would be run, not {folder / "tree"}')
    used = 0.0
    for case in todo:
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
            used += ended(process, case)
        printed.with_suffix('.code').write_text(f'exit code {process.returncode}')
        tell(case.name)
    return used


def ended(process: subprocess.Popen[bytes], case: Case) -> float:
    """Wait for a process and those that it waited for; returns their processor time [s]."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        pid, status, used = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return used.ru_utime + used.ru_stime
        time.sleep(0.01)
    process.kill()
    raise SystemExit(f'{case.name} has not ended after {PATIENCE:g} s')


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
        yield 'columns', str(table.schema)
        text = table.to_pandas().to_csv(index=False).splitlines()
        yield from ((f'row {row}', line) for row, line in enumerate(text))
    elif path.suffix == '.fmu':
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            for name in sorted(packed.namelist()):
                inside = parts(Path(name), packed.read(name), folder)
                yield from ((f'{name}, {where}', content) for where, content in inside)
    else:
        lines = plain(data, folder).splitlines()
        yield from ((f'line {line}', content) for line, content in enumerate(lines, 1))


def messages(data: bytes, folder: Path) -> Iterator[tuple[str, str]]:
    """Records of an MCAP file, topic by topic: nodes write theirs in any order."""
    schemas: dict[int, Schema] = {}
    topics: dict[int, str] = {}
    found: collections.Counter[str] = collections.Counter()
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
                found[record.name] += 1
                for key in sorted(record.metadata):
                    where = f'metadata {record.name} {found[record.name]}, {key}'
                    yield where, plain(record.metadata[key].encode(), folder)
    except McapError as error:
        yield 'end', str(error)


def difference(name: Path, folders: list[Path]) -> str:
    """The first difference of a file; empty if there is none."""
    missing = [folder.name for folder in folders if not (folder / name).is_file()]
    if missing:
        return f'is not in {missing[0]}'
    contents = [(folder / name).read_bytes() for folder in folders]
    if contents[0] == contents[1]:
        return ''
    those, these = (dict(parts(name, *each)) for each in zip(contents, folders, strict=True))
    for where in [*those, *(key for key in these if key not in those)]:
        pair = [side.get(where, '(nothing)') for side in (those, these)]
        if pair[0] != pair[1]:
            both = zip(*pair, strict=False)
            first = next((k for k, (a, b) in enumerate(both) if a != b), min(map(len, pair)))
            begin = max(0, first - SHOWN // 3)
            shown = [ascii(text[begin : begin + SHOWN]) for text in pair]
            told = [f'\n    {side}: {text}' for side, text in zip(SIDES, shown, strict=True)]
            return f'{where}{"".join(told)}'
    return ''


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
    try:
        for each in folders:
            (each / 'tree').mkdir(parents=True)
            (each / 'work').mkdir()
        try:
            copy_revision(words.revision, folders[0] / 'tree')
        except ValueError as error:
            parser.error(str(error))
        copy_this(folders[1] / 'tree')
        give(folder / 'given')
        for each in folders:
            shutil.copytree(folder / 'given', each / 'work' / 'given')
        begun, domain = time.monotonic(), 10 + os.getpid() % 40

        def tell(name: str) -> None:
            sys.stderr.write(f'\r{time.monotonic() - begun:4.0f} s  {name:<20}')

        with ThreadPoolExecutor(2) as pool:
            used = [
                pool.submit(run, each, todo, domain + 45 * k, tell)
                for k, each in enumerate(folders)
            ]
            spent = sum(each.result() for each in used)
        taken = time.monotonic() - begun
        sys.stderr.write('\r' + 30 * ' ' + '\r')
        count, found = compare(folders, todo)
    finally:
        if not words.keep:
            shutil.rmtree(folder)
    for name, told in found.items():
        print('\n'.join([name, *(f'  {each}' for each in told[:FILES])]))
        if len(told) > FILES:
            print(f'  and {len(told) - FILES} more files')
    differ = f'{len(found)} of {len(todo)} cases differ' if found else 'nothing differs'
    print(f'{differ}: {len(todo)} cases, {count} files, {taken:.0f} s, processor {spent:.0f} s')
    return 1 if found else 0


if __name__ == '__main__':
    sys.exit(main())
