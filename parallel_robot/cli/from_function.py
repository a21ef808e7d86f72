"""Commands from functions: options from the signature, help from the docstring, results shown.

A parameter without a default is a word in its place, ``out`` and each other one an option.
``**values`` are what ``--set`` changes; ``**options`` also say how a bag is to be read.
"""

from __future__ import annotations

import argparse
import inspect
import re
import types
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

import parallel_robot
from parallel_robot.cli.shared import (
    add_format_argument,
    add_set_argument,
    layers,
    show,
    time_on_line,
    warn,
)
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import number
from parallel_robot_model.common.tables import ShownResult

VIEW = 'parallel_robot.bags.bag_reader:view'  # its arguments are what `options` may be
ENTRY = re.compile(r'^    (\*{0,2}\w+): ', re.MULTILINE)
QUOTED = re.compile(r'``(.+?)``|:\w+:`(.+?)`|`(.+?)`')


def function(place: str) -> Callable[..., Any]:
    """The function MODULE:NAME; of one that returns something else to Python, the original."""
    module, _, name = place.partition(':')
    found: Callable[..., Any] = getattr(import_module(module), name)
    return getattr(found, 'raw', found)


# How some arguments are spelled in a shell, by name, where their type does not say it.


def _topics(words: Iterable[str]) -> dict[str, str]:
    """Topics by name, of words NAME=TOPIC."""
    found = {}
    for word in words:
        name, equals, topic = word.partition('=')
        if not equals:
            names = 'joint_states, reference, commands'
            raise InputError(f'--topic takes NAME=TOPIC, with a name as {names}, not {word!r}')
        found[name.strip()] = topic.strip()
    return found


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(',') if name.strip()]


def _constants(text: str) -> tuple[float | str, ...]:
    """Numbers, or ``auto``, with commas between them."""
    return tuple(each if each == 'auto' else number(each) for each in text.split(','))


NAMES = {'start': '--from', 'stop': '--to'}  # of options
WORDS: dict[str, dict[str, Any]] = {
    'bags': {'metavar': 'BAG'},
    'directories': {'metavar': 'DIR'},
    'joints': {'metavar': 'A,B,C', 'action': 'store', 'type': _names},
    'laws': {'metavar': 'LAW|FILE', 'nargs': '+'},
    'start': {'type': time_on_line, 'metavar': 'S'},
    'stop': {'type': time_on_line, 'metavar': 'S'},
    'topic': {'metavar': 'NAME=TOPIC', 'action': 'append'},
    'torque_constant': {'metavar': 'A,B,C', 'action': 'store', 'type': _constants},
}


# What is known of one function.


def _described(function: Callable[..., Any]) -> dict[str, str]:
    """Help of each parameter, from the section ``Args`` of the docstring."""
    _, _, after = (inspect.getdoc(inspect.unwrap(function)) or '').partition('\nArgs:\n')
    names = inspect.signature(function).parameters
    pieces = ENTRY.split(after.partition('\n\n')[0])[1:]
    return {name: _help(text, names) for name, text in zip(pieces[::2], pieces[1::2], strict=True)}


def _help(text: str, names: Collection[str]) -> str:
    """A description as a shell shows it: other parameters are options."""

    def shown(match: re.Match[str]) -> str:
        code, reference, name = match.groups()
        return _option(name) if name in names else str(code or reference or name)

    return QUOTED.sub(shown, ' '.join(text.split())).rstrip('.').replace('%', '%%')


def _option(name: str) -> str:
    return NAMES.get(name, f'--{name.replace("_", "-")}')


def _parameters(of: Callable[..., Any]) -> Iterator[inspect.Parameter]:
    """The arguments that a command has, with those of how a bag is read."""
    own = inspect.signature(of, eval_str=True).parameters
    for parameter in own.values():
        if parameter.name == 'options':
            yield from (each for each in _parameters(function(VIEW)) if each.name not in own)
        elif parameter.kind is not parameter.VAR_KEYWORD and parameter.name != 'memory':
            yield parameter


def _typed(parameter: inspect.Parameter) -> dict[str, Any]:
    """What argparse is told by the type of a parameter."""
    kind = parameter.annotation
    union = get_origin(kind) in (Union, types.UnionType)
    kinds = {*(get_args(kind) if union else (kind,))} - {type(None)}
    if bool in kinds:
        return {'action': 'store_true'}
    if kinds in ({int}, {float}):
        return {'type': kinds.pop()}
    found: dict[str, Any] = {}
    for each in kinds:
        origin = get_origin(each) or each
        several = isinstance(origin, type) and issubclass(origin, Iterable)
        if several and not issubclass(origin, str | Mapping):
            found['action'] = 'append'
        for inner in (each, *get_args(each)):
            if get_origin(inner) is Literal:
                found['choices'] = get_args(inner)
    return found


# Commands of one function, or of several behind the same word.


class Mode(NamedTuple):
    """A function of a command."""

    place: str  # MODULE:NAME
    flag: str = ''  # option without a value that asks for it
    renamed: Mapping[str, str] = MappingProxyType({})  # its parameter to the option that has it
    refusal: str = ''  # why options of others are refused beside it; with {option} and {name}
    alone: str = ''  # why its own options are refused without it
    needs: Mapping[str, str] = MappingProxyType({})  # what is said where one of these is missing

    @property
    def function(self) -> Callable[..., Any]:
        """The function."""
        return function(self.place)

    @property
    def names(self) -> dict[str, inspect.Parameter]:
        """Its parameters by what argparse calls them."""
        found = _parameters(self.function)
        return {self.renamed.get(each.name, each.name): each for each in found}


class Command:
    """A command that calls a function; it stands where others have a module."""

    def __init__(
        self, *modes: Mode, pick: Callable[[argparse.Namespace], int] = lambda _: 0
    ) -> None:
        """Prepare; `pick` returns the number of the mode that is asked for."""
        self._modes, self._pick = modes, pick

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments of the command that are not declared."""
        declared = {action.dest for action in parser._actions}
        for mode in self._modes:
            help_of = _described(function(VIEW)) | _described(mode.function)
            for name, parameter in mode.names.items():
                if name not in declared:
                    self._add(parser, mode, name, parameter, help_of[parameter.name])
                declared.add(name)
            if mode.flag:
                text = (mode.function.__doc__ or '').partition('\n')[0].rstrip('.')
                parser.add_argument(f'--{mode.flag}', action='store_true', help=text)
        if any(_is_shown(mode.function) for mode in self._modes):
            add_format_argument(parser)

    def _add(
        self,
        parser: argparse.ArgumentParser,
        mode: Mode,
        name: str,
        parameter: inspect.Parameter,
        text: str,
    ) -> None:
        """Declare one argument: a word in its place where it has no default, or an option."""
        if name == 'param_file':
            add_set_argument(parser)
            return
        options = {'help': text, **_typed(parameter), **WORDS.get(name, {})}
        several, alone = parameter.kind is parameter.VAR_POSITIONAL, len(self._modes) == 1
        needed = parameter.default is parameter.empty
        if 'nargs' in options:
            options.pop('action', None)
        if several or (needed and name != 'out' and parameter.name not in mode.renamed):
            if several or options.pop('action', None):
                options['nargs'] = '*' if several else '+'
            elif not alone:
                options['nargs'] = '?'
            parser.add_argument(name, **options)
        else:
            options |= {'required': True} if needed and alone else {}
            parser.add_argument(_option(name), dest=name, **options)

    def execute(self, arguments: argparse.Namespace) -> int:
        """Run the command."""
        found = self.call(arguments)
        if isinstance(found, ShownResult):
            warn(getattr(found, 'warnings', ()))
            show(arguments.format, found.parts(), found.as_data(), found.file_lines())
        else:
            warn(getattr(found, 'doubts', ()))
            print(found, end='')
        return int(getattr(found, 'failed', False))

    def call(self, arguments: argparse.Namespace) -> Any:
        """What the function returns.

        Raises:
            InputError: options do not go together, or what the function raises.
        """
        mode = self._modes[self._pick(arguments)]
        self._refuse_others(mode, arguments)
        words, values = [], {}
        for name, parameter in mode.names.items():
            value = getattr(arguments, name)
            if name == 'param_file':
                value = layers(arguments)
            elif name == 'topic' and value:
                value = _topics(value)
            if not _is_given(value):
                if name in mode.needs:
                    raise InputError(mode.needs[name])
            elif parameter.kind is parameter.VAR_POSITIONAL:
                words += value
            else:
                values[parameter.name] = value
        return mode.function(*words, **values)

    def _refuse_others(self, chosen: Mode, arguments: argparse.Namespace) -> None:
        """Refuse options of other modes.

        Raises:
            InputError: one was given.
        """
        for mode in self._modes:
            for name in (*filter(None, [mode.flag]), *mode.names):
                own = name in (chosen.flag, *chosen.names)
                if not own and _is_given(getattr(arguments, name)):
                    why = mode.alone or chosen.refusal
                    raise InputError(why.format(option=_option(name), name=name.replace('_', '-')))


def _is_given(value: Any) -> bool:
    """Whether an argument stands on the command line."""
    return not (value is None or value is False or value == [])


def _is_shown(of: Callable[..., Any]) -> bool:
    """Whether a function returns a result of lines and tables."""
    kind = inspect.signature(of, eval_str=True).return_annotation
    return any(issubclass(each, ShownResult) for each in get_args(kind) or [kind])


# Those of several functions.

IDENTIFICATION = 'parallel_robot.studies.identification'
CALIBRATION = 'parallel_robot.studies.calibration'


def _of_identify(arguments: argparse.Namespace) -> int:
    if (arguments.bag is None) == (arguments.design is None):
        raise InputError('identify takes either a bag or --design SCENARIO')
    return 2 if arguments.bag is None else int(arguments.rest)


def _of_calibrate(arguments: argparse.Namespace) -> int:
    if arguments.bag is None and (arguments.scenario is None or arguments.design is None):
        raise InputError('calibrate takes either a bag or --scenario SCENARIO --design N')
    if arguments.bag is not None and arguments.design is not None:
        raise InputError('--design reads no bag')
    return int(arguments.bag is None)


MODES = {
    'identify': Command(
        Mode(f'{IDENTIFICATION}.bag_identification:identify'),
        Mode(
            f'{IDENTIFICATION}.bag_identification:sensor_noise',
            flag='rest',
            refusal='--rest identifies no robot: no {option}',
        ),
        Mode(
            f'{IDENTIFICATION}.design:exciting_motion',
            renamed={'scenario': 'design'},
            refusal='--design reads no bag: no {option}',
            alone='{option} goes with --design alone',
            needs={'out': '--design needs --out FILE for the coefficients'},
        ),
        pick=_of_identify,
    ),
    'calibrate': Command(
        Mode(f'{CALIBRATION}.bag_calibration:calibrate'),
        Mode(
            f'{CALIBRATION}.design:calibration_poses',
            renamed={'count': 'design'},
            refusal='--design reads no bag: no {option}',
            alone='{option} goes with --design alone',
        ),
        pick=_of_calibrate,
    ),
    'export': Command(Mode('parallel_robot.analysis.export:exported')),
    'replay': Command(Mode('parallel_robot.analysis.replay.bag_replay:replayed_in_windows')),
    'benchmark': Command(
        Mode(
            'parallel_robot.studies.benchmark.benchmark:benchmark',
            needs={
                'laws': 'name a law, or the file of one',
                'out': '--out is missing: the directory of the results',
            },
        ),
        Mode(
            'parallel_robot.studies.benchmark.benchmark:check_score',
            renamed={'score': 'check'},
            refusal='--check takes the {name} of the score: leave {option} out',
        ),
        pick=lambda arguments: int(arguments.check is not None),
    ),
}


def command_of(name: str) -> Command:
    """The command of the function of this name that ``import parallel_robot`` offers."""
    return MODES.get(name) or Command(Mode(f'{parallel_robot.PLACES[name]}:{name}'))


VIEW_OF_BAG = Command(Mode(VIEW))  # of commands that read a bag and are no function
