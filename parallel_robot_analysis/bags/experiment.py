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

import yaml

from parallel_robot_interface import plugins
from parallel_robot_interface.config import PACKAGE
from parallel_robot_interface.loop import LoopParameters

LIBRARIES = ('numpy', 'numba', 'scipy', 'mcap', 'rclpy')  # also by the names of their wheels
SIMULATION, NODES = 'simulation', 'nodes'  # who moved the robot
GIT = ('git', 'describe', '--always', '--dirty')
GIT_PATIENCE = 2.0  # s


def describe(
    loop: LoopParameters, values: Mapping[str, Any], start_stamp: int, source: str = NODES
) -> dict[str, str]:
    """Facts for the metadata of a bag, all as text.

    Args:
        loop: What the nodes agreed on.
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
        'randomness': 'none',  # so there is no seed
        **software(),
        'config': yaml.safe_dump(dict(values), sort_keys=True),
    }


@functools.cache
def software() -> dict[str, str]:
    """Versions of the suite and of what it stands on; the revision in a git working copy."""
    libraries = {name: _version(name) or _version(f'ros-jazzy-{name}') for name in LIBRARIES}
    facts = {
        'version': _version(PACKAGE) or 'not installed',
        'revision': _revision(Path(__file__).resolve().parents[1]),
        'python': platform.python_version(),
        'platform': platform.platform(),
        'libraries': ', '.join(f'{name} {number}' for name, number in libraries.items() if number),
    }
    return {name: text for name, text in facts.items() if text}


def command_line() -> str:
    """The words that started this process."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def sources(values: Mapping[str, Any]) -> dict[str, bytes]:
    """Name to source of the laws of one's own in a configuration."""
    return {plugins.load(path)[0]: Path(path).read_bytes() for path in values['own_laws']}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ''


def _revision(root: Path) -> str:
    """What git says of a source tree; empty elsewhere."""
    if not (root / '.git').exists():
        return ''
    try:
        done = subprocess.run(
            GIT, cwd=root, capture_output=True, text=True, timeout=GIT_PATIENCE, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return ''
    return done.stdout.strip()
