"""Texts of a bag cannot control the terminal."""

import io
import sys

from parallel_robot.bags import output
from parallel_robot.bags.output import MAX_LINE_LENGTH, printable_output
from parallel_robot.cli.command_line import main


def test_what_commands_print_has_no_escape_sequences(capsys):
    with printable_output():
        print('a\x1b[2J\rb\n\ttwo lines')
        print('é' * (MAX_LINE_LENGTH + 1), file=sys.stderr)
    out, err = capsys.readouterr()
    assert out == 'a\ufffd[2J\ufffdb\n\ufffdtwo lines\n'
    assert err == 'é' * (MAX_LINE_LENGTH - 1) + '…\n'


def test_progress_still_draws_on_the_terminal(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, 'stderr', terminal)
    monkeypatch.setattr(output, 'QUIET', 0.0)
    with printable_output():
        assert list(output.tracked('ab', 2, 'letters')) == ['a', 'b']
    assert terminal.getvalue().startswith(output.CLEAR)


def test_a_terminal_that_lacks_a_letter_gets_another(monkeypatch):
    content = io.BytesIO()
    terminal = io.TextIOWrapper(content, encoding='ascii')
    monkeypatch.setattr(sys, 'stdout', terminal)
    assert main(['compare', 'paper_circle', '--laws', 'smc', '--duration', '0.1']) == 0
    print('5 µrad…')
    terminal.flush()
    text = content.getvalue().decode('ascii')
    assert '[um]' in text and text.endswith('5 urad?\n')
