"""Gives hostile bags to a command, one after the other, in a process whose end says enough.

Its words: COMMAND SECONDS GIGABYTES OUT BAG...
"""

import contextlib
import io
import json
import resource
import signal
import sys
import time
import traceback
from pathlib import Path

from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.output import MAX_LINE_LENGTH
from parallel_robot.bags.player import Player, PlayerOptions
from parallel_robot.bags.run import recording
from parallel_robot.cli import command_line
from parallel_robot.cli.commands import run
from parallel_robot_model.common.errors import ParallelRobotError, RunError, printable

WORDS = {
    'analyze': lambda bag, out: [
        'analyze',
        bag,
        '--figure',
        f'{out}.png',
        '--json',
        f'{out}.json',
    ],
    'report': lambda bag, out: ['report', bag, '--out', out],
    'export': lambda bag, out: ['export', bag, '--out', f'{out}.csv'],
    'recover': lambda bag, out: ['recover', bag, '--out', out],
    'replay': lambda bag, out: ['replay', bag],
    'other law': lambda bag, out: ['replay', bag, '--law', 'smc', '--figure', f'{out}.svg'],
    'rerun': lambda bag, out: ['rerun', bag, '--out', out],
}


def one_line(function):
    """A function of a bag as a command: what it raises costs one line."""

    def command(bag, out):
        try:
            function(Path(bag))
        except ParallelRobotError as error:
            print(printable(str(error).replace('\n', ' '), MAX_LINE_LENGTH), file=sys.stderr)
            return 2
        return 0

    return command


def play(bag):
    reader = BagReader(bag)
    options = PlayerOptions(str(bag), fast=True)
    sent = []
    Player(reader, reader.topics, options, lambda _, data: sent.append(len(data)), print).run()
    reader.latched(reader.topics, reader.end)
    reader.close()


def no_nodes(*_):
    raise RunError('starts nodes')


COMMANDS = {
    **{
        name: lambda bag, out, words=words: command_line.main(words(bag, out))
        for name, words in WORDS.items()
    },
    'recording': one_line(recording.read),
    'player': one_line(play),
}


class Late(BaseException):
    """Not an Exception: nobody else shall catch it."""


def late(*_):
    raise Late


def try_one(command, bag, out, seconds):
    """What a command makes of a bag, as plain data."""
    stdout, stderr = io.StringIO(), io.StringIO()
    code, trace = None, ''
    signal.setitimer(signal.ITIMER_PROF, seconds)  # of the processor, whatever else it does
    begun = time.process_time()
    try:
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            code = COMMANDS[command](bag, out)
    except BaseException:
        trace = traceback.format_exc()
    finally:
        taken = time.process_time() - begun
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return {
        'code': code,
        'seconds': taken,
        'trace': trace,
        'out': stdout.getvalue(),
        'err': stderr.getvalue(),
        'peak': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,  # GB
    }


def main():
    """Read bags in this process, which has no more than that of time and memory."""
    command, seconds, gigabytes, out, *bags = sys.argv[1:]
    limit = int(float(gigabytes) * 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, late)
    run.record = no_nodes
    for k, bag in enumerate(bags):
        print(json.dumps(['begin', bag]), flush=True)
        found = try_one(command, bag, f'{out}/{command}_{k}', float(seconds))
        print(json.dumps(['end', found]), flush=True)
