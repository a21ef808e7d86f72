"""Bags computed again: their torques, or their experiments."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from parallel_robot.analysis.replay import bag_replay
from parallel_robot.analysis.replay.bag_replay import BagReplay
from parallel_robot.analysis.report import figures
from parallel_robot.bags import new_files
from parallel_robot.bags.limits import MEMORY
from parallel_robot.python import arguments
from parallel_robot_sim.scenario_run import changes


def replay(
    bag: str | Path,
    *,
    law: str | None = None,
    figure: str | Path | None = None,
    trust: bool = False,
    memory: int = MEMORY,
    param_file: str | Path | Iterable[str | Path] | None = None,
    **values: Any,
) -> BagReplay:
    """Compute the torques of a bag again, as ``parallel_robot replay`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.5), 'runs/replayed')
    >>> pr.replay('runs/replayed')
    paper_circle, smc: 501 states answered again by smc
    identical: 501 commands
    >>> pr.replay('runs/replayed', **{'smc.z': 20}).torque.shape
    (501, 3)

    Args:
        bag: Directory of the bag, or its MCAP file.
        law: The law that computes them; default: that of the bag.
        figure: Picture of both torques, .png, .pdf or .svg, which must not exist; default: none.
        trust: Whether the code of laws, robot and trajectory that the bag holds may run: with all
            your rights.
        memory: What may be held of the bag [bytes].
        param_file: YAML file with keys of the configuration, or several; later ones win.
        values: Keys of the configuration of the controller that change, and their values.

    Returns:
        Its ``torque`` beside the ``recorded`` one, and how many are ``differing``.

    Raises:
        BagError: not a bag of a run, or it needs code that it does not hold or that may not run.
        InputError: a key or a value is wrong, or the figure cannot be written.
    """
    path = None if figure is None else arguments.path('figure', figure)
    if path is not None:
        figures.check_format(path)
        new_files.check(path, '--figure')
    changed = changes(param_file, values | ({} if law is None else {'law': law}))
    place = arguments.path('a bag', bag)
    with bag_replay.prepared(place, changed, trust, memory, told=False) as prepared:
        found = prepared.compute()
    if path is not None:
        found.save_figure(path)
    return found
