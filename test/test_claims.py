"""Claims are verified by the metrics they name; `compare` shows table and verdicts."""

import json
import math
import re

import pytest

from parallel_robot.analysis import claims, readable_metrics
from parallel_robot.analysis.metrics import TABLE, Metrics, Window
from parallel_robot.analysis.readable_metrics import shown
from parallel_robot.bags.run.run_log import TopicCount
from parallel_robot.cli.command_line import main
from parallel_robot_model.configuration import config


def measured(error, settled, chattering):
    values = dict.fromkeys((metric.key for metric in TABLE), math.nan)
    values |= dict.fromkeys(('xy_rms_m', 'xy_max_m', 'joint_rms_rad', 'sync_rms_rad'), error)
    values |= {'to_1_mm_s': settled, 'torque_max_nm': 1.0, 'chattering_nm': chattering}
    return Metrics(values, 12.0, Window(6.0, 12.0, 12.0))


AS_CLAIMED = {
    'smc': measured(4.0, None, 0.0),
    's_smc': measured(3.0, 3.0, 0.0),
    'nftsmc': measured(2.0, 2.0, 2.0),
    's_fotsmc': measured(1.0, 1.0, 1.0),
}


def test_all_claims_hold_for_metrics_as_claimed():
    verdicts = claims.verify('paper_line', AS_CLAIMED)
    assert [v.claim for v in verdicts] == list(claims.CLAIMS)
    assert all(v.reproduced for v in verdicts)


@pytest.mark.parametrize('claim', claims.CLAIMS, ids=lambda claim: claim.text)
def test_each_claim_falls_when_its_law_is_not_ahead(claim):
    results = AS_CLAIMED | {claim.better: measured(9.0, None, 9.0)}
    verdict = next(v for v in claims.verify('paper_line', results) if v.claim == claim)
    assert not verdict.reproduced
    assert set(verdict.values) == {claim.better, *claim.others}


def test_a_tie_is_no_lead():
    results = dict.fromkeys(AS_CLAIMED, measured(1.0, 1.0, 1.0))
    assert not any(v.reproduced for v in claims.verify('paper_line', results))


@pytest.mark.parametrize('scenario', ['circle_pi12', 'disturbed_circle', 'heavy_circle', ''])
def test_the_paper_claims_nothing_of_other_scenarios(scenario):
    assert claims.verify(scenario, AS_CLAIMED) == []
    assert set(claims.SCENARIOS) <= set(config.scenarios())


def test_a_metric_that_is_not_defined_verifies_nothing():
    results = AS_CLAIMED | {'smc': measured(math.nan, math.nan, 0.0)}
    found = {verdict.claim.text for verdict in claims.verify('paper_line', results)}
    rest = [c.text for c in claims.CLAIMS if 'smc' not in (c.better, *c.others)]
    assert found == set(rest) and rest


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (0.0, '0.000'), (2.98, '2.980'), (84.0, '84.00'), (1.0 / 3.0, '0.3333'),
        (1108.2, '1108'), (9999.6, '10000'), (12345.6, '12350'), (1.5e7, '1.500e+07'),
        (0.04, '0.04000'), (2e-6, '2.000e-06'), (-3.5, '-3.500'),
        (math.inf, 'never'),
    ],
)  # fmt: skip
def test_all_values_have_four_digits(value, text):
    assert readable_metrics.shown(value) == text


def test_claims_about_laws_without_results_are_left_out():
    assert [
        v.claim.better
        for v in claims.verify('paper_line', {k: AS_CLAIMED[k] for k in ('smc', 's_smc')})
    ] == ['s_smc']


def test_missing_messages_stand_beside_the_metrics():
    counts = {'reference': TopicCount(99, 2), 'pose': TopicCount(10, 0), 'clock': TopicCount(5, 7)}
    lines = readable_metrics.brief(measured(1e-6, 1.0, 0.5), counts)
    assert len(lines) == 4 and lines[3] == '  messages missing: reference 2, clock 7'
    assert lines[0].startswith('  end-effector error, rms 1.000 µm; ')


def test_compare_shows_what_was_measured(tmp_path, capsys):
    report = tmp_path / 'report.json'
    laws = ['s_fotsmc', 'pid']
    words = ['compare', 'paper_circle', '--duration', '2', '--laws', *laws]
    assert main([*words, '--json', str(report)]) == 0
    captured = capsys.readouterr()
    assert all('not settled' in line for line in captured.err.splitlines())
    data = json.loads(report.read_text())
    assert list(data['laws']) == laws and not data['claims']
    for law in laws:
        (row,) = re.findall(rf'^ *{law} .*$', captured.out, re.MULTILINE)
        rms = data['laws'][law]['steady']['xy_rms_m']
        assert shown(1e6 * rms) in row.split()
        assert {len(re.sub(r'^[0.]*|[.]', '', cell)) for cell in row.split()[1:]} <= {4, 5}


@pytest.mark.parametrize('given', [['smc,pid'], ['smc,', 'pid'], ['smc', ',', 'pid']])
def test_compare_tells_of_the_space_between_laws(given, capsys):
    assert main(['compare', 'paper_circle', '--laws', *given]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'with spaces between them, smc pid, not smc' in error


def test_compare_refuses_an_unknown_law(capsys):
    assert main(['compare', 'paper_circle', '--laws', 'pidd']) == 2
    assert "did you mean 'pid'" in capsys.readouterr().err


def test_a_law_in_a_fault_has_no_figures_of_merit(tmp_path, capsys):
    report = tmp_path / 'report.json'
    words = ['compare', 'paper_circle', '--duration', '1', '--laws', 'smc', 's_smc', 'nftsmc']
    assert main([*words, '--set', 'safety.speed_limit=[10, 0.09, 10]', '--json', str(report)]) == 0
    out, err = capsys.readouterr()
    data = json.loads(report.read_text())
    assert data['faults'] and data['faults'].keys() < {'smc', 's_smc', 'nftsmc'}
    for law, text in data['faults'].items():
        row = rf'^ *{law} +no figures: in a fault for .* % of the run, first at t = 0'
        assert re.search(row, out, re.MULTILINE) and law not in data['laws']
        number = re.fullmatch(
            r'joint2 at (\S+) rad/s is above safety.speed_limit, 0.09 rad/s', text
        )[1]
        assert float(number) > 0.09
        fault = rf'^warning: {law}: fault at t = .*: {re.escape(text)}$'
        assert re.search(fault, err, re.MULTILINE)
        assert not any(law in claim['figures'] for claim in data['claims'])
    for law in {*data['laws']} - {*data['faults']}:
        assert re.search(rf'^ *{law}  ', out, re.MULTILINE)
