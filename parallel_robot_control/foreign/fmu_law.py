"""A law as an FMU for co-simulation, run by fmpy, see docs/fmu.md."""

from __future__ import annotations

import contextlib
import math
import os
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from keyword import iskeyword
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_type_hints

from parallel_robot_control.foreign import process
from parallel_robot_control.foreign.channel import Gains
from parallel_robot_control.foreign.process import MOST_GAINS
from parallel_robot_model.common.errors import InputError, UnknownNameError, first_line, optional
from parallel_robot_model.common.units import BASES, BOTH, HINGES, PRISMATIC
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.fields import Field, check

# Parameters of an FMU as gains of its law: what it says of them, and the class of gains.

FLOATS = ('Real', 'Float64', 'Float32')


def _described_gains(file: Path, called: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """What an FMU says of the parameters that are gains; nothing of it is run."""
    if len(called) > MOST_GAINS:
        raise InputError(f'{file}: at most {MOST_GAINS} parameters are gains, not {len(called)}')
    description, _ = _read(str(file), 'gains of an FMU need fmpy: pip install fmpy')
    variables = description.modelVariables
    known = {each.name: each for each in variables if each.causality == 'parameter'}
    return {gain: _described(file, name, known) for gain, name in called.items()}


def _read(file: str, lacking: str) -> tuple[Any, list[str]]:
    """The description of an FMU, and the names of its files; `lacking` says that fmpy is."""
    fmpy = optional('fmpy', lacking)
    try:
        description = fmpy.read_model_description(file, validate=False)
        with zipfile.ZipFile(file) as archive:
            return description, archive.namelist()
    except Exception as error:  # whatever is in the file
        raise InputError(f'{file} is no FMU: {first_line(error)}') from None


def _described(file: Path, name: str, known: Mapping[str, Any]) -> dict[str, Any]:
    variable = known.get(name)
    if variable is None:
        raise UnknownNameError(f'parameter of {file}', name, known)
    if variable.type not in FLOATS or variable.shape:
        raise InputError(
            f'{file}: {name} is no gain: it is not one number of type Real or Float64'
        )
    declared = variable.declaredType
    said: dict[str, Any] = {
        key: getattr(variable, of) or getattr(declared, of, None)
        for key, of in (('unit', 'unit'), ('low', 'min'), ('high', 'max'))
    }
    try:
        start = float(variable.start)
        low, high = (None if said[key] is None else float(said[key]) for key in ('low', 'high'))
    except (TypeError, ValueError):
        raise InputError(f'{file}: {name} needs a start value that is a number') from None
    field = Field(said['unit'] or '', '', *_limits(low, high))
    check(f'{file}: start of {name}', float, field, start)
    return {
        'variable': name,
        'start': start,
        'unit': said['unit'] or '',
        'text': variable.description or name,
        'low': low,
        'high': high,
    }


def gains_class(described: Mapping[str, Mapping[str, Any]], module: str) -> type:
    """The class of the gains of a foreign law: those of any, then its own.

    Args:
        described: See :func:`described`.
        module: What it is called by the compiler, which must differ from all others.
    """
    if not described:
        return Gains
    fields: list[tuple[str, Any]] = [*get_type_hints(Gains, include_extras=True).items()]
    for gain, one in described.items():
        limits = _limits(one['low'], one['high'])
        fields.append((gain, Annotated[float, Field(one['unit'], one['text'], *limits)]))
    made: Any = NamedTuple('Gains', fields)  # type: ignore[misc]
    defaults = Gains._field_defaults | {gain: one['start'] for gain, one in described.items()}
    made._field_defaults, made.__new__.__defaults__ = defaults, tuple(defaults.values())
    made.__module__ = module
    return made


def _limits(low: float | None, high: float | None) -> tuple[float, float]:
    return -math.inf if low is None else low, math.inf if high is None else high


# What an FMU calls what a law gets and gives: a YAML file beside it.

# Unit of hinges, row of the question; of two rows the difference.
INPUTS: dict[str, tuple[Any, ...]] = {
    'position': ('rad', process.POSITION),
    'velocity': ('rad/s', process.VELOCITY),
    'reference.position': ('rad', process.REFERENCE),
    'reference.velocity': ('rad/s', process.REFERENCE_VELOCITY),
    'reference.acceleration': ('rad/s^2', process.REFERENCE_ACCELERATION),
    'excess': ('N m', process.EXCESS),
    'disturbance': ('N m', process.DISTURBANCE),
    'gravity': ('N m', process.GRAVITY),
    'error': ('rad', process.REFERENCE, process.POSITION),
    'error_rate': ('rad/s', process.REFERENCE_VELOCITY, process.VELOCITY),
}
# Unit of hinges, empty where it is the law's own; row of the answer.
RESULTS: dict[str, tuple[Any, ...]] = {
    'torque': ('N m', process.TORQUE),
    'sliding_variable': ('', process.SLIDING_VARIABLE),
    'coupled_error': ('rad', process.COUPLED_ERROR),
}
UNITS = {'age': 's', 'time': 's'} | {name: of[0] for name, of in (INPUTS | RESULTS).items()}
SAYS_NOTHING = (None, '', '-', '1')  # as a unit
AGE_NAME, FAULT_NAME = 'age', 'fault'  # one number each
KNOWN = {'inputs': (*INPUTS, AGE_NAME), 'outputs': (*RESULTS, FAULT_NAME)}
NAME_GROUPS = ('inputs', 'outputs', 'parameters', 'gains')
STEP = 'step'  # s, where the one that the FMU names is not meant


def file_beside(path: Path) -> Path | None:
    """The file beside an FMU, ``controller.yaml`` beside ``controller.fmu``; None without one."""
    file = path.with_suffix('.yaml')
    return file if path.suffix == '.fmu' and file.exists() else None


def names_beside(path: Path) -> dict[str, Any]:
    """What the file beside an FMU says; nothing without one.

    Args:
        path: The FMU.

    Returns:
        Group to name in the suite to what the FMU calls it; of parameters, name to value; of
        gains, see :func:`parallel_robot_control.foreign.fmu_law.described`.

    Raises:
        InputError: it cannot be read, or has what is no name.
    """
    file = file_beside(path)
    if file is None:
        return {}
    found: dict[str, dict[str, Any]] = {}
    step: dict[str, float] = {}
    for key, value in yaml_file.read(file).items():
        group, _, name = key.partition('.')
        if key == STEP and isinstance(value, int | float) and value > 0.0:
            step = {STEP: float(value)}
            continue
        try:
            _check(group, name, value)
        except InputError as error:
            raise InputError(f'{file}: {error}') from None
        found.setdefault(group, {})[name] = value
    if 'gains' in found:
        found['gains'] = _described_gains(path, found['gains'])
    return found | step


def _check(group: str, name: str, value: Any) -> None:
    if group not in NAME_GROUPS or not name:
        raise UnknownNameError('key', group, (*NAME_GROUPS, STEP))
    if group == 'gains':
        if not isinstance(value, str):
            raise InputError(f'{group}.{name} must be the name of a parameter, not {value!r}')
        if not name.isidentifier() or name[0] == '_' or iskeyword(name) or name in Gains._fields:
            raise InputError(f'{group}.{name}: {name} cannot be the name of a gain')
        return
    known = KNOWN.get(group)
    if known is None:
        numbers = value if isinstance(value, list) else [value]
        if not all(isinstance(number, bool | int | float) for number in numbers):
            raise InputError(f'{group}.{name} must be a number or a list of some, not {value!r}')
        return
    if name not in known:
        raise UnknownNameError(group.removesuffix('s'), name, known)
    texts = [value] if isinstance(value, str) else value
    one = name in (AGE_NAME, FAULT_NAME) and not isinstance(value, str)
    if one or not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        wanted = 'a name' if one else 'an array, or a list of names, one for each joint'
        raise InputError(f'{group}.{name} must be {wanted}, not {value!r}')


VERSIONS = ('2.0', '3.0')
NUMBERS = (*FLOATS, 'Boolean', 'Integer', 'Int8', 'UInt8', 'Int16', 'UInt16', 'Int32', 'UInt32')
PLACES = ('binaries/linux64/', 'binaries/x86_64-linux/')
MANY = 100_000  # periods between two states
DISCARDED, TERMINATED = 2, 3  # fmi2Discard, fmi2Terminated
ENDS = 'asks for the end of the simulation'
SI = ('rad', 'kg', 'm', 's', 'A', 'K', 'mol', 'cd')
TAKEN_OFF = 'estimator.zero_angle'  # of an exported law: the cycle around it takes them off


class FmuLaw:
    """An FMU that is loaded and initialised."""

    def __init__(self, task: Any, question: Any, answer: Any) -> None:
        """Load it.

        Args:
            task: Its file, names, folder for what it unpacks to, number of joints.
            question: What is asked, see :mod:`parallel_robot_control.foreign.process`.
            answer: What it answers.

        Raises:
            InputError: it is none, cannot run here, or has not the variables that are named.
        """
        self._file, self._joints = task['file'], task['joints']
        self._question, self._answer = question, answer
        needed = 'an FMU as a law needs fmpy: pip install fmpy'
        described, parts = _read(self._file, needed)
        fmpy, simulation = (optional(name, needed) for name in ('fmpy', 'fmpy.simulation'))
        runs = described.coSimulation
        if described.fmiVersion not in VERSIONS or runs is None:
            kind = 'co-simulation' if runs is None else f'FMI {described.fmiVersion}'
            lacks = f'is not for {kind}' if runs is None else f'is of {kind}'
            raise InputError(
                f'{self._file} {lacks}: a law is one of FMI 2.0 or 3.0 for co-simulation'
            )
        if not any(part.startswith(PLACES) and part.endswith('.so') for part in parts):
            raise InputError(f'{self._file} has no code for Linux on x86-64')
        any_step = runs.canHandleVariableCommunicationStepSize
        usual = described.defaultExperiment and described.defaultExperiment.stepSize
        own = runs.fixedInternalStepSize or (0.0 if any_step else usual)
        # the length of its steps [s]; 0 if it takes any
        self.period = float(task['names'].get('step', own) or 0.0)
        self.multiples = bool(any_step)  # whether it takes multiples of it, too
        self._third = described.fmiVersion == '3.0'
        self._variables = {variable.name: variable for variable in described.modelVariables}
        self._units = {unit.name: unit.baseUnit for unit in described.unitDefinitions}
        # by joint, and whether it is a slide, what says so by its unit
        self._kinds: dict[tuple[int, bool], str] = {}
        self._scales: dict[str, list[tuple[float, float]]] = {}  # factors and offsets to our units
        for variable in self._variables.values():
            if variable.causality == 'independent' and self._scale(variable, 'time') != (1.0, 0.0):
                raise InputError(f'{self._file}: {variable.name} is in {variable.unit}, not in s')
        groups = {group: dict(task['names'].get(group, {})) for group in NAME_GROUPS}
        self._inputs = self._named(groups['inputs'], 'input', INPUTS)
        if not self._inputs:
            raise InputError(self._without('input', 'position'))
        self._outputs = self._named(groups['outputs'], 'output', RESULTS)
        if 'torque' not in self._outputs:
            raise InputError(self._without('output', 'torque'))
        self._fault = self._alone(groups['outputs'], 'output', FAULT_NAME, NUMBERS)
        self._age = self._alone(groups['inputs'], 'input', AGE_NAME, FLOATS)
        self.aged = self._age is not None  # whether it takes the age of the state
        if self._age:
            self._scales[AGE_NAME] = [self._scale(self._age, AGE_NAME)]
        self.kinds = [(*key, text) for key, text in self._kinds.items()]
        own = (self._variables.get(f'{TAKEN_OFF}[{k + 1}]') for k in range(self._joints))
        zeros = {each.name: 0.0 for each in own if each and each.causality == 'parameter'}
        groups['parameters'] = zeros | groups['parameters']
        self._parameters = [
            (self._of(name, 'parameter', NUMBERS), value)
            for name, value in groups['parameters'].items()
        ]
        for variable, value in self._parameters:
            count = len(value) if isinstance(value, list) else 1
            if count != _size(variable):
                raise InputError(
                    f'parameters.{variable.name} has {_size(variable)} numbers, not {count}'
                )
        gains = groups['gains'].values()
        self._gains = [self._of(gain['variable'], 'parameter', FLOATS) for gain in gains]
        self._chosen = [gain['start'] for gain in gains]
        fmpy.extract(self._file, task['folder'])
        os.chdir(task['folder'])  # where it may write
        self._said = ''
        self._unit: Any = simulation.instantiate_fmu(
            task['folder'], described, 'CoSimulation', logger=self._log, require_functions=False
        )
        self._time, self._period = 0.0, math.inf
        self._used = False
        self._start()

    def update(self, begins: bool, dt: float, age: float, gains: Sequence[float]) -> float:
        """See :class:`parallel_robot_control.foreign.process.Loaded`.

        It steps over the time since the last state, with its new inputs in the last period.
        """
        if begins:
            chosen = [*gains] or self._chosen
            if self._used or chosen != self._chosen:
                self._chosen = chosen
                self._call(self._unit.reset)
                self._start()
            self._used = True
            # A run may begin after a gap; the period is known from one that does not.
            known = self.period and not self.multiples
            self._period = self.period if known else min(self._period, dt)
            dt = self._period
        for _ in range(min(round(dt / self._period), MANY) - 1):
            self._step(self._period)
        n, inputs = self._joints, self._question
        for name, variables in self._inputs.items():
            row, *less = (inputs[n * row : n * row + n] for row in INPUTS[name][1:])
            values = [one - other for one, other in zip(row, *less, strict=True)] if less else row
            self._put(variables, self._foreign(name, values))
        if self._age:
            self._put([self._age], self._foreign(AGE_NAME, [age]))
        if begins:
            self._call(self._unit.exitInitializationMode)
        self._step(self._period)
        for name, variables in self._outputs.items():
            begin, scales = n * RESULTS[name][1], self._scales[name]
            self._answer[begin : begin + n] = [
                value * factor + offset if offset else value * factor
                for value, (factor, offset) in zip(self._get(variables), scales, strict=True)
            ]
        return float(self._get([self._fault])[0]) if self._fault else 0.0

    def _foreign(self, name: str, values: Iterable[float]) -> list[float]:
        """Values in the units of the FMU."""
        scaled = zip(values, self._scales[name], strict=True)
        return [(value - offset) / factor for value, (factor, offset) in scaled]

    def _start(self) -> None:
        """Begin the initialisation, which ends when the first inputs are set."""
        unit, self._time = self._unit, 0.0
        for variable, value in self._parameters:
            self._put([variable], value if isinstance(value, list) else [value])
        for variable, number in zip(self._gains, self._chosen, strict=True):
            self._put([variable], [number])
        if not self._third:
            self._call(unit.setupExperiment, startTime=0.0)
        self._call(unit.enterInitializationMode)

    def _step(self, period: float) -> None:
        done = self._call(self._unit.doStep, self._time, period)
        self._time += period
        if self._third and (done[1] or done[2]):
            ends = f'returned early, at {done[3]:.9g} s' if not done[1] else ENDS
            raise InputError(f'the FMU {ends}{self._log_text()}')

    def _put(self, variables: list[Any], values: Iterable[float]) -> None:
        """Set variables of one type."""
        kind = variables[0].type
        convert = float if kind in FLOATS else int
        put = getattr(self._unit, f'set{kind}')
        self._call(put, [each.valueReference for each in variables], list(map(convert, values)))

    def _get(self, variables: list[Any]) -> list[float]:
        """Values of variables of one type."""
        get = getattr(self._unit, f'get{variables[0].type}')
        count = {'nValues': sum(map(_size, variables))} if self._third else {}
        numbers = [each.valueReference for each in variables]
        return list(map(float, self._call(get, numbers, **count)))

    def _call(self, function: Any, *given: Any, **named: Any) -> Any:
        """Call a function of the FMU."""
        try:
            return function(*given, **named)
        except Exception as error:
            ends = False
            if not self._third and getattr(error, 'status', None) == DISCARDED:
                with contextlib.suppress(Exception):  # it need not have this function
                    ends = self._unit.getBooleanStatus(TERMINATED)
            failed = ENDS if ends else f'failed: {first_line(error)}'
            raise InputError(f'the FMU {failed}{self._log_text()}') from None

    def _log_text(self) -> str:
        return f', {self._said}' if self._said else ''

    def _log(self, *words: Any) -> None:
        """Remember what the FMU says: its last word is the message."""
        last = words[-1]
        self._said = (
            last.decode(errors='replace').strip() if isinstance(last, bytes) else str(last)
        )

    def _named(
        self, given: dict[str, Any], role: str, known: Iterable[str]
    ) -> dict[str, list[Any]]:
        """Variables of each name of the suite: those that are given, else those called so."""
        found = {}
        for name in known:
            texts = given.get(name)
            if texts is None:
                if f'{name}[1]' not in self._variables:
                    continue
                texts = [f'{name}[{k + 1}]' for k in range(self._joints)]
                if f'{name}[{self._joints + 1}]' in self._variables:
                    raise InputError(f'{self._file} is for more than {self._joints} joints')
            whole = isinstance(texts, str)
            texts = [texts] if whole else texts
            of_name = [self._of(text, role, FLOATS) for text in texts]
            count = _size(of_name[0]) if whole else len(of_name)
            if count != self._joints or any(_size(each) != 1 for each in of_name if not whole):
                raise InputError(
                    f'{role}s.{name} must name {self._joints} numbers, one for each joint, '
                    f'not {", ".join(texts)}'
                )
            if len({each.type for each in of_name}) > 1:
                raise InputError(f'{role}s.{name}: {", ".join(texts)} are of different types')
            found[name] = of_name
            joints = range(self._joints)
            self._scales[name] = [self._scale(of_name[0 if whole else k], name, k) for k in joints]
        return found

    def _scale(self, variable: Any, name: str, joint: int | None = None) -> tuple[float, float]:
        """Factor and offset from the unit that a variable declares to that of the suite."""
        declared = variable.declaredType
        unit, ours = variable.unit or getattr(declared, 'unit', None), UNITS.get(name)
        if unit in SAYS_NOTHING or not ours:
            return 1.0, 0.0
        base = self._units.get(unit)
        fits = [kind for kind in (HINGES, PRISMATIC) if _fits(unit, base, BASES[kind.of(ours)])]
        if not fits or (base and not 0.0 < abs(base.factor) < math.inf):
            raise InputError(
                f'{self._file}: {variable.name} is in {unit}, {_defined(base)}: {name} is in '
                f'{BOTH.of(ours)}'
            )
        if joint is not None and len(fits) == 1:
            self._kinds.setdefault((joint, fits == [PRISMATIC]), f'{variable.name} is in {unit}')
        if base is None:
            return 1.0, 0.0
        relative = variable.relativeQuantity or getattr(declared, 'relativeQuantity', False)
        return base.factor, 0.0 if relative or 'error' in name else base.offset

    def _alone(self, given: dict[str, Any], role: str, known: str, types: tuple[str, ...]) -> Any:
        """The variable of a name of the suite that is one number: as given, or if one fits."""
        if known in given:
            return self._of(given[known], role, types)
        variable = self._variables.get(known)
        if variable is None or variable.causality != role or variable.shape:
            return None
        return variable if variable.type in types else None

    def _of(self, name: str, role: str, types: tuple[str, ...]) -> Any:
        """A variable of the FMU."""
        variable = self._variables.get(name)
        if variable is None:
            alike = [each.name for each in self._variables.values() if each.causality == role]
            raise UnknownNameError(f'{role} of {self._file}', name, alike)
        if variable.causality != role or variable.type not in types:
            raise InputError(
                f'{self._file}: {name} is a {variable.causality} of type {variable.type}, '
                f'not a {role} of type {" or ".join(types[:2])}'
            )
        return variable

    def _without(self, role: str, name: str) -> str:
        """That the FMU lacks what a law needs."""
        own = [each.name for each in self._variables.values() if each.causality == role]
        if not own:
            return f'{self._file} has no {role}s: it is no law'
        listed = ', '.join(own[:8]) + (', ...' if len(own) > 8 else '')
        beside = os.path.basename(self._file).removesuffix('.fmu') + '.yaml'
        return (
            f'{self._file} has no {role} {name}[1]: {beside} beside it says what it calls its '
            f'{role}s ({listed})'
        )


def load(task: Any, question: Any, answer: Any) -> FmuLaw:
    """Load the FMU of a task."""
    return FmuLaw(task, question, answer)


def _fits(unit: str, base: Any, wanted: Mapping[str, int]) -> bool:
    """Whether a unit is of some base units: by its definition, else by its name."""
    if base is None:
        plain = unit.replace('N.m', 'N m').replace('N*m', 'N m').replace('Nm', 'N m')
        return BASES.get(plain.replace('s2', 's^2')) == wanted
    angle = 'rad' in unit or 'deg' in unit or base.rad == wanted.get('rad', 0)
    return angle and all(getattr(base, si) == wanted.get(si, 0) for si in SI[1:])


def _defined(base: Any) -> str:
    """The definition of a unit, in words."""
    if base is None:
        return 'which it does not define'
    powers = ' '.join(f'{si}^{getattr(base, si)}' for si in SI if getattr(base, si))
    return f'which is {base.factor:.6g} {powers or "without a unit"}'


def _size(variable: Any) -> int:
    """Number of the elements of a variable."""
    return math.prod(variable.shape or ())
