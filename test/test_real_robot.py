"""identify on the log of a real UR10, which others published (see ur10/LICENSE)."""

import lzma
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

import parallel_robot as pr
from parallel_robot_model.configuration import config

DATA = Path(__file__).parent / 'ur10'


@pytest.fixture(scope='module')
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp('ur10')
    bag, robot = folder / 'exciting.db3', folder / 'my_ur10.urdf'
    packed = DATA / 'ur10_exciting_trajectory.db3.xz'
    bag.write_bytes(lzma.decompress(packed.read_bytes()))
    shutil.copy(DATA / 'ur10.urdf', robot)
    return pr.identify(bag, scenario=robot, out=folder / 'ur10.yaml'), folder / 'ur10.yaml', robot


def test_what_was_not_fitted_is_predicted(found):
    """Without columns of friction 13.7 %; with the best ones of another program 6.7 %."""
    data = found[0].as_data()
    assert np.mean(data['held_out']['share']) < 0.075 < np.mean(data['held_out']['share_before'])
    chosen = {each['name'] for each in data['friction_chosen']}
    assert {'offset4', 'offset5', 'offset6', 'load2', 'stribeck1'} <= chosen
    friction = data['friction']
    assert friction['stribeck'][0] < -10.0 and 0.08 < friction['stribeck_velocity'] < 0.15
    assert friction['load'][1] == pytest.approx(0.05, abs=0.015)


def test_the_robot_of_its_file_can_be_built_and_moves(found):
    _, file, robot = found
    values = config.flat(yaml.safe_load(file.read_text()))
    assert len(values['robot.inertia_shift']) == 36
    run = pr.simulate(robot, law='lqg_tracking', duration=0.2, param_file=file)
    assert np.abs(run.error).max() < 0.01
