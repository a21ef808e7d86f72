"""The live page in a browser, on a graph that it starts and on a bag."""

import time

import pytest
from browser import requests, started
from domain_coordinator import domain_id
from ros_fixtures import PATIENCE, SLOW_LOOP, Process

from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

LIVE = ('parallel_robot', 'live', '--port', '0')
SET = [word for one in SLOW_LOOP for word in ('--set', one.replace(':=', '='))]


class Page:
    """A page in a browser, and the process that serves it."""

    def __init__(self, browser, process):
        self.browser, self.process = browser, process
        process.until(lambda: 'page' in process.stdout)
        (self.address,) = [w for w in process.stdout.split() if w.startswith('http')]
        self.host, _, self.token = self.address.partition('/#')
        browser.get('about:blank')  # no page of another test seeks its server any more
        requests(browser), browser.get_log('browser')
        browser.get(self.address)

    def find(self, name):
        return self.browser.find_element('id', name)

    def script(self, text, *words):
        return self.browser.execute_script(f'return {text}', *words)

    def until(self, condition):
        """Wait until a script, or a function, is true."""
        deadline = time.monotonic() + PATIENCE
        while not (found := condition() if callable(condition) else self.script(condition)):
            assert time.monotonic() < deadline and self.process.running, self.process.stderr
            time.sleep(0.05)
        return found

    def choose(self, name, value):
        from selenium.webdriver.support.ui import Select

        Select(self.find(name)).select_by_value(value)

    def clean(self):
        """No errors, and no other host was asked."""
        told = [e['message'] for e in self.browser.get_log('browser') if e['level'] == 'SEVERE']
        assert [text for text in told if '409 (Conflict)' not in text] == []  # refused by a node
        asked = requests(self.browser)
        ws = self.host.replace('http:', 'ws:')
        assert asked and all(url.startswith((self.host + '/', ws + '/')) for url in asked)
        assert not any(self.token in url for url in asked[1:])
        return True


@pytest.fixture(scope='module')
def browser():
    driver = started()
    yield driver
    driver.quit()


@pytest.fixture(scope='module')
def serve(tmp_path_factory, compiled):
    """Start `live` with some words in a folder of its own, in a ROS domain of its own."""
    made = []
    with domain_id() as number:
        place = {'ROS_DOMAIN_ID': str(number), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}

        def start(*words, module=LIVE):
            folder = tmp_path_factory.mktemp('live')
            made.append(Process([*module, *words], folder, place, fresh=True))
            made[-1].folder = folder
            return made[-1]

        yield start
        for process in made:
            process.clean()


@pytest.fixture(scope='module')
def graph(browser, serve):
    """The page of a graph; the tests below follow each other on it."""
    return Page(browser, serve('--run', 'paper_circle', *SET))


def moved(page):
    """Wait until the picture has changed."""
    page.until('document.documentElement.dataset.ready')
    before = page.script('document.getElementById("whole").innerHTML')
    page.until(lambda: page.script('document.getElementById("whole").innerHTML') != before)


def test_the_robot_moves_and_no_other_host_is_asked(graph):
    moved(graph)
    assert graph.script('location.hash') == ''  # the token is no longer seen
    graph.until('document.getElementById("law").textContent === "computed torque"')
    assert len(graph.browser.find_elements('css selector', '#whole [data-part]')) == 3
    graph.until('document.querySelectorAll("#nodes tr").length === 3')
    graph.until('document.getElementById("rms").textContent.endsWith("µm")')
    canvas = 'document.querySelectorAll("#curves canvas")'
    assert graph.script(f'{canvas}.length') == 3
    pixels = 'c.getContext("2d").getImageData(0, 0, c.width, c.height).data'
    assert graph.script(f'[...{canvas}].every((c) => {pixels}.some((value) => value))')
    assert graph.clean()


def test_a_law_is_switched(graph):
    graph.choose('laws', 'nftsmc')
    graph.until('document.getElementById("law").textContent === "NFTSMC"')
    graph.choose('laws', 'computed_torque')
    graph.until('document.getElementById("law").textContent === "computed torque"')
    graph.until('document.getElementById("computed_torque.Kp")')


def entered(page, key, text):
    from selenium.webdriver.common.keys import Keys

    field = page.find(key)
    field.clear()
    field.send_keys(text, Keys.ENTER)
    return field


@pytest.mark.parametrize('text', ['-1', 'many', '1, 2'])
def test_a_gain_is_refused_by_the_field(text, graph):
    field = entered(graph, 'computed_torque.Kp', text)
    graph.until(lambda: field.get_attribute('aria-invalid') == 'true')
    why = field.find_element('xpath', '..').find_element('class name', 'why').text
    assert 'computed_torque.Kp must be' in why and why.endswith('; still 25')
    assert field.get_attribute('aria-description').endswith('at least 0')


def test_a_gain_is_set(graph):
    field = entered(graph, 'computed_torque.Kp', '26')
    graph.until('texts.setup.gains.computed_torque.some(({ value }) => value === 26)')
    assert field.get_attribute('aria-invalid') == 'false'
    assert graph.script('texts.setup.preset') == 'custom'


def test_a_parameter_of_the_motion_is_set_and_the_curves_go_on(graph):
    number = graph.script('texts.layout.number')
    why = entered(graph, 'circle.radius', '3').find_element('xpath', '..')
    why = why.find_element('class name', 'why')  # the answer, after that to the cleared field
    graph.until(lambda: why.text.startswith('motion refused at t = '))
    assert why.text.endswith('; still 0.03')
    entered(graph, 'circle.radius', '0.025')
    graph.until('texts.setup.shapes.circle.some(({ value }) => value === 0.025)')
    graph.choose('shapes', 'ellipse')
    graph.until('document.getElementById("motionof").textContent === "Parameters of ellipse"')
    graph.until('document.getElementById("ellipse.semi_axes")')
    graph.choose('shapes', 'waypoints')
    graph.until('document.getElementById("said").textContent.includes("waypoints.times must")')
    assert graph.script('document.getElementById("shapes").value') == 'ellipse'
    graph.choose('shapes', 'circle')
    graph.until('texts.setup.shape === "circle"')
    assert graph.script('texts.layout.number') == number


def test_a_ghost_tells_what_another_law_would_ask_for(graph):
    graph.choose('ghost', 'smc')
    graph.until('texts.state.ghost === "smc"')
    graph.until('seen.curves("ghost").every(({ values }) => Number.isFinite(values.at(-1)))')
    asked, acted = (
        graph.script(f'seen.curves("{name}").map((curve) => curve.values.at(-1))')
        for name in ('ghost', 'torque')
    )
    assert any(abs(a - b) > 1e-6 for a, b in zip(asked, acted, strict=True))
    assert graph.script('diagrams[2].ghostKey.textContent') == 'SMC would ask for'


def test_the_keyboard_stops_the_robot_and_a_button_clears(graph):
    from selenium.webdriver.common.keys import Keys

    stop, fault = graph.find('stop'), graph.find('fault')
    assert stop.accessible_name.startswith('Emergency stop') and stop.aria_role == 'button'
    assert not fault.is_displayed()
    graph.browser.find_element('tag name', 'body').send_keys(Keys.ESCAPE)
    graph.until(fault.is_displayed)
    assert 'emergency stop' in fault.text and fault.aria_role == 'alert'
    graph.find('clear').click()
    graph.until(lambda: not fault.is_displayed())
    stop.send_keys(Keys.SPACE)
    graph.until(fault.is_displayed)
    graph.find('clear').click()
    graph.until(lambda: not fault.is_displayed())


def test_a_bag_is_recorded(graph):
    graph.find('record').click()
    graph.until('document.getElementById("record").ariaPressed === "true"')
    graph.until(lambda: graph.script('texts.state.nodes.some((n) => n.name === "recorder")'))
    (bag,) = (graph.process.folder / 'runs').iterdir()

    def states():
        try:
            return len(recording.read(bag).log.time)
        except BagError:  # nothing of some topic so far
            return 0

    graph.until(lambda: states() > 100)
    graph.find('record').click()
    graph.until('document.getElementById("recording").textContent.endsWith("is complete")')
    log = recording.read(bag).log
    assert not log.warnings and log.scenario == 'paper_circle'


def test_nodes_come_and_go(graph, serve):
    plant = graph.process.children()[MODULES['plant']]
    plant.kill()
    graph.until('document.getElementById("connection").textContent === "no states"')
    words = [w for one in SLOW_LOOP for w in ('-p', one)]
    other = serve('--ros-args', *words, module=[MODULES['plant']])
    graph.until('document.getElementById("connection").textContent === "live"')
    moved(graph)
    other.end(2)
    assert graph.clean()


def test_without_the_token_the_page_only_shows(graph):
    graph.browser.switch_to.new_window('tab')
    graph.browser.get(graph.host)
    graph.until('document.documentElement.dataset.ready')
    assert not any(e.is_enabled() for e in graph.browser.find_elements('class name', 'acts'))
    graph.browser.close()
    graph.browser.switch_to.window(graph.browser.window_handles[0])


def test_ctrl_c_ends_the_nodes_too(graph):
    children = dict(graph.process.children())
    assert MODULES['controller'] in children
    assert graph.process.end(2) == 0
    assert all(child.ended(1.0) for child in children.values())
    assert graph.token not in graph.process.stderr


def test_a_bag_plays_from_any_moment(browser, serve, tmp_path_factory):
    bag = tmp_path_factory.mktemp('bag') / 'bag'
    assert main(['simulate', 'paper_circle', '--duration', '3', '--out', str(bag)]) == 0
    page = Page(browser, serve('--bag', str(bag)))
    moved(page)
    assert not page.find('stop').is_displayed() and page.find('play').is_displayed()
    page.until('seen.now === 3 && !texts.bag.playing')
    assert page.script('seen.shown()') == [page.script('seen.time[0]'), 3]
    page.script('seek(1.25)')
    page.until('Math.abs(seen.now - 1.25) < 1e-9')
    page.find('forth').click()
    page.until('Math.abs(seen.now - 1.251) < 1e-9')
    page.find('back').click()
    page.until('Math.abs(seen.now - 1.25) < 1e-9')
    page.choose('speed', '0.01')
    page.find('play').click()
    page.until('texts.bag.playing && texts.bag.speed === 0.01 && seen.now > 1.26')
    page.choose('ghost', 's_fotsmc')  # the law that ran: it asks for what was asked for
    page.until('seen.curves("ghost").every(({ values }) => Number.isFinite(values.at(-1)))')
    assert page.clean()
    assert page.process.end(2) == 0


def test_a_machine_in_space_turns_under_the_mouse(browser, serve, tmp_path_factory):
    from selenium.webdriver import ActionChains

    bag = tmp_path_factory.mktemp('bag') / 'delta'
    assert main(['simulate', 'delta_circle', '--duration', '1', '--out', str(bag)]) == 0
    page = Page(browser, serve('--bag', str(bag)))
    page.until('document.documentElement.dataset.ready && seen.now === 1 && !texts.bag.playing')
    views = '["whole", "detail"].map((name) => document.getElementById(name).innerHTML)'
    before = page.script(views)
    mouse = ActionChains(browser).move_to_element(page.find('whole'))
    mouse.click_and_hold().move_by_offset(80, 40).release().perform()
    page.until(lambda: all(a != b for a, b in zip(before, page.script(views), strict=True)))
    assert page.clean()
    assert page.process.end(2) == 0
