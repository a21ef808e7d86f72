"""Bags computed again: their torques, or their experiments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from parallel_robot.analysis.replay import bag_replay, bag_rerun
from parallel_robot.analysis.replay.bag_replay import BagReplay
from parallel_robot.analysis.replay.bag_rerun import Rerun
from parallel_robot.analysis.report import figures
from parallel_robot.bags import output
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.python import arguments
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.plain_data import merged
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.scenario_run import changes, named
from parallel_robot_sim.simulation import RunSummary, parts


def replay(
    bag: str | Path,
    *,
    law: str | Path | None = None,
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
        values: Keys of the configuration of the controller that change, and their values; and
            what the bag does not say itself, see ``load``.

    Returns:
        Its ``torque`` beside the ``recorded`` one, and how many are ``differing``.

    Raises:
        BagError: not a bag of a run, or it needs code that it does not hold or that may not run.
        InputError: a key or a value is wrong, or the figure cannot be written.
    """
    path = arguments.optional('figure', figure)
    if path is not None:
        figures.check_new(path)
    options = {name: values.pop(name) for name in arguments.OF_BAG if name in values}
    changed = changes(param_file, values)
    if law is not None:
        changed = merged([changed, law_loader.chosen(named('law', law), changed)])
    place = arguments.path('a bag', bag)
    view = arguments.view(options)
    with bag_replay.prepared(place, changed, trust, memory, False, view) as prepared:
        found = prepared.compute()
    if path is not None:
        found.save_figure(path)
    return found


def rerun(
    bag: str | Path,
    out: str | Path | None = None,
    *,
    duration: float | None = None,
    trust: bool = False,
    memory: int = MEMORY,
) -> Rerun:
    """Run the experiment of a simulated bag once more, as ``parallel_robot rerun`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/first')
    >>> pr.rerun('runs/first', 'runs/second')
    identical: 382 messages

    Args:
        bag: Directory of the bag, or its MCAP file.
        out: Directory of the new bag, which must not exist; default: beside the bag, its name
            ends with ``_rerun``.
        duration: Length of the motion [s]; default: as recorded.
        trust: Whether the code of laws, robot and trajectory that the bag holds may run: with all
            your rights.
        memory: What may be held of each bag [bytes].

    Returns:
        Whether both bags are ``identical``, and the first ``difference``.

    Raises:
        BagError: not a bag of a run, it needs code that it does not hold or that may not run, or
            the new one cannot be written.
        InputError: the bag is of nodes, or a value is wrong.
        RunError: the disk is full.
    """
    place = arguments.path('a bag', bag)
    path = arguments.optional('out', out) or bag_rerun.default_place(place)
    with bag_rerun.prepared(place, duration, trust, memory, told=False) as experiment:
        if not experiment.simulated:
            raise InputError(f'{bag} is of nodes, which `parallel_robot rerun` starts again')
        output.check_directory(path)
        values = resolve(experiment.scenario, experiment.changes | {'time_mode': 'lockstep'})
        summary = RunSummary()
        simulation_bag.save(path, values, summary.taken(parts(configure(values))))
    found = experiment.compare(path, memory)
    failure = (summary.failure,) if summary.failure else ()
    return replace(found, warnings=(*found.warnings, *failure))
