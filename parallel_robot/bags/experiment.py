"""What a bag says of the experiment that made it."""

from __future__ import annotations

import functools
import platform
import shlex
import subprocess
import sys
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.limits import is_name
from parallel_robot.bags.trust import named_files
from parallel_robot_model.common.errors import BagError, InputError, printable
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.config import PACKAGE
from parallel_robot_model.configuration.config_files import scenario_stem
from parallel_robot_model.configuration.fields import PerJoint, PerLink, allowed_words, parameters
from parallel_robot_model.configuration.loop import LoopParameters, loop_of
from parallel_robot_model.robots.described.parameters import Parameters
from parallel_robot_model.robots.registry import ROBOTS
from parallel_robot_sim.configuration import members

# How this machine computes, and what is said of a bag that was computed otherwise.
#
# Kernels, and Python where its numbers reach a bag, use elementary functions and equations of the
# suite's own: their bits are the same on every x86-64. Earlier versions took those of the C
# library (libm) and of LAPACK, which choose their code by the processor.

OWN = 'own functions'


def arithmetic_fingerprint() -> str:
    """What tells machines apart that give other last digits."""
    return f'{OWN}, {platform.machine()}'


def arithmetic_doubt(facts: Mapping[str, str]) -> str:
    """What is said of a bag whose last digits may not be those of this machine; empty if they are.

    Args:
        facts: What the bag says of its experiment; an older one does not say it.
    """
    said = facts.get('arithmetic', arithmetic_fingerprint())
    if said == arithmetic_fingerprint():
        return ''
    theirs = ', '.join(printable(facts[key]) for key in ('processor', 'platform') if key in facts)
    here = f'{theirs}; here {processor()}, {platform.platform()}'
    why = 'the bag is of another kind of processor'
    if not said.startswith(OWN):
        why = 'the bag was computed with the libm of its machine, now the functions are our own'
    return f'{why} ({here}): last digits differ, and what follows from them'


def processor() -> str:
    """Name of the processor, for people."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()


LIBRARIES = ('numpy', 'numba', 'scipy', 'mcap', 'rclpy')  # also by the names of their wheels
UNKNOWN_LAW = 'unknown'  # of a bag that does not say which law ran
SIMULATION, NODES = 'simulation', 'nodes'  # what moved the robot
OWNERS = {  # nodes whose parameters count, the later overriding; and common keys they own
    'trajectory': ('scenario', 'robot_model', 'joints', 'period', 'time_mode'),
    'plant': ('robot_model', 'joints', 'period', 'duration', 'seed', 'time_mode'),
    'controller': ('law', 'preset'),
}
OF_RUN = (
    'start_stamp',
    'subscribers',
    'recorder.out',
    'recorder.command_line',
)  # keys that the command `run` gives to its nodes
OF_ROBOT = {'robot', 'true_robot', 'safety', 'trajectory'}  # groups with keys of a robot
GIT = ('git', 'describe', '--always', '--dirty')
GIT_PATIENCE = 10.0  # s, of a busy machine


def describe(
    loop: LoopParameters, values: Mapping[str, Any], start_stamp: int, source: str = NODES
) -> dict[str, str]:
    """Facts about an experiment for the metadata of a bag, all as text.

    Args:
        loop: Parameters that all nodes share.
        values: The resolved configuration.
        start_stamp: Stamp of t = 0 [ns]; 0 when it is not known.
        source: SIMULATION or NODES.
    """
    return {
        'scenario': loop.scenario,
        'law': loop.law,
        'time_mode': loop.time_mode,
        'start_stamp': str(start_stamp),
        'period_ns': str(loop.period_ns),
        'source': source,
        'command_line': str(values['recorder.command_line']) or command_line(),
        'randomness': f'seed {loop.seed}',
        **software(),
        'config': plain_data.dump(values),
    }


def configuration(
    bag: Path,
    facts: Mapping[str, str],
    nodes: Mapping[str, Mapping[str, Any]],
    view: BagView = AS_RECORDED,
) -> tuple[dict[str, Any], LoopParameters, int]:
    """Configuration of the run over the defaults, where nodes that were started by hand lack keys.

    Args:
        bag: The bag, for error messages.
        facts: What the bag says, see :func:`describe`; empty when another recorded it.
        nodes: Full name of a node to its parameters. Where the nodes were started by hand, they
            have values that the recorder does not know.
        view: What a bag without a configuration is of, or what takes the place of its own.

    Returns:
        All keys, those of the loop, and the stamp of t = 0 [ns], 0 when it is not known.

    Raises:
        BagError: its metadata hold no usable configuration.
        InputError: what the view says is wrong, or would change what the bag says.
    """
    view = view.of(bool(facts))
    if facts and view.assumes and not view.override:
        what = f'{bag} has its own configuration, which {view.told()} would change'
        raise InputError(f'{what}; --override permits that')
    if not facts and view.assumes:
        values = view.assumed()
        law = values['law'] if 'law' in view.values else UNKNOWN_LAW
        values |= {'law': law, 'scenario': scenario_stem(view.scenario or 'unknown')}
        return values, loop_of(values), 0
    values = config.resolve('paper_circle')
    try:
        stored: dict[str, Any] = {'scenario': 'unknown', 'law': 'unknown'}
        if facts:
            stored = plain_data.load(facts['config'])
            values = _defaults(stored, nodes)
            stored = _checked(values, stored)
            stored |= _of_nodes(values | stored, nodes)
            stored |= {
                'custom_robots': [],
                'custom_trajectories': [],
            }  # named files are not loaded
        loop = loop_of(values | stored)
        names = (loop.scenario, loop.law, *loop.joints)
        if not all(map(is_name, names)):
            raise ValueError('a name in it is too long or cannot be printed')
    except (KeyError, ValueError, InputError) as error:
        raise BagError(f'{bag}: its metadata hold no usable config: {error}') from None
    values, start = values | stored, int(facts.get('start_stamp', 0))
    if view.assumes:
        values = view.changed(values)
        return values, loop_of(values), start
    return values, loop, start


def _defaults(stored: Any, nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Defaults of the recorded robot; those of the paper's where it is not one of the suite."""
    models = [found['robot_model'] for found in nodes.values() if 'robot_model' in found]
    if isinstance(stored, dict):
        models.append(stored.get('robot_model'))
    known = config.robot_models()
    model = next((name for name in models if name in known), None)
    return config.resolve('paper_circle', {'robot_model': model} if model else None)


def _checked(known: Mapping[str, Any], stored: Any) -> dict[str, Any]:
    """Check that the values of a stored configuration have the types of the known ones."""
    if not isinstance(stored, dict):
        raise ValueError('no keys and values')
    for key, value in stored.items():
        if not (plain_data.flat(value) and suits(known, key, value)):
            raise ValueError(f'{key} cannot be {value!r}')
    return stored


def suits(known: Mapping[str, Any], key: str, value: Any) -> bool:
    """Whether a plain value has the type of the known value of its key, if there is one."""
    example, kind = known.get(key, value), _kinds().get(key)
    if allowed_words(kind):
        return value in allowed_words(kind) or _is_like(1.0, value)
    if kind in (PerJoint, PerLink):
        example = [1.0] if isinstance(value, list) and value else 1.0  # one is for all
    elif example == [] and kind == tuple[float, ...]:
        example = [1.0]
    return _is_like(example, value)


@functools.cache
def _kinds() -> dict[str, Any]:
    """Types of the parameters of the robots of the suite, by key."""
    described = {
        f'{prefix}.{parameter.key}': parameter.type
        for prefix in ('robot', 'true_robot')
        for parameter in parameters(Parameters)
        if parameter.type is PerLink
    }
    return described | {
        key: parameter.type for robot in ROBOTS.values() for key, parameter in members(robot, {})
    }


def _is_like(example: Any, value: Any) -> bool:
    """Whether a plain value has the type of another; lists may have other lengths."""
    if isinstance(example, list):
        item = example[0] if example else ''
        return isinstance(value, list) and all(_is_like(item, other) for other in value)
    if isinstance(example, str):
        return isinstance(value, str) or value is False  # YAML takes an unquoted off for false
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return isinstance(value, bool) if isinstance(example, bool) else number


@functools.cache
def software() -> dict[str, str]:
    """Versions of the suite and its libraries; in a git working copy, the revision too."""
    libraries = {name: _version(name) or _version(f'ros-jazzy-{name}') for name in LIBRARIES}
    facts = {
        'version': _version(PACKAGE) or 'not installed',
        'revision': _revision(Path(__file__).resolve().parents[2]),
        'python': platform.python_version(),
        'platform': platform.platform(),
        'processor': processor(),
        'arithmetic': arithmetic_fingerprint(),
        'libraries': ', '.join(f'{name} {number}' for name, number in libraries.items() if number),
    }
    return {name: text for name, text in facts.items() if text}


def command_line() -> str:
    """Command line that started this process."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def _of_nodes(values: Mapping[str, Any], nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Configuration of a run by the parameters of its nodes, without the places of files."""
    merged: dict[str, Any] = {}
    for name, common in OWNERS.items():
        for node, found in nodes.items():
            if node.rpartition('/')[2] == name:
                custom = {Path(file).stem for _, file in named_files(found)}
                if found.get('robot_model') in custom:
                    custom |= OF_ROBOT
                merged |= {
                    key: value
                    for key, value in found.items()
                    if key in common
                    or ('.' in key and (key in values or key.partition('.')[0] in custom))
                }
    if isinstance(merged.get('scenario'), str):  # nodes keep the path of one that is not shipped
        merged['scenario'] = scenario_stem(merged['scenario'])
    return merged


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ''


def _revision(root: Path) -> str:
    """Description of a source tree by git, or of what is installed by that which built it."""
    try:
        if not (root / '.git').exists():
            return (root / 'parallel_robot' / 'REVISION').read_text().strip()
        done = subprocess.run(
            GIT, cwd=root, capture_output=True, text=True, timeout=GIT_PATIENCE, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return ''
    return done.stdout.strip()
