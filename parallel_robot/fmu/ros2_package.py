"""A law or the simulated robot as a ROS 2 package of ros2_control, around its native code."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

from parallel_robot.fmu.contents import Contents
from parallel_robot.fmu.unit import code_of
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError
from parallel_robot_sim.configuration import Configuration

NAME = re.compile('[a-z][a-z0-9]*(_[a-z0-9]+)*')  # REP 144
FAULTS = ('TORQUE_NOT_FINITE', 'REFERENCE_STALE', 'STATES_INVALID')  # named by a controller
TEMPLATES = {
    'package.xml': 'package.xml',
    'CMakeLists.txt': 'CMakeLists.txt',
    'plugin.xml': 'plugin.xml',
}


class Kind(NamedTuple):
    """What a package holds."""

    noun: str  # of ros2_control
    base: str  # package of its interface
    plugin: str  # its class
    dependencies: str  # packages beside the base and hardware_interface
    templates: Mapping[str, str]  # files of its own, by their templates
    variables: str  # that its code names, of joints the first one's


KINDS = {
    'law': Kind(
        'controller', 'controller_interface', 'LawController',
        'pluginlib rclcpp rclcpp_lifecycle realtime_tools std_msgs std_srvs trajectory_msgs',
        {'controllers.yaml': 'config/controllers.yaml', 'controller.cpp': 'src/controller.cpp'},
        'position[1] velocity[1] effort[1] reference.position[1] reference.velocity[1] '
        'reference.acceleration[1] elapsed reference_age effort_known joins torque[1] fault',
    ),
    'plant': Kind(
        'system', 'hardware_interface', 'RobotSystem', 'pluginlib rclcpp rclcpp_lifecycle',
        {
            'manager.yaml': 'config/controllers.yaml',
            'robot.urdf': 'config/robot.urdf',
            'system.cpp': 'src/system.cpp',
        },
        'torque[1] position[1] velocity[1] effort[1]',
    ),
}  # fmt: skip


def ros2_package(
    contents: Contents, configuration: Configuration, kind: str, name: str
) -> dict[str, bytes]:
    """Make the files of a package, by their paths in it.

    Args:
        contents: The law with its control cycle, or the robot.
        configuration: What it was made of.
        kind: ``law`` or ``plant``.
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
    safety, of = configuration.safety, KINDS[kind]
    joints = configuration.loop.joints
    needed = list(dict.fromkeys([of.base, 'hardware_interface', *of.dependencies.split()]))
    words = {
        'package': name,
        'text': escape(contents.text),  # it stands in XML
        'rate': str(round(rate)),
        'joints': _quoted(joints),
        'timeout': repr(safety.reference_timeout),
        'head': '' if kind == 'law' else '# Not yet run.\n',
        'kind': kind,
        'noun': of.noun,
        'base': of.base,
        'class': of.plugin,
        'interface': f'{of.base}::{of.noun.capitalize()}Interface',
        'source': of.noun,
        'dependencies': '\n'.join(f'  {each}' for each in needed),
        'depends': '\n'.join(f'  <depend>{each}</depend>' for each in needed),
        'targets': '\n'.join(
            f'  ${{{each}_TARGETS}}' if each.endswith(('_msgs', '_srvs')) else f'  {each}::{each}'
            for each in needed
        ),
    }
    if kind == 'plant':
        words |= _description(contents, configuration)
    source = files('parallel_robot.fmu')
    made = {
        path: _filled(source.joinpath('ros2_control', template).read_text('utf-8'), words)
        for template, path in (TEMPLATES | dict(of.templates)).items()
    }
    native = {
        name: source.joinpath('c', name).read_bytes() for name in ('instance.c', 'instance.h')
    }
    native |= {
        'kernels.o': code.kernels,
        'variables.c': code.table.encode(),
        'layout.h': _layout(contents, of, joints, safety.reference_timeout).encode(),
    }
    return made | {f'src/native/{name}': content for name, content in native.items()}


def _filled(template: str, words: dict[str, str]) -> bytes:
    return re.sub('@([a-z]+)@', lambda found: words[found[1]], template).encode()


def _in_c(variable: str) -> str:
    return variable.removesuffix('[1]').replace('.', '_').upper()


def _quoted(names: Iterable[str]) -> str:
    """Names as strings of C++ and of YAML."""
    return ', '.join(json.dumps(name, ensure_ascii=False) for name in names)


def _description(contents: Contents, configuration: Configuration) -> dict[str, str]:
    """Words of the robot description: joints with their limits, parameters, interfaces."""
    control, units = configuration, configuration.robot.joint_units
    limits = zip(control.safety.torque_limit, control.safety.speed_limit, strict=True)
    joints, interfaces = [], []
    for k, (joint, (effort, speed)) in enumerate(zip(control.loop.joints, limits, strict=True)):
        name, link = quoteattr(joint), quoteattr(f'{joint}_link')
        slide = units.one(k).of('rad') == 'm'
        ends = ' lower="-1000" upper="1000"' if slide else ''  # a slide must have some
        joints += [
            f'  <link name={link}/>',
            f'  <joint name={name} type="{"prismatic" if slide else "continuous"}">',
            f'    <parent link="base_link"/><child link={link}/><axis xyz="0 0 1"/>',
            f'    <limit effort="{effort!r}" velocity="{speed!r}"{ends}/>',
            '  </joint>',
        ]
        interfaces += [f'    <joint name={name}>', '      <command_interface name="effort"/>']
        for kind in ('position', 'velocity', 'effort'):
            interfaces.append(f'      <state_interface name="{kind}"/>')
        interfaces.append('    </joint>')
    parameters = [
        f'      <!-- <param name={quoteattr(each.name)}>{each.start!r}</param> -->'
        for each in contents.variables
        if each.role == 'parameter'
    ]
    parts = {'described': joints, 'parameters': parameters, 'interfaces': interfaces}
    return {word: '\n'.join(lines) for word, lines in parts.items()}


def _layout(contents: Contents, kind: Kind, joints: tuple[str, ...], timeout: float) -> str:
    """Where the variables of the joints stand in the table, and words for faults, in C++."""
    numbers = {variable.name: k for k, variable in enumerate(contents.variables)}
    named = kind.variables.split()
    texts = (
        f'  case {number}: return {json.dumps(text, ensure_ascii=False)};'
        for number, text in sorted(contents.codes.items())
    )
    of_law = (
        *(f'constexpr std::uint8_t {name} = {getattr(faults, name)};' for name in FAULTS),
        f'constexpr double REFERENCE_TIMEOUT = {timeout!r};  // s',
        'inline const char * fault_text(std::uint8_t number)',
        '{',
        '  switch (number) {',
        *texts,
        '  default: return "unknown";',
        '  }',
        '}',
    )
    return '\n'.join(
        (
            '// Written by parallel_robot: where the variables stand in their table.',
            '#pragma once',
            '#include <cstddef>',
            '#include <cstdint>',
            '#include <string>',
            '#include <vector>',
            'namespace layout',
            '{',
            f'constexpr std::size_t JOINTS = {len(joints)};',
            *(f'constexpr std::uint32_t {_in_c(name)} = {numbers[name]};' for name in named),
            *(of_law if contents.codes else ()),
            f'inline std::vector<std::string> joint_names() {{ return {{{_quoted(joints)}}}; }}',
            '}  // namespace layout\n',
        )
    )
