"""A law as a ROS 2 package: a controller of ros2_control around its native code."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from importlib.resources import files
from xml.sax.saxutils import escape

from parallel_robot.fmu.contents import Contents
from parallel_robot.fmu.unit import code_of
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError

NAME = re.compile('[a-z][a-z0-9]*(_[a-z0-9]+)*')  # REP 144
TEMPLATES = {
    'package.xml': 'package.xml',
    'CMakeLists.txt': 'CMakeLists.txt',
    'plugin.xml': 'plugin.xml',
    'controllers.yaml': 'config/controllers.yaml',
    'controller.cpp': 'src/controller.cpp',
}
FIRST = {  # variables of the first joint, by their names in C
    'position[1]': 'POSITION',
    'velocity[1]': 'VELOCITY',
    'effort[1]': 'EFFORT',
    'reference.position[1]': 'REFERENCE_POSITION',
    'reference.velocity[1]': 'REFERENCE_VELOCITY',
    'reference.acceleration[1]': 'REFERENCE_ACCELERATION',
    'effort_known': 'EFFORT_KNOWN',
    'joins': 'JOINS',
    'torque[1]': 'TORQUE',
    'fault': 'FAULT',
}


def ros2_package(
    contents: Contents, configuration: ControlConfiguration, name: str
) -> dict[str, bytes]:
    """Make the files of a package, by their paths in it.

    Args:
        contents: The law with its control cycle.
        configuration: What it was made of.
        name: Name of the package.

    Raises:
        InputError: it is no name of a package, the system is another one, or a kernel makes
            arrays.
    """
    if NAME.fullmatch(name) is None:
        raise InputError(
            f'a ROS package is named by small letters, digits and single underscores, not {name!r}'
        )
    code = code_of(contents)
    rate = 1.0 / contents.period
    if abs(rate - round(rate)) > 1e-6 * rate:
        raise InputError(
            f'ros2_control runs at a whole number of Hz: period must be 1 / n s, not '
            f'{contents.period:g}',
            'period',
        )
    joints, timeout = configuration.loop.joints, configuration.safety.reference_timeout
    words = {
        'package': name,
        'text': escape(contents.text),  # it stands in XML
        'rate': str(round(rate)),
        'joints': _quoted(joints),
        'timeout': repr(timeout),
    }
    source = files('parallel_robot.fmu')
    made = {
        path: re.sub(
            '@([a-z]+)@',
            lambda found: words[found[1]],
            source.joinpath('ros2_control', template).read_text('utf-8'),
        ).encode()
        for template, path in TEMPLATES.items()
    }
    native = {
        name: source.joinpath('c', name).read_bytes() for name in ('instance.c', 'instance.h')
    }
    native |= {
        'kernels.o': code.kernels,
        'variables.c': code.table.encode(),
        'layout.h': _layout(contents, joints, timeout).encode(),
    }
    return made | {f'src/native/{name}': content for name, content in native.items()}


def _quoted(names: Iterable[str]) -> str:
    """Names as strings of C++ and of YAML."""
    return ', '.join(json.dumps(name, ensure_ascii=False) for name in names)


def _layout(contents: Contents, joints: tuple[str, ...], timeout: float) -> str:
    """Where the variables of the joints stand in the table, in C++."""
    numbers = {variable.name: k for k, variable in enumerate(contents.variables)}
    return '\n'.join(
        (
            '// Written by parallel_robot: where the variables of the law stand in their table.',
            '#pragma once',
            '#include <cstddef>',
            '#include <cstdint>',
            '#include <string>',
            '#include <vector>',
            'namespace layout',
            '{',
            f'constexpr std::size_t JOINTS = {len(joints)};',
            *(f'constexpr std::uint32_t {FIRST[name]} = {numbers[name]};' for name in FIRST),
            f'constexpr std::uint8_t REFERENCE_STALE = {faults.REFERENCE_STALE};',
            f'constexpr std::uint8_t STATES_INVALID = {faults.STATES_INVALID};',
            f'constexpr double REFERENCE_TIMEOUT = {timeout!r};  // s',
            f'inline std::vector<std::string> joint_names() {{ return {{{_quoted(joints)}}}; }}',
            '}  // namespace layout\n',
        )
    )
