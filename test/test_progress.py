"""Progress is for terminals."""

import io
from types import SimpleNamespace

import pytest

from parallel_robot.analysis.report import runs
from parallel_robot.bags import output
from parallel_robot.bags.output import CLEAR, Progress, tracked
from parallel_robot.cli.commands import run
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.processes import cache_directory
from parallel_robot_model.processes.cache_directory import NOTICE


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def terminal(monkeypatch):
    """A terminal on which everything is drawn at once."""
    monkeypatch.setattr(output, 'QUIET', 0.0)
    monkeypatch.setattr(output, 'UPDATE_INTERVAL', 0.0)
    terminal = Terminal()
    monkeypatch.setattr(output, 'sys', SimpleNamespace(stderr=terminal))
    return terminal


def test_a_pipe_sees_nothing(monkeypatch, capsys):
    monkeypatch.setattr(output, 'QUIET', 0.0)
    assert list(tracked('abc', 3, 'letters')) == ['a', 'b', 'c']
    assert capsys.readouterr() == ('', '')


def test_a_terminal_sees_a_bar_that_goes_away(terminal):
    assert list(tracked('abcd', 4, 'letters')) == ['a', 'b', 'c', 'd']
    pictures = terminal.getvalue().split(CLEAR)
    assert len(pictures) == 6 and pictures[0] == pictures[-1] == ''
    assert pictures[3].startswith('[' + 15 * '#' + 15 * ' ' + '] 2 of 4 letters')


def test_short_work_says_nothing(terminal, monkeypatch):
    monkeypatch.setattr(output, 'QUIET', 60.0)
    list(tracked('abc', 3, 'letters'))
    assert terminal.getvalue() == ''


def test_the_bar_goes_away_after_an_error(terminal):
    def items():
        yield from 'ab'
        raise ValueError('broken')

    with pytest.raises(ValueError, match='broken'):
        list(tracked(items(), 3, 'letters'))
    assert '1 of 3 letters' in terminal.getvalue() and terminal.getvalue().endswith(CLEAR)


def test_nothing_to_do_and_more_than_expected(terminal):
    with Progress(0) as bar:
        bar.show(0)
    with Progress(1) as bar:
        bar.show(5)
    assert 2 * f'[{30 * "#"}]' in terminal.getvalue().replace(f'{CLEAR}', '').replace(
        ' 0 of 0 ', ''
    )


def test_a_report_says_how_many_bags_are_read(terminal, monkeypatch):
    log = SimpleNamespace(scenario='line', law='smc', joints=('a',), config={'robot_model': 'one'})

    def evaluate(bag, *_, **__):
        if bag.name == 'third':
            raise BagError('broken')
        return SimpleNamespace(log=log, past=SimpleNamespace(sources={'custom_laws': {}}))

    monkeypatch.setattr(runs.evaluated_bag, 'evaluate', evaluate)
    with pytest.raises(BagError, match='broken'):
        runs.read_runs(['first', 'second', 'third'])
    assert '2 of 3 bags read' in terminal.getvalue()


def test_nodes_that_compile_are_told_of_once_and_shown(terminal, capsys, monkeypatch):
    monkeypatch.setattr(cache_directory, 'compiled', lambda: '7 of about 119 kernels are compiled')
    processes = SimpleNamespace(compiling=lambda name: name == 'plant')
    with Progress(4, 'nodes ready') as bar:
        tell = run.waiting_display(processes, bar, 4)
        tell(['controller', 'recorder'])
        assert capsys.readouterr().err == ''
        tell(['plant', 'controller'])
        tell(['plant'])
    said = capsys.readouterr().err.splitlines()
    assert said == [f'parallel_robot run: the nodes are {NOTICE}']
    pictures = terminal.getvalue().split(CLEAR)
    assert pictures[1].endswith('2 of 4 nodes ready ')
    assert pictures[3].endswith(
        '3 of 4 nodes ready (plant compiling; 7 of about 119 kernels are compiled)'
    )
