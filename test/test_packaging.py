"""What is installed and where: package.xml, setup.py, scripts, launch file, configuration."""

import ast
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ElementTree.parse(ROOT / 'package.xml').getroot()
NAME = PACKAGE.findtext('name')
DEPENDENCIES = {element.text for element in PACKAGE.iter('exec_depend')}
ROS = {key for key in DEPENDENCIES if not key.startswith('python3-')}
EXECUTABLES = {
    'trajectory': 'trajectory_gen.trajectory_node',
    'plant': 'parallel_robot_sim.plant_node',
    'controller': 'parallel_robot_control.controller_node',
    'recorder': 'parallel_robot_analysis.recorder_node',
    'player': 'parallel_robot_analysis.player_node',
    'monitor': 'parallel_robot_analysis.monitor_node',
}


@pytest.fixture(scope='module')
def setup():
    """What setup.py tells setuptools, which need not be installed."""
    captured = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setitem(sys.modules, 'setuptools', SimpleNamespace(setup=captured.update))
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
    assert setup['package_data']['parallel_robot_analysis.report'] == ['templates/*']


def test_there_is_one_command(setup):
    (command,) = setup['entry_points']['console_scripts']
    name, module = re.fullmatch(r'(\w+) = ([\w.]+):main', command).groups()
    assert name == NAME
    assert has_main(module)


@pytest.mark.parametrize('name', EXECUTABLES)
def test_executable_starts_its_node(setup, name):
    path = ROOT / 'scripts' / name
    text = path.read_text()
    assert os.access(path, os.X_OK)
    assert text.startswith('#!/usr/bin/env python3\n')
    assert f'from {EXECUTABLES[name]} import main\n' in text
    assert 'sys.exit(main())' in text
    assert has_main(EXECUTABLES[name])


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
    expected.update({f'lib/{NAME}/{name}': f'scripts/{name}' for name in EXECUTABLES})
    assert installed == expected


def test_launch_file_starts_every_node_of_a_run(monkeypatch):
    for module in ('', '.actions', '.conditions', '.substitutions'):
        monkeypatch.setitem(sys.modules, f'launch{module}', MagicMock())
    ros = MagicMock()
    monkeypatch.setitem(sys.modules, 'launch_ros', MagicMock())
    monkeypatch.setitem(sys.modules, 'launch_ros.actions', ros)
    launch = runpy.run_path(str(ROOT / 'launch' / 'run.launch.py'))
    launch['generate_launch_description']()
    started = [call.kwargs for call in ros.Node.call_args_list]
    assert {node['package'] for node in started} == {NAME}
    assert {node['executable'] for node in started} == set(EXECUTABLES) - {'player'}
    assert all('namespace' in node for node in started)


def test_every_import_is_declared(setup):
    required, optional = (
        {re.split(r'[<>=]', item)[0] for item in items}
        for items in (
            setup['install_requires'],
            setup['extras_require']['export'] + setup['extras_require']['top'],
        )
    )
    for name, tree in modules(setup['packages']):
        imported = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported.add(node.module.partition('.')[0])
        for module in (
            imported - set(sys.stdlib_module_names) - set(setup['packages']) - ROS - optional
        ):
            assert DEPENDENCIES & {f'python3-{module}', f'python3-{module}-pip'}, (name, module)
            assert {'yaml': 'pyyaml'}.get(module, module) in required, (name, module)


def test_ros_is_needed_by_nodes_alone(setup):
    pure = [
        name
        for name, _ in modules(setup['packages'])
        if not re.search(r'_node$|\.ros_\w+$', name) and not name.endswith('__init__')
    ]
    code = (
        'import importlib, sys\n'
        f'sys.modules.update(dict.fromkeys({sorted(ROS)!r}))\n'
        f'for name in {pure!r}: importlib.import_module(name)\n'
    )
    subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True)
