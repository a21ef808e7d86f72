"""What is installed and where: package.xml, setup.py, scripts, launch file, configuration."""

import ast
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple, get_args, get_origin
from xml.etree import ElementTree

import pytest
import yaml
from conftest import QUICK
from ros_fixtures import until

from parallel_robot.cli.command_line import build_parser
from parallel_robot.cli.commands.node import NODES

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
PACKAGE = ElementTree.parse(ROOT / 'package.xml').getroot()
NAME = PACKAGE.findtext('name')
DEPENDENCIES = {element.text for element in PACKAGE.iter('exec_depend')}
ROS = {key for key in DEPENDENCIES if not key.startswith('python3-')}
PIP = {'lz4', 'mcap', 'plotly', 'threadpoolctl', 'zstandard'}  # of which rosdep knows nothing
WITH_NUMBA = {'llvmlite'}  # a dependency of Numba, of the version that it needs
OPTIONAL = (
    'export',
    'live',
    'top',
    'study',
    'cluster',
    'tune',
    'fmu',
)  # extras without which the suite works
ROSDEP_KEYS = {  # that exist
    *('python3-argcomplete', 'python3-hypothesis', 'python3-jinja2', 'python3-matplotlib'),
    *(
        'python3-numba',
        'python3-numpy',
        'python3-pil',
        'python3-pytest',
        'python3-rosbags-pip',
        'python3-scipy',
        'python3-yaml',
    ),
}
ROS_PACKAGES = {  # of Jazzy
    *('ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'launch'),
    *('launch_ros', 'rcl_interfaces', 'rclpy', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs'),
    *('std_srvs', 'trajectory_msgs', 'visualization_msgs'),
}
MAIN = 'parallel_robot.__main__'
RUN, HARDWARE = (ROOT / 'launch' / f'{name}.launch.py' for name in ('run', 'hardware'))
STRICT = ROOT / 'config' / 'hardware' / 'strict.yaml'
IMPORTED = '_multiarray_umath'  # by a process that has begun to import the suite


@pytest.fixture(scope='module')
def setup():
    """What setup.py tells setuptools, which need not be installed."""
    captured = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setitem(sys.modules, 'setuptools', SimpleNamespace(setup=captured.update))
        patch.setitem(sys.modules, 'setuptools.command', SimpleNamespace())
        build = SimpleNamespace(build_py=object)
        patch.setitem(sys.modules, 'setuptools.command.build_py', build)
        runpy.run_path('setup.py')
    return captured


def modules(packages):
    """Every module of the suite: dotted name and parsed source."""
    for package in packages:
        for path in sorted((ROOT / package.replace('.', '/')).glob('*.py')):
            yield f'{package}.{path.stem}', ast.parse(path.read_text())


def has_main(module):
    tree = ast.parse((ROOT / (module.replace('.', '/') + '.py')).read_text())
    return 'main' in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_package_xml_and_setup_agree(setup):
    assert PACKAGE.get('format') == '3'
    assert PACKAGE.findtext('export/build_type') == 'ament_python'
    assert re.fullmatch(r'\d+\.\d+\.\d+', setup['version'])
    for key in ('name', 'version', 'description', 'license', 'maintainer'):
        assert setup[key] == PACKAGE.findtext(key)


def test_every_package_is_installed(setup):
    folders = {path.parent.relative_to(ROOT) for path in ROOT.glob('[!.]*/**/__init__.py')}
    assert set(setup['packages']) == {'.'.join(folder.parts) for folder in folders}


def test_templates_are_installed(setup):
    for package, patterns in setup['package_data'].items():
        assert all(list((ROOT / package.replace('.', '/')).glob(pattern)) for pattern in patterns)
    assert setup['package_data']['parallel_robot.analysis.report'] == ['templates/*']


def test_what_is_installed_knows_its_revision(tmp_path):
    pytest.importorskip('setuptools')
    words = ['setup.py', '--quiet', 'build_py', '--build-lib', str(tmp_path)]
    subprocess.run([sys.executable, *words], cwd=ROOT, check=True, capture_output=True)
    words = ['-m', 'parallel_robot', '--version']
    told = [
        subprocess.run(
            [sys.executable, *words],
            cwd=tmp_path,
            env={**environment(), 'PYTHONPATH': str(place)},
            capture_output=True,
            text=True,
        ).stdout
        for place in (ROOT, tmp_path)
    ]
    assert told[0] == told[1] and told[0].startswith('parallel_robot ')
    assert ('revision' in told[0]) == (ROOT / '.git').exists()


def test_there_is_one_command(setup):
    (command,) = setup['entry_points']['console_scripts']
    name, module = re.fullmatch(r'(\w+) = ([\w.]+):main', command).groups()
    assert name == NAME
    assert has_main(module)


def test_every_node_has_its_executable():
    scripts = {path.name: path.read_text() for path in (ROOT / 'scripts').iterdir()}
    assert set(scripts) == set(NODES) and len(set(scripts.values())) == 1
    assert all(os.access(ROOT / 'scripts' / name, os.X_OK) for name in scripts)
    assert all(map(has_main, NODES.values()))


@pytest.fixture(params=['pip', 'colcon', 'colcon --symlink-install'])
def installed(request, tmp_path):
    """Executables of an installation in a place with a space; environment without it."""
    prefix = tmp_path / 'a place'
    lib, scripts = (
        prefix / 'lib' / NAME,
        prefix / ('bin' if request.param == 'pip' else f'lib/{NAME}'),
    )
    lib.mkdir(parents=True), scripts.mkdir(exist_ok=True)
    command = scripts / NAME
    command.write_text(
        f'#!{sys.executable}\nimport sys\nfrom {MAIN} import main\nsys.exit(main())\n'
    )
    command.chmod(0o755)
    for path in (ROOT / 'scripts').iterdir():
        if 'symlink' in request.param:
            (lib / path.name).symlink_to(path)
        else:
            shutil.copy(path, lib)
    return lib


def environment(**more):
    """Of a user who has activated nothing."""
    return {'PATH': '/usr/bin:/bin', 'HOME': os.environ['HOME'], 'PYTHONPATH': str(ROOT), **more}


def test_an_executable_finds_its_interpreter(installed):
    words = [installed / 'plant', '--ros-args', '-p', 'no_such_parameter:=1']
    done = subprocess.run(words, env=environment(), capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert 'no_such_parameter' in done.stderr and done.stderr.count('\n') == 1


def test_the_installed_executable_runs_without_the_environment_being_activated():
    script = Path(sys.prefix) / 'lib' / NAME / 'controller'
    if not script.exists():
        pytest.skip('the suite was not installed by pip')
    words = [script, '--ros-args', '-p', 'no_such_parameter:=1']
    done = subprocess.run(words, env=environment(), capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, ''), done.stderr
    assert 'no_such_parameter' in done.stderr


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('when', ['Python starts', 'it imports'])
@pytest.mark.parametrize('installed', ['colcon'], indirect=True)
def test_a_node_that_is_ended_while_it_starts_ends_well(when, number, installed, domain):
    process = subprocess.Popen(
        [installed / 'plant'],
        env=environment(ROS_DOMAIN_ID=str(domain)),
        stderr=subprocess.PIPE,
        text=True,
    )
    proc = Path(f'/proc/{process.pid}')
    reached = {
        'Python starts': lambda: 'python' in os.readlink(proc / 'exe'),
        'it imports': lambda: IMPORTED in (proc / 'maps').read_text(),
    }
    until(reached[when], step=lambda: None)
    process.send_signal(number)
    _, errors = process.communicate(timeout=300.0)
    assert (process.returncode, errors) == (0, '')


def test_every_data_file_is_installed_where_ros_looks(setup):
    installed = {
        f'{folder}/{Path(file).name}': file
        for folder, files in setup['data_files']
        for file in files
    }
    expected = {
        f'share/{NAME}/{path.relative_to(ROOT)}': str(path.relative_to(ROOT))
        for folder in ('config', 'launch')
        for path in (ROOT / folder).rglob('*.*')
        if '__pycache__' not in path.parts
    }
    expected[f'share/{NAME}/package.xml'] = 'package.xml'
    expected[f'share/ament_index/resource_index/packages/{NAME}'] = f'resource/{NAME}'
    expected.update({f'lib/{NAME}/{name}': f'scripts/{name}' for name in NODES})
    assert installed == expected


class Text(NamedTuple):
    """As launch has it: a substitution that is its text."""

    text: str

    def perform(self, context):
        return self.text


class Configuration(NamedTuple):
    """As launch has it: the value of an argument."""

    name: str

    def perform(self, context):
        return context[self.name]


class Value:
    """As strict as launch_ros: only a substitution is converted, a value must have its type."""

    def __init__(self, value, *, value_type):
        if not isinstance(value, (Text, Configuration, get_origin(value_type) or value_type)):
            raise TypeError(f'value={value!r} is not an instance of {value_type}')
        self._value, self._type = value, value_type

    def evaluate(self, context):
        if not isinstance(self._value, (Text, Configuration)):
            return self._value
        text = self._value.perform(context)
        if self._type in (str, int, float):
            return self._type(text)
        value, items = yaml.safe_load(text), get_args(self._type)
        if items and isinstance(value, list) and all(isinstance(item, items) for item in value):
            return value
        if type(value) is not self._type:
            raise ValueError(f"Cannot convert value '{text}' to '{self._type}'")
        return value


class Condition(NamedTuple):
    """As launch has it: an argument that says yes or no."""

    argument: Configuration

    def evaluate(self, context):
        return {'true': True, '1': True, 'false': False, '0': False}[
            self.argument.perform(context).lower()
        ]


def evaluated(source, context):
    """Parameters as a node is given them: those of a dictionary, or the path of a file."""
    if not isinstance(source, dict):
        return source
    return {name: value.evaluate(context) for name, value in source.items()}


@pytest.fixture
def launch(monkeypatch, tmp_path):
    """Launch a file with arguments, in what stands for ROS's launch; the nodes by executable."""
    declared, functions, included = {}, [], {}

    def describe(file):
        runpy.run_path(str(file))['generate_launch_description']()

    def include(file, *, launch_arguments):
        included.update(launch_arguments)
        describe(file)

    stand_in = {
        'launch': {'LaunchContext': dict, 'LaunchDescription': list},
        'launch.actions': {
            'DeclareLaunchArgument': lambda name, **words: declared.setdefault(name, words),
            'ExecuteProcess': lambda **words: words,
            'IncludeLaunchDescription': include,
            'OpaqueFunction': lambda function: functions.append(function),
        },
        'launch.conditions': {'IfCondition': Condition},
        'launch.substitutions': {'LaunchConfiguration': Configuration, 'TextSubstitution': Text},
        'launch_ros': {},
        'launch_ros.actions': {'Node': lambda **words: words},
        'launch_ros.parameter_descriptions': {'ParameterValue': Value},
    }
    for name, members in stand_in.items():
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(**members))
    monkeypatch.setenv('HOME', str(tmp_path))
    monkeypatch.delenv('ROS_HOME', raising=False)

    def context_of(file, arguments):
        for known in (declared, included):
            known.clear()
        describe(file)
        assert all(words['description'] for words in declared.values())
        context = {name: words['default_value'] for name, words in declared.items()}
        assert {*arguments, *included} <= set(context)
        return context | arguments | included

    def page(**arguments):
        context = context_of(RUN, arguments)
        (found,) = functions[-2](context)
        return found

    def start(file=RUN, **arguments):
        context = context_of(file, arguments)
        return {
            node['executable']: node
            | {
                'namespace': node['namespace'].perform(context),
                'parameters': [evaluated(source, context) for source in node['parameters']],
                'condition': node['condition'] is None or node['condition'].evaluate(context),
            }
            for node in functions[-1](context)
        }

    start.page = page
    return start


def test_launch_serves_the_page_of_its_robot_where_it_is_asked_for(launch):
    for given, namespace in (('left', '/left'), ('/left', '/left'), ('', '/')):
        for live in ('true', 'false'):
            page = launch.page(namespace=given, live=live)
            command = build_parser().parse_args(page['cmd'][3:])
            assert page['condition'].evaluate({'live': live}) == (live == 'true')
            assert (command.command, command.namespace) == ('live', namespace)
            assert command.host == '127.0.0.1'


def started(nodes):
    return {name for name, node in nodes.items() if node['condition']}


def test_launch_starts_every_node_of_a_run(launch):
    nodes = launch(namespace='left')
    assert set(nodes) == set(NODES) - {'player'}
    assert {(node['package'], node['namespace']) for node in nodes.values()} == {(NAME, 'left')}
    assert started(nodes) == {'trajectory', 'plant', 'controller'}


@pytest.mark.parametrize('value', ['true', 'false'])
def test_launch_takes_every_argument(launch, value, tmp_path):
    file = tmp_path / 'my.yaml'
    file.write_text('{}')
    texts = {'scenario': 'paper_line', 'law': 'smc', 'time_mode': 'lockstep'}
    names = ('use_sim_time', 'end_with_parent', 'record', 'monitor', 'plant')
    nodes = launch(
        **texts,
        **dict.fromkeys(names, value),
        namespace='left',
        limits=str(STRICT),
        params_file=str(file),
        period='0.004',
        joints='[a, b, c]',
    )
    yes = value == 'true'
    for node in nodes.values():
        _, *paths, given = node['parameters']
        assert paths == [str(STRICT), str(file)]
        values = {'use_sim_time': yes, 'end_with_parent': yes, 'joints': ['a', 'b', 'c']}
        assert given == {**texts, 'period': 0.004, **values}
    assert ({'recorder', 'monitor', 'plant'} <= started(nodes)) == yes


def test_launch_passes_on_what_is_given_alone(launch):
    default, given = launch()['plant']['parameters']
    assert set(default) == {'recorder.out'} and given == {}
    with pytest.raises(RuntimeError, match='params_file: nowhere is not a file'):
        launch(params_file='nowhere')
    with pytest.raises(ValueError, match=r"'maybe' to '<class 'bool'>'"):
        launch(use_sim_time='maybe')
    with pytest.raises(ValueError, match='four'):
        launch(period='four')
    with pytest.raises(ValueError, match='joint1'):
        launch(joints='joint1')


def test_launch_of_hardware_starts_no_plant_and_a_controller_that_is_stopped(launch):
    nodes = launch(HARDWARE, period='auto', plant='true')
    assert started(nodes) == {'trajectory', 'controller'}
    for node in nodes.values():
        _, limits, given = node['parameters']
        assert (limits, given) == (str(STRICT), {'period': 'auto'})
        assert node['remappings'] == [('robot_description', 'monitor/robot_description')]
    assert yaml.safe_load(STRICT.read_text())['/**']['ros__parameters']['controller']['stopped']
    assert all(node['remappings'] == [] for node in launch().values())


def test_launch_records_where_ros_keeps_its_own_or_where_it_is_told(launch, tmp_path, monkeypatch):
    def place(**arguments):
        return launch(**arguments)['recorder']['parameters'][0]['recorder.out']

    date = r'\d{4}(_\d\d){2}-\d\d(_\d\d){2}'
    home = re.escape(str(tmp_path / '.ros' / NAME))
    assert re.fullmatch(f'{home}/run_{date}', place(record='true'))
    assert re.fullmatch(f'{home}/left_line_{date}', place(scenario='line', namespace='/left'))
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'home'))
    assert place().startswith(str(tmp_path / 'home' / NAME))
    recorder = launch(out='runs/mine', law='smc')['recorder']
    assert recorder['condition']
    assert recorder['parameters'] == [{'law': 'smc', 'recorder.out': 'runs/mine'}]


def test_launch_hands_on_the_absolute_path_of_a_scenario(launch, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    out, given = launch(scenario='sub/mine.yaml')['plant']['parameters']
    assert given == {'scenario': str(tmp_path / 'sub' / 'mine.yaml')}
    place = Path(out['recorder.out'])
    assert place.parent == tmp_path / '.ros' / NAME and place.name.startswith('mine_2')
    _, given = launch(scenario='paper_line')['plant']['parameters']
    assert given == {'scenario': 'paper_line'}


@pytest.mark.parametrize('value', ['true', 'false'])
def test_the_launch_of_ros_takes_every_argument(value, tmp_path):
    actions = pytest.importorskip('launch_ros.actions', reason='launch_ros is not installed')
    import launch

    file = tmp_path / 'my.yaml'
    file.write_text('{}')
    texts = {'scenario': 'paper_line', 'law': 'smc', 'time_mode': 'lockstep'}
    switches = dict.fromkeys(('use_sim_time', 'end_with_parent', 'record', 'monitor'), value)
    context = launch.LaunchContext()
    others = {'namespace': 'left', 'params_file': str(file), 'period': '4e-3', 'joints': '[a, b]'}
    context.launch_configurations.update({**texts, **switches, **others})
    description = runpy.run_path(str(HARDWARE))['generate_launch_description']()
    page, *nodes = processes(description, context, launch.actions.ExecuteProcess)
    assert not isinstance(page, actions.Node)
    for node in nodes:
        assert isinstance(node, actions.Node)
        node._perform_substitutions(context)
        texts_of = [[getattr(part, 'text', '') for part in word] for word in node.cmd]
        files = [Path(*b) for a, b in pairwise(texts_of) if a == ['--params-file']]
        _, limits, own, given = (yaml.safe_load(path.read_text()) for path in files)
        (parameters,) = given.values()
        assert own == {} and limits == yaml.safe_load(STRICT.read_text())
        yes = value == 'true'
        values = {
            'use_sim_time': yes,
            'end_with_parent': yes,
            'period': 4e-3,
            'joints': ['a', 'b'],
        }
        assert parameters['ros__parameters'] == {**texts, **values}
        assert node.condition is None or not node.condition.evaluate(context) or value == 'true'


def processes(entity, context, kind):
    """The processes that ROS's launch would start for an entity, whatever their conditions."""
    if isinstance(entity, kind):
        return [entity]
    found = entity.visit(context) or []
    return [process for part in found for process in processes(part, context, kind)]


def test_colcon_test_runs_with_the_pytest_of_ubuntu(setup, request):
    """Which colcon chooses if the extra `test` names pytest; plugins of ROS stay out."""
    assert any(re.match(r'pytest\b(?!-)', item) for item in setup['extras_require']['test'])
    assert request.config.getini('minversion') == '7.4'
    blocked = request.config.pluginmanager.is_blocked
    assert blocked('launch_testing') and blocked('launch_ros')
    assert all((ROOT / 'test' / f'test_{name}.py').is_file() for name in QUICK)


def test_every_import_is_declared(setup):
    required, optional = (
        {re.split(r'[<>=]', item)[0] for item in items}
        for items in (
            setup['install_requires'],
            [item for name in OPTIONAL for item in setup['extras_require'][name]],
        )
    )
    for name, tree in modules(setup['packages']):
        imported = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported.add(node.module.partition('.')[0])
        ours = {*sys.stdlib_module_names, *setup['packages'], *ROS, *optional, *WITH_NUMBA}
        for module in imported - ours:
            keys = {f'python3-{module.lower()}', f'python3-{module}-pip'}
            assert bool(DEPENDENCIES & keys) != (module in PIP), (name, module)
            assert {'yaml': 'pyyaml', 'PIL': 'pillow'}.get(module, module) in required, (
                name,
                module,
            )


def test_rosdep_knows_every_dependency_and_the_docs_say_what_it_does_not():
    asked = {element.text for element in PACKAGE if element.tag.endswith('depend')}
    assert asked <= ROSDEP_KEYS | ROS_PACKAGES
    (told,) = re.findall(
        r'^pip install (.*)$', (ROOT / 'docs' / 'nodes.md').read_text(), re.MULTILINE
    )
    assert {re.split('[<>=]', word.strip("'"))[0] for word in told.split()} >= PIP


def test_ros_is_needed_by_nodes_alone(setup):
    pure = [
        name
        for name, _ in modules(setup['packages'])
        if not re.search(r'_node$|\.ros_\w+$|^parallel_robot_model.nodes\.', name)
        and not name.endswith('__init__')
    ]
    code = (
        'import importlib, sys\n'
        f'sys.modules.update(dict.fromkeys({sorted(ROS)!r}))\n'
        f'for name in {pure!r}: importlib.import_module(name)\n'
    )
    subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True)
