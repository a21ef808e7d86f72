"""Hazards of a loop: how they are written, and what is refused."""

import numpy as np
import pytest

from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import hazards
from parallel_robot_model.configuration.hazard_table import HazardTable
from parallel_robot_model.configuration.hazards import KINDS, Hazard
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_sim.configuration import configure

TYPED = {
    'commands_lost at 4.0 for 2.0': {'what': 'commands_lost', 'at': 4, 'for': 2},
    'encoder_frozen joint joint1 at 6.0 for 0.2': {
        'what': 'encoder_frozen', 'for': 0.2, 'joint': 'joint1', 'at': 6.0
    },
    'motors_clipped limit 0.5 at 4.0 for 4.0': {
        'what': 'motors_clipped', 'at': 4.0, 'limit': 0.5, 'for': 4.0
    },
    'stranger size -3.0 at 1.0 for 1.0': {'what': 'stranger', 'size': -3, 'at': 1, 'for': 1},
    'clear_fault at 9.0': {'what': 'clear_fault', 'at': 9},
}  # fmt: skip
WRONG = {
    'comands_lost at 4 for 2': "unknown value of hazards[0] 'comands_lost'; did you mean",
    'commands_lost at 4': 'hazards[0]: commands_lost needs for',
    'commands_lost joint joint1 at 4 for 2': 'commands_lost takes at, for, not',
    'commands_lost at 4 for': 'hazards[0] must be like "commands_lost at 4.0 for 2.0"',
    'commands_lost at 4 at 5 for 2': 'hazards[0] must be like "commands_lost at 4.0 for 2.0"',
    'commands_lost at soon for 2': "hazards[0].at must be a number, not 'soon'",
    'commands_lost at -1 for 2': 'hazards[0].at must be from 0 to 1e+06 s, not -1',
    'commands_lost at 1 for nan': "hazards[0].for must be a number, not 'nan'",
    'commands_lost at 1 for 0.0001': 'hazards[0]: for must be at least one period, 0.001 s',
    'states_dropped share 1.5 at 1 for 1': 'hazards[0].share must be from 0 to 1, not 1.5',
    'motor_dead joint joint7 at 1 for 1': "unknown joint of hazards[0] 'joint7'",
    '': "unknown value of hazards[0] ''",
}


@pytest.mark.parametrize('text', TYPED)
def test_texts_and_mappings_are_one_form(text):
    (hazard,) = hazards.parse([TYPED[text]])
    assert str(hazard) == text
    assert hazards.parse([text]) == (hazard,)
    assert resolve('paper_circle', {'hazards': [TYPED[text]]})['hazards'] == [text]


def test_a_share_of_the_states_is_dropped_at_random_by_the_seed():
    given = {'hazards': ['states_dropped share 0.1 at 0.5 for 20.0']}
    loops = (loop_of(resolve('paper_circle', {**given, 'seed': seed})) for seed in (1, 1, 2))
    one, again, other = (
        HazardTable(loop, 0.04).reception(np.arange(20_500)).published for loop in loops
    )
    assert (one == again).all() and one[:500].all()
    for told in (one, other):
        assert abs(np.mean(~told[500:]) - 0.1) < 3.0 * np.sqrt(0.1 * 0.9 / 20_000)
    both = np.mean(~one[500:] & ~other[500:])
    assert abs(both - 0.01) < 3.0 * np.sqrt(0.01 / 20_000)


def test_states_that_are_never_sent_are_not_refused():
    given = ['states_dropped share 1.0 at 0.0 for 3e3', 'velocity_nan joint joint1 at 0.0 for 3e3']
    table = HazardTable(loop_of(resolve('paper_circle', {'hazards': given})), 0.04)
    assert not table.lost and not table.reception(np.arange(2_999_000, 2_999_999)).published.any()


def test_every_kind_can_be_written():
    for what, kind in KINDS.items():
        joint, size = ('joint2' if 'joint' in kind.words else ''), len(kind.words) > 2
        sized = {'size', 'limit', 'delay', 'share'} & {*kind.words}
        lasts = 0.5 if 'for' in kind.words else 0.0
        hazard = Hazard(what, 1.0, lasts, joint, 0.25 if size and sized else 0.0)
        assert hazards.parse([str(hazard)]) == (hazard,)


@pytest.mark.parametrize('text', WRONG)
def test_a_wrong_one_is_refused_in_one_line(text, tmp_path, capsys):
    assert main(['simulate', 'paper_circle', '--set', f'hazards=["{text}"]', '--out', 'x']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert WRONG[text] in line


def test_the_line_in_a_file_is_told(tmp_path, capsys):
    file = tmp_path / 'mine.yaml'
    file.write_text('base: paper_circle\nhazards:\n- {what: brakes, at: 1}\n')
    assert main(['simulate', str(file), '--out', str(tmp_path / 'bag')]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f'{file}, line 2: hazards[0]: brakes needs for' in line


def test_files_may_hold_mappings(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('base: paper_circle\nhazards: [{what: brakes, at: 1, for: 2}]\n')
    assert configure(resolve(str(file))).loop.hazards == ('brakes at 1.0 for 2.0',)
    other = tmp_path / 'other.yaml'
    other.write_text('base: paper_circle\ncircle.center: [{x: 1}]\n')
    with pytest.raises(InputError, match=r'circle\.center cannot be a list'):
        resolve(str(other))


@pytest.mark.parametrize('given', ['brakes at 1 for 2', 3, {'what': 'brakes'}])
def test_what_is_no_list_is_refused(given):
    with pytest.raises(InputError, match='hazards must be a list'):
        resolve('paper_circle', {'hazards': given})


def test_there_are_none_by_default():
    assert resolve('paper_circle')['hazards'] == []
