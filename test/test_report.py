"""The report: figures, page, and what a browser makes of it."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from bags import WRITERS, content, streams, write_foreign, write_mcap
from browser import requests, started
from geometry import PAPER_START, legs
from matplotlib.figure import Figure

from parallel_robot.analysis.report import page, report_files, runs
from parallel_robot.analysis.report.charts import charts
from parallel_robot.analysis.report.report_files import draw_chart
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.messages import topics

EVIL = '</script><script>alert(1)</script><img src=x onerror=alert(2)>$\\frac{'


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Two laws on the circle, one of them on the line too."""
    folder = tmp_path_factory.mktemp('bags')
    found = []
    for scenario, law in (
        ('paper_circle', 'smc'),
        ('paper_circle', 's_fotsmc'),
        ('paper_line', 's_fotsmc'),
    ):
        found.append(folder / f'{scenario}_{law}')
        words = ['simulate', scenario, '--law', law, '--duration', '2.5', '--out', str(found[-1])]
        assert main(words) == 0
    return found


@pytest.fixture(scope='module')
def foreign(tmp_path_factory, robot):
    """A bag of another tool: no metadata, no telemetry."""
    bag = tmp_path_factory.mktemp('foreign') / 'bag'
    t = np.arange(300)[:, np.newaxis] * 1e-3
    path = PAPER_START + np.hstack([0.02 * np.sin(9 * t), 0.02 * np.cos(9 * t), 0 * t])
    reference = legs(robot, path)[0]
    write_foreign(bag, streams(reference, reference + 1e-4 * np.exp(-t)))
    return bag


@pytest.fixture(scope='module')
def report(bags, tmp_path_factory):
    directory = tmp_path_factory.mktemp('report') / 'new' / 'report'
    assert main(['report', *map(str, bags), '--out', str(directory)]) == 0
    return directory


def refused(words, capsys):
    assert main(['report', *map(str, words)]) == 2
    out, err = capsys.readouterr()
    assert out == '' and err.startswith('parallel_robot report: ') and err.count('\n') == 1
    return err


def test_the_files_say_which_figure_they_are(report):
    common = {'4_x_error', '5_y_error', '6_joint_errors', '7_coupling_errors', '8_torques'}
    stems = {f'figure_{name}_paper_circle' for name in common | {'3_path'}}
    stems |= {f'figure_{name}_paper_line' for name in common | {'9_path'}}
    expected = {f'{stem}.{kind}' for stem in stems for kind in ('pdf', 'svg')}
    assert {path.name for path in report.iterdir()} == expected | {'report.html'}
    assert all(path.read_bytes().startswith(b'%PDF') for path in report.glob('*.pdf'))


def test_the_path_is_round_and_begins_beside_the_circle(bags):
    chart = charts(runs.read_runs(bags)['paper_circle'])[0]
    for panel in chart.panels:
        curves = {curve.label: np.stack([curve.x, curve.y], axis=1) for curve in panel.curves}
        assert list(curves) == ['reference', 'SMC', 'S-FOTSMC', 'start']
        radius = np.linalg.norm(curves['reference'] - [490, 370], axis=1)
        np.testing.assert_allclose(radius, 30, atol=1e-6)
        for name in ('SMC', 'S-FOTSMC', 'start'):
            np.testing.assert_allclose(curves[name][0], [528.4, 368.1], atol=1e-6)


def test_errors_are_reference_less_feedback_in_the_unit_they_name(bags):
    found = runs.read_runs(bags)['paper_circle']
    by_name = {chart.name: chart.panels for chart in charts(found)}
    log = found[0].log
    first = {
        'x_error': (0, -8.4),  # mm: 520 - 528.4
        'y_error': (0, 1.9),
        'joint_errors': (2, 1e3 * (log.reference_position - log.position)[0, 2]),
    }
    for name, (panel, value) in first.items():
        assert by_name[name][panel].curves[0].y[0] == pytest.approx(value, abs=1e-6)
        assert by_name[name][panel].unit == ('mm' if panel == 0 else 'mrad')


def axes_of(chart, directory, monkeypatch, scale):
    """Scales and names of the y axes of a figure."""
    found = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: found.append(figure))
    draw_chart(chart, directory, 'name', scale)
    return {(axes.get_yscale(), axes.get_ylabel()) for axes in found[0].axes}


def test_errors_are_magnitudes_where_a_good_law_would_look_like_zero(bags, tmp_path, monkeypatch):
    both = charts(runs.read_runs(bags)['paper_circle'])
    alone = charts(runs.read_runs(bags[:1])['paper_circle'])  # SMC: 1.1 of 8.4 mm
    linear, log = {('linear', 'x error [mm]')}, {('log', '|x error| [mm]')}
    for found, scale, expected in (
        (both, 'auto', log), (both, 'linear', linear), (alone, 'auto', linear), (alone, 'log', log)
    ):  # fmt: skip
        assert axes_of(found[1], tmp_path, monkeypatch, scale) == expected
        assert found[1].logarithmic(scale) == (expected == log)
        assert not found[0].logarithmic(scale) and not found[-1].logarithmic(scale)
    with pytest.raises(InputError, match="scale 'lin'"):
        both[1].logarithmic('lin')


@pytest.mark.usefixtures('page_alone')
def test_the_scale_of_a_report_can_be_chosen(bags, tmp_path):
    words = ['report', str(bags[1]), '--scale', 'linear', '--out', str(tmp_path / 'out')]
    assert main(words) == 0
    text = (tmp_path / 'out' / 'report.html').read_text(encoding='utf-8')
    assert '"log": true' not in text and '"log": false' in text


def test_figures_fit_the_columns_of_a_paper(report):
    for path in report.glob('*.svg'):
        width = float(ElementTree.parse(path).getroot().get('width').removesuffix('pt')) / 72
        assert width == pytest.approx(3.45) or width == pytest.approx(7.1)


def test_the_same_bags_give_the_same_bytes(bags, tmp_path, report):
    groups = runs.read_runs(bags)
    chart = charts(groups['paper_circle'])[1]
    for path in draw_chart(chart, tmp_path, 'figure_4_x_error_paper_circle'):
        assert path.read_bytes() == (report / path.name).read_bytes()


def test_the_page_is_small_and_names_no_other_file(report):
    text = (report / 'report.html').read_text(encoding='utf-8')
    assert len(text) < 10e6
    own = re.sub(r'<script>.*?</script>', '', text, flags=re.DOTALL)
    assert 'http' not in own.replace('http-equiv', '') and '@import' not in own
    assert not re.search(r'<(link|iframe|object|embed|img)\b|\bsrc=', own)
    assert "default-src 'none'" in own


def test_the_page_shows_claims_differences_and_counts(report):
    text = (report / 'report.html').read_text(encoding='utf-8')
    differing = text.partition('class="text differences"')[2].partition('</table>')[0]
    keys = re.findall(r'<tr class="differs"><td><code>([^<]*)', differing)
    assert keys == ['law', 'scenario', 'trajectory.shape']
    assert 'controller/cross_coupling_error' in text and '>2501<' in text
    assert '1500 equal intervals' in text
    for name in ('p50', 'p99', 'max'):  # of a simulation: one period
        assert f'lag of the torque, {name} [ms]</td><td>1.000<' in text


def test_claims_are_verified_where_the_laws_are_there(bags, tmp_path):
    assert main(['simulate', 'paper_circle', '--law', 's_smc', '--duration', '2.5', '--out',
                 str(tmp_path / 'bag')]) == 0  # fmt: skip
    groups = runs.read_runs([bags[0], tmp_path / 'bag', tmp_path / 'bag'])
    (found,) = groups.values()
    assert [run.label for run in found] == ['SMC', 'S-SMC (bag) #1', 'S-SMC (bag) #2']
    assert len({run.style for run in found}) == 3
    text = page.render(groups, {'paper_circle': charts(found)})
    assert 'S-SMC tracks better than SMC' in text and 'the first counts' in text
    assert 'NFTSMC tracks' not in text


def test_cross_coupling_errors_are_those_of_the_controller(bags):
    (found,) = runs.read_runs(bags[1:2]).values()
    run = found[0]
    error = (run.motion.reference_position - run.motion.position)[::10]
    assert len(run.cross_coupling.time) == len(error) == 251
    np.testing.assert_array_equal(run.cross_coupling.time, run.motion.time[::10])
    coupled = 2 * error - np.roll(error, 1, axis=1) - np.roll(error, -1, axis=1)
    integral = np.cumsum(coupled, axis=0) * 0.01  # coarse: every tenth state
    np.testing.assert_allclose(run.cross_coupling.values, error + 0.9 * integral, atol=6e-4)


def test_a_bag_of_another_tool(foreign, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(report_files, 'FORMATS', ('svg',))
    assert main(['report', str(foreign), '--out', str(tmp_path / 'out')]) == 0
    assert 'no cross-coupling error' in capsys.readouterr().out
    text = (tmp_path / 'out' / 'report.html').read_text(encoding='utf-8')
    assert 'No cross-coupling error is in the bag of unknown' in text
    assert 'says nothing about its experiment' in text


def split(path, messages):
    path.mkdir()
    for k in range(2):
        part = {
            topic: found[k * len(found) // 2 :][: len(found) // 2 + k]
            for topic, found in messages.items()
        }
        write_mcap(path / f'bag_{k}.mcap', part)


def cut(path, messages):
    write_mcap(path, messages, chunk_size=20_000)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])


RECORDINGS = WRITERS | {'split': split, 'cut': cut}


@pytest.fixture(scope='module')
def short(tmp_path_factory):
    """A short run, and its messages by topic."""
    bag = tmp_path_factory.mktemp('short') / 'bag'
    words = ['simulate', 'paper_circle', '--law', 'smc', '--duration', '0.3', '--out', str(bag)]
    assert main(words) == 0
    found = content(bag / 'bag_0.mcap')
    return bag, {topic: found[topic.name] for topic in topics.RECORDED}


@pytest.mark.parametrize('kind', RECORDINGS)
def test_whoever_recorded_it_the_report_is_the_same(kind, short, tmp_path):
    bag, messages = short
    RECORDINGS[kind](tmp_path / 'bag', messages)
    ((expected,),) = runs.read_runs([bag]).values()
    groups = runs.read_runs([tmp_path / 'bag'])
    ((found,),) = groups.values()
    count, coupled = len(found.log.time), len(found.cross_coupling.time)
    assert (count, coupled) == (301, 31) if kind != 'cut' else 100 < count < 250 and coupled > 10
    np.testing.assert_array_equal(found.motion.effort, expected.motion.effort[:count])
    actual = expected.motion.poses.actual[:count]
    np.testing.assert_array_equal(found.motion.poses.actual, actual)
    values = expected.cross_coupling.values[:coupled]
    np.testing.assert_array_equal(found.cross_coupling.values, values)
    assert f'>{count}<' in page.render(groups, {'unknown': charts([found])})


def test_a_cut_and_a_split_bag_are_compared(short, tmp_path, monkeypatch):
    monkeypatch.setattr(report_files, 'FORMATS', ('svg',))
    cut(tmp_path / 'cut', short[1])
    split(tmp_path / 'split', short[1])
    bags = [str(tmp_path / 'cut'), str(tmp_path / 'split')]
    assert main(['report', *bags, '--out', str(tmp_path / 'out')]) == 0
    text = (tmp_path / 'out' / 'report.html').read_text(encoding='utf-8')
    assert 'unknown (cut)' in text and 'unknown (split)' in text


def test_a_broken_topic_of_that_name_is_left_out(foreign, bags, tmp_path, robot):
    t = np.zeros((20, 3))
    reference = legs(robot, PAPER_START + t)[0]
    broken = {topics.CROSS_COUPLING_ERROR: [(5 * 10**9, b'\0\1\0\0' + bytes(12))]}
    write_foreign(tmp_path / 'bag', streams(reference, reference) | broken)
    (found,) = runs.read_runs([tmp_path / 'bag']).values()
    assert found[0].cross_coupling is None


@pytest.fixture(scope='module')
def hostile(bags, tmp_path_factory):
    """A report of runs whose names and values want to be code."""
    groups = runs.read_runs(bags[:2])
    (found,) = groups.values()
    values = {EVIL: EVIL, 'nothing': ['\ud800', '\0']}
    evil = [
        run._replace(
            label=f'{EVIL}{index}',
            log=run.log._replace(law=EVIL, config=run.log.config | values),
        )
        for index, run in enumerate(found)
    ]
    path = tmp_path_factory.mktemp('hostile') / 'report.html'
    drawn = charts(evil)
    path.write_text(page.render({EVIL: evil}, {EVIL: drawn}), encoding='utf-8')
    return path, drawn


def test_names_of_a_bag_are_text(hostile, tmp_path):
    path, drawn = hostile
    text = path.read_text(encoding='utf-8')
    assert '<script>alert' not in text and '<img' not in text
    for data in re.findall(
        r'<script type="application/json"[^>]*>(.*?)</script>', text, re.DOTALL
    ):
        assert '<' not in json.dumps(json.loads(data)['plots'][0]['data'][1]['name'])
    for name in draw_chart(drawn[0], tmp_path, 'path'):
        assert name.stat().st_size > 1000


def test_scenario_names_make_no_paths(bags, tmp_path, monkeypatch):
    monkeypatch.setattr(report_files, 'charts', lambda found: charts(found)[1:2])
    groups = {'../../x y': runs.read_runs(bags[:1])['paper_circle']}
    assert report_files.write(groups, tmp_path / 'out') == 2
    assert (tmp_path / 'out' / 'figure_4_x_error_______x_y.pdf').is_file()
    assert list(tmp_path.iterdir()) == [tmp_path / 'out']


def test_bad_input_leaves_nothing(bags, foreign, tmp_path, capsys, robot):
    out = tmp_path / 'deep' / 'out'
    assert 'does not exist' in refused([bags[0], tmp_path / 'nothing', '--out', out], capsys)
    assert 'up to 8 bags, not 9' in refused([*[bags[0]] * 9, '--out', out], capsys)
    assert 'exists' in refused([bags[0], '--out', tmp_path], capsys)
    angles = np.tile([9.0, 1.0, 1.0], (20, 1))
    other = tmp_path / 'other'
    write_foreign(other, streams(angles, angles))
    assert str(other) in refused([other, '--out', out], capsys)
    assert list(tmp_path.iterdir()) == [other]


def test_a_disk_that_is_full_leaves_nothing(bags, tmp_path, capsys, monkeypatch):
    def full(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('parallel_robot.analysis.report.report_files.draw_chart', full)
    assert 'No space left' in refused([bags[0], '--out', tmp_path / 'out'], capsys)
    assert not list(tmp_path.iterdir())


# In a browser


@pytest.fixture(scope='module')
def browser():
    driver = started()
    yield driver
    driver.quit()


def opened(browser, path):
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get(path.as_uri())
    ready = 'return document.documentElement.dataset.ready'
    WebDriverWait(browser, 60).until(lambda _: browser.execute_script(ready))
    return browser


def attribute(browser, selector, name):
    return browser.find_element('css selector', selector).get_attribute(name)


def lines_of(browser, part):
    """Ends of the lines of a part of the robot [m], shape (lines, 2, 2)."""
    path = attribute(browser, f'[data-part="{part}"]', 'd')
    return np.array(re.findall(r'-?[\d.]+', path), dtype=float).reshape(-1, 2, 2) * [1, -1]


def set_value(browser, selector, value, event):
    script = 'const e = document.querySelector(arguments[0]); e.value = arguments[1];'
    script += 'e.dispatchEvent(new Event(arguments[2]));'
    browser.execute_script(script, selector, value, event)


def test_the_page_works_in_a_browser(report, browser, bags):
    browser.get_log('performance')
    opened(browser, report / 'report.html')
    assert requests(browser) == [(report / 'report.html').as_uri()]
    assert len(browser.find_elements('css selector', '.plot .main-svg')) >= 12
    lines = browser.find_elements('css selector', '.plot[data-index="1"] .scatterlayer .js-line')
    assert len(lines) == 3 and all(len(line.get_attribute('d')) > 200 for line in lines)

    parts = ('proximal', 'distal', 'platform')
    before = {part: lines_of(browser, part) for part in parts}
    set_value(browser, '.time', 100, 'input')
    after = {part: lines_of(browser, part) for part in before}
    assert all((before[part] != after[part]).any() for part in before)
    assert browser.find_element('css selector', '.now').text == '2.00 s'
    elbow, end = after['distal'][0]
    run = runs.read_runs(bags)['paper_circle'][0]
    theta = run.motion.position[2000, 0]
    np.testing.assert_allclose(elbow, 0.4 * np.array([np.cos(theta), np.sin(theta)]), atol=1e-5)
    assert np.linalg.norm(end - elbow) == pytest.approx(0.6, abs=1e-5)
    np.testing.assert_array_equal(after['platform'][:, 0], after['distal'][:, 1])
    base = attribute(browser, '.whole polygon', 'points').replace(',', ' ').split()
    np.testing.assert_array_equal(
        np.array(base, float).reshape(3, 2) * [1, -1], before['proximal'][:, 0]
    )
    set_value(browser, '.robot', 1, 'change')
    assert (lines_of(browser, 'proximal') != after['proximal']).any()
    path = attribute(browser, '.detail polyline:last-of-type', 'points')
    set_value(browser, '.magnify', 100, 'change')
    assert attribute(browser, '.detail polyline:last-of-type', 'points') != path

    play = browser.find_element('css selector', '.play')
    browser.execute_script('arguments[0].click()', play)
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 10).until(lambda _: attribute(browser, '.time', 'value') == '125')
    WebDriverWait(browser, 10).until(lambda _: play.text == '▶')


def test_a_legend_hides_curves_and_errors_change_their_axis(report, browser):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.support.ui import WebDriverWait

    opened(browser, report / 'report.html')
    plot = 'return document.querySelector(\'.plot[data-index="1"]\')'
    shown = f'{plot}.data.map((trace) => trace.visible ?? true)'
    assert browser.execute_script(shown) == [True, True]
    toggle = browser.find_element('css selector', '.plot[data-index="1"] .legendtoggle')
    browser.execute_script('arguments[0].scrollIntoView({block: "center"})', toggle)
    ActionChains(browser).move_to_element(toggle).click().perform()
    WebDriverWait(browser, 5).until(
        lambda _: browser.execute_script(shown) == ['legendonly', True]
    )
    button = browser.find_element('css selector', '.log')
    axis = f'{plot}._fullLayout.yaxis.type'
    assert browser.execute_script(axis) == 'log' and button.text == 'signed, linear'
    browser.execute_script('arguments[0].click()', button)
    WebDriverWait(browser, 5).until(lambda _: browser.execute_script(axis) == 'linear')
    assert button.text == 'magnitude, logarithmic'
    browser.execute_script('arguments[0].click()', button)
    WebDriverWait(browser, 5).until(lambda _: browser.execute_script(axis) == 'log')
    browser.find_element('id', 'theme').click()
    assert browser.find_element('tag name', 'html').get_attribute('data-theme') == 'dark'


def test_a_hostile_bag_is_harmless_and_nothing_is_asked_of_the_network(hostile, browser):
    browser.get_log('performance')
    opened(browser, hostile[0])
    assert requests(browser) == [hostile[0].as_uri()]
    heading = browser.find_element('css selector', 'h2').text
    assert heading == EVIL
    legend = [
        e.text for e in browser.find_elements('css selector', '.plot[data-index="1"] .legendtext')
    ]
    assert legend == [f'{EVIL}0', f'{EVIL}1']
    assert [entry for entry in browser.get_log('browser') if entry['level'] != 'INFO'] == []
