"""Tables: written, read back by others, compared."""

import sys

import numpy as np
import pandas
import pytest
from bags import full_disk, table_of

from parallel_robot.cli.command_line import main

READERS = {'.csv': pandas.read_csv, '.parquet': pandas.read_parquet}


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    directory = tmp_path_factory.mktemp('export') / 'bag'
    assert main(['simulate', 'paper_line', '--duration', '0.3', '--out', str(directory)]) == 0
    return directory


def refused(words, capsys, code=2):
    """The line of a command that fails."""
    capsys.readouterr()
    assert main([str(word) for word in words]) == code
    out, err = capsys.readouterr()
    assert out == '' and err.count('\n') == 1
    return err


@pytest.mark.parametrize('suffix', READERS)
def test_a_table_comes_back(suffix, bag, tmp_path, capsys):
    out = tmp_path / f'run{suffix}'
    assert main(['export', str(bag), '--out', str(out)]) == 0
    assert '301 rows, 36 columns' in capsys.readouterr().out
    back, expected = READERS[suffix](out), table_of(bag).columns
    assert list(back.columns) == list(expected)
    for name, column in expected.items():
        assert np.array_equal(back[name], column, equal_nan=True), name
    assert back['stamp_ns'].dtype == np.int64
    efforts = back['joint1_effort_nm'].to_numpy()[1:]
    assert np.array_equal(efforts, back['joint1_command_nm'].to_numpy()[:-1])


@pytest.mark.parametrize('suffix', READERS)
def test_nothing_is_overwritten(suffix, bag, tmp_path, capsys):
    out = tmp_path / f'run{suffix}'
    out.write_text('mine')
    assert 'exists; nothing is overwritten' in refused(['export', bag, '--out', out], capsys)
    assert out.read_text() == 'mine'


@pytest.mark.parametrize(
    ('out', 'message'),
    [
        ('run.xls', "unknown table format '.xls'"),
        ('run', "unknown table format ''"),
        ('file/run.csv', 'Not a directory'),
    ],
)
def test_a_file_that_cannot_be_written(out, message, bag, tmp_path, capsys):
    (tmp_path / 'file').write_text('mine')
    assert message in refused(['export', bag, '--out', tmp_path / out], capsys)
    assert list(tmp_path.iterdir()) == [tmp_path / 'file']


def test_a_full_disk_leaves_no_half_table(bag, tmp_path, capsys):
    with full_disk(10_000):
        line = refused(['export', bag, '--out', tmp_path / 'run.csv'], capsys, code=1)
    assert 'File too large' in line and not list(tmp_path.iterdir())


def test_parquet_without_its_library_costs_one_line(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    line = refused(['export', bag, '--out', tmp_path / 'run.parquet'], capsys)
    assert 'pip install pyarrow' in line and not list(tmp_path.iterdir())
    assert main(['export', str(bag), '--out', str(tmp_path / 'run.csv')]) == 0
