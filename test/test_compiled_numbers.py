"""What MuJoCo compiled stands beside a description: shipped machines, bags, files of strangers."""

import json
import subprocess
import sys

import mujoco
import pytest
from reading import read

from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config_files, robot_file
from parallel_robot_model.mechanisms.description.compiled import (
    difference,
    numbers_of,
    written,
)
from parallel_robot_model.mechanisms.description.machine import read as read_text
from parallel_robot_model.robots.described.robot import (
    compiled_of,
    compiler_warning,
    description_of,
)

ARM = (
    '<mujoco><worldbody><body name="b"><joint name="j" range="-1 2" limited="true"/>'
    '<joint name="k" type="slide" damping="2"/><geom size=".1" mass="1" pos=".3 0 0"/></body>'
    '</worldbody><actuator><motor joint="j" ctrlrange="0 60"/><motor joint="k"/></actuator>'
    '<tendon><fixed name="t" stiffness="3"><joint joint="j" coef="2"/></fixed></tendon>'
    '<keyframe><key name="home" qpos="0.5 0.1"/></keyframe></mujoco>'
)


@pytest.mark.parametrize('name', config_files.builtin_machines())
def test_numbers_of_shipped_machines_are_those_of_the_compiler(name):
    path = config_files.machine_path(name)
    text = robot_file.text_of(path)
    shipped = numbers_of(path.with_suffix('.json').read_text(), text, name)
    assert shipped is not None and difference(shipped, read(text)) < 1e-12


def test_what_is_written_is_read_to_the_last_bit():
    description = read(ARM)
    back = numbers_of(written(ARM, 'MuJoCo', description), ARM, 'robot.xml')
    assert difference(back, description) == 0.0 and back.tendons == description.tendons
    assert back.joints[0].lower == description.joints[0].lower and back.source == 'robot.xml'


def test_numbers_of_another_text_do_not_count():
    assert numbers_of(written(ARM, 'MuJoCo', read(ARM)), ARM + ' ', 'robot.xml') is None


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (lambda d: d['bodies'][0].update(mass=True), 'mass is True'),
        (lambda d: d['bodies'][0].update(parent=3), "body 'b' has no parent before it"),
        (lambda d: d['bodies'][0].update(centre=[0, 0]), 'must be numbers of shape'),
        (lambda d: d['joints'][0].update(axis=[0, 0, 2]), 'no unit vector'),
        (lambda d: d['joints'][0].update(kind='ball?'), 'no body or kind'),
        (lambda d: d['actuators'][0].update(joint='x'), "there is no joint 'x'"),
        (lambda d: d.update(loops='no'), 'loops must be a list'),
        (lambda d: d.pop('gravity'), 'must have source'),
        (lambda d: d['bodies'][0].update(rotation=[[1, 0, 0]] * 3), 'a rotation that is none'),
    ],
)
def test_numbers_of_strangers_are_checked(change, message):
    data = json.loads(written(ARM, 'MuJoCo', read(ARM)))
    change(data['description'])
    with pytest.raises(InputError, match=message):
        numbers_of(json.dumps(data), ARM, 'robot.xml')


def test_numbers_that_the_compiler_does_not_make_are_told():
    data = json.loads(written(ARM, 'MuJoCo', read(ARM)))
    assert compiler_warning(ARM, json.dumps(data)) == ''
    data['description']['bodies'][0]['mass'] += 1e-6
    assert 'makes other numbers of the description' in compiler_warning(ARM, json.dumps(data))


def test_numbers_that_no_machine_has_are_refused_as_those_of_a_file():
    data = json.loads(written(ARM, 'MuJoCo', read(ARM)))
    data['description']['bodies'][0]['mass'] = 1e12
    with pytest.raises(InputError, match='not below'):
        description_of(ARM, json.dumps(data))


def test_a_configuration_carries_the_numbers_of_its_machine(tmp_path):
    (tmp_path / 'mine.xml').write_text(ARM, encoding='utf-8')
    values = resolve('paper_circle', {'robot_model': str(tmp_path / 'mine.xml')})
    text = values['robot_description']
    assert difference(numbers_of(values['robot_compiled'], text, ''), read_text(text)) == 0.0
    assert mujoco.__version__ in values['robot_compiled']
    assert compiled_of(text, values['robot_compiled']) == values['robot_compiled']


def test_a_run_of_a_shipped_machine_imports_no_mujoco():
    code = (
        'import sys; from parallel_robot_control.configuration import resolve; '
        'resolve("delta_circle"); print("mujoco" in sys.modules)'
    )
    told = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert told.stdout == 'False\n'
