"""How the benchmarks are run together, and the page of their figures; not what they measure."""

import importlib
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def modules(monkeypatch):
    """The modules all, benchmark_page and rows of the benchmarks."""
    monkeypatch.syspath_prepend(ROOT / 'benchmarks')
    return [importlib.import_module(name) for name in ('all', 'benchmark_page', 'rows')]


def test_a_figure_has_its_median_spread_and_verdict(modules, capsys):
    _, _, rows = modules
    found = rows.row('speed', 'x', [3.0, 9.0, 5.0], '>= 6')
    assert (found['median'], found['min'], found['max'], found['count']) == (5.0, 3.0, 9.0, 3)
    assert found['met'] is False
    assert rows.row('speed', 'x', [6.0], '>= 6')['met'] is True
    assert rows.row('cost', 'x', [1.2], '<= 1.1')['met'] is False
    assert 'met' not in rows.row('cost', 'us', [1.2])
    assert rows.ratios([6.0, 8.0], [2.0, 4.0]) == [3.0, 2.0]
    rows.show([found])
    table, last = capsys.readouterr().out.splitlines()
    assert '>= 6: missed' in table
    assert json.loads(last) == [found]


def test_a_benchmark_is_a_process_whose_last_line_counts(modules, tmp_path, monkeypatch):
    campaign, _, _ = modules
    monkeypatch.setattr(campaign, '__file__', str(tmp_path / 'all.py'))
    (tmp_path / 'good.py').write_text("print('words'); print('[1]')")
    (tmp_path / 'silent.py').write_text('')
    (tmp_path / 'bad.py').write_text("print('[1]'); raise SystemExit(3)")
    assert campaign.measure('good', ['7'])['rows'] == [1]
    assert campaign.measure('good', ['7'])['arguments'] == ['7']
    assert campaign.measure('silent', [])['error'] == 'its last line is no JSON'
    assert campaign.measure('bad', [])['error'] == 'exit code 3'


def test_a_failed_benchmark_leaves_the_page_and_the_others(modules, tmp_path, monkeypatch):
    campaign, _, rows = modules
    figure = rows.row('speed', 'x', [3.0])
    outcomes = {name: {'arguments': [], 'rows': [figure]} for name in campaign.BENCHMARKS}
    monkeypatch.setattr(campaign, 'measure', lambda name, words: dict(outcomes[name]))
    monkeypatch.setattr(campaign, 'PAGE', tmp_path / 'page.md')
    for name, failing in (('whole', False), ('part', True)):
        if failing:
            (tmp_path / 'page.md').unlink()
            outcomes['laws'] = {'arguments': [], 'error': 'exit code 3'}
        file = tmp_path / f'{name}.json'
        monkeypatch.setattr(sys, 'argv', ['all.py', '--json', str(file)])
        assert campaign.main() == int(failing)
        found = json.loads(file.read_text())
        assert list(found['benchmarks']) == list(campaign.BENCHMARKS)
        assert found['machine']['versions']['numba']
        assert (tmp_path / 'page.md').exists() is not failing
    assert campaign.main() == 2  # the file exists
    monkeypatch.setattr(sys, 'argv', ['all.py', '--quick', '--json', str(tmp_path / 'q.json')])
    outcomes['laws'] = outcomes['kernels']
    assert campaign.main() == 0
    assert not (tmp_path / 'page.md').exists()


def test_the_page_has_a_section_for_each(modules):
    campaign, page, _ = modules
    text = (ROOT / 'docs' / 'benchmarks.md').read_text()
    assert list(page.TEXTS) == list(campaign.BENCHMARKS)
    for name, (title, words) in page.TEXTS.items():
        assert (ROOT / 'benchmarks' / f'{name}.py').is_file()
        assert f'## {title}\n\n{words}\n' in text, 'run make bench'
    targets = re.findall(r'^- MuJoCo, .*; >= ([\d.]+): \w+$', text, re.MULTILINE)
    assert targets == ['6', '20', '2.5']


def test_a_unit_of_a_whole_column_stands_in_its_head(modules):
    _, page, rows = modules
    names = ('a, kernel', 'us'), ('a, node', 'us'), ('b, kernel', 'us'), ('b, node', 'ms')
    figures = [rows.row(name, unit, [i]) for i, (name, unit) in enumerate(names)]
    assert page.table(figures, (', kernel', ', node')).splitlines() == [
        '| figure | kernel [us] | node |',
        '|---|---|---|',
        '| a | 0 | 1 us |',
        '| b | 2 | 3 ms |',
    ]
    assert page.table(figures[:1], ('',)) == '- a, kernel: 0 us'


def test_the_programs_that_pages_cite_run(monkeypatch, capsys):
    """Shortened; those that need nodes are left to the campaign."""
    monkeypatch.syspath_prepend(ROOT / 'benchmarks')
    tables = importlib.import_module('doc_tables')
    monkeypatch.setattr(tables, 'AFTER', 0.02)
    monkeypatch.setattr(tables, 'SEEDS', range(1))
    assert 0.001 < tables.astray('pid', 0.01, 0.05, 0.05) < 0.1
    assert re.fullmatch(r'\d+ \([\d.]+\)', tables.loss('pid', tables.ENCODER, 0.05))
    tables.delays(['1'])
    assert re.search(r'1 robots, default kept on \d\n  exact \d', capsys.readouterr().out)


@pytest.mark.parametrize(
    'words',
    [
        pytest.param(
            ('calibration', '1', '10', 'planar_3rrr', 'five_bar'), marks=pytest.mark.endurance
        ),
        ('estimators', '1'),
        ('kernels', '1', '1'),
        pytest.param(('native', '--seconds', '0.5'), marks=pytest.mark.endurance),
    ],
)
def test_a_program_that_a_page_cites_ends_with_figures(words, monkeypatch, capsys):
    monkeypatch.syspath_prepend(ROOT / 'benchmarks')
    monkeypatch.setattr(sys, 'argv', list(words))
    importlib.import_module(words[0]).main()
    assert re.search(r'\d\.\d', capsys.readouterr().out)


def test_the_table_of_noise_has_every_law(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / 'benchmarks')
    tables = importlib.import_module('doc_tables')
    text = (ROOT / 'docs' / 'noise.md').read_text()
    table = text.partition('## What each law loses')[2].partition('\n## ')[0]
    assert re.findall(r'^\| `(\w+)`', table, re.MULTILINE) == list(tables.LAWS)
