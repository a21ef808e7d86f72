"""What a bag says of the experiment that made it."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import yaml

from parallel_robot_interface.config import PACKAGE
from parallel_robot_interface.loop import LoopParameters


def describe(loop: LoopParameters, values: Mapping[str, Any], start_stamp: int) -> dict[str, str]:
    """Facts for the metadata of a bag, all as text.

    Args:
        loop: What the nodes agreed on.
        values: The resolved configuration.
        start_stamp: Stamp of t = 0 [ns]; 0 when it is not known.
    """
    try:
        installed = version(PACKAGE)
    except PackageNotFoundError:
        installed = 'not installed'
    return {
        'scenario': loop.scenario,
        'law': loop.law,
        'time_mode': loop.time_mode,
        'start_stamp': str(start_stamp),
        'period_ns': str(loop.period_ns),
        'version': installed,
        'config': yaml.safe_dump(dict(values), sort_keys=True),
    }
