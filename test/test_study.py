"""Studies: their files, their samples, and the rows that follow from them."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from parallel_robot.cli.command_line import main
from parallel_robot.studies.least_errors import is_study
from parallel_robot.studies.sweep import store, study, uncertainty
from parallel_robot.studies.sweep.plan import plan, sample, sampling
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_sim.configuration import configure

HEAD = 'scenarios: [paper_circle]\nlaws: [smc]\nruns: 4\n'


def uncertain(line):
    return f'{HEAD}uncertainty: {{{line}}}\n'


HOSTILE = {
    'nothing': ('', 'must hold keys and values'),
    'a list': ('[1, 2]', 'must hold keys and values'),
    'no YAML': ('a: [', 'cannot be read as YAML'),
    'a tab': ('\tscenarios: 5', 'cannot be read as YAML'),
    'deep': ('a: ' + '[' * 5000, 'cannot be read as YAML'),
    'bomb': ('a: &a [1,1]\nb: &b [*a,*a]\n' * 9, 'cannot be read as YAML'),
    'binary': ('a: !!binary aGVsbG8=', 'cannot be read as YAML'),
    'object': ('a: !!python/object/apply:os.system [ls]', 'cannot be read as YAML'),
    'NaN': (HEAD + 'duration: .nan', 'study.yaml, line 4: duration must be finite, not nan'),
    'infinite': (
        uncertain('true_robot.m1: {distribution: uniform, low: 1, high: .inf}'),
        'study.yaml, line 4: uncertainty.true_robot.m1.high must be finite, not inf',
    ),
    'infinite choice': (
        uncertain('circle.radius: {distribution: choice, values: [0.1, -.inf]}'),
        'uncertainty.circle.radius.values[1] must be finite, not -inf',
    ),
    'infinite in a group': (
        HEAD + 'set:\n  friction:\n    viscous: [1.0, .nan, 1.0]',
        'study.yaml, line 6: set.friction.viscous[1] must be finite, not nan',
    ),
    'negative masses': (
        uncertain('true_robot.m1: {distribution: uniform, relative: 2.5}'),
        'study.yaml, line 4: uncertainty: true_robot.m1 must be positive, not -7.68',
    ),
    'an end below a range': (
        uncertain('sensor.delay: {distribution: uniform, low: -0.1, high: 0.01}'),
        'uncertainty: sensor.delay must be from 0 to',
    ),
    'an end above a range': (
        uncertain('sensor.delay: {distribution: log_uniform, low: 0.01, high: 10}'),
        'uncertainty: sensor.delay must be from 0 to',
    ),
    'an end of one entry': (
        uncertain('friction.viscous: {distribution: uniform, relative: 1.5}'),
        'uncertainty: friction.viscous[0] must be at least 0',
    ),
    'a mean out of range': (
        uncertain('true_robot.m1: {distribution: normal, mean: -3, std: 1}'),
        'uncertainty: true_robot.m1 must be positive, not -3',
    ),
    'a gain of a variant': (
        'scenarios: [paper_circle]\nruns: 3\nlaws:\n  smc: {}\n  soft: {law: smc, z: a}',
        'study.yaml, line 5: smc.z must be a number',
    ),
    'law of a variant': (
        'scenarios: [paper_circle]\nruns: 3\nlaws:\n  smc: {}\n  soft:\n    law: smk',
        "study.yaml, line 5: unknown law 'smk'",
    ),
    'a law of a list': (
        'scenarios: [paper_circle]\nruns: 3\nlaws: [smc, smk]',
        "study.yaml, line 3: unknown law 'smk'",
    ),
    'a scenario of a list': (
        'runs: 3\nscenarios: [circel]\nlaws: [smc]',
        "study.yaml, line 2: unknown scenario 'circel'",
    ),
    'the line of a value': (HEAD + 'seed: 3\nmethod: sobal', 'study.yaml, line 5: unknown value'),
    'unknown key': (HEAD + 'rums: 5', "unknown key 'rums'; did you mean 'runs'?"),
    'no laws': ('scenarios: [paper_circle]\nruns: 3', 'laws is missing'),
    'laws of numbers': ('scenarios: [paper_circle]\nlaws: [1]\nruns: 3', 'laws[0] must be text'),
    'laws as text': ('scenarios: [paper_circle]\nlaws: smc\nruns: 3', 'laws must be a list'),
    'no law at all': ('scenarios: [paper_circle]\nlaws: []\nruns: 3', 'laws must name at least'),
    'a law twice': ('scenarios: [paper_circle]\nlaws: [smc, smc]\nruns: 3', 'names smc twice'),
    'unknown law': ('scenarios: [paper_circle]\nlaws: [smk]\nruns: 3', "unknown law 'smk'"),
    'unknown gain': ('scenarios: [paper_circle]\nlaws: {smc: {q: 1}}\nruns: 3', "'smc.q'"),
    'bad gain': ('scenarios: [paper_circle]\nlaws: {smc: {z: a}}\nruns: 3', 'smc.z must be a num'),
    'one name twice': (
        'scenarios: [a/eight.yaml, ./eight.yml]\nlaws: [smc]\nruns: 3',
        'scenarios: two are called eight; rename a file',
    ),
    'unknown scenario': ('scenarios: [circel]\nlaws: [smc]\nruns: 3', "scenario 'circel'"),
    'no runs': ('scenarios: [paper_circle]\nlaws: [smc]\nruns: 0', 'runs must be from 1'),
    'half a run': ('scenarios: [paper_circle]\nlaws: [smc]\nruns: 1.5', 'runs must be a whole'),
    'no end': (HEAD + 'duration: 0', 'duration must be positive'),
    'too long': (HEAD + 'duration: 1.0e+9', 'duration'),
    'method': (HEAD + 'method: sobal', "did you mean 'sobol'?"),
    'seed': (HEAD + 'seed: -1', 'seed must be from 0'),
    'set a list': (HEAD + 'set: [1]', 'set must hold keys and values'),
    'set unknown': (HEAD + 'set: {friction.viscos: 1}', "did you mean 'friction.viscous'?"),
    'set code': (HEAD + 'set: {custom_laws: [a.py]}', 'on the command line alone'),
    'set law': (HEAD + 'set: {law: smc}', 'law cannot stand there'),
    'both': (
        HEAD + 'set: {friction.viscous: 1}\n'
        'uncertainty: {friction.viscous: {distribution: uniform, relative: 0.1}}',
        'both in set and in uncertainty',
    ),
    'uncertain code': (
        uncertain('custom_laws: {distribution: choice, values: [a]}'),
        'on the command line alone',
    ),
    'of a law and uncertain': (
        'scenarios: [paper_circle]\nruns: 3\nlaws: {smc: {z: 3.0}}\n'
        'uncertainty: {smc.z: {distribution: uniform, relative: 0.1}}',
        'smc.z is both in laws and in uncertainty',
    ),
    'estimator of a law': (
        'scenarios: [paper_circle]\nruns: 3\nlaws: {smc: {estimator: {kind: kalmann}}}',
        "unknown value of estimator.kind 'kalmann'",
    ),
    'scrambles of none': (HEAD + 'method: random\nscrambles: 2', 'method must be sobol'),
    'runs and scrambles': (HEAD + 'scrambles: 5', 'runs must be a multiple of the 5 scrambles'),
    'no distribution': (uncertain('robot.m1: {relative: 0.2}'), 'unknown distribution of uncer'),
    'a number': (uncertain('robot.m1: 0.2'), 'must be {distribution: ...'),
    'distribution': (
        uncertain('robot.m1: {distribution: unifrom, relative: 0.2}'),
        "did you mean 'uniform'?",
    ),
    'both forms': (
        uncertain('robot.m1: {distribution: uniform, relative: 0.2, low: 1, high: 2}'),
        'uniform takes low and high, or relative, or factor, not relative, low, high',
    ),
    'half a form': (uncertain('robot.m1: {distribution: uniform, low: 1}'), 'takes low and high'),
    'exchanged': (
        uncertain('robot.m1: {distribution: uniform, low: 2, high: 1}'),
        'low must be below high, not 2 and 1',
    ),
    'an entry exchanged': (
        uncertain('plant.initial_pose: {distribution: uniform, low: [0, 2, 1], high: [1, 1, 2]}'),
        'low must be below high, not 2 and 1',
    ),
    'lists of two lengths': (
        uncertain('plant.initial_pose: {distribution: uniform, low: [0, 0], high: [1, 1, 2]}'),
        'the lists low and high must have one length',
    ),
    'a list too short': (
        uncertain('plant.initial_pose: {distribution: uniform, low: [0, 0], high: [1, 1]}'),
        'no list of 2 numbers',
    ),
    'a list for a number': (
        uncertain('robot.m1: {distribution: uniform, low: [1], high: [2]}'),
        'no list of 1 numbers',
    ),
    'log of 0': (
        uncertain('robot.m1: {distribution: log_uniform, low: 0, high: 1}'),
        'log_uniform needs positive values',
    ),
    'no width': (
        uncertain('robot.m1: {distribution: normal, relative: 0}'),
        'relative must be positive',
    ),
    'share of 0': (
        uncertain('disturbance.amplitude: {distribution: uniform, relative: 0.1}'),
        'a share of 0 is 0',
    ),
    'no choice': (uncertain('robot.m1: {distribution: choice, values: []}'), 'a list of values'),
    'wrong choice': (
        uncertain('plant.integrator: {distribution: choice, values: [ode3, ode5]}'),
        "did you mean 'ode3'?",
    ),
    'uniform text': (
        uncertain('plant.integrator: {distribution: uniform, relative: 0.1}'),
        'uniform is for numbers',
    ),
    'uniform whole number': (
        uncertain('plant.substeps: {distribution: uniform, low: 1, high: 4}'),
        'plant.substeps must be a whole number',
    ),
    'unknown parameter': (
        uncertain('robot.m4: {distribution: uniform, low: 1, high: 4}'),
        "unknown parameter 'robot.m4'",
    ),
    'common text': (
        uncertain('friction.viscous: {distribution: uniform, relative: 0.1, common: 5}'),
        'common must be true or false',
    ),
}


@pytest.mark.parametrize('name', HOSTILE)
def test_a_bad_study_costs_one_line_and_leaves_nothing(name, tmp_path, capsys):
    text, message = HOSTILE[name]
    file = tmp_path / 'study.yaml'
    file.write_text(text)
    assert main(['sweep', str(file), '--out', str(tmp_path / 'out')]) == 2
    out, error = capsys.readouterr()
    assert message in error and error.count('\n') == 1 and not out
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['robustnes'], "unknown study 'robustnes'; did you mean 'robustness'?"),
        (['missing.yaml'], 'cannot read the study missing.yaml: No such file'),
        (['.'], "unknown study '.'"),
        (['./'], 'cannot read the study .: Is a directory'),
        (['robustness', '--runs', '0'], '--runs must be from 1'),
        (['robustness', '--workers', '0'], '--workers must be from 1'),
        (['robustness', '--workers', '2', '--scheduler', 'x'], '--workers is for processes'),
        (['robustness', '--set', 'law=smc'], '--set: law cannot stand there'),
        (['robustness', '--set', 'true_robot.m1=3'], '--set true_robot.m1: it is uncertain'),
        (['robustness', '--laws', 'smc', 'pdi'], "unknown law 'pdi'; did you mean 'pid'?"),
        (['robustness', '--laws', 'smc', 'smc'], 'laws names smc twice'),
        (['robustness', '--set', 'custom_laws=[nowhere.py]'], 'nowhere.py'),
    ],
    ids=' '.join,
)
def test_bad_arguments_cost_one_line(words, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['sweep', *words, '--out', 'out']) == 2
    out, error = capsys.readouterr()
    assert message in error and error.count('\n') == 1 and not out
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_not_text(tmp_path, capsys):
    (tmp_path / 'study.yaml').write_bytes(b'\xff\xfe\x00')
    assert main(['sweep', str(tmp_path / 'study.yaml'), '--out', str(tmp_path / 'out')]) == 2
    assert 'is not text in UTF-8' in capsys.readouterr().err


BASE = """
scenarios: [own.yaml]
laws: {smc: {z: 20.0}, soft: {law: smc, z: 10.0}, pid: {}}
runs: 4
seed: 3
set: {plant: {substeps: 2}, friction.viscous: [1.0, 1.0, 1.0]}
uncertainty:
  true_robot.m1: {distribution: uniform, relative: 0.2}
  true_robot.m2: {distribution: uniform, relative: 0.2}
"""
DERIVED = """
base: ../base.yaml
laws: [soft, s_fotsmc]
runs: 8
set: {true_robot.m1: 2.5}
uncertainty:
  friction.viscous: {distribution: uniform, relative: 0.1}
"""


@pytest.fixture
def derived(tmp_path):
    """A study in another folder than its base, which names a scenario beside it."""
    (tmp_path / 'base.yaml').write_text(BASE)
    (tmp_path / 'own.yaml').write_text('base: paper_circle\n')
    (tmp_path / 'sub').mkdir()
    file = tmp_path / 'sub' / 'derived.yaml'
    file.write_text(DERIVED)
    return file


def test_a_study_says_what_differs_from_its_base(derived, tmp_path):
    found = study.parse(derived.read_text(), str(derived), derived.parent)
    assert found.scenarios == (str(tmp_path / 'own.yaml'),)
    laws = [(law.name, law.law, law.gains) for law in found.laws]
    assert laws == [('soft', 'smc', {'smc.z': 10.0}), ('s_fotsmc', 's_fotsmc', {})]
    assert (found.runs, found.seed) == (8, 3)
    assert found.fixed == {'plant.substeps': 2, 'true_robot.m1': 2.5}
    assert [each.key for each in found.uncertainties] == ['true_robot.m2', 'friction.viscous']
    files = {key: Path(place.file).name for key, place in found.places.items()}
    assert (files['seed'], files['runs'], files['laws']) == ('base.yaml', *2 * ['derived.yaml'])
    assert 'laws.soft.z' not in files
    again = study.parse(found.text)  # what a sweep keeps stands alone
    assert again.text == found.text and replace(again, places={}) == replace(found, places={})
    assert plan(found).count == 2 * 8 and is_study(str(derived))
    assert not is_study(str(tmp_path / 'own.yaml'))


def test_two_lines_compare_with_the_laws_of_a_study():
    text = 'base: laboratory\nlaws: [pid_tuned, adrc]\n'
    (tuned, adrc), laboratory = (
        study.parse(text).laws,
        study.parse(study.read(study.file_of('laboratory'))),
    )
    assert tuned in laboratory.laws and adrc.gains == {}
    alone = study.parse(study.read(study.file_of('laboratory')), laws=['pid_tuned', 'adrc'])
    assert alone.laws == (tuned, adrc) and study.parse(alone.text).laws == alone.laws


@pytest.mark.parametrize(
    ('line', 'message'),
    [
        ('base: 5', 'derived.yaml, line 2: base must be'),
        ('base: laboratorie', "unknown study 'laboratorie'; did you mean 'laboratory'?"),
        ('base: none.yaml', 'sub/none.yaml: No such file'),
        ('base: derived.yaml', 'the bases of a study lead in a circle: derived.yaml -> derived'),
        ('base: ../own.yaml', "unknown study 'paper_circle'"),  # of a scenario
        ('base: ../base.yaml\nseed: -1', 'derived.yaml, line 3: seed must be'),
    ],
)
def test_a_wrong_base_costs_one_line(line, message, derived, capsys):
    derived.write_text(DERIVED.replace('base: ../base.yaml', line))
    assert main(['sweep', str(derived), '--out', str(derived.with_name('out'))]) == 2
    out, error = capsys.readouterr()
    assert message in error and error.count('\n') == 1 and not out


POINTS = np.random.default_rng(0).random(2000)
PAGE = (Path(__file__).parents[1] / 'docs' / 'studies.md').read_text()


def test_the_study_in_the_documentation_can_be_planned():
    text, short = re.findall(r'```yaml\n(.*?)```', PAGE, re.DOTALL)
    assert [law.name for law in study.parse(short).laws] == ['my_law', 's_fotsmc', 'pid_tuned']
    found = plan(study.parse(text))
    assert found.count == 2 * 4 * 256 and len(found.row(0).drawn) == 9


def test_every_column_distribution_and_key_is_documented():
    columns = set(store.IDENTITY) | {*store.COLUMNS} - {'duration_s'}
    for word in (*columns, *uncertainty.FORMS):
        assert f'`{word}`' in PAGE


LAWS_OF_CHANCE = {
    'uniform': ({'low': 2.0, 'high': 5.0}, stats.uniform(2.0, 3.0)),
    'uniform relative': ({'relative': 0.25}, stats.uniform(3.0, 2.0)),
    'uniform factor': ({'factor': [0.5, 2.0]}, stats.uniform(2.0, 6.0)),
    'log_uniform': ({'low': 0.1, 'high': 10.0}, stats.loguniform(0.1, 10.0)),
    'log_uniform factor': ({'factor': [0.5, 2.0]}, stats.loguniform(2.0, 8.0)),
    'normal': ({'mean': 1.0, 'std': 3.0}, stats.norm(1.0, 3.0)),
    'normal std': ({'std': 3.0}, stats.norm(4.0, 3.0)),
    'normal relative': ({'relative': 0.5}, stats.norm(4.0, 2.0)),
}


@pytest.mark.parametrize('name', LAWS_OF_CHANCE)
def test_values_have_the_distribution_that_was_asked_for(name):
    given, expected = LAWS_OF_CHANCE[name]
    entry = uncertainty.parse('key', {'distribution': name.split()[0], **given})
    drawn = [uncertainty.value(entry, 4.0, [point]) for point in POINTS]
    np.testing.assert_allclose(drawn, expected.ppf(POINTS), rtol=1e-9, atol=1e-9)


def test_the_ends_of_the_unit_interval_are_finite():
    entry = uncertainty.parse('key', {'distribution': 'normal', 'mean': 0.0, 'std': 1.0})
    assert abs(uncertainty.value(entry, 0.0, [0.0])) < 10.0
    choice = uncertainty.parse('key', {'distribution': 'choice', 'values': ['a', 'b']})
    drawn = [uncertainty.value(choice, 'a', [point]) for point in (0.0, 0.49, 0.5, 1.0 - 2**-53)]
    assert drawn == ['a', 'a', 'b', 'b']


def test_lists_have_one_draw_each_or_one_in_common():
    entry = {'distribution': 'uniform', 'relative': 0.5}
    each, common = (uncertainty.parse('key', entry | more) for more in ({}, {'common': True}))
    nominal = [1.0, 2.0, 4.0]
    assert uncertainty.dimensions(each, nominal) == 3
    assert uncertainty.value(each, nominal, [0.0, 0.5, 0.75]) == [0.5, 2.0, 5.0]
    assert uncertainty.dimensions(common, nominal) == 1
    assert uncertainty.value(common, nominal, [0.75]) == [1.25, 2.5, 5.0]
    assert uncertainty.columns(common, nominal, [1.25, 2.5, 5.0]) == {'key': 1.25}


def test_entries_of_a_list_may_have_ranges_of_their_own():
    given = {'distribution': 'uniform', 'low': [0.5, -1.0, 1.5], 'high': [0.6, 1.0, 1.6]}
    entry, nominal = uncertainty.parse('key', given), [0.55, 0.0, 1.55]
    assert uncertainty.dimensions(entry, nominal) == 3
    assert uncertainty.value(entry, nominal, [0.0, 0.75, 0.5]) == pytest.approx([0.5, 0.5, 1.55])
    assert uncertainty.extremes(entry, nominal)[0] == given['low']
    spread = uncertainty.parse('key', {'distribution': 'normal', 'std': [0.1, 1.0, 2.0]})
    drawn = uncertainty.value(spread, nominal, [stats.norm.cdf(1.0)] * 3)
    assert drawn == pytest.approx([0.65, 1.0, 3.55])


STUDY = """
scenarios: [paper_circle, axes_step]
laws: {smc: {z: 22.0}, soft: {law: smc, z: 5.0}}
runs: 8
seed: 7
duration: 0.1
set: {safety: {min_sin_psi: 0.04}}
uncertainty:
  friction.viscous: {distribution: log_uniform, factor: [0.5, 2.0]}
  plant.integrator: {distribution: choice, values: [ode3, rk4]}
  plant.substeps: {distribution: choice, values: [1, 2]}
"""


def planned(text=STUDY, **changes):
    for old, new in changes.items():
        text = text.replace(old, new)
    return plan(study.parse(text))


def study_of(scenarios='[paper_circle]', **more):
    text = STUDY.replace('[paper_circle, axes_step]', scenarios)
    return planned(text, **more)


def test_a_law_may_have_a_controller_of_its_own():
    entry = 'laws: {smc: {z: 22.0, estimator: {kind: filter}, estimator.bandwidth: 80}, soft'
    text = STUDY.replace('set: {safety: {min_sin_psi: 0.04}}', '')
    found = planned(text, **{'laws: {smc: {z: 22.0}, soft': entry})
    own, other = (case.nominal for case in found.cases[:2])
    assert (own['estimator.kind'], own['estimator.bandwidth']) == ('filter', 80.0)
    assert (own['smc.z'], other['smc.z'], other['estimator.kind']) == (22.0, 5.0, 'auto')


@pytest.mark.parametrize('first', ['own', 'other'])
def test_an_uncertain_gain_is_checked_beside_the_gains_of_each_law(first):
    """Laws of a scenario are checked as one, but where their gains may decide."""
    laws = {
        'own': '{law: continuous_twisting, k4: 11}',
        'other': '{law: continuous_twisting, k4: 21}',
    }
    second = ({*laws} - {first}).pop()
    text = (
        f'scenarios: [paper_circle]\nlaws: {{{first}: {laws[first]}, {second}: {laws[second]}}}\n'
        'runs: 2\nuncertainty:\n'
        '  continuous_twisting.k3: {distribution: uniform, low: 20, high: 30}\n'
    )
    with pytest.raises(InputError, match='k3 must be above k4 = 21, not 20'):
        planned(text)
    assert planned(text.replace('k4: 21', 'k4: 19')).count == 4


def test_rows_are_counted_sample_by_sample_and_paired():
    found = planned(STUDY.replace('set: {safety: {min_sin_psi: 0.04}}', ''))
    rows = [found.row(number) for number in range(found.count)]
    assert [row.row for row in rows] == list(range(32))
    assert [row.sample for row in rows] == [k // 4 for k in range(32)]
    assert [(row.scenario, row.law) for row in rows[:4]] == [
        ('paper_circle', 'smc'),
        ('paper_circle', 'soft'),
        ('axes_step', 'smc'),
        ('axes_step', 'soft'),
    ]
    for a, b in zip(rows[::2], rows[1::2], strict=True):
        assert a.drawn == b.drawn and a.seed == b.seed
        assert (a.overrides['smc.z'], b.overrides['smc.z']) == (22.0, 5.0)
        assert a.overrides['law'] == b.overrides['law'] == 'smc'
    assert len({row.seed for row in rows}) == 8
    assert len({row.drawn['friction.viscous[0]'] for row in rows}) == 16
    assert len(rows[0].drawn) == 5 and len(rows[2].drawn) == 7  # three joints, five axes
    assert set(found.columns()) == set(rows[2].drawn)
    assert found.columns()['plant.substeps'] and not found.columns()['plant.integrator']


@pytest.mark.parametrize('method', ['sobol', 'random', 'sobol\nscrambles: 2'])
def test_more_runs_only_add_samples_and_blocks_are_parts_of_the_whole(method):
    few, many = (study_of(**{'runs: 8': f'runs: {n}\nmethod: {method}'}) for n in (8, 30))
    blocks = np.concatenate([sample(many.study, 5, k, 5) for k in range(0, 30, 5)])
    np.testing.assert_array_equal(blocks, sample(many.study, 5, 0, 30))
    assert ((blocks >= 0.0) & (blocks < 1.0)).all() and len(np.unique(blocks)) == 150
    assert [few.row(n) for n in range(few.count)] == [many.row(n) for n in range(few.count)]
    assert many.rows(1, 3, 4) == [many.row(2 * k + 1) for k in range(3, 7)]


def test_the_seed_changes_samples_and_seeds():
    a, b = study_of().row(3), study_of(**{'seed: 7': 'seed: 8'}).row(3)
    assert a.seed != b.seed and a.drawn != b.drawn


def test_sobol_fills_the_cube_evenly():
    points = sample(study_of().study, 3, 0, 64)
    for column in points.T:
        assert sorted(np.floor(64 * column)) == list(range(64))


def test_each_scramble_is_a_sobol_sequence_of_its_own():
    one, four = study_of().study, study_of(**{'runs: 8': 'runs: 8\nscrambles: 4'}).study
    points = sample(four, 3, 0, 256)
    np.testing.assert_array_equal(points[::4], sample(one, 3, 0, 64))  # the first is that of old
    for scramble in range(4):
        for column in points[scramble::4].T:
            assert sorted(np.floor(64 * column)) == list(range(64))
    assert len(np.unique(points)) == points.size
    assert sampling(one) == 'sobol' and sampling(four) == 'sobol, 4 scrambles'


def test_runs_share_the_motion_that_they_have_in_common():
    def motion(**changes):
        keys = {key.replace('__', '.'): value for key, value in changes.items()}
        return configure(resolve('paper_circle', keys)).trajectory

    first, small = motion(), motion(circle__radius=0.02)
    assert motion(true_robot__m1=5.0, law='smc', seed=3) is first  # sampled once for a study
    assert small is not first and motion(robot__m1=5.0) is not first
    assert first.first_pose[0] == pytest.approx(0.52) and small.first_pose[0] == pytest.approx(
        0.51
    )
