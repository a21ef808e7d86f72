"""Writes the lists of docs/parameters.md from the types of the parameters."""

import math
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from parallel_robot.analysis.monitor import MonitorParameters
from parallel_robot.bags.writing.ros_topics import RecorderParameters
from parallel_robot_control.laws import LAWS
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import Parameter, allowed_words, parameters
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_model.robots.described.parameters import MotionLimits, SafetyMargins
from parallel_robot_model.robots.described.parameters import Parameters as Described
from parallel_robot_model.robots.registry import resolve
from parallel_robot_sim.configuration import groups

HEAD = """# Parameters

Every key of the configuration with its default, its range and what it means: as ROS parameter
(`-p KEY:=VALUE`), on the command line (`--set KEY=VALUE`), in YAML and in code
(`config.resolve(scenario, {KEY: VALUE})`). Defaults are those of `paper_circle`, of several words
the first; [other robots](robots.md) have other groups `robot`, limits and margins. One number for
a list is for all its entries, as for all joints; slides have m and N where rad and N m stand here.
What can be changed while the loop runs: [nodes.md](nodes.md#switched-while-the-robot-moves).
`make docs` writes this file.

`ros2 param load` takes what `ros2 param dump` wrote of the same node. Call again where a request
gets no answer ("client will not receive response" in the log): the middleware had not found its
receiver within 0.1 s.
"""
DESCRIBED = [('robot', Described), ('safety', SafetyMargins), ('trajectory', MotionLimits)]
LAST = [('recorder', RecorderParameters), ('monitor', MonitorParameters)]
MACHINES = 'Machines from a description, in place of those of the robot above, here of `delta`'
LONGEST_LIST = 4  # that is shown as a whole
GROUPS = {
    **groups(planar_3rrr, LAWS),
    'Recorder and monitor': LAST,
    MACHINES: DESCRIBED,
}


def text() -> str:
    """The whole page."""
    values = resolve('delta_circle') | config.resolve('paper_circle')
    parts = [HEAD]
    for title, members in GROUPS.items():
        rows = _gains(members, values) if title == 'Laws' else _keys(members, values)
        parts.append(f'\n## {title}\n\n{rows}')
    return ''.join(parts)


def _keys(members: list[tuple[str, Any]], values: dict[str, Any]) -> str:
    """An entry for each key; keys that differ in nothing else share one."""
    keys_of = defaultdict(list)
    for prefix, group in members:
        if prefix == 'true_robot':
            continue
        for parameter in parameters(group):
            key = f'{prefix}.{parameter.key}' if prefix else parameter.key
            keys_of[_limited(values[key], parameter), parameter.field.description].append(
                f'`{key}`'
            )
    return ''.join(
        f'- {", ".join(of)}: {value}; {text}\n' for (value, text), of in keys_of.items()
    )


def _gains(members: list[tuple[str, Any]], values: dict[str, Any]) -> str:
    """An entry for each name of a gain: what it means by which default in which laws."""
    laws_of: dict[str, dict[str, dict[str, list[str]]]] = defaultdict(
        lambda: defaultdict(lambda: defaultdict(list))
    )
    for law, group in members:
        for gain in parameters(group):
            default = _limited(values[f'{law}.{gain.key}'], gain)
            laws_of[gain.key][gain.field.description][default].append(f'`{law}`')
    rows = ['A key is law and gain, as `smc.G`; the laws stand in brackets.\n\n']
    for gain, meanings in sorted(laws_of.items(), key=lambda row: row[0].lower()):
        texts = (
            f'{meaning}: '
            + ', '.join(f'{default} ({", ".join(of)})' for default, of in laws.items())
            for meaning, laws in meanings.items()
        )
        rows.append(f'- `{gain}`: {"; ".join(texts)}\n')
    return ''.join(rows)


def _limited(value: Any, parameter: Parameter) -> str:
    """A default, the range, and the words that can stand in its place."""
    others = [word for word in _words(parameter) if word != value]
    default = f'{_plain(value)} {parameter.field.unit}'.strip()
    return ', '.join(filter(None, [default, *others, _range(parameter)]))


def _words(parameter: Parameter) -> tuple[str, ...]:
    literal = get_origin(parameter.type) is Literal
    return get_args(parameter.type) if literal else allowed_words(parameter.type)


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:.10g}'
    if isinstance(value, list) and len(value) > LONGEST_LIST:
        return f'[{_plain(value[0])}, ...], {len(value)} numbers'
    if isinstance(value, list) and len(value) > 1 and value.count(value[0]) == len(value):
        return _plain(value[0])
    if isinstance(value, list):
        return f'[{", ".join(map(_plain, value))}]'
    return str(value).lower() if isinstance(value, bool) else str(value) or "''"


def _range(parameter: Parameter) -> str:
    low, high = parameter.field.low, parameter.field.high
    if math.inf in (-low, high):
        return f'≥{low:g}' if low > -math.inf else f'≤{high:g}' if high < math.inf else ''
    return f'{low:g}\N{EN DASH}{high:g}'


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(text())
