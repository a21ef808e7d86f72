"""The robot of a bag, calibrated or identified."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, overload

from parallel_robot.bags.run import joint_table, recorded_robot
from parallel_robot.python import arguments
from parallel_robot.studies.calibration import bag_calibration
from parallel_robot.studies.calibration.calibrated import Calibration
from parallel_robot.studies.calibration.design import Designed
from parallel_robot.studies.calibration.design import design as designed
from parallel_robot.studies.estimate import check_files
from parallel_robot.studies.identification import bag_identification
from parallel_robot.studies.identification.design import Designed as ExcitingMotion
from parallel_robot.studies.identification.design import search
from parallel_robot.studies.identification.motor_lag import Rest
from parallel_robot.studies.identification.readable import Identification
from parallel_robot_model.common.errors import InputError
from parallel_robot_sim.scenario_run import changes, named

# The robot of a bag, calibrated by measured poses.

Place = str | Path


@overload
def calibrate(
    bag: Place,
    *,
    poses: Place | None = None,
    pose_topic: str | None = None,
    free: Sequence[str] = (),
    out: Place | None = None,
    robust: bool = False,
    figure: Place | None = None,
    trust: bool = False,
    custom_robots: Sequence[Place] = (),
    **options: Any,
) -> Calibration: ...
@overload
def calibrate(
    *,
    scenario: Place,
    design: int,
    free: Sequence[str] = (),
    out: Place | None = None,
    seed: int | None = None,
    param_file: Place | Iterable[Place] | None = None,
    **values: Any,
) -> Designed: ...
def calibrate(
    bag: Place | None = None,
    *,
    poses: Place | None = None,
    pose_topic: str | None = None,
    free: Sequence[str] = (),
    out: Place | None = None,
    robust: bool = False,
    figure: Place | None = None,
    trust: bool = False,
    custom_robots: Sequence[Place] = (),
    scenario: Place | None = None,
    design: int | None = None,
    seed: int | None = None,
    param_file: Place | Iterable[Place] | None = None,
    **values: Any,
) -> Calibration | Designed:
    """Calibrate the geometry of the robot of a bag, as ``parallel_robot calibrate`` does.

    >>> import parallel_robot as pr
    >>> pr.calibrate(scenario='serial_2r_circle', design=4).poses.shape
    (4, 2)

    Args:
        bag: Directory of the bag, or its MCAP file.
        poses: CSV of measured poses, t [s] or stamp [ns] and coordinates; default: of the bag.
        pose_topic: Topic of measured poses in the bag; default: the only one.
        free: What is unknown of the tracker: ``frame``, ``target``.
        robust: Whether poses that are not what the others tell are left out.
        out: YAML file of the robot, or of the motion, for ``param_file``; it must not exist.
        figure: Picture of the errors of the poses and of what was changed; likewise.
        trust: Whether the file of a custom robot in the bag may run.
        custom_robots: Files of custom robots of yours.
        scenario: Without a bag, the scenario around whose first pose others are chosen; else what
            a bag without a configuration is of.
        design: How many poses are chosen.
        seed: Seed of the poses that they are chosen from; default: 0.
        param_file: YAML file with keys of the configuration of `scenario`, or of a bag that has
            none, or several.
        values: Keys of that configuration and their values; and what a bag does not say itself,
            see ``load``.

    Returns:
        The robot as keys of the configuration, ``values``, with tables and warnings; with
        `scenario` the poses that tell most.

    Raises:
        BagError: not a bag of a run, or its poses do not suffice.
        InputError: arguments do not go together, a value is wrong, or a file cannot be written.
    """
    of_bag = {name: values.pop(name) for name in arguments.OF_BAG if name in values}
    options = {
        **of_bag,
        'from': of_bag.get('start'),
        'to': of_bag.get('stop'),
        'bag': bag,
        'poses': poses,
        'pose-topic': pose_topic,
        'figure': figure,
        'free': free,
        'robust': robust,
        'trust': trust,
        'scenario': scenario,
        'design': design,
        'seed': seed,
    }
    bag_calibration.check_options(options)
    file = arguments.optional('out', out)
    picture = arguments.optional('figure', figure)
    check_files(file, picture, 'out')
    if bag is None:
        name = named('scenario', scenario)
        chosen = designed(name, changes(param_file, values), design or 0, free, seed or 0)
        chosen.write(file)
        return chosen
    if not (pose_topic is None or isinstance(pose_topic, str)):
        raise InputError(f'pose_topic must be the name of a topic, not {pose_topic!r}')
    found = bag_calibration.calibrate(
        arguments.path('a bag', bag),
        arguments.optional('poses', poses),
        pose_topic,
        free,
        recorded_robot.chosen(trust, custom_robots),
        arguments.view({**of_bag, **values, 'scenario': scenario, 'param_file': param_file}),
        robust,
    )
    found.write(file, picture)
    return found


# The robot of a bag, identified.


@overload
def identify(
    bag: Place,
    *,
    validate: Place | None = None,
    out: Place | None = None,
    figure: Place | None = None,
    cutoff: float | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    hold_out: float | None = None,
    torque_constant: float | str | Iterable[float | str] = (),
    **options: Any,
) -> Identification: ...
@overload
def identify(bag: Place, *, rest: Literal[True], **options: Any) -> Rest: ...
@overload
def identify(
    *,
    design: Place,
    out: Place | None = None,
    trials: int | None = None,
    seed: int | None = None,
    param_file: Place | Iterable[Place] | None = None,
    **values: Any,
) -> ExcitingMotion: ...
def identify(
    bag: Place | None = None,
    *,
    validate: Place | None = None,
    rest: bool = False,
    out: Place | None = None,
    figure: Place | None = None,
    cutoff: float | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    hold_out: float | None = None,
    torque_constant: float | str | Iterable[float | str] = (),
    design: Place | None = None,
    trials: int | None = None,
    seed: int | None = None,
    param_file: Place | Iterable[Place] | None = None,
    **values: Any,
) -> Identification | Rest | ExcitingMotion:
    """Identify inertia and friction of the robot of a bag, as ``parallel_robot identify`` does.

    >>> import parallel_robot as pr
    >>> heavy = {'true_robot.mp': 4.0}
    >>> pr.save(pr.simulate('excitation', law='pid', duration=3, **heavy), 'runs/excited')
    >>> found = pr.identify('runs/excited')
    >>> round(found.values['robot.mp'], 1)
    4.0

    Args:
        bag: Directory of the bag, its MCAP file, or a table of joints, CSV or Parquet.
        validate: Another bag of the same robot, whose torques are predicted.
        rest: Whether only the noise of the sensors is asked for, of a robot that rests.
        out: YAML file of the robot, for ``param_file``, which must not exist; default: none.
        figure: Picture of the torques, measured and predicted; likewise.
        cutoff: Bandwidth of the regression [Hz]; default: 10, or a tenth of the rate.
        bounds: What is known of the robot, e.g. ``{'mass': (25, 35)}``.
        hold_out: Share of the time, at the end, on which a fit to what is before it is judged;
            default: a third.
        torque_constant: Of the motors, the gear ratio in it [N m/A], where a table has currents:
            one number, or one for each joint; ``'auto'``: to be found.
        design: Scenario with an exciting motion of which better coefficients are searched for: in
            place of a bag.
        trials: Number of motions to try for it; default: 2500.
        seed: Seed of that search; default: 0.
        param_file: YAML file with keys of the configuration of `design`, or of a bag that has
            none, or several.
        values: Keys of that configuration and their values; and what a bag does not say itself,
            see ``load``.

    Returns:
        The robot as keys of the configuration, ``values``, with tables and warnings; with `rest`
        the noise of the sensors; with `design` the motion.

    Raises:
        BagError: not a bag of a run, too little of it can be used, or of another robot.
        InputError: arguments do not go together, a value is wrong, or a file cannot be written.
    """
    of_bag = {name: values.pop(name) for name in arguments.OF_BAG if name in values}
    options = {
        **of_bag,
        'from': of_bag.get('start'),
        'to': of_bag.get('stop'),
        'bag': bag,
        'design': design,
        'rest': rest,
        'out': out,
        'validate': validate,
        'figure': figure,
        'cutoff': cutoff,
        'bounds': bounds,
        'hold-out': hold_out,
        'torque-constant': torque_constant,
        'trials': trials,
        'seed': seed,
        'set': values,
        'param-file': param_file,
    }
    bag_identification.check_options(options)
    robot, picture = arguments.optional('out', out), arguments.optional('figure', figure)
    second = arguments.optional('validate', validate)
    check_files(robot, picture, 'out')
    if design is not None:
        scenario = named('design', design)
        motion = search(scenario, changes(param_file, values), trials, seed)
        motion.write(robot)
        return motion
    place = arguments.path('a bag', bag)
    view = arguments.view({**of_bag, **values, 'param_file': param_file})
    if rest:
        return bag_identification.at_rest(place, view)
    view = view._replace(torque_constant=_constants(torque_constant))
    share = bag_identification.HOLD_OUT if hold_out is None else hold_out
    found = bag_identification.identify(place, second, cutoff, view, bounds, share)
    found.write(robot, picture)
    return found


def _constants(given: float | str | Iterable[float | str]) -> tuple[float | None, ...]:
    """Torque constants, None for those that are to be found."""
    several = [given] if isinstance(given, str) or not isinstance(given, Iterable) else given
    return tuple(
        None if each == joint_table.AUTO else arguments.numbers('torque_constant', each)[0]
        for each in several
    )
