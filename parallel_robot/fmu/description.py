"""The file modelDescription.xml of a unit, of FMI 2.0 and 3.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from parallel_robot.fmu.variables import Variable

TOOL = 'parallel_robot'
TYPES = {
    2: {'real': 'Real', 'integer': 'Integer', 'boolean': 'Boolean'},
    3: {'real': 'Float64', 'integer': 'Int32', 'boolean': 'Boolean'},
}
# Exponents of kg, m, s, A, K, mol, cd, rad of units; of others the name alone is told.
BASES = {
    's': {'s': 1}, 'm': {'m': 1}, 'kg': {'kg': 1}, 'rad': {'rad': 1}, 'Hz': {'s': -1},
    'm/s': {'m': 1, 's': -1}, 'm/s^2': {'m': 1, 's': -2},
    'rad/s': {'rad': 1, 's': -1}, 'rad/s^2': {'rad': 1, 's': -2},
    'N': {'kg': 1, 'm': 1, 's': -2}, 'N m': {'kg': 1, 'm': 2, 's': -2},
    'kg m^2': {'kg': 1, 'm': 2}, '1/s': {'s': -1},
}  # fmt: skip


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
        (_second if version == 2 else _third)(listed, number, variable)
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


def _second(listed: Any, number: int, variable: Variable) -> None:
    """A variable of FMI 2.0."""
    element = SubElement(listed, 'ScalarVariable', _common(number, variable))
    SubElement(element, TYPES[2][variable.kind], _values(variable))


def _third(listed: Any, number: int, variable: Variable) -> None:
    """A variable of FMI 3.0."""
    SubElement(listed, TYPES[3][variable.kind], _common(number, variable) | _values(variable))
