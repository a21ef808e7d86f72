"""Studies from Python: benchmark, limit, tunings and their fronts, checks of robots and bags."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from parallel_robot.analysis.pictures import check_new
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.writing import recovery
from parallel_robot.bags.writing.recovery import Recovery
from parallel_robot.python import arguments
from parallel_robot.studies import least_errors
from parallel_robot.studies.benchmark.benchmark import Scores, benchmarked
from parallel_robot.studies.benchmark.judged_runs import competitors
from parallel_robot.studies.benchmark.protocol import DEFAULT, read
from parallel_robot.studies.calm import REST
from parallel_robot.studies.sweep.sweep import worker_count
from parallel_robot.studies.sweep.workers import Processes
from parallel_robot.studies.tuning import tuned
from parallel_robot.studies.tuning.front import Compared, compare
from parallel_robot.studies.tuning.tuned import IMPROVEMENT, Asked, Tuned
from parallel_robot.studies.verification import (
    SCENARIOS,
    Difference,
    check_numbers,
    name_of,
    verify_file,
    verify_machine,
    verify_robot,
)
from parallel_robot.studies.verification import verify as against_mujoco
from parallel_robot_model.common.errors import Frame, InputError, pandas
from parallel_robot_model.configuration.config_files import machine_file, with_file_contents
from parallel_robot_model.configuration.plain_data import LocatedDict
from parallel_robot_model.robots.robot_checks import FINE
from parallel_robot_sim.scenario_run import changes, named

# Laws judged by a fixed protocol.


def benchmark(
    *laws: str | Path,
    out: str | Path,
    quick: bool = False,
    phrase: str | None = None,
    protocol: str | Path = DEFAULT,
    workers: int | None = None,
) -> Scores:
    """Judge laws against the limit by a fixed protocol, as ``parallel_robot benchmark`` does.

    >>> import parallel_robot as pr
    >>> found = pr.benchmark('pid', 'my_law.py', out='runs/scores', quick=True)  # doctest: +SKIP
    >>> scores = found.as_data()['laws'].get('pid')  # doctest: +SKIP
    >>> scores['tuned'].get('all')  # doctest: +SKIP

    Args:
        laws: Names of laws of the suite, or Python files of others.
        out: Directory of the results; new, or that of the same benchmark, which is continued.
        quick: Whether only a first look is wanted.
        phrase: Words from which other samples are drawn than those to develop on.
        protocol: Name of a protocol, or its file.
        workers: Processes; default: one for each core.

    Returns:
        The scores; ``as_data()`` has all of them.

    Raises:
        InputError: something in the arguments is wrong, or the directory is of another benchmark.
        RunError: workers cannot run it, or the disk is full; what is finished is kept.
    """
    count = worker_count(workers, 'workers')
    asked = read(named('protocol', protocol), quick, phrase)
    judged = competitors([named('law', law) for law in laws])
    return benchmarked(asked, phrase, judged, arguments.path('out', out), lambda: Processes(count))


# The least error of any controller.


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


# The gains of a law, tuned.


def tune(
    law: str | Path,
    scenario: str | Path,
    out: str | Path,
    *,
    study: str | Path | None = None,
    runs: int | None = None,
    study_seed: int | None = None,
    duration: float | None = None,
    trials: int | None = None,
    until_converged: bool = False,
    patience: int | None = None,
    improvement: float = IMPROVEMENT,
    seed: int = 0,
    weights: Mapping[str, float] | None = None,
    bounds: Mapping[str, Any] | None = None,
    search: Sequence[str] = (),
    break_conditions: bool = False,
    pick: int | None = None,
    effort: str | None = None,
    workers: int | None = None,
    param_file: str | Path | Iterable[str | Path] | None = None,
    **values: Any,
) -> Tuned:
    """Tune the gains of a law, or what is left of it, as ``parallel_robot tune`` does.

    >>> import parallel_robot as pr
    >>> bounds = {'z': (10, 50), 'G': 12}
    >>> found = pr.tune(
    ...     'smc', 'paper_circle', 'runs/tuned', duration=0.2, trials=2, workers=1, bounds=bounds
    ... )
    >>> found.values['smc.G'], len(found.trials())
    (12.0, 2)

    Args:
        law: The law, or its file.
        scenario: Name or file of a scenario.
        out: Directory of the results; new, or that of the same tuning, which is continued.
        study: Name or file of a study, of which uncertainty, samples, duration and values are
            taken; default: one exact run.
        runs: Samples; default: the study's.
        study_seed: Their seed; default: the study's.
        duration: Length of each run [s]; default: as of the study.
        trials: In total, at most; default: so many that the search can converge.
        until_converged: Whether it ends when the best has hardly improved for a while.
        patience: How many trials that is; default: by the number of gains.
        improvement: What is hardly an improvement [%].
        seed: Of the search.
        weights: Of ``error`` and of the measure of effort, e.g. ``{'error': 2, 'chattering': 1}``:
            one objective in place of a front.
        bounds: Gain to the ends between which it is searched, or to the value that it keeps.
        search: Keys that are searched beside the gains, e.g. ``estimator.bandwidth``.
        break_conditions: Whether gains may break a condition of the law, of which it warns.
        pick: Number of the trial of the front that is taken; default: its knee.
        effort: What the error is traded against, e.g. ``'torque_max'``; or with a limit,
            ``'chattering=2'``, within which the least error is taken.
        workers: Processes; default: one for each core.
        param_file: YAML file with keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values in all runs.

    Returns:
        The gains that are taken as keys of the configuration, ``values``; its ``trials()`` and
        ``front()`` as tables, and whether the search has converged, ``verdict``.

    Raises:
        InputError: something in the arguments is wrong, or the directory is of another tuning.
        RunError: workers cannot run it, all trials are infeasible, or the disk is full; finished
            trials are kept.
    """
    for what, mapping in (('weights', weights), ('bounds', bounds)):
        if mapping is not None and not isinstance(mapping, Mapping):
            raise InputError(f'{what} must be names and values, not {mapping!r}')
    if isinstance(search, str):
        raise InputError(f'search must be a list of keys, not {search!r}')
    asked = Asked(
        law=named('law', law),
        scenario=named('scenario', scenario),
        study=None if study is None else named('study', study),
        runs=runs,
        study_seed=study_seed,
        duration=duration,
        trials=trials,
        until_converged=until_converged,
        patience=patience,
        improvement=improvement,
        seed=seed,
        weights=None if weights is None else ','.join(f'{k}={v}' for k, v in weights.items()),
        bounds=[
            f'{gain}={":".join(map(str, each)) if isinstance(each, tuple) else each}'
            for gain, each in (bounds or {}).items()
        ],
        search=search,
        break_conditions=break_conditions,
        pick=pick,
        effort=None if effort is None else named('effort', effort),
        workers=workers,
    )
    return tuned.tune(asked, changes(param_file, values), arguments.path('out', out))


# Robots checked, broken bags recovered, tunings drawn.

ROBOTS = 10


def verify(
    robots: int | None = None, *, seed: int = 0, duration: float = 1.0, **values: Any
) -> Frame:
    """Compare plants with MuJoCo, or check one robot, as ``parallel_robot verify`` does.

    >>> import parallel_robot as pr
    >>> bool(pr.verify(robot_model='serial_2r').agrees.all())
    True

    Args:
        robots: Number of random robots of each kind against MuJoCo; None: 10.
        seed: Of all that is random.
        duration: Of each motion against MuJoCo [s].
        values: Keys of the configuration, such as ``robot_model``, ``custom_robots``; with any of
            them, the functions of that robot are checked against each other, and a described
            machine is held against MuJoCo's or Pinocchio's model of its file, where it is
            installed; or, with ``robots``, random variants of it move beside MuJoCo's.

    Returns:
        A pandas.DataFrame. Against MuJoCo, a row a robot: kind, number, and the largest difference
        of its poses [m] or [rad]. Of one robot, a row a check, and whether it agrees.

    Raises:
        InputError: something is wrong in the arguments; MuJoCo or pandas is not installed.
        RunError: no motion was found that stays in the workspace.
    """
    frames = pandas()
    frame: Frame
    check_numbers(number := ROBOTS if robots is None else robots, seed, duration)
    if values and robots is None:
        of_one, rows = with_file_contents(LocatedDict(values)), []
        if file := machine_file(LocatedDict(values)):
            for each in verify_file(of_one, file, seed)[1]:
                what, apart = f'{each.what}, {each.where}', abs(each.here - each.there)
                rows.append(('file', what, apart, each.size, each.agrees))
        _, checks = verify_robot(of_one, seed)
        rows += [(*check, check.passes(FINE)) for check in checks]
        columns = ['function', 'what', 'difference', 'size', 'agrees']
        frame = frames.DataFrame(rows, columns=columns)
        return frame
    found: dict[str, list[Difference]]
    if values:
        given = with_file_contents(LocatedDict(values))
        found = {name_of(given): verify_machine(given, range(number), seed, duration)}
    else:
        found = {kind: against_mujoco(kind, range(number), seed, duration) for kind in SCENARIOS}
    differences = [(kind, *each) for kind, differences in found.items() for each in differences]
    frame = frames.DataFrame(differences, columns=['kind', 'robot', 'largest_difference', 'path'])
    return frame


def recover(bag: str | Path, out: str | Path, *, memory: int = MEMORY) -> Recovery:
    """Write a whole bag of what is intact in a broken one, as ``parallel_robot recover`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/broken')
    >>> pr.recover('runs/broken', 'runs/whole').kept['/joint_states']
    101

    Args:
        bag: Directory of the bag, or one file of it.
        out: Directory of the new bag, which must not exist.
        memory: What may be held of the bag [bytes].

    Raises:
        BagError: nothing in it is intact, or the directory exists.
        RunError: the disk is full.
    """
    return recovery.recover(arguments.path('a bag', bag), arguments.path('out', out), memory)


def fronts(directories: Iterable[str | Path], out: str | Path) -> Compared:
    """Draw the fronts of several tunings in one picture, as ``parallel_robot fronts`` does.

    >>> import parallel_robot as pr
    >>> chosen = {'trials': 16, 'duration': 1, 'bounds': {'z': (10, 50)}}
    >>> tuned = pr.tune('smc', 'paper_circle', 'runs/fronts', **chosen)
    >>> pr.fronts(['runs/fronts'], 'runs/fronts.png').out.name
    'fronts.png'

    Args:
        directories: Those of the results of :func:`tune`.
        out: Picture, .png or .svg; must not exist.

    Returns:
        What the command prints; ``as_data()`` has the figures.

    Raises:
        InputError: one is no directory of a tuning that has ended, they cannot be compared, or the
            file cannot be written.
    """
    return compare(
        [arguments.path('a directory', each) for each in directories],
        arguments.path('out', out),
    )
