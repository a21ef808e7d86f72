"""Custom laws: one file, found everywhere; a wrong one costs one line."""

import json
import re
import signal

import numpy as np
import pytest
from assembly import prepare, simulated
from custom_law import LAW, RETURN
from rig import Rig

import parallel_robot as pr
from parallel_robot.analysis.report.looks import law_label
from parallel_robot.cli.command_line import main
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import resolve, settings
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import Vector
from parallel_robot_model.messages import topics
from parallel_robot_model.processes import cache_directory, child_process
from parallel_robot_model.processes.cache_directory import NOTICE
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures', 'warm_trials']
pytestmark = pytest.mark.usefixtures('warm_trials')


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a law file with some of its text replaced; the test runs beside it."""
    monkeypatch.chdir(tmp_path)

    def write(name, *replaced, folder='.'):
        text = LAW
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / folder).mkdir(exist_ok=True)
        path = tmp_path / folder / f'{name}.py'
        path.write_text(text)
        return path

    return write


@pytest.fixture(scope='module')
def mine(tmp_path_factory):
    """A good law file; compiled once."""
    path = tmp_path_factory.mktemp('laws') / 'mine.py'
    path.write_text(LAW)
    return path


def values_of(path, **changes):
    return resolve('paper_circle', {'custom_laws': [str(path)], 'law': path.stem, **changes})


def test_it_is_compared_and_simulated_like_the_others(mine, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(mine.parent)
    own = ['--duration', '2', '--set', 'custom_laws=[mine.py]']
    assert main(['compare', 'paper_circle', *own, '--laws', 'mine', 'pid']) == 0
    rows = {
        line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines()[3:5]
    }
    assert rows['mine'] == rows['pid'] and len(rows['mine']) > 5
    assert main(['compare', 'paper_circle', *own, '--laws', 'mien']) == 2
    assert "unknown law 'mien'; did you mean 'mine'?" in capsys.readouterr().err
    assert (
        main(['simulate', 'paper_circle', *own, '--law', 'mine', '--out', str(tmp_path / 'bag')])
        == 0
    )


def test_compare_takes_its_gains_as_simulate_does(mine, tmp_path, capsys):
    gains = tmp_path / 'tuned.yaml'
    gains.write_text('mine: {Kp: 700.0}\n')
    words = ['paper_circle', '--duration', '1', '--param-file', str(gains)]
    assert main(['compare', *words, '--laws', str(mine), 'pid', '--format', 'json']) == 0
    compared = json.loads(capsys.readouterr().out)['laws']['mine']
    out = str(tmp_path / 'bag')
    assert main(['simulate', *words, '--law', str(mine), '--out', out, '--format', 'json']) == 0
    alone = json.loads(capsys.readouterr().out)
    assert compared['steady']['xy_rms_m'] == alone['steady']['xy_rms_m']
    assert main(['compare', *words, '--laws', 'pid']) == 2
    assert 'mine.Kp' in capsys.readouterr().err


def test_python_takes_it_by_its_file_wherever_a_law_is_named(mine, tmp_path):
    short, study = {'duration': 0.1}, {'scenarios': ['paper_circle'], 'runs': 1, 'duration': 0.1}
    run = pr.simulate('paper_circle', law=mine, **short)
    assert run.law == 'mine'
    pr.save(pr.simulate('paper_circle', law='pid', **short), tmp_path / 'pid')
    torque = pr.replay(tmp_path / 'pid', law=mine).torque
    np.testing.assert_array_equal(torque, run.command[: len(torque)])
    swept = pr.sweep(study, tmp_path / 'sweep', laws=[mine, 'pid'], workers=1)
    searched = pr.grid('paper_circle', mine, {'mine.Kp': [500.0, 600.0]}, **short)
    bounds = {'Kp': (100.0, 900.0)}
    tuned = pr.tune(
        mine, 'paper_circle', tmp_path / 'tune', trials=2, workers=1, bounds=bounds, **short
    )
    assert swept.law.tolist() == ['mine', 'pid'] and {*searched.status} == {'ok'}
    assert 100.0 <= tuned.values['mine.Kp'] <= 900.0
    assert pr.simulate('paper_circle', law=mine, custom_laws=[mine], **short).law == 'mine'


def test_classes_of_the_same_names_as_those_of_another_law_are_told_apart(mine):
    values = values_of(mine, duration=2.0)
    made, pid = simulated(values), simulated(values | {'law': 'pid'})
    assert np.array_equal(made.run.command, pid.run.command)
    memory, of_pid = (each.experiment.control.law.memory for each in (made, pid))
    assert type(memory.current) is type(memory.first) is not LAWS['pid'].Memory
    assert type(of_pid.current) is LAWS['pid'].Memory
    assert type(memory.current.integral) is Vector  # it began with an array


def test_the_laws_are_switched_to_and_fro(mine):
    rig = Rig('lockstep', custom_laws=[str(mine)])
    for law in ('mine', 'pid', 's_fotsmc', 'mine'):
        before = rig.run(20).torque
        rig.change(law=law)
        sample = rig.step()
        assert sample.status.law == law and sample.status.fault is None
        assert np.abs(sample.torque - before).max() <= 1.0 + 1e-12
        memory = rig.controller.law.memory
        assert type(memory.current) is type(memory.first)


def test_the_node_runs_it_or_says_in_one_line_why_not(mine, write, launch, peer):
    def node(path, law):
        words = ['-p', f'custom_laws:=["{path}"]', '-p', f'law:={law}', '-p', f'{law}.Kp:=1000']
        return launch(MODULES['controller'], '--ros-args', *words)

    good = node(mine, 'mine')
    wrong = node(write('mistaken', ('gains.Kp * e', 'gains.Kq * e')), 'mistaken')
    laws = peer.listen(topics.ACTIVE_LAW)
    peer.until(lambda: laws or not good.running)
    assert laws[-1].data == 'mine'
    assert wrong.wait() == 2
    notice, *_, error = wrong.stderr.splitlines()  # between them, how much is compiled
    assert notice.endswith(NOTICE) and "Unknown attribute 'Kq'" in error
    assert good.end(signal.SIGINT) == 0


def test_the_preset_of_a_law__are_its_defaults_as_numbers(mine):
    rig = Rig('lockstep', law='mine', custom_laws=[str(mine)])
    rig.change(mine__Kp=1000.0)
    change = rig.controller.prepare_change({'preset': 'paper'})
    gain = dict(settings(change.configuration))['mine.Kp']
    assert (type(gain), gain) == (float, 1350.0)  # the file says 1350


def test_judge_of_a_law__may_refuse_or_fail(write):
    judged = '\n\ndef validate_gains(gains):\n    return [f"{1.0 / (gains.Kp - 2.0)}"]\n'
    path = write('judging', ('\n\n@kernel', judged + '\n\n@kernel'))
    assert prepare('judging', values_of(path, **{'judging.Kp': 3.0})).warnings == ('judging: 1.0',)
    with pytest.raises(InputError, match=r'^judging: validate_gains: ZeroDivisionError'):
        prepare('judging', values_of(path, **{'judging.Kp': 2.0}))


HELPER = '@kernel\ndef twice(x):\n    return x.foo\n\n\n@kernel'
MIXED = 'd = {}\n    d["a"] = reference\n    d[1] = 2\n    torque = '  # Numba warns of it, too
WRONG = {
    'syntax': ([('def update(', 'def update((')], 'SyntaxError'),
    'no_update': ([('def update(', 'def upgrade(')], 'no_update.py has no update'),
    'no_gains': ([('class Gains(', 'class Grains(')], 'no_gains.py has no Gains'),
    'no_default': ([(' = 1350', '')], 'no_default.Kp has no default'),
    'no_field': (
        [("Annotated[float, Field('N m/rad', 'proportional gain', 0.0)]", 'float')],
        'Gains.Kp needs Annotated',
    ),
    'no_tuple': ([('class Gains(NamedTuple)', 'class Gains')], 'Gains is not a NamedTuple'),
    'negative': ([(' = 90.0', ' = -90.0')], 'negative.Kd must be at least 0 N m s/rad, not -90'),
    'not_a_number': ([(' = 90.0', " = float('nan')")], 'not_a_number.Kd must be finite'),
    'plain': ([('@kernel\n', '')], 'plain: update is not compiled: put @kernel before it'),
    'unknown': ([('gains.Kp * e', 'gains.Kq * e')], "does not compile: Unknown attribute 'Kq'"),
    'place': ([('gains.Kp * e', 'gains.Kq * e')], '(place.py:27)'),
    'in_helper': ([('@kernel', HELPER), ('gains.Kp * e', 'twice(dt) * e')], '(in_helper.py:25)'),
    'undefined': ([('gains.Kp * e', 'Kp * e')], "name 'Kp' is not defined (undefined.py:27)"),
    'format': ([('torque = ', 'f"{dt:.3f}"\n    torque = ')], 'not supported yet (format.py:'),
    'bytecode': ([('torque = ', 'with dt:\n        pass\n    torque = ')], '(bytecode.py:2'),
    'signature': ([('e_dot\n', 'e_dot @ "a"\n')], 'for signature: >>> matmul(array(float64, 1d, '),
    'mixed': ([('torque = ', MIXED)], 'mixed: update does not compile: No implementation'),
    'short': ([('feedback, memory, dt)', 'feedback)')], '(short.py:23)'),
    'scalar': (
        [(RETURN, RETURN.replace('torque', '1.0'))],
        'scalar: update returns torque as a number (float64), not a 1-d array of float64',
    ),
    'small': (
        [
            (RETURN, RETURN.replace('torque', 'vector((1.0, 2.0))')),
            ('kernel\n\n', 'kernel, vector\n\n'),
        ],
        'update returns torque as a vector of shape (2,) of float64, not a 1-d',
    ),
    'two_wrong': (
        [(RETURN, 'ControlOutput(torque, e > 0.0, e, Memory(memory.integral[::2]))')],
        'sliding_variable as a 1-d array of bool, not a 1-d array of float64; '
        'memory.integral as a 1-d array of float64 with gaps (take a .copy()), not',
    ),
    'nothing': ([('return ' + RETURN, 'pass')], 'coupled_error, memory), not None'),
    'tuple_alone': (
        [(RETURN, '(torque, e, e, memory)')],
        'coupled_error, memory), not a tuple of 4',
    ),
    'other_memory': (
        [('Memory(memory.integral + dt * e))', 'memory.integral)')],
        'other_memory: update returns memory as a 1-d array of float64, not Memory',
    ),
    'odd_memory': ([('return Memory(np.zeros(joints))', 'return {}')], 'odd_memory: initial_memo'),
    'float32': (
        [('np.zeros(joints))', 'np.zeros(joints, np.float32))')],
        'initial_memory: memory.integral is a 1-d array of float32, but a memory is made of num',
    ),
    'failing': ([('return Memory(np.zeros(joints))', 'return 1 // 0')], 'ZeroDivisionError'),
    'exits': ([('class Gains', 'raise SystemExit(0)\n\n\nclass Gains')], 'SystemExit: 0'),
    'wordy': (
        [('class Gains', 'raise OSError("a\\nb")\n\n\nclass Gains')],
        'wordy.py: OSError: a',
    ),
    'titled': (
        [('class Gains', 'TITLE = "S-FOTSMC"\n\n\nclass Gains')],
        "'S-FOTSMC' is that of a law",
    ),
    'numbered': (
        [('class Gains', 'TITLE = 5\n\n\nclass Gains')],
        'numbered: TITLE must be one line',
    ),
    'plant': ([], 'custom_laws: plant is a group of parameters; rename the file'),
    'smc': ([], 'custom_laws: smc.py: there is already a law smc; rename the file'),
}


@pytest.mark.parametrize('name', WRONG)
def test_a_wrong_file_costs_one_line(name, write, capsys):
    replaced, reason = WRONG[name]
    write(name, *replaced)
    words = ['paper_circle', '--duration', '0.1', '--set', f'custom_laws=[{name}.py]']
    commands = [['simulate', *words, '--law', name, '--out', 'bag']]
    if name in ('syntax', 'negative', 'unknown'):  # before, at and after its import
        commands.append(['compare', *words])
    for command in commands:
        assert main(command) == 2
        out, err = capsys.readouterr()
        assert out == '' and err.count('\n') == 1 and reason in err and len(err) < 300


DEADLY = 'import os; os.environ.get("NUMBA_BOUNDSCHECK") and os.abort()'
UNFIT = {
    'beyond': (('Kd * e_dot', 'Kd * e_dot + e[7]'), 'IndexError: index is out of bounds'),
    'deadly': (('(joints):', f'(joints):\n    {DEADLY}'),
               'initial_memory ends the process with SIGABRT'),
}  # fmt: skip
FAULTY = {  # what update does after all else, and what is said of it
    'cut': ('torque = torque[:2]', 'torque of shape (2,), not (3,)'),
    'shrinking': ('integral = integral[:1]', 'memory.integral of shape (1,), not (3,)'),
    'far': ('if e[0] > 8.0: raise ValueError("far")',
            'ValueError: far (line 35), in the trial with made-up states, here errors up to'),
    'endless': ('while dt < 1: dt -= 1', 'update does not return within 1 s of processor time'),
}  # fmt: skip


@pytest.fixture(scope='module')
def faulty(tmp_path_factory):
    """A law with all of these faults, each for a value of a gain; compiled once."""
    faults = [
        f'if gains.fault == {number}.0:\n        {line}'
        for number, (line, _) in enumerate(FAULTY.values(), start=1)
    ]
    integral = 'memory.integral + dt * e'
    lines = [f'integral = {integral}', *faults, 'return ']
    text = LAW.replace('return ControlOutput', '\n    '.join(lines) + 'ControlOutput')
    text = text.replace(f'Memory({integral})', 'Memory(integral)')
    gain = "    fault: Annotated[float, Field('', 'which', 0.0)] = 0.0\n"
    path = tmp_path_factory.mktemp('faulty') / 'faulty.py'
    path.write_text(text.replace(' = 90.0\n', f' = 90.0\n{gain}'))
    return path


def test_time_in_which_it_has_no_processor_does_not_count(write):
    """As on a busy machine, where a law that is good must pass all the same."""
    slow = 'import os, time; os.environ.get("NUMBA_BOUNDSCHECK") and time.sleep(1.5)'
    path = write('unhurried', ('(joints):', f'(joints):\n    {slow}'))
    assert prepare('unhurried', values_of(path)).warnings == ()


@pytest.mark.parametrize('name', UNFIT)
def test_what_a_law_does_wrong_is_found_before_it_acts(name, write):
    replaced, reason = UNFIT[name]
    with pytest.raises(InputError, match=f'^{name}: .*{re.escape(reason)}'):
        prepare(name, values_of(write(name, replaced)))


@pytest.mark.parametrize('name', FAULTY)
def test_what_a_law_does_wrong_with_its_gains_is_found_before_it_acts(name, faulty):
    gains = {'faulty.fault': 1.0 + [*FAULTY].index(name)}
    with pytest.raises(InputError, match=f'^faulty: .*{re.escape(FAULTY[name][1])}'):
        prepare('faulty', values_of(faulty, **gains))


def test_the_trial_takes_no_code_of_the_ordinary_cache(write, monkeypatch, tmp_path):
    """Not even where the user has chosen that cache (NUMBA_CACHE_DIR)."""
    monkeypatch.setattr(cache_directory, 'OWN', '')
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'chosen'))
    replaced, reason = UNFIT['beyond']
    with pytest.raises(InputError, match=reason):
        prepare('aloof', values_of(write('aloof', replaced)))


def test_a_law_for_three_joints_alone_says_so_and_is_tried_once(write, monkeypatch):
    path = write('rigid', ('    torque =', '    e[2] += 0.0\n    torque ='))
    for _ in range(2):
        (warning,) = prepare('rigid', values_of(path)).warnings
        assert warning == (
            'rigid: written for 3 joints; with 1: update: IndexError: index is out of bounds, '
            'in the trial with made-up states, here errors up to 0 rad'
        )
        monkeypatch.setattr(child_process, 'run_trial', None)  # now it is known


def test_a_memory_that_never_changes_is_told(write):
    path = write('forgetful', ('Memory(memory.integral + dt * e)', 'memory'))
    (warning,) = prepare('forgetful', values_of(path)).warnings
    assert warning.startswith('forgetful: memory never changes')


def test_numbers_that_do_not_follow_from_its_input_are_told(write):
    told = 'gives other numbers for the same input, as a random one or a time: rerun will differ'
    for name, part, replaced in (
        (
            'drawn',
            'update',
            ('    return Con', '    torque += np.random.normal()\n    return Con'),
        ),
        ('shaken', 'initial_memory', ('np.zeros(joints)', 'np.random.normal(size=joints)')),
    ):
        (warning,) = prepare(name, values_of(write(name, replaced))).warnings
        assert warning == f'{name}: {part} {told}'


def test_a_title_is_what_pictures_and_reports_call_a_law(write):
    path = write('named', ('class Gains', "TITLE = 'my \u03bb law'  # of 2026\n\n\nclass Gains"))
    law_loader.load(str(path))
    assert law_label('named') == 'my \u03bb law' and law_label('unnamed') == 'unnamed'
    hostile = {
        'named': b'TITLE = "S-FOTSMC"',
        'pid': b"TITLE = 'best'",
        'long': b'TITLE = "%s"' % (b'x' * 99),
    }
    law_loader.learn_titles(
        hostile | {'odd': b"TITLE = 'a\x07\xff'", 'run': b'TITLE = str(1 // 0)'}
    )
    assert [law_label(name) for name in ('named', 'long', 'odd', 'run')] == [
        'named',
        'long',
        'odd',
        'run',
    ]
    assert law_label('pid') == 'PID'


NO_LAW = 'is not a Python file whose name is an identifier'


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ('missing.py', 'does not exist'),
        ('missing/a-b.txt', 'does not exist'),
        (300 * 'x' + '.py', 'does not exist'),
        ('~nobody_of_this_name/mine.py', 'does not exist'),
        ('.', NO_LAW),
        ('a-b.py', NO_LAW),
        ('mine.txt', NO_LAW),
    ],
)
def test_a_file_that_is_none_costs_one_line(given, reason, write, tmp_path, capsys):
    (tmp_path / 'a-b.py').write_text(LAW), (tmp_path / 'mine.txt').write_text(LAW)
    assert main(['compare', 'paper_circle', '--set', f'custom_laws=[{given}]']) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and f'custom_laws: {given} {reason}' in err


def test_two_files_of_one_name_are_not_confused(write, capsys):
    write('same'), write('same', folder='b')
    assert main(['compare', 'paper_circle', '--set', 'custom_laws=[same.py, b/same.py]']) == 2
    assert 'custom_laws: b/same.py: there is already a law same' in capsys.readouterr().err


def test_a_copy_of_a_law_is_not_compiled_again(write):
    one, copy = write('same'), write('same', folder='copy')
    other = write('same', ('e, e, Memory', 'e_dot, e, Memory'), folder='other')
    modules = [law_loader.load(str(path))[1] for path in (one, copy, other)]
    assert modules[0] is modules[1] and modules[0] is not modules[2]


ADVISED = """
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.compiler import kernel
from parallel_robot_model.compiler import multiply, select, vector
from parallel_robot_control.terms import unless_any_saturated, unless_saturated
from parallel_robot_control.contract import ControlOutput
from parallel_robot_control.terms import coupling
from parallel_robot_control.terms import Integral, advanced, zero_integral
from parallel_robot_control.terms import saturate, sig
from parallel_robot_model.robots.contract import inverse_dynamics


class Gains(NamedTuple):
    Kp: Annotated[float, Field('1/s^2', 'gain', 0.0)] = 400.0


class Memory(NamedTuple):
    error: Integral
    ring: Integral


def initial_memory(joints):
    return Memory(Integral(np.zeros(joints), np.zeros(joints)), zero_integral(joints))


@kernel
def update(gains, model, reference, feedback, memory, dt):
    e = reference.position - feedback.position
    e_dot = reference.velocity - feedback.velocity
    total, ring = advanced(memory.error, dt), advanced(memory.ring, dt)
    S = e_dot + 20.0 * e + ring
    wanted = reference.acceleration + 40.0 * e_dot + gains.Kp * (e + total) + sig(S, 0.5)
    torque = inverse_dynamics(model, wanted, feedback.velocity) + multiply(model.M, saturate(S))
    rate = unless_saturated(e, feedback.excess)
    ring_rate = unless_any_saturated(coupling(e), feedback.excess)
    AS_IT_IS
    return ControlOutput(torque, S, e, Memory(Integral(total, rate), Integral(ring, ring_rate)))
"""


MAKES_VECTORS = 'torque = select(torque == torque, torque, vector((0.0, 0.0, 0.0)))'
USES_ARRAYS = """formula = torque
    torque = np.zeros(len(e))
    for i in range(len(e)):
        torque[i] = formula[i]
    torque[1:] += 0.0
    e[:1] *= 1.0"""


@pytest.fixture(scope='module')
def advised(tmp_path_factory):
    """Two law files of one formula, compiled once: one makes vectors, one works with arrays."""
    made = {'of_vectors': MAKES_VECTORS, 'of_arrays': USES_ARRAYS}
    folder = tmp_path_factory.mktemp('advised')
    for name, lines in made.items():
        (folder / f'{name}.py').write_text(ADVISED.replace('AS_IT_IS', lines))
    return [folder / f'{name}.py' for name in made]


def test_all_that_the_suite_offers_to_a_law_works_with_vectors_and_with_arrays(advised):
    limits = {'safety.torque_limit': 5.0, 'duration': 1.0}
    of_vectors, of_arrays = (simulated(values_of(path, **limits)) for path in advised)
    laws = [made.experiment.control.law for made in (of_vectors, of_arrays)]
    steps = ['step', 'step_with_arrays']
    assert [law.step.function.py_func.__name__ for law in laws] == steps
    assert of_vectors.run.active_limits.any()  # the integrals were held, too
    assert np.array_equal(of_vectors.run.command, of_arrays.run.command)
    for one, other in zip(*(law.memory.current for law in laws), strict=True):
        assert np.array_equal(np.array(tuple(one)), np.array(tuple(other)))


def test_only_the_trial_with_other_joints_refuses_vectors_that_a_law_makes(advised):
    (warning,) = prepare('of_vectors', values_of(advised[0])).warnings
    assert warning.startswith('of_vectors: written for 3 joints; with 1: ')
    assert prepare('of_arrays', values_of(advised[1])).warnings == ()


def test_a_law_with_arrays_is_switched_to_and_fro_and_keeps_its_memory(advised):
    rig = Rig('lockstep', law='pid', custom_laws=[str(advised[1])])
    for law in ('of_arrays', 'pid', 'of_arrays'):
        before = rig.run(20).torque
        rig.change(law=law)
        sample = rig.step()
        assert sample.status.law == law and sample.status.fault is None
        assert np.abs(sample.torque - before).max() <= 1.0 + 1e-12
    integral = rig.run(20) and rig.controller.law.memory.current.error.value.copy()
    rig.change(of_arrays__Kp=300.0)
    rig.step()
    assert 0.0 < np.abs(rig.controller.law.memory.current.error.value - integral).max() < 1e-4
