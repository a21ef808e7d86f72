"""Writes the tables of docs/parameters.md from the types of the parameters."""

import math
import sys
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from parallel_robot.analysis.monitor import MonitorParameters
from parallel_robot.bags.ros_topics import RecorderParameters
from parallel_robot_control.laws import LAWS
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import Field, parameters, words
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_sim.parameter_groups import groups

HEAD = """# Parameters

Every key of the configuration: as ROS parameter (`-p KEY:=VALUE`), on the command line
(`--set KEY=VALUE`), in YAML and in code (`config.resolve(scenario, {KEY: VALUE})`). Defaults are
those of `paper_circle`; other robots have other groups `robot`, limits and margins, see
[robots.md](robots.md). A number in place of a list is for all joints. While the controller runs,
`law`, `preset` and the gains of all laws can be changed:
`ros2 param set /controller s_fotsmc.G 12`; what is set in one request is judged as a whole. This
file is written by `make docs`.

`ros2 param load` takes what `ros2 param dump` wrote of the same node: a fixed parameter that keeps
its value is no change. On a machine that is busy, while kernels are compiled say, a request may
get no answer ("client will not receive response" in the log): the middleware drops an answer whose
receiver it has not found within 0.1 s. Then call again.
"""
LAST = [('recorder', RecorderParameters), ('monitor', MonitorParameters)]
GROUPS = {**groups(planar_3rrr, LAWS), 'Recorder and monitor': LAST}


def text() -> str:
    """The whole page."""
    values = config.resolve('paper_circle')
    parts = [HEAD]
    for title, members in GROUPS.items():
        parts.append(
            f'\n## {title}\n\n| key | default | unit | range | meaning |\n|---|---|---|---|---|\n'
        )
        for prefix, group in members:
            if prefix == 'true_robot':
                continue
            for parameter in parameters(group):
                key = f'{prefix}.{parameter.key}' if prefix else parameter.key
                cells = [
                    f'`{key}`',
                    f'`{_plain(values[key])}`',
                    parameter.field.unit,
                    _range(parameter.type, parameter.field),
                    parameter.field.description.replace('|', r'\|'),
                ]
                parts.append('| ' + ' | '.join(cells) + ' |\n')
    return ''.join(parts)


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:.10g}'
    if isinstance(value, list):
        return f'[{", ".join(map(_plain, value))}]'
    return str(value).lower() if isinstance(value, bool) else str(value) or "''"


def _range(kind: Any, field: Field) -> str:
    choices = get_args(kind) if get_origin(kind) is Literal else words(kind)
    listed = ', '.join(f'`{choice}`' for choice in choices)
    if get_origin(kind) is Literal:
        return listed
    if words(kind):
        return f'{listed}, {_range(float, field)}'
    low = '' if field.low == -math.inf else f'{field.low:g}'
    high = '' if field.high == math.inf else f'{field.high:g}'
    if low and high:
        return f'{low} to {high}'
    return f'>= {low}' if low else f'<= {high}' if high else ''


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(text())
