"""A law as an FMU for co-simulation, run by fmpy, see docs/fmu.md."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Iterable, Sequence
from typing import Any

from parallel_robot_control.foreign import names
from parallel_robot_model.common.errors import InputError, UnknownNameError, first_line

VERSIONS = ('2.0', '3.0')
FLOATS = ('Real', 'Float64', 'Float32')
NUMBERS = (*FLOATS, 'Boolean', 'Integer', 'Int8', 'UInt8', 'Int16', 'UInt16', 'Int32', 'UInt32')
PLACES = ('binaries/linux64/', 'binaries/x86_64-linux/')
MANY = 100_000  # periods between two states
TAKEN_OFF = 'estimator.zero_angle'  # of an exported law: the cycle around it takes them off


class FmuLaw:
    """An FMU that is loaded and initialised.

    Attributes:
        period: The length of its steps [s]; 0 if it takes any.
        multiples: Whether it takes multiples of it, too.
        aged: Whether it takes the age of the state.
    """

    def __init__(self, task: Any, question: Any, answer: Any) -> None:
        """Load it.

        Args:
            task: Its file, names, folder for what it unpacks to, number of joints.
            question: What is asked, see :mod:`parallel_robot_control.foreign.process`.
            answer: What it answers.

        Raises:
            InputError: it is none, cannot run here, or has not the variables that are named.
        """
        try:
            import fmpy
            from fmpy.simulation import instantiate_fmu
        except ImportError:
            raise InputError('an FMU as a law needs fmpy: pip install fmpy') from None
        self._file, self._joints = task['file'], task['joints']
        self._question, self._answer = question, answer
        try:
            described = fmpy.read_model_description(self._file, validate=False)
            with zipfile.ZipFile(self._file) as archive:
                parts = archive.namelist()
        except Exception as error:  # whatever is in the file
            raise InputError(f'{self._file} is no FMU: {first_line(error)}') from None
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
        self.period = float(task['names'].get('step', own) or 0.0)
        self.multiples = bool(any_step)
        self._variables = {variable.name: variable for variable in described.modelVariables}
        groups = {group: names.given(task['names'], group) for group in names.GROUPS}
        self._inputs = self._named(groups['inputs'], 'input', names.INPUTS)
        if not self._inputs:
            raise InputError(self._without('input', 'position'))
        self._outputs = self._named(groups['outputs'], 'output', names.RESULTS)
        if 'torque' not in self._outputs:
            raise InputError(self._without('output', 'torque'))
        self._fault = self._alone(groups['outputs'], 'output', names.FAULT, NUMBERS)
        self._age = self._alone(groups['inputs'], 'input', names.AGE, FLOATS)
        self.aged = self._age is not None
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
        gains = names.given(task['names'], 'gains')
        self._gains = [self._of(gain['variable'], 'parameter', FLOATS) for gain in gains.values()]
        self._chosen = [gain['start'] for gain in gains.values()]
        fmpy.extract(self._file, task['folder'])
        os.chdir(task['folder'])  # where it may write
        self._said = ''
        self._unit: Any = instantiate_fmu(
            task['folder'], described, 'CoSimulation', logger=self._log, require_functions=False
        )
        self._third = described.fmiVersion == '3.0'
        self._time, self._period = 0.0, math.inf
        self._used = False
        self._initialise()

    def update(self, begins: bool, dt: float, age: float, gains: Sequence[float]) -> float:
        """See :class:`parallel_robot_control.foreign.process.Loaded`.

        It steps over the time since the last state, with its new inputs in the last period.
        """
        if begins:
            chosen = [*gains] or self._chosen
            if self._used or chosen != self._chosen:
                self._chosen = chosen
                self._call(self._unit.reset)
                self._initialise()
            self._used = True
            # A run may begin after a gap; the period is known from one that does not.
            known = self.period and not self.multiples
            self._period = self.period if known else min(self._period, dt)
            dt = self._period
        for _ in range(min(round(dt / self._period), MANY) - 1):
            self._step(self._period)
        n, asked = self._joints, self._question
        for name, variables in self._inputs.items():
            if name in names.ROWS:
                begin = n * names.ROWS[name]
                values = asked[begin : begin + n]
            else:
                one, other = names.DIFFERENCES[name]
                values = [asked[n * one + k] - asked[n * other + k] for k in range(n)]
            self._put(variables, values)
        if self._age:
            self._put([self._age], [age])
        self._step(self._period)
        for name, variables in self._outputs.items():
            begin = n * names.RESULTS[name]
            self._answer[begin : begin + n] = self._get(variables)
        return float(self._get([self._fault])[0]) if self._fault else 0.0

    def _initialise(self) -> None:
        unit, self._time = self._unit, 0.0
        for variable, value in self._parameters:
            self._put([variable], value if isinstance(value, list) else [value])
        for variable, number in zip(self._gains, self._chosen, strict=True):
            self._put([variable], [number])
        if not self._third:
            self._call(unit.setupExperiment, startTime=0.0)
        self._call(unit.enterInitializationMode)
        self._call(unit.exitInitializationMode)

    def _step(self, period: float) -> None:
        self._call(self._unit.doStep, self._time, period)
        self._time += period

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
        """Call a function of the FMU.

        Raises:
            InputError: it does not do it; what it says of it.
        """
        try:
            return function(*given, **named)
        except Exception as error:
            said = f', {self._said}' if self._said else ''
            raise InputError(f'the FMU failed: {first_line(error)}{said}') from None

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
        return found

    def _alone(self, given: dict[str, Any], role: str, known: str, types: tuple[str, ...]) -> Any:
        """The variable of a name of the suite that is one number: as given, or if one fits."""
        if known in given:
            return self._of(given[known], role, types)
        variable = self._variables.get(known)
        if variable is None or variable.causality != role or variable.shape:
            return None
        return variable if variable.type in types else None

    def _of(self, name: str, role: str, types: tuple[str, ...]) -> Any:
        """A variable of the FMU.

        Raises:
            InputError: it has none of this name, or it is something else.
        """
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


def _size(variable: Any) -> int:
    """Number of the elements of a variable."""
    return math.prod(variable.shape or ())
