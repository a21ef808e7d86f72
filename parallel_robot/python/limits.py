"""The least error of any controller."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from parallel_robot.analysis.report.figures import check_new
from parallel_robot.python import arguments
from parallel_robot.studies import least_errors
from parallel_robot.studies.limit.calm import REST
from parallel_robot_model.common.errors import Frame, pandas
from parallel_robot_sim.scenario_run import changes, named


def limit(
    scenario: str | Path,
    *,
    runs: int | None = None,
    duration: float | None = None,
    calm: bool = False,
    rest: float = REST,
    figure: str | Path | None = None,
    param_file: str | Path | Iterable[str | Path] | None = None,
    **values: Any,
) -> Frame:
    """Compute the least error that any controller can have, as ``parallel_robot limit`` does.

    >>> import parallel_robot as pr
    >>> noise = {'disturbance.noise': 0.1, 'sensor.delay': 0.002}
    >>> found = pr.limit('axes_step', duration=1, **noise)
    >>> (1e9 * found[['as_it_is_rad', 'without_delays_rad']]).round().values.tolist()
    [[1435.0, 243.0]]

    Args:
        scenario: Name or file of a scenario; or of a study, of which it is asked for all robots.
        runs: Robots of each scenario of a study; default: the study's.
        duration: Length of the motion of a scenario [s]; default: its own.
        calm: Whether the least errors with at most some chattering are asked for, too.
        rest: Weight of joints that the error does not see in these, relative.
        figure: Picture of these, .png, .pdf or .svg, which must not exist; default: none.
        param_file: YAML file with keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values.

    Returns:
        A pandas.DataFrame with one row a robot, the root mean square error over the second half
        of its motion without some of the causes, as ``--out`` of the command has it;
        ``attrs['warnings']`` says what to know of them.

    Raises:
        InputError: something is wrong in the arguments, or pandas is not installed.
    """
    frames = pandas()
    path = arguments.optional('figure', figure)
    if path is not None:
        check_new(path)
    found = least_errors.compute(
        named('scenario', scenario),
        changes(param_file, values),
        runs,
        duration,
        calm or path is not None,
        rest,
    )
    if path is not None:
        found.save_figure(path)
    head, rows = found.rows()
    frame: Frame = frames.DataFrame(rows, columns=head)
    frame.attrs['warnings'] = found.warnings
    return frame
