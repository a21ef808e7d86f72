"""Completion in a shell: the words that bash is given for what was typed so far."""

import os
import subprocess

import pytest

from parallel_robot.cli.command_line import WORDS, _actions, build_parser
from parallel_robot_model.processes.node_processes import command

ROOT = os.path.dirname(os.path.dirname(__file__))


def completed(typed):
    """What the function does that argcomplete registers in bash: the answer comes through fd 8."""
    words = command('parallel_robot.__main__')
    asked = {
        '_ARGCOMPLETE': '1',
        '_ARGCOMPLETE_IFS': '\n',
        'COMP_LINE': typed,
        'COMP_POINT': str(len(typed)),
        'PYTHONPATH': ROOT,
    }
    shell = ['bash', '-c', '"$@" 8>&1 9>&2 1>/dev/null 2>/dev/null', 'bash', *words]
    done = subprocess.run(shell, env={**os.environ, **asked}, cwd=ROOT, capture_output=True)
    return done.stdout.decode().split()


@pytest.mark.parametrize(
    ('typed', 'words'),
    [
        ('parallel_robot simu', ['simulate']),
        ('parallel_robot simulate paper_', ['paper_circle', 'paper_line']),
        ('.venv/bin/parallel_robot run docs/example_sc', ['docs/example_scenario.yaml']),
        ('parallel_robot run paper_circle --law s_', ['s_fotsmc', 's_fotsmc_ft', 's_smc']),
        ('parallel_robot run paper_circle --set smc.', ['smc.G=', 'smc.g=', 'smc.u=', 'smc.z=']),
        ('parallel_robot sweep unc', ['uncertain_robot']),
    ],
)
def test_a_word_is_completed(typed, words):
    assert sorted(completed(typed)) == words


def test_every_kind_of_word_is_asked_for_somewhere():
    assert WORDS.keys() <= {action.dest for action in _actions(build_parser())}
