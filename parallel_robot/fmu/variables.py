"""Variables of a unit: what they are, and where they lie in the memory of its kernels."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from numba import typeof

from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import BASES, JointUnits
from parallel_robot_model.compiler import Boxed, FunctionValue, Leaf, leaves
from parallel_robot_model.configuration.fields import Field, PerJoint, parameters

WORD = 8  # bytes
SHARE, MORE = 0.25, 0.1  # by which a parameter is changed to see what follows


class Variable(NamedTuple):
    """A variable of a unit."""

    name: str
    # ``input``, ``output``, ``parameter``, which can be changed at any time, ``constant``
    role: str
    kind: str  # ``real``, ``integer`` or ``boolean``
    text: str  # what it is
    unit: str  # its unit; empty if it has none
    start: float  # its value at the start; of an output what is there before the first step
    low: float = -math.inf  # smallest value
    high: float = math.inf  # largest value
    address: int = 0  # where it lies, in this process; of a constant nowhere


class Rows(NamedTuple):
    """Numbers of joints in memory, as variables."""

    address: int  # where row 0 begins
    joints: Sequence[str]  # names of the joints
    units: JointUnits  # their units

    def of(self, role: str, *rows: tuple[int, str, str, str]) -> Iterator[Variable]:
        """A variable for each joint, of rows: number, name, unit for hinges, and what it is."""
        for (row, name, unit, text), (k, joint) in product(rows, enumerate(self.joints)):
            own = self.units.one(k)
            place = self.address + WORD * (row * len(self.joints) + k)
            words = f'{own.label(text)} of {joint}'
            yield Variable(
                f'{name}[{k + 1}]', role, 'real', words, own.of(unit), 0.0, address=place
            )


def of_group(
    group: Any, prefix: str, boxed: Boxed, make: Callable[[Any], Any] | None, units: JointUnits
) -> Iterator[Variable]:
    """Variables of a group of parameters.

    A number is a parameter that can be changed if it stands in memory as it is, and nothing else
    there follows from it; this is tried by changing it. Others are constants; texts are left out.

    Args:
        group: The group.
        prefix: Of its keys.
        boxed: What the kernels have of it.
        make: Makes the tuple of `boxed` from another group; None: all are constants.
        units: Units of the joints, for numbers per joint.
    """
    known = list(_numbers(boxed, boxed.value)) if make else []
    for at, parameter in enumerate(parameters(type(group))):
        value, several = group[at], isinstance(group[at], tuple)
        for k, number in enumerate(value if several else (value,)):
            if isinstance(number, str) or not isinstance(number, int | float):
                continue
            place = None
            if make and isinstance(number, float):
                changed = functools.partial(_changed, make, group, at, k)
                place = _place_of(boxed, known, changed, number, parameter.field)
            own = units
            if parameter.type is PerJoint:
                own = units.one(k)
            yield Variable(
                f'{prefix}.{parameter.key}' + (f'[{k + 1}]' if several else ''),
                'constant' if place is None else 'parameter',
                {bool: 'boolean', int: 'integer'}.get(type(number), 'real'),
                parameter.field.description,
                own.of(parameter.field.unit),
                float(number),
                parameter.field.low,
                parameter.field.high,
                place or 0,
            )


def _changed(make: Callable[[Any], Any], group: Any, at: int, k: int, new: float) -> Any:
    """What is made of a group in which number `k` of field `at` is another one."""
    value = group[at]
    whole = (*value[:k], new, *value[k + 1 :]) if isinstance(value, tuple) else new
    return make(group._replace(**{group._fields[at]: whole}))


def _numbers(boxed: Boxed, value: Any) -> Iterator[Leaf]:
    """The numbers in a boxed tuple, or in another of its type."""
    for leaf in leaves(value, typeof(boxed.value), boxed.address):
        if not isinstance(leaf.value, Boxed | FunctionValue | str) and leaf.value is not None:
            yield leaf


def _place_of(
    boxed: Boxed,
    known: list[Leaf],
    changed: Callable[[float], Any],
    number: float,
    field: Field,
) -> int | None:
    """Where a number lies as it is, if nothing else follows from it."""
    tried = (number + SHARE * abs(number) + MORE, number - SHARE * abs(number) - MORE)
    ends = [min(max(new, field.low), field.high) for new in tried]
    ends += [end for end in (field.low, field.high) if math.isfinite(end)]
    places = set()
    for new in ends:
        if new == number:
            continue
        try:
            after = list(_numbers(boxed, changed(new)))
        except (ParallelRobotError, ArithmeticError, ValueError):
            continue  # no such robot
        moved = [b for a, b in zip(known, after, strict=True) if _differ(a.value, b.value)]
        if len(moved) != 1 or moved[0].value != new:
            return None
        places.add(moved[0].address)
    return places.pop() if len(places) == 1 else None


def _differ(one: Any, other: Any) -> bool:
    with contextlib.suppress(TypeError, ValueError):
        return bool(one != other) and not (one != one and other != other)
    return False  # arrays


# The file modelDescription.xml of a unit, of FMI 2.0 and 3.0.

TOOL = 'parallel_robot'
TYPES = {
    2: {'real': 'Real', 'integer': 'Integer', 'boolean': 'Boolean'},
    3: {'real': 'Float64', 'integer': 'Int32', 'boolean': 'Boolean'},
}


def description(
    version: int,
    name: str,
    token: str,
    text: str,
    variables: Sequence[Variable],
    period: float,
    duration: float,
) -> bytes:
    """Write it.

    Args:
        version: Of FMI, 2 or 3.
        name: Identifier of the model, that of its library.
        token: What binds it to its library.
        text: What the unit is.
        variables: Its variables, in the order of their numbers; the time comes last.
        period: The only length of a step [s].
        duration: Of the default experiment [s].
    """
    attributes = {
        'fmiVersion': '2.0' if version == 2 else '3.0',
        'modelName': name,
        'guid' if version == 2 else 'instantiationToken': token,
        'description': text,
        'generationTool': TOOL,
        'variableNamingConvention': 'structured',
    }
    root = Element('fmiModelDescription', attributes)
    state, get = ('FMUstate', 'canGetAndSetFMUstate') if version == 2 else ('FMUState', '')
    abilities = {
        'modelIdentifier': name,
        get or 'canGetAndSetFMUState': 'true',
        f'canSerialize{state}': 'true',
        'canHandleVariableCommunicationStepSize': 'false',
    }
    if version == 2:
        abilities['canNotUseMemoryManagementFunctions'] = 'true'
    else:
        abilities['fixedInternalStepSize'] = repr(period)
    SubElement(root, 'CoSimulation', abilities)
    _units(root, variables)
    SubElement(SubElement(root, 'LogCategories'), 'Category', {'name': 'logStatusError'})
    experiment = {'startTime': '0', 'stopTime': repr(duration), 'stepSize': repr(period)}
    SubElement(root, 'DefaultExperiment', experiment)
    listed = SubElement(root, 'ModelVariables')
    for number, variable in enumerate(variables):
        kind, values = TYPES[version][variable.kind], _values(variable)
        common = _common(number, variable)
        if version == 2:
            SubElement(SubElement(listed, 'ScalarVariable', common), kind, values)
        else:
            SubElement(listed, kind, common | values)
    structure = SubElement(root, 'ModelStructure')
    outputs = [k for k, variable in enumerate(variables) if variable.role == 'output']
    if version == 2:
        for group in ('Outputs', 'InitialUnknowns'):
            whole = SubElement(structure, group)
            for number in outputs:
                SubElement(whole, 'Unknown', {'index': str(number + 1)})
    else:
        time = {'name': 'time', 'valueReference': str(len(variables)), 'causality': 'independent',
                'variability': 'continuous', 'description': 'time', 'unit': 's'}  # fmt: skip
        SubElement(listed, 'Float64', time)
        for group in ('Output', 'InitialUnknown'):
            for number in outputs:
                SubElement(structure, group, {'valueReference': str(number)})
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, 'utf-8', xml_declaration=True)) + b'\n'


def _units(root: Element, variables: Sequence[Variable]) -> None:
    """Define the units of variables."""
    defined = SubElement(root, 'UnitDefinitions')
    for unit in sorted({variable.unit for variable in variables if variable.unit} | {'s'}):
        element = SubElement(defined, 'Unit', {'name': unit})
        if unit in BASES:
            powers = {base: str(power) for base, power in BASES[unit].items()}
            SubElement(element, 'BaseUnit', powers)


def _common(number: int, variable: Variable) -> dict[str, str]:
    """Attributes that both versions have at the same element."""
    causality = {'constant': 'local'}.get(variable.role, variable.role)
    sampled = 'discrete' if variable.role == 'output' or variable.kind != 'real' else 'continuous'
    variability = {'parameter': 'tunable', 'constant': 'constant'}.get(variable.role, sampled)
    attributes = {
        'name': variable.name,
        'valueReference': str(number),
        'causality': causality,
        'variability': variability,
    }
    initial = {'output': 'calculated', 'parameter': 'exact', 'constant': 'exact'}
    if variable.role in initial:
        attributes['initial'] = initial[variable.role]
    if variable.text:
        attributes['description'] = variable.text
    return attributes


def _values(variable: Variable) -> dict[str, str]:
    """Unit, range and start."""
    attributes = {}
    if variable.unit:
        attributes['unit'] = variable.unit
    if variable.kind != 'boolean':
        if math.isfinite(variable.low):
            attributes['min'] = _spelled(variable, variable.low)
        if math.isfinite(variable.high):
            attributes['max'] = _spelled(variable, variable.high)
    if variable.role != 'output':
        attributes['start'] = _spelled(variable, variable.start)
    return attributes


def _spelled(variable: Variable, value: float) -> str:
    if variable.kind == 'boolean':
        return 'true' if value else 'false'
    return str(int(value)) if variable.kind == 'integer' else repr(value)
