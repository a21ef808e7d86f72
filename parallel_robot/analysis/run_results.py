"""The results of a run as plain data and as tables."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from parallel_robot.analysis import metrics, timing
from parallel_robot.analysis.readable_metrics import as_data, head, whole
from parallel_robot.bags.run import run_log
from parallel_robot_model.common.tables import Part, Table


def summarise(
    log: run_log.RunLog, found: metrics.Metrics, timed: timing.Timing, failure: str = ''
) -> dict[str, Any]:
    """Metrics and timing as plain data, for JSON; of a run that failed, why in their place."""
    return {
        'scenario': log.scenario,
        'law': log.law,
        'duration_s': found.duration_s,
        **({'failure': failure} if failure else as_data(found)),
        'timing': timing.as_json(timed),
        'messages': {name: asdict(count) for name, count in log.messages.items()},
    }


def tables(result: dict[str, Any], found: metrics.Metrics, planned: float = 0.0) -> list[Part]:
    """Metrics and messages.

    Args:
        result: See :func:`summarise`.
        found: The metrics.
        planned: How long the motion was to be [s]; 0 if not known.
    """
    rows = [
        [name, f'{count["count"]}', f'{count["missing"]}']
        for name, count in result['messages'].items()
    ]
    messages = Table(['messages', 'count', 'missing'], rows)
    if 'failure' in result:
        names = f'{result["scenario"]}, {result["law"]}'
        why = (
            f'{names}, {result["duration_s"]:g} s: no figures of a run that was '
            f'{result["failure"]}; --from and --to choose a part'
        )
        return [why, messages]
    lines = head(result['scenario'], result['law'], found, planned).split('\n')
    return [*lines, whole(found), messages]
