"""A bag as columns, beside the simulation that made it; bags of others."""

import sys

import numpy as np
import pytest
from assembly import simulated as simulate
from bags import JOINTS, MS, START, streams, table_of, write_foreign

from parallel_robot.analysis.export import export
from parallel_robot.bags.writing import simulation_bag
from parallel_robot_control.messages import telemetry_layouts
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import layouts, topics

COUNT = 305
PER_JOINT = 9
OTHERS = 2 + 3 + 3 + 1
SLOW = topics.SLOW


def simulated(directory, **changed):
    """Write a simulation; return it."""
    values = config.resolve('paper_circle', {'duration': 1e-3 * COUNT, **changed})
    simulation = simulate(values)
    simulation_bag.write(directory, values, [simulation])
    return simulation


def by_joint(columns, joints, quantity):
    return np.stack([columns[f'{joint}_{quantity}'] for joint in joints], axis=1)


@pytest.mark.parametrize('joints', [JOINTS, ('left', 'right', 'top')])
def test_the_platform_and_what_the_law_says_of_itself(joints, tmp_path):
    simulation = simulated(tmp_path / 'bag', joints=list(joints))
    run, reference = simulation.run, simulation.reference
    columns, warnings = table_of(tmp_path / 'bag')
    assert warnings == () and len(columns) == OTHERS + PER_JOINT * len(joints)
    assert {len(column) for column in columns.values()} == {COUNT + 1}
    for k, name in enumerate(('x_m', 'y_m', 'phi_rad')):
        assert columns[f'platform_{name}'] == pytest.approx(run.pose[:, k], abs=1e-9)
        wanted = reference.pose[: COUNT + 1, k]
        assert columns[f'platform_reference_{name}'] == pytest.approx(wanted, abs=1e-9)
    offset = run.pose[:, :2] - reference.pose[: COUNT + 1, :2]
    assert columns['platform_error_m'] == pytest.approx(np.hypot(*offset.T), abs=1e-9)
    error = reference.position[: COUNT + 1] - run.position
    ring = np.stack([error[:, k] - error[:, (k + 1) % 3] for k in range(3)], axis=1)
    assert np.array_equal(by_joint(columns, joints, 'synchronisation_error_rad'), ring)
    sliding = by_joint(columns, joints, 'sliding_variable')
    assert np.array_equal(sliding[::SLOW], run.telemetry.sliding_variable[::SLOW])
    assert np.isnan(np.delete(sliding, np.s_[::SLOW], axis=0)).all()


def test_columns_name_their_units(tmp_path):
    simulation = simulated(tmp_path / 'bag')
    columns, _ = table_of(tmp_path / 'bag')
    assert list(columns)[:5] == [
        'time_s', 'stamp_ns', 'joint1_position_rad', 'joint2_position_rad', 'joint3_position_rad',
    ]  # fmt: skip
    wanted = simulation.reference.position[: COUNT + 1, 1]
    assert np.array_equal(columns['joint2_reference_position_rad'], wanted)
    assert np.array_equal(columns['joint3_command_nm'], simulation.run.command[:, 2])
    frame = export(tmp_path / 'bag')
    assert list(frame.columns) == list(columns) and len(frame) == COUNT + 1
    assert np.array_equal(frame['stamp_ns'], columns['stamp_ns'])


def at_rest(names=JOINTS):
    """Messages of a stock recorder, of a robot that stands 0.01 rad beside its reference."""
    values = config.resolve('paper_circle')
    rest = np.tile(simulate({**values, 'duration': 1e-3}).reference.position[:1], (50, 1))
    return streams(rest, rest - [0.01, 0.0, 0.0], names=names)


def test_a_stock_bag_without_telemetry(tmp_path):
    write_foreign(tmp_path / 'bag', at_rest(JOINTS[::-1]), space='/left')
    columns, (robot,) = table_of(tmp_path / 'bag')
    assert 'of which robot' in robot
    assert np.isnan(by_joint(columns, JOINTS, 'sliding_variable')).all()
    ring = by_joint(columns, JOINTS, 'synchronisation_error_rad')
    assert ring == pytest.approx(np.tile([0.01, 0.0, -0.01], (50, 1)))
    assert (columns['platform_error_m'] > 1e-4).all()


def test_a_stock_bag_with_telemetry_in_another_order(tmp_path):
    found, names = at_rest(), JOINTS[::-1]
    rows = np.arange(15.0).reshape(5, 3)
    stamps = START + 10 * MS * np.arange(5) + np.array([0, 0, 0, 0, 1])  # one fits no state
    records = telemetry_layouts(names)[topics.SLIDING_VARIABLE].records(5, stamps, position=rows)
    found[topics.SLIDING_VARIABLE] = [
        (int(t), r.tobytes()) for t, r in zip(stamps, records, strict=True)
    ]
    write_foreign(tmp_path / 'bag', found, space='/left')
    sliding = by_joint(table_of(tmp_path / 'bag').columns, JOINTS, 'sliding_variable')
    assert np.array_equal(sliding[:40:10], rows[:4, ::-1])
    assert np.isnan(np.delete(sliding, np.s_[:40:10], axis=0)).all()


@pytest.mark.parametrize('kind', ['joints', 'bytes'])
def test_somebody_elses_telemetry_is_left_out(kind, tmp_path):
    found = at_rest()
    data = layouts.joint_state(('a', 'b', 'c')).encode(START) if kind == 'joints' else bytes(20)
    found[topics.SLIDING_VARIABLE] = [(START, data)]
    write_foreign(tmp_path / 'bag', found)
    sliding = by_joint(table_of(tmp_path / 'bag').columns, JOINTS, 'sliding_variable')
    assert sliding.shape == (50, 3) and np.isnan(sliding).all()


@pytest.mark.parametrize('bad', [30, 0])
def test_where_there_is_no_pose_its_columns_are_empty(bad, tmp_path):
    found = at_rest()
    out = np.array([0.0, np.pi, np.pi / 2])
    layout = layouts.joint_state(JOINTS)
    for k in range(bad, 50):
        stamp = START + k * MS
        data = layout.encode(stamp, position=out, velocity=out * 0, effort=out * 0)
        found[topics.JOINT_STATES][k] = (stamp, data)
    write_foreign(tmp_path / 'bag', found)
    columns, (_, warning) = table_of(tmp_path / 'bag')
    assert 'pose of the robot' in warning and '\n' not in warning
    for name in ('platform_x_m', 'platform_reference_y_m', 'platform_error_m'):
        assert np.isfinite(columns[name][:bad]).all() and np.isnan(columns[name][bad:]).all()
    assert np.isfinite(by_joint(columns, JOINTS, 'synchronisation_error_rad')).all()


def test_a_frame_without_pandas_costs_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(InputError, match='pandas is not installed'):
        export(tmp_path / 'bag')
