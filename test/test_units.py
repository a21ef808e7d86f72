"""Units of joints: what is said of hinges in rad and N m is said of slides in m and N."""

from dataclasses import replace

import numpy as np
import pytest

from parallel_robot.analysis import metrics
from parallel_robot.analysis.readable_metrics import as_data, whole
from parallel_robot.analysis.table import fields_of
from parallel_robot.studies.sweep.results import ERRORS, OTHERS
from parallel_robot.studies.sweep.store import COLUMNS
from parallel_robot_model.common.units import BOTH, HINGES, PRISMATIC, JointUnits, all_of
from parallel_robot_model.robots.registry import resolve, units_of
from parallel_robot_sim.motions import Motion, Motions, Poses
from parallel_robot_sim.run_columns import JointColumns, of_joints


@pytest.mark.parametrize(
    ('unit', 'slides', 'both'),
    [
        ('rad', 'm', 'rad or m'),
        ('µrad', 'µm', 'µrad or µm'),
        ('N m', 'N', 'N m or N'),
        ('N m s/rad', 'N s/m', 'N m s/rad or N s/m'),
        ('N m/(rad s)', 'N/(m s)', 'N m/(rad s) or N/(m s)'),
        ('(rad/s)²/Hz', '(m/s)²/Hz', '(rad/s)²/Hz or (m/s)²/Hz'),
        ('(N m)²/Hz', 'N²/Hz', '(N m)²/Hz or N²/Hz'),
        ('rad^(1-gamma1)/s^2', 'm^(1-gamma1)/s^2', 'rad^(1-gamma1)/s^2 or m^(1-gamma1)/s^2'),
        ('s', 's', 's'),
        ('m/s', 'm/s', 'm/s'),
    ],
)
def test_a_unit_of_hinges_is_told_of_slides(unit, slides, both):
    assert (HINGES.of(unit), PRISMATIC.of(unit), BOTH.of(unit)) == (unit, slides, both)


def test_labels_keys_and_single_joints():
    mixed = JointUnits((False, True))
    assert mixed.label('torque, rms [N m]') == 'torque or force, rms [N m or N]'
    assert (
        PRISMATIC.label('|torque| [N m]') == '|force| [N]'
        and PRISMATIC.label('Torques') == 'Forces'
    )
    assert mixed.label('Torques') == 'Torques and forces' and HINGES.label('Torques') == 'Torques'
    assert mixed.one(0).label('[N m]') == '[N m]' and mixed.one(1).label('[N m]') == '[N]'
    assert PRISMATIC.key('torque_variation_nm_per_s') == 'torque_variation_n_per_s'
    assert mixed.key('joint_rms_rad') == 'joint_rms_rad_or_m'
    assert HINGES.one(2) == HINGES and HINGES.key('position_rad') == 'position_rad'
    assert PRISMATIC.key('xy_rms_m') == 'xy_rms_m' and PRISMATIC.key('stamp_ns') == 'stamp_ns'


def test_robots_together_have_the_units_of_all():
    assert all_of([PRISMATIC, PRISMATIC]).of('rad') == 'm'
    assert all_of([HINGES, PRISMATIC]).of('rad') == 'rad or m'
    assert all_of([]).of('rad') == 'rad'


def test_columns_have_the_unit_of_their_joint():
    nothing = np.zeros((2, 2))
    found = JointColumns(*[nothing] * 8)
    names = of_joints(np.zeros(2), np.zeros(2, int), ['turn', 'lift'], found, BOTH)
    assert {'turn_position_rad', 'lift_position_m', 'turn_command_nm', 'lift_command_n'} < {*names}
    assert 'lift_velocity_m_per_s' in names and 'lift_reference_acceleration_m_per_s2' in names


def still(units):
    """A motion of two joints that rest beside their reference."""
    time, nothing = 0.001 * np.arange(2000), np.zeros((2000, 2))
    poses = Poses(nothing, nothing, 0, units)
    return Motions(Motion(time, nothing + 1e-6, nothing, nothing + 2.0, poses), None)


def test_metrics_have_the_units_of_the_joints():
    found = metrics.figures(still(PRISMATIC))
    assert set(as_data(found)['steady']) == {'joint_rms_m', 'sync_rms_m'}
    assert 'max_n' in as_data(found)['torque']
    rows = {name: unit for name, _, unit in whole(found).rows}
    assert rows['joint error, rms'] == 'µm' and rows['force, max (whole run)'] == 'N'
    rows = {name: unit for name, _, unit in whole(metrics.figures(still(BOTH))).rows}
    assert rows['joint error, rms'] == 'µrad or µm' and rows['torque or force, rms'] == 'N m or N'


def test_a_rotation_error_is_an_angle_with_slides_too():
    found = metrics.figures(still(PRISMATIC))
    turned = replace(found, values=found.values | {'rotation_rms_rad': 2e-3})
    assert as_data(turned)['steady']['rotation_rms_rad'] == 2e-3
    (row,) = [row for row in whole(turned).rows if 'rotation error' in row[0]]
    assert row[1:] == ('2000.000', 'µrad')


def test_every_figure_of_a_sweep_has_its_column_in_any_unit():
    for units in (HINGES, PRISMATIC, BOTH):
        names = {units.key(name) for name in COLUMNS}
        assert len(names) == len(COLUMNS)
        assert {each.in_units(units).key for each in (*ERRORS, *OTHERS)} <= names


def test_a_hexapod_has_slides_and_a_delta_has_hinges():
    assert units_of(resolve('hexapod_circle')).of('N m') == 'N'
    assert units_of(resolve('delta_circle')).of('N m') == 'N m'
    assert units_of(resolve('paper_circle')) == HINGES


def test_parameters_of_a_hexapod_are_in_units_of_slides():
    fields = fields_of(resolve('hexapod_circle'))
    assert fields['friction.viscous'].unit == 'N s/m' and fields['s_fotsmc.G'].unit == 'm/s^3'
    assert fields['robot.lower'].unit == 'm' and fields['trajectory.max_joint_speed'].unit == 'm/s'
    assert fields['disturbance.phase'].unit == 'rad' and fields['circle.rate'].unit == 'rad/s'
    assert fields['safety.min_travel'].unit == 'm' and fields['plant.torque_limit'].unit == 'N'


def test_no_unit_of_a_hexapod_is_one_of_hinges():
    angles = {
        key for key, field in fields_of(resolve('hexapod_circle')).items() if 'N m' in field.unit
    }
    assert not angles
