"""Units made, opened and stepped by fmpy, by the names of their variables."""

from __future__ import annotations

import ctypes
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from parallel_robot.cli.command_line import main

PERIOD = 1e-3  # s
TYPES = {2: ('Real', 'Integer', 'Boolean'), 3: ('Float64', 'Int32', 'Boolean')}


def made(folder: Path, kind: str, name: str, *words: str, fmi: int = 2) -> Path:
    """Make a unit by the command, and unpack it."""
    stem = f'{kind}{fmi}'
    file = folder / f'{stem}.fmu'
    assert main(['fmu', kind, name, '--fmi', str(fmi), '--out', str(file), *words]) == 0
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder / stem)
    return folder / stem


def library(folder: Path) -> Path:
    """The library of an unpacked unit."""
    (file,) = folder.glob('binaries/*/*.so')
    return file


def follows_schema(folder: Path, version: int) -> bool:
    """Whether the description follows the standard's schema, by libxml2."""
    xml = ctypes.CDLL('libxml2.so.2')
    for name in ('xmlSchemaNewParserCtxt', 'xmlSchemaParse', 'xmlSchemaNewValidCtxt'):
        getattr(xml, name).restype = ctypes.c_void_p
    xml.xmlReadFile.restype = ctypes.c_void_p
    schemas = Path(fmpy.__file__).parent / 'schema' / f'fmi{version}'
    schema = str(schemas / f'fmi{version}ModelDescription.xsd').encode()
    parser = ctypes.c_void_p(xml.xmlSchemaNewParserCtxt(schema))
    judge = xml.xmlSchemaNewValidCtxt(ctypes.c_void_p(xml.xmlSchemaParse(parser)))
    document = xml.xmlReadFile(str(folder / 'modelDescription.xml').encode(), None, 0)
    found: int = xml.xmlSchemaValidateDoc(ctypes.c_void_p(judge), ctypes.c_void_p(document))
    return found == 0


class Unit:
    """An instance of an unpacked unit, after its initialisation."""

    def __init__(self, folder: Path, **values: float) -> None:
        root = ElementTree.parse(folder / 'modelDescription.xml').getroot()
        self.version = int(root.get('fmiVersion', '')[0])
        token = root.get('guid') or root.get('instantiationToken')
        kind = FMU2Slave if self.version == 2 else FMU3Slave
        self.fmu: Any = kind(
            guid=token, modelIdentifier=folder.name, unzipDirectory=str(folder), instanceName='it'
        )
        self.numbers, self.types = {}, {}
        for element in root.find('ModelVariables'):
            name, number = element.get('name'), int(element.get('valueReference'))
            typed = element if self.version == 3 else element[0]
            self.numbers[name], self.types[name] = number, typed.tag
        self.fmu.instantiate()
        self.set(**values)
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.time = 0.0

    def set(self, **values: float) -> None:
        """Set variables; `__` stands for a dot."""
        for name, value in values.items():
            self.put(name.replace('__', '.'), value)

    def put(self, name: str, value: float) -> None:
        """Set a variable."""
        kind = self.types[name]
        getattr(self.fmu, f'set{kind}')([self.numbers[name]], [value])

    def get(self, name: str) -> Any:
        """Get a variable."""
        return getattr(self.fmu, f'get{self.types[name]}')([self.numbers[name]])[0]

    def row(self, name: str) -> np.ndarray:
        """Get a variable of each joint."""
        kind, numbers = self._row(name)
        return np.array(getattr(self.fmu, f'get{kind}')(numbers))

    def put_row(self, name: str, values: Any) -> None:
        """Set a variable of each joint."""
        kind, numbers = self._row(name)
        getattr(self.fmu, f'set{kind}')(numbers, list(map(float, values)))

    def _row(self, name: str) -> tuple[str, list[int]]:
        k, numbers = 1, []
        while f'{name}[{k}]' in self.numbers:
            numbers.append(self.numbers[f'{name}[{k}]'])
            k += 1
        return TYPES[self.version][0], numbers

    def step(self, period: float = PERIOD) -> None:
        """One step."""
        self.fmu.doStep(self.time, period)
        self.time += period


def coupled(law: Unit, plant: Unit, reference: Any) -> tuple[np.ndarray, np.ndarray]:
    """Commands [N m] and measured positions [rad] of a loop of two units, each shape (N, n)."""
    commands, positions = [], []
    for position, velocity, acceleration in zip(*reference, strict=True):
        positions.append(plant.row('position'))
        for name in ('position', 'velocity', 'effort'):
            law.put_row(name, plant.row(name))
        law.put('age', plant.get('age'))
        law.put_row('reference.position', position)
        law.put_row('reference.velocity', velocity)
        law.put_row('reference.acceleration', acceleration)
        law.step()
        commands.append(law.row('torque'))
        plant.put_row('torque', commands[-1])
        plant.step()
    return np.array(commands), np.array(positions)
