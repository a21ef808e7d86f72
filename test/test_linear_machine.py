"""The linear model of described machines against their equations of motion, without compiling."""

import numpy as np
import pytest

from parallel_robot_model.common.errors import InputError, KinematicsError, RobotError
from parallel_robot_model.configuration import config_files, robot_file
from parallel_robot_model.mechanisms import closure_solver, dynamics
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.described.robot import default_values, described


def _with_springs(text):
    """The five-bar whose elbow has a spring and whose motors are tied by a damper."""
    tie = '<joint joint="left" coef="1"/><joint joint="right" coef="-2"/>'
    return text.replace(
        '<joint name="left_elbow"', '<joint name="left_elbow" stiffness="3"'
    ).replace('</worldbody>', f'</worldbody><tendon><fixed damping="2">{tie}</fixed></tendon>')


@pytest.fixture(scope='module', params=['five_bar', 'delta', 'springs'])
def case(request):
    """A machine, with the parameters of its file and with other ones."""
    if request.param == 'springs':
        return _case('five_bar', _with_springs)
    return _case(request.param)


@pytest.fixture(scope='module')
def five_bar():
    return _case('five_bar')


def _case(name, change=str):
    text = change(robot_file.text_of(config_files.directory() / 'machines' / f'{name}.xml'))
    values = default_values({'robot_description': text})
    robot = described(text)
    given = {key: values[f'robot.{key}'] for key in robot.Parameters._fields}
    lists = {key: tuple(x) if isinstance(x, list) else x for key, x in given.items()}
    return robot, robot.Parameters(**lists)


def changed(parameters, seed=0):
    """Parameters whose masses differ from the file's."""
    rng, links = np.random.default_rng(seed), len(parameters.mass_factor)
    return parameters._replace(
        mass_factor=tuple(rng.uniform(0.8, 1.2, links)),
        spread_factor=tuple(rng.uniform(0.8, 1.2, 3 * links)),
        centre_shift=tuple(rng.normal(0.0, 0.01, 3 * links)),
        inertia_shift=(*rng.normal(0.0, 1e-7, 6), *[0.0] * 6 * (links - 1)),
        armature=tuple(rng.uniform(0.001, 0.1, len(parameters.armature))),
        payload=0.3,
    )


def states(robot, parameters, count=3):
    """Positions near home, rates and accelerations, each shape (count, n)."""
    mechanism, rng = robot.mechanism(parameters), np.random.default_rng(2)
    shape = count, len(mechanism.actuated)
    home = mechanism.home[mechanism.actuated]
    return home + rng.uniform(-0.05, 0.05, shape), *rng.normal(size=(2, *shape))


@pytest.mark.parametrize('differs', [False, True], ids=['as in the file', 'changed'])
def test_the_regressor_gives_the_torques_of_the_kernels(case, differs):
    robot, parameters = case
    parameters = changed(parameters) if differs else parameters
    linear, (q, velocity, acceleration) = robot.linear_model, states(robot, parameters)
    Y = linear.regressor(parameters, np.empty(0), q, velocity, acceleration)
    values = linear.values(parameters)
    assert Y.shape == (*q.shape, len(values)) and len(linear.units(parameters)) == len(values)
    mechanism, made = boxed(robot.mechanism(parameters))
    n = q.shape[1]
    M, Q, gravity = *np.zeros((2, n, n)), np.zeros(n)
    for k in range(len(q)):
        assert closure_solver.close(mechanism, made, q[k]) == closure_solver.FOUND
        dynamics.model(mechanism, made, velocity[k], M, Q, gravity)
        wanted = M @ acceleration[k] + Q @ velocity[k] + gravity
        assert np.allclose(Y[k] @ values, wanted, rtol=1e-10, atol=1e-12)


def test_free_keys_change_the_torques_and_have_a_size(case):
    robot, parameters = case
    linear, parameters = robot.linear_model, changed(case[1])
    before, sizes = linear.values(parameters), linear.sizes(parameters)
    assert (np.abs(before) <= (1.0 + 1e-9) * sizes * 2.0).all() and (sizes > 0.0).all()
    for key in linear.parameters(parameters, linear.bodies(parameters).numbers):
        value = np.array(getattr(parameters, key))
        more = tuple(value + 0.01) if value.ndim else float(value) + 0.01
        assert not np.array_equal(before, linear.values(parameters._replace(**{key: more}))), key


def test_derivatives_by_complex_steps_are_those_by_differences(five_bar):
    robot, parameters = five_bar
    parameters = changed(parameters)
    linear = robot.linear_model
    for key in linear.parameters(parameters, linear.bodies(parameters).numbers):
        value = np.array(getattr(parameters, key))

        def values_at(step, key=key, value=value):
            moved = value + step
            given = tuple(moved) if value.ndim else moved
            return robot.linear_model.values(parameters._replace(**{key: given}))

        slope = values_at(1e-20j).imag / 1e-20
        wanted = (values_at(1e-6) - values_at(-1e-6)) / 2e-6
        assert np.allclose(slope, wanted, rtol=1e-6, atol=1e-8), key


def test_any_ten_numbers_of_each_link_are_written_and_read_back(case):
    """Bodies of random points of mass, seen in the frames of the links."""
    robot, parameters = case
    linear, rng = robot.linear_model, np.random.default_rng(5)
    for loaded in (0.0, 0.3):
        parameters = parameters._replace(payload=loaded)
        bodies = linear.bodies(parameters)
        numbers = bodies.numbers.copy()
        names = [name[2:-1] for name in bodies.known if name.startswith('m[')]
        wanted = {}
        for name in names:
            mass, place = rng.uniform(0.1, 1.0, 5), rng.normal(0.0, 0.1, (5, 3))
            inertia = np.einsum('k,ka,ka->', mass, place, place) * np.eye(3)
            inertia -= np.einsum('k,ka,kb->ab', mass, place, place)
            for k, j in zip(*np.triu_indices(3), strict=True):
                wanted[f'I{"xyz"[k]}{"xyz"[j]}[{name}]'] = inertia[k, j]
            wanted |= {f'm{"xyz"[k]}[{name}]': (mass @ place)[k] for k in range(3)}
            wanted[f'm[{name}]'] = mass.sum()
        units = [*linear.units(parameters)]
        own = bodies.linear.T[: len(numbers) - bool(loaded)]
        for k, column in enumerate(own):  # which p is this number?
            p = units[int(np.flatnonzero(column == 1.0)[0])]
            numbers[k] = wanted.get(p, numbers[k])
        given = linear.parameters(parameters, numbers)
        changed = robot.validate(parameters._replace(**given))
        bare = linear.values(changed._replace(payload=0.0))
        values = dict(zip(linear.units(changed._replace(payload=0.0)), bare, strict=True))
        for name, value in wanted.items():
            assert values[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name
        expected = bodies.linear @ numbers + bodies.fixed
        assert np.allclose(linear.values(changed), expected, rtol=1e-9, atol=1e-12)


def test_moments_of_inertia_of_no_body_are_refused(five_bar):
    robot, parameters = five_bar
    shift = np.zeros((4, 6))
    shift[1, 5] = 1.0  # kg m^2: Izz above Ixx + Iyy
    with pytest.raises(RobotError, match=r'inertia_shift: no body has such .* \(left_elbow\)'):
        robot.validate(parameters._replace(inertia_shift=tuple(shift.ravel())), 'robot')


def test_a_link_that_can_not_be_has_a_body_near_it(five_bar):
    """A rod without a width, and moments that violate the triangle inequality."""
    robot, parameters = five_bar
    flat = parameters._replace(spread_factor=(1.0, 0.0, 0.0) * 4)
    bodies = robot.linear_model.bodies(flat)
    for each in bodies.pseudo_inertias:
        assert np.linalg.eigvalsh(each @ bodies.numbers)[0] > 0.0
    p = robot.linear_model.values(flat)
    near = bodies.linear @ bodies.numbers + bodies.fixed
    assert np.abs(near - p).max() < 1e-5 * robot.linear_model.sizes(parameters).max() + 1e-6


def test_a_machine_as_in_the_file_keeps_its_numbers_to_the_last_bit(case):
    robot, parameters = case
    made, of_file = robot.mechanism(parameters), robot.machine(parameters).mechanism
    for name in ('mass', 'centre', 'inertia', 'armature', 'origin', 'home', 'gravity'):
        assert np.array_equal(getattr(made, name), getattr(of_file, name)), name


def test_a_payload_is_a_point_at_the_tool_whatever_the_link_weighs(five_bar):
    robot, parameters = five_bar
    bare, parameters = parameters._replace(mass_factor=(2.0,) * 4), parameters
    loaded = bare._replace(payload=0.5)
    one, other = robot.mechanism(bare), robot.mechanism(loaded)
    assert np.isclose(other.mass.sum() - one.mass.sum(), 0.5)
    moment = other.mass[other.tool] * other.centre[other.tool]
    moment -= one.mass[one.tool] * one.centre[one.tool]
    assert np.allclose(moment, 0.5 * one.tool_point)


def test_loops_of_shifted_joints_are_closed_again(five_bar):
    robot, parameters = five_bar
    moved = np.zeros(18)
    moved[3] = 0.002  # m, the left elbow along the proximal link
    moved[15] = 0.001  # m, the end of the right distal link along it
    of_file = robot.mechanism(parameters)
    made = robot.mechanism(parameters._replace(shift=tuple(moved)))
    assert np.allclose(made.origin[1] - of_file.origin[1], [0.002, 0.0, 0.0])
    assert np.array_equal(made.home[made.actuated], of_file.home[of_file.actuated])
    passive = made.passive
    assert 1e-4 < np.abs(made.home[passive] - of_file.home[passive]).max() < 0.1

    def tip(mechanism, base, lengths, joint):  # of a chain of two links in the plane
        angles = mechanism.home[joint], mechanism.home[[joint, joint + 1]].sum()
        return base + np.dot(lengths, np.exp(1j * np.array(angles)))

    left, right = tip(made, -0.059, (0.092, 0.09), 0), tip(made, 0.059, (0.09, 0.091), 2)
    assert abs(left - right) < 1e-12


def test_what_cannot_be_built_costs_one_line(five_bar):
    robot, parameters = five_bar
    with pytest.raises(
        InputError,
        match='shift must be 18 numbers, 3 for each joint and each end of a loop, not 1',
    ):
        robot.validate(parameters._replace(shift=(0.0,)), 'true_robot')
    far = (0.5, *(0.0,) * 17)
    with pytest.raises(RobotError, match='the loops of the machine cannot be closed near home'):
        robot.validate(parameters._replace(shift=far), 'true_robot')
    q = np.array([[0.0, np.pi]])
    with pytest.raises(KinematicsError, match=r'loops|singularity'):
        robot.linear_model.regressor(parameters, np.empty(0), q, q, q)
