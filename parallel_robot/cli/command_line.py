"""The command line ``parallel_robot``: one module a subcommand."""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import os
import shutil
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from parallel_robot.bags.output import MAX_LINE_LENGTH, printable_output, spell
from parallel_robot_model.common.errors import (
    DescriptionWarning,
    InputError,
    ParallelRobotError,
    StoppedError,
    UnknownNameError,
    first_line,
    printable,
    redirect_description_warnings,
)
from parallel_robot_model.common.options import Parser
from parallel_robot_model.configuration import config, config_files
from parallel_robot_model.processes.termination_signals import Terminated

# Completion of the command line in a shell, by argcomplete.

COMPLETION_ASKED = '_ARGCOMPLETE'  # set by the shell while it asks


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell that asks what a word may become, and end this process."""
    import argcomplete  # only a shell needs it

    for action in _actions(parser):
        if action.dest in WORDS:
            action.completer = _completer(WORDS[action.dest])  # type: ignore[attr-defined]
    argcomplete.autocomplete(parser)


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


def _studies() -> list[str]:
    return config_files.scenario_names(config.directory() / 'studies')


def _laws() -> list[str]:
    return config_files.scenario_names(config.directory() / 'laws')


WORDS: dict[str, Callable[[], list[str]]] = {  # by the name that argparse gives an argument
    'scenario': lambda: [
        *config_files.scenario_names(config.directory() / 'scenarios'),
        *_studies(),
    ],
    'study': _studies,
    'law': _laws,
    'laws': _laws,
    'assignments': lambda: [f'{key}=' for key in config.resolve('paper_circle')],
}


COMMANDS = {
    'run': 'run the nodes in processes of their own and record them',
    'simulate': 'run the same closed loop without ROS and record it',
    'node': 'one node in this process, as ros2 run starts it',
    'live': 'the robot in a browser: a running graph, one that is started, or a bag; acts on it',
    'top': 'a running graph in the terminal: rates, times, law, fault; keys act on it',
    'param': 'parameters of a running node: get, set, dump',
    'call': 'a service of a running node: emergency_stop, clear_fault, reset, ready ...',
    'analyze': 'metrics and a picture of a bag',
    'replay': 'the torques of a bag computed again, by its law or another',
    'rerun': 'the experiment of a bag once more, from the bag alone',
    'report': "the paper's figures and an interactive page of one bag or several",
    'export': 'a bag as a table, one row a state, or with frames of the robot for viewers',
    'video': 'the moving robot of a bag, or of up to four side by side, as MP4 or GIF',
    'recover': 'a whole bag of what is intact in a broken one',
    'show': 'the effective configuration of a scenario, and the source of each value',
    'robot': 'a machine from its description: tree, loops, freedoms, limits, equations, picture',
    'fmu': 'a law or the simulated robot as an FMU: native code for other simulators',
    'urdf': 'the robot of a scenario for RViz and other tools, from its parameters',
    'sweep': 'a study: laws x scenarios x sampled uncertainty, in parallel, with intervals',
    'benchmark': 'laws judged against the limit by a fixed protocol that others can check',
    'tune': 'gains of a law: error against chattering, under the uncertainty of a study',
    'fronts': 'the fronts of several tunings in one picture',
    'identify': 'masses, inertias and friction of the robot from its motion in a bag',
    'calibrate': 'links, base and zero angles of the robot from measured poses and a bag',
    'rehearse': 'the first power-up of a robot, step by step, on the simulated one',
    'limit': 'the least error of any controller, in a scenario or on the robots of a study',
    'verify': 'the simulated plants against MuJoCo, on random robots under random torques',
    'compare': "all laws on one scenario, without ROS, beside the paper's claims",
}


FUNCTIONS = (  # commands of the functions of their names
    'benchmark', 'calibrate', 'export', 'fronts', 'identify', 'limit', 'recover', 'replay',
    'report', 'sweep', 'tune', 'urdf', 'verify', 'video',
)  # fmt: skip
ABOVE = {'live': 'parallel_robot.live.command'}  # commands of packages above this one


def module_of(command: str) -> Any:
    """The module of a subcommand, or a Command; together they take long to import."""
    if command in FUNCTIONS:
        from parallel_robot.cli.from_function import command_of  # other commands take less time

        return command_of(command)
    return import_module(ABOVE.get(command, f'parallel_robot.cli.commands.{command}'))


def build_parser(words: Collection[str] = tuple(COMMANDS)) -> Parser:
    """Make the parser of the command line.

    Args:
        words: Of the command line; subcommands that are none of them have no arguments.
    """
    parser = Parser(
        prog='parallel_robot',
        description='Compares control laws for parallel robots, simulated or over ROS 2.',
    )
    if '--version' in words:
        from parallel_robot.bags.experiment import software  # slow to import

        facts = software()
        revision = f', revision {facts["revision"]}' if 'revision' in facts else ''
        version = f'%(prog)s {facts["version"]}{revision}'
    else:
        version = ''
    help_text = 'show the version of the suite, and end'
    parser.add_argument('--version', action='version', version=version, help=help_text)
    subparsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, text in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=text, description=text)
        if name in words:
            module_of(name).add_arguments(subparser)
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        0; 1 when a run failed; 2 when the input is wrong, after one line that says so; 128 and the
        number of the signal that stopped a run.
    """
    if COMPLETION_ASKED in os.environ:
        complete(build_parser(os.environ.get('COMP_LINE', '').split()))
    words = sys.argv[1:] if words is None else words
    name = 'parallel_robot'
    os.environ['MPLBACKEND'] = 'agg'  # pictures go into files
    spell(sys.stdout)
    try:
        if words and not words[0].startswith('-') and words[0] not in COMMANDS:
            raise UnknownNameError('command', words[0], COMMANDS)
        name = ' '.join([name, *(word for word in words[:1] if word in COMMANDS)])
        arguments = build_parser(words).parse_args(words)
        # Says what takes long; a pipe gets results and errors alone, and a node has its own log.
        if sys.stderr.isatty() and arguments.command != 'node':
            logging.basicConfig(format=f'{name}: %(message)s')
            logging.getLogger('parallel_robot').setLevel(logging.INFO)
        # `top` draws a screen, and cleans what it writes on it; a node writes a log.
        raw = arguments.command in ('top', 'node')
        with warnings.catch_warnings(), contextlib.nullcontext() if raw else printable_output():
            if arguments.command in ('robot', 'top'):  # it has them all; it draws a screen
                warnings.simplefilter('ignore', DescriptionWarning)
            elif not raw:
                redirect_description_warnings(
                    lambda line: print(f'warning: {line}', file=sys.stderr)
                )
            code: int = module_of(arguments.command).execute(arguments)
        sys.stdout.flush()
    except ParallelRobotError as error:
        text = printable(str(error).replace('\n', ' '), MAX_LINE_LENGTH)
        print(f'{name}: {text}', file=sys.stderr)
        if isinstance(error, StoppedError):
            return error.exit_code
        return 2 if isinstance(error, InputError) else 1
    except MemoryError:
        print(f'{name}: out of memory', file=sys.stderr)
        return 1
    except Terminated as ended:
        return ended.exit_code
    except KeyboardInterrupt:
        return 130
    except SystemError as error:  # of machine code that a signal interrupted
        if not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        return getattr(error.__cause__, 'exit_code', 130)
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except ImportError as error:
        *_, last = traceback.walk_tb(error.__traceback__)
        where = last[0].f_code.co_filename
        print(f'{name}: {first_line(error)} ({where}); is PYTHONPATH right?', file=sys.stderr)
        return 1
    except OSError as error:
        if error.errno == errno.ENOSPC:  # of the output: files have messages of their own
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            with contextlib.suppress(OSError):
                print(f'{name}: the output is full: {error.strerror}', file=sys.stderr)
            return 1
        if error.errno != errno.EIO:  # the terminal has been closed
            raise
        for descriptor in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
        return 128 + signal.SIGHUP
    return code


# How the user started the command line, for commands that are told to be typed next.

NAME = 'parallel_robot'


def invocation_words() -> list[str]:
    """The words before the subcommand; the name of the program when they cannot be known."""
    given = Path(sys.argv[0])
    if given.name == '__main__.py' and given.parent.name == 'parallel_robot':
        return ['python', '-m', __name__.partition('.')[0]]
    if given.name != NAME:
        return [NAME]
    if given.parts[-3:-1] == ('lib', NAME):
        return ['ros2', 'run', NAME, NAME]
    return [NAME] if shutil.which(NAME) == str(given) else [str(given)]


if __name__ == '__main__':
    sys.exit(main())
