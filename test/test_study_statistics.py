"""What follows from many runs, against what is known of the numbers; and how it is written."""

import csv
import io
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import chi2, norm
from table_readers import latex_tables

from parallel_robot.studies.sweep import picture, statistics, study, summary
from parallel_robot.studies.sweep.plan import plan, sample
from parallel_robot.studies.sweep.results import ERRORS, OTHERS, LawResult, ScenarioResult
from parallel_robot.studies.sweep.statistics import Duel, Estimate

RANDOM = np.random.default_rng(0)


def test_the_interval_of_a_median_covers_it_as_often_as_it_says():
    samples = RANDOM.exponential(size=(100, 60))
    found = [statistics.median(values) for values in samples]
    assert [one.value for one in found] == pytest.approx(np.median(samples, axis=1))
    covered = np.mean([one.low <= math.log(2.0) <= one.high for one in found])
    assert 0.88 <= covered <= 1.0


def test_a_median_with_failures_is_finite_while_most_runs_are():
    values = np.array([1.0, 2.0, 3.0, np.inf, np.inf])
    found = statistics.median(values)
    assert found.value == 3.0 and found.low == 1.0 and found.high == math.inf
    assert statistics.median(np.array([1.0, np.inf, np.inf])).value == math.inf
    same = statistics.median(np.full(4, 2.5))
    assert same == Estimate(2.5, 2.5, 2.5)
    assert statistics.median(np.array([7.0])) == Estimate(7.0, 7.0, 7.0)
    assert statistics.median(np.full(3, np.inf)).low == math.inf


@pytest.mark.parametrize('failed', range(9))
@pytest.mark.parametrize(
    'median', [statistics.median, lambda values: statistics.sectioned(values, np.tile([0, 1], 4))]
)
def test_between_a_number_and_a_failure_lies_no_number(median, failed):
    """The median of an even number of runs, and ends of intervals, are interpolated."""
    values = np.array([*np.linspace(1.0, 2.0, 8 - failed), *[np.inf] * failed])
    found = median(values)
    assert found.value == (np.median(values) if failed < 4 else np.inf)
    assert found.low <= 2.0 or found.low == np.inf
    assert found.high < 100.0 or found.high == np.inf


def test_duels_are_in_the_same_samples():
    base = RANDOM.lognormal(0.0, 2.0, 400)
    (duel,) = statistics.duels({'a': base * 1.01, 'b': base})  # b wins though they overlap
    assert (duel.winner, duel.loser, duel.probability.value) == ('b', 'a', 1.0)
    assert 0.98 < duel.probability.low < 1.0 == duel.probability.high


def test_wilsons_interval_of_a_duel():
    ours = np.zeros(100)
    theirs = np.where(np.arange(100) < 80, 1.0, -1.0)
    (duel,) = statistics.duels({'ours': ours, 'theirs': theirs})
    # Wilson (1927): (p + z^2/2n -+ z sqrt(p q / n + z^2 / 4 n^2)) / (1 + z^2 / n)
    z, p, n = 1.959964, 0.8, 100
    middle, half = p + z**2 / 2 / n, z * math.sqrt(p * (1 - p) / n + z**2 / 4 / n**2)
    expected = [(middle + sign * half) / (1 + z**2 / n) for sign in (-1, 1)]
    assert duel.winner == 'ours' and duel.probability.value == pytest.approx(0.8)
    assert [duel.probability.low, duel.probability.high] == pytest.approx(expected, abs=1e-6)


def test_p_of_a_duel_is_that_of_the_sign_test_without_ties():
    ours = np.zeros(12)
    theirs = np.array([1.0] * 9 + [-1.0] + [0.0] * 2)
    (duel,) = statistics.duels({'ours': ours, 'theirs': theirs})
    assert duel.p == pytest.approx(2 * (1 + 10) / 2**10)  # 0 or 1 of 10, both ways
    (tie,) = statistics.duels({'a': ours, 'b': ours})
    assert tie.p == 1.0


def test_holms_correction():
    found = statistics.corrected([0.01, 0.04, 0.03, 0.005])
    assert found == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.corrected([0.5, 0.9]) == [1.0, 1.0] and statistics.corrected([]) == []
    # of 20 true null hypotheses none is rejected in 95 of 100 cases
    tests = [min(statistics.corrected(row)) < 0.05 for row in RANDOM.random((2000, 20))]
    assert 0.035 < np.mean(tests) < 0.065


def test_the_interval_between_sections_covers_the_median_as_often_as_it_says():
    section = np.tile(np.arange(8), 8)  # in turn, as the scrambles of a study
    covered, by_bootstrap = [], []
    for _ in range(400):
        # what one sequence has in common, so that its runs are not independent
        values = np.exp(RANDOM.normal(size=64) + RANDOM.normal(size=8)[section])
        found = statistics.sectioned(values, section)
        covered.append(found.low <= 1.0 <= found.high)
        by_bootstrap.append(statistics.median(values))
        assert found.value == np.median(values)
    assert 0.92 < np.mean(covered) < 0.98
    assert np.mean([one.low <= 1.0 <= one.high for one in by_bootstrap]) < 0.85


NUMBERS = 12  # that are uncertain
LAWS_OF_NUMBERS = {  # functions of uniform numbers, with their medians
    'a sum': (lambda u: norm.ppf(u) @ np.linspace(3.0, 0.3, NUMBERS), 0.0),
    'the largest': (lambda u: u.max(axis=1), 0.5 ** (1.0 / NUMBERS)),
    'a sum of squares': (lambda u: np.sum(norm.ppf(u) ** 2, axis=1), chi2.median(NUMBERS)),
    'a product': (lambda u: (u[:, 0] - 0.5) * (u[:, 5] - 0.5), 0.0),
}


@pytest.mark.parametrize('name', LAWS_OF_NUMBERS)
def test_intervals_for_independent_runs_are_not_too_narrow_for_a_sobol_sequence(name):
    """Its points are spread more evenly; those of several scrambles tell how much."""
    function, middle = LAWS_OF_NUMBERS[name]
    found = []
    for seed in range(100):
        one = replace(study.parse('scenarios: [paper_circle]\nlaws: [smc]\n'), seed=seed)
        values = function(np.maximum(sample(one, NUMBERS, 0, 64), 1e-12))
        [duel] = statistics.duels({'ours': values, 'middle': np.full(64, middle)})
        eight = function(np.maximum(sample(replace(one, scrambles=8), NUMBERS, 0, 64), 1e-12))
        estimates = (
            (statistics.median(values), middle),
            (duel.probability, 0.5),
            (statistics.sectioned(eight, np.arange(64) % 8), middle),
        )
        found.append([each.low <= true <= each.high for each, true in estimates])
    by_bootstrap, by_wilson, by_scrambles = np.mean(found, axis=0)
    assert min(by_bootstrap, by_wilson) >= 0.95 and by_scrambles >= 0.9


def test_sections_with_failures():
    values, section = np.array([1.0, 2.0, np.inf, np.inf]), np.array([0, 0, 1, 1])
    found = statistics.sectioned(values, section)
    assert found.low == 1.5 and found.high == math.inf
    exact = statistics.sectioned(np.array([1.0, 3.0, 2.0, 4.0]), section)
    # Student's t with one degree of freedom, 12.706; sections 2 and 3 about 2.5
    assert exact.high - exact.value == pytest.approx(
        12.7062 * math.sqrt(0.5) / math.sqrt(2.0), 1e-5
    )


def test_failures_of_both_are_a_tie_and_of_one_a_defeat():
    ours = np.array([1.0, np.inf, np.inf, 1.0])
    theirs = np.array([np.inf, np.inf, np.inf, np.inf])
    (duel,) = statistics.duels({'ours': ours, 'theirs': theirs})
    assert (duel.winner, duel.probability.value) == ('ours', 0.75)
    (tie,) = statistics.duels({'a': theirs, 'b': theirs})
    assert tie.probability.value == 0.5


def test_drivers_are_found_and_the_interval_covers_the_partial_rank_correlation():
    covered, count = [], 400
    for _ in range(100):
        cause, other, noise = RANDOM.normal(size=(3, count))
        other = 0.8 * cause + 0.6 * other  # it goes with the cause, and does nothing
        found = statistics.drivers({'other': other, 'cause': cause}, np.exp(cause + noise))
        assert found[0].parameter == 'cause'
        # of normal numbers, by 6 / pi asin(r / 2) of each pair, then the partial one of ranks
        by_pair = [6.0 / math.pi * math.asin(r / 2.0) for r in (0.5**0.5, 0.8 * 0.5**0.5, 0.8)]
        cy, oy, co = by_pair
        expected = (cy - oy * co) / math.sqrt((1.0 - oy**2) * (1.0 - co**2))
        nothing = (oy - cy * co) / math.sqrt((1.0 - cy**2) * (1.0 - co**2))
        for driver, true in zip(found, (expected, nothing), strict=True):
            assert abs(driver.correlation.value - true) < 0.3
            covered.append(driver.correlation.low <= true <= driver.correlation.high)
    assert np.mean(covered) > 0.88 and abs(nothing) < 0.05 < 0.45 < expected


def test_drivers_of_nothing():
    numbers = np.arange(80.0)
    assert statistics.drivers({'a': numbers}, np.full(80, np.inf)) == []
    assert statistics.drivers({'a': np.ones(80)}, numbers) == []
    assert statistics.drivers({'a': numbers[:63]}, numbers[:63]) == []
    (sure,) = statistics.drivers({'a': numbers}, numbers**3)
    assert sure.correlation.value == pytest.approx(1.0) and sure.correlation.low > 0.9
    sixth = 4.83 + 1e-5 * numbers / 80.0  # nobody sees what differs
    assert statistics.drivers({'a': numbers}, sixth) == []
    assert statistics.drivers({'a': numbers, 'again': 2.0 * numbers}, numbers**3) == []


def test_parameters_that_go_together_in_few_samples_are_told():
    one = replace(study.parse('scenarios: [paper_circle]\nlaws: [smc]\n'), seed=1)
    for runs, told in ((32, True), (256, False)):
        points = sample(one, NUMBERS, 0, runs)
        said = statistics.together({f'p{k}': column for k, column in enumerate(points.T)})
        assert bool(said) == told, said
    assert statistics.together({'a': np.arange(9.0)}) == ''


def test_a_distribution_ends_below_one_where_runs_failed():
    values, shares = statistics.distribution(np.array([3.0, 1.0, np.inf, 2.0]))
    assert values.tolist() == [1.0, 2.0, 3.0] and shares.tolist() == [0.25, 0.5, 0.75]


@pytest.fixture(scope='module')
def planned():
    return plan(study.parse('scenarios: [paper_circle]\nlaws: [smc, s_smc]\nruns: 4\n'))


@pytest.fixture(scope='module')
def results():
    def law(error):
        medians = (
            Estimate(error, 0.5 * error, math.inf),
            *[Estimate(1.0, 0.5, 2.0)] * len(OTHERS),
        )
        reasons = {'<b>driven</b> & out': 1}
        errors = np.array([error, 2.0 * error, np.inf])
        return LawResult({'ok': 2, 'failed': 1}, reasons, medians, (), errors)

    laws = {'smc': law(10.0), '<i>$x_1&': law(20.0)}
    duels = (Duel('smc', '<i>$x_1&', Estimate(0.75, 0.5, 0.9), 0.25),)
    return {'paper_circle': ScenarioResult((ERRORS[0], *OTHERS), laws, duels)}


def test_the_text_tells_medians_duels_and_failures(planned, results):
    found = summary.text(planned, results)
    assert re.search(r'\n  smc +2/3 +10\.00 \[5\.000, failed\]\n', found)
    assert '  smc     <i>$x_1&  0.750 [0.500, 0.900]  0.25, open' in found
    assert "1 pairs, p of the sign test with Holm's correction" in found
    assert '  smc, 1 runs: <b>driven</b> & out' in found
    assert all(len(line) < 150 for line in found.splitlines())


def test_the_csv_reads_back(results):
    rows = list(csv.DictReader(io.StringIO(summary.table(results))))
    first = rows[0]
    assert (first['law'], first['unit'], float(first['value'])) == ('smc', 'µm', 10.0)
    assert float(first['high']) == math.inf and first['runs'] == '3'
    assert {row['quantity'] for row in rows} >= {
        'median of end-effector error, rms',
        'runs failed',
        'probability of a smaller error than <i>$x_1&',
        'p of a smaller error than <i>$x_1&, corrected by Holm',
    }


def test_latex_is_escaped(results):
    found = summary.latex(results)
    errors, effort = latex_tables(found)
    assert errors[0] == 'lrr' and errors[1][2] == 'end-effector error, rms [µm]'
    assert [row[:2] for row in errors[2:]] == [['SMC', '2/3'], ['<i>$x_1&', '2/3']]
    assert effort[0] == 'lrrrrr' and effort[2][1] == '1.000 [0.5000, 2.000]'


def test_the_page_is_escaped_and_closed(planned, results):
    open_tags, seen = [], []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attributes):
            seen.append(tag)
            if tag not in ('meta', 'img'):
                open_tags.append(tag)

        def handle_endtag(self, tag):
            assert open_tags.pop() == tag

    pictures = picture.draw(results)
    page = summary.page(planned, results, pictures['png'])
    Reader().feed(page)
    assert not open_tags and not {'i', 'b', 'script'} & set(seen) and 'img' in seen
    assert 'http' not in page and '<td>SMC</td>' in page


def test_the_pictures_are_the_same_every_time(results):
    pictures = picture.draw(results)
    assert pictures['png'].startswith(b'\x89PNG') and pictures['pdf'].startswith(b'%PDF')
    assert pictures == picture.draw(results)


def test_labels_keep_their_order_and_distance_near_their_curves():
    wanted = np.array([0.1, 0.5, 0.51, 0.52, 0.99, 1.0])
    places = picture.spread(wanted, 0.05)
    assert (np.diff(places) > 0.05 - 1e-12).all() and places[0] >= 0.0 and places[-1] <= 1.0
    np.testing.assert_allclose(places, [0.1, 0.46, 0.51, 0.56, 0.95, 1.0])
    np.testing.assert_allclose(picture.spread(np.full(5, 0.9), 0.5), np.linspace(0, 1, 5))
    assert picture.spread(np.zeros(0), 0.1).size == 0


def test_a_law_is_named_at_its_curve(monkeypatch):
    found = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: found.append(figure))
    errors = {'s_fotsmc': np.array([3.0, 1.0, 2.0]), 'pid': np.full(3, np.inf)}
    laws = {law: SimpleNamespace(errors=values) for law, values in errors.items()}
    quantity = SimpleNamespace(name='error', unit='µm')
    limit = {'limit': SimpleNamespace(values=np.array([0.5, 0.0, 0.2]))}
    for levels in ({}, limit):
        result = SimpleNamespace(laws=laws, quantities=[quantity], levels=levels)
        picture.draw({'paper_circle': result})
    *_, drawn = found[-1].axes[0].lines
    assert drawn.get_label() == 'limit'
    np.testing.assert_array_equal(np.unique(drawn.get_ydata()), [0.2, 0.5])
    assert found[-1].axes[0].get_legend() is not None
    (axes,) = found[0].axes
    assert [(t.get_text(), t.get_fontweight()) for t in axes.texts] == [
        ('S-FOTSMC', 'bold'),
        ('PID (no run)', 'normal'),
    ]
    ours, other = axes.lines
    assert axes.texts[0].xy == (1.0, 3.0) and ours.get_linewidth() > other.get_linewidth()
    np.testing.assert_array_equal(ours.get_ydata(), [1.0, 1.0, 2.0, 3.0])
    assert axes.get_legend() is None
