"""A unit as a file: kernels and the functions of FMI as one library, described and packed."""

from __future__ import annotations

import hashlib
import html
import io
import json
import os
import platform
import re
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.fmu.contents import Contents
from parallel_robot.fmu.variables import description
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import Image, native_object

COMPILER = 'gcc'
SYSTEM = 'Linux x86_64'
FOLDERS = {2: 'binaries/linux64', 3: 'binaries/x86_64-linux'}
FLAGS = (
    '-std=c11', '-D_GNU_SOURCE', '-O2', '-ffp-contract=off', '-fPIC', '-shared', '-Wl,-s',
    '-Wl,--gc-sections', '-Wl,-z,defs',
)  # fmt: skip
TOKEN = '@token@'  # in the table, until it is known
SOURCES = ('instance.c', 'instance.h', 'functions.h', 'fmi2.c', 'fmi3.c')


def need_compiler() -> None:
    """Refuse to begin without gcc.

    Raises:
        InputError: it is missing.
    """
    if shutil.which(COMPILER) is None:
        raise InputError(f'{COMPILER} is missing: it links the FMU; install it')


def unit(contents: Contents, name: str, version: int, duration: float) -> bytes:
    """Make a unit, a ZIP archive; the same contents make the same bytes.

    Args:
        contents: What it is made of.
        name: Its name, of letters, digits and underscores.
        version: Of FMI, 2 or 3.
        duration: Of its default experiment [s].

    Raises:
        InputError: gcc does not link it, the system is another one, or a kernel makes arrays.
    """
    code = code_of(contents)
    library = _library(code.kernels, code.table, version)
    described = description(
        version, name, code.token, contents.text, contents.variables, contents.period, duration
    )
    parts = {
        'modelDescription.xml': described,
        f'{FOLDERS[version]}/{name}.so': library,
        'documentation/index.html': _page(contents, name),
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, 'w', zipfile.ZIP_DEFLATED) as archive:
        for path, content in parts.items():
            archive.writestr(zipfile.ZipInfo(path), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


class Code(NamedTuple):
    """The native code of a unit."""

    kernels: bytes  # its kernels as an object file
    table: str  # the table of its variables, in C
    token: str  # what binds its description to it


def code_of(contents: Contents) -> Code:
    """The kernels of a unit and the table of its variables.

    Raises:
        InputError: the system is another one, or a kernel makes arrays.
    """
    system = f'{platform.system()} {platform.machine()}'
    if system != SYSTEM:
        raise InputError(f'native code is that of this process: on {SYSTEM}, not {system}')
    native = native_object(contents.entries, contents.root)
    table = _table(contents, native.image)
    digest = hashlib.sha256(native.content + table.encode()).hexdigest()
    token = str(uuid.uuid5(uuid.NAMESPACE_OID, digest))
    return Code(native.content, table.replace(TOKEN, token), token)


def identifier(text: str) -> str:
    """A text as a name in C."""
    return re.sub(r'\W|^(?=\d)', '_', text, flags=re.ASCII)


def _table(contents: Contents, image: Image) -> str:
    """The table of the variables, in C."""
    roles = {'input': 'INPUT', 'output': 'OUTPUT', 'parameter': 'PARAMETER'}
    rows = []
    for each in contents.variables:
        place = image.place_of(each.address) if each.address else 0
        numbers = ', '.join(_number(value) for value in (each.low, each.high, each.start))
        role, kind = roles.get(each.role, 'CONSTANT'), each.kind.upper()
        rows.append(f'    {{{role}, {kind}, {place}, {numbers}, {json.dumps(each.name)}}},')
    rows.append('    {TIME, REAL, 0, 0.0, 0.0, 0.0, "time"},')
    lines = [
        '#include <math.h>',
        '#include "instance.h"',
        'const Variable variables[] = {',
        *rows,
        '};',
        f'const int64_t variable_count = {len(rows)};',
        f'const double period = {_number(contents.period)};',
        f'const char *const guid = "{TOKEN}";',
    ]
    return '\n'.join(lines) + '\n'


def _number(value: Any) -> str:
    if value in (float('inf'), float('-inf')):
        return 'INFINITY' if value > 0 else '-INFINITY'
    return float(value).hex()


def _library(kernels: bytes, table: str, version: int) -> bytes:
    """Link kernels, table and the functions of FMI."""
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        for name in SOURCES:
            source = files('parallel_robot.fmu').joinpath('c', name).read_bytes()
            (folder / name).write_bytes(source)
        (folder / 'kernels.o').write_bytes(kernels)
        (folder / 'variables.c').write_text(table)
        shown = f'{{ global: fmi{version}*; local: *; }};'
        (folder / 'shown.map').write_text(shown)
        words = [
            COMPILER, *FLAGS, '-Wl,--version-script=shown.map', f'fmi{version}.c', 'instance.c',
            'variables.c', 'kernels.o', '-o', 'unit.so', '-lm',
        ]  # fmt: skip
        ended = subprocess.run(
            words, cwd=folder, capture_output=True, text=True, check=False,
            env={**os.environ, 'LC_ALL': 'C'},
        )  # fmt: skip
        if ended.returncode:
            raise InputError(f'{COMPILER} does not link the FMU: {ended.stderr.strip()}')
        return (folder / 'unit.so').read_bytes()


def _page(contents: Contents, name: str) -> bytes:
    """What people read about the unit."""
    rows = ''.join(
        f'<tr><td>{number}</td><td>{html.escape(text)}</td></tr>\n'
        for number, text in sorted(contents.codes.items())
    )
    table = f'<table><caption>Faults</caption>\n{rows}</table>\n' if rows else ''
    return (
        f'<!DOCTYPE html>\n<html><head><meta charset="utf-8"><title>{name}</title></head><body>\n'
        f'<h1>{name}</h1>\n<p>{html.escape(contents.text)}; one step is '
        f'{contents.period:g} s.</p>\n{table}</body></html>\n'
    ).encode()
