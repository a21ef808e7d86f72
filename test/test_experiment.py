"""What a bag says of the experiment that made it: written as it is, read with suspicion."""

import contextlib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from test_plain_data import DEFAULTS, PLAIN

from parallel_robot.bags import experiment
from parallel_robot.bags.limits import NAME
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.configuration import plain_data
from parallel_robot_model.configuration.fields import PerJoint, allowed_words

EXTREMES = st.sampled_from(
    [10**30, -1, 0, 1e308, '', 'x' * 300, '\x1b[2J', [], [[]], {}, ['a'] * 5]
)


def test_a_bag_says_what_made_it(tmp_path):
    words = ['paper_circle', '--duration', '0.1', '--out', str(tmp_path / 'bag')]
    assert main(['simulate', *words]) == 0
    facts = recording.read(tmp_path / 'bag').history.facts
    assert facts['source'] == 'simulation' and facts['randomness'] == 'seed 0'
    assert 'numpy' in facts['libraries'] and facts['python'].count('.') == 2
    assert facts['command_line'] == experiment.command_line()


def test_the_revision_is_that_of_a_working_copy_or_of_what_was_built_of_one(tmp_path, monkeypatch):
    assert experiment._revision(tmp_path) == ''
    (tmp_path / 'parallel_robot').mkdir()
    (tmp_path / 'parallel_robot' / 'REVISION').write_text('4e30a7a7-dirty\n')
    assert experiment._revision(tmp_path) == '4e30a7a7-dirty'
    (tmp_path / '.git').mkdir()
    assert experiment._revision(tmp_path) == ''  # not a working copy after all
    monkeypatch.setenv('PATH', '')
    assert experiment._revision(tmp_path) == ''


def test_the_plant_started_by_hand_says_its_seed():
    facts = {'config': plain_data.dump(DEFAULTS)}
    nodes = {'/controller': {'seed': 3}, '/plant': {'seed': 7, 'sensor.jitter': 0.002}}
    values, loop, _ = experiment.configuration('bag', facts, nodes)
    assert values['seed'] == loop.seed == 7 and values['sensor.jitter'] == 0.002


def test_without_a_plant_the_trajectory_says_period_and_joints():
    facts = {'config': plain_data.dump(DEFAULTS)}
    nodes = {'/trajectory': {'period': 0.004, 'joints': ['a', 'b', 'c']}}
    _, loop, _ = experiment.configuration('bag', facts, nodes)
    assert (loop.period, loop.joints) == (0.004, ('a', 'b', 'c'))
    _, loop, _ = experiment.configuration('bag', facts, nodes | {'/plant': {'period': 0.002}})
    assert (loop.period, loop.joints) == (0.002, ('a', 'b', 'c'))


def test_a_bag_from_before_a_key_has_its_default():
    older = {key: value for key, value in DEFAULTS.items() if key != 'trajectory.transition'}
    values, *_ = configuration({'config': plain_data.dump(older)})
    assert values['trajectory.transition'] == DEFAULTS['trajectory.transition'] == 2.0


def configuration(facts):
    """Configuration of a bag; None when it is refused in one line."""
    with contextlib.suppress(BagError):
        return experiment.configuration('bag', facts, {})


@given(st.dictionaries(st.sampled_from([*DEFAULTS, 'own.gain']), PLAIN | EXTREMES, max_size=3))
@example({'estimator.acceleration': []})
def test_a_configuration_is_like_the_default_or_refused(changes):
    found = configuration({'config': plain_data.dump({**DEFAULTS, **changes})})
    if found is None:
        return
    values, loop, start = found
    assert start == 0 and len(loop.joints) == 3
    assert all(len(name) <= NAME and name.isprintable() for name in (*loop.joints, loop.law))
    for key, default in DEFAULTS.items():
        number = isinstance(default, (int, float)) and not isinstance(default, bool)
        kinds = (int, float) if number else (type(default), bool)
        kind = experiment._kinds().get(key)
        if kind is PerJoint:  # one number for all joints, or one for each
            kinds = (int, float, list)
            assert values[key] != []
        if allowed_words(kind):  # one of them, or a number
            kinds = (str, int, float)
        assert isinstance(values[key], kinds), key


@pytest.mark.parametrize('scenario', ['/home/me/mine.yaml', 'mine.yml', 'mine'])
def test_a_scenario_has_the_name_of_the_file_that_nodes_were_given(scenario):
    facts = {'config': plain_data.dump(DEFAULTS)}
    values, loop, _ = experiment.configuration(
        'bag', facts, {'/trajectory': {'scenario': scenario}}
    )
    assert (values['scenario'], loop.scenario) == ('mine', 'mine')


@given(st.dictionaries(st.sampled_from(['config', 'law', 'start_stamp']), st.text(), max_size=3))
def test_facts_of_any_text_are_refused(facts):
    assert configuration({'version': '1', **facts}) is None
