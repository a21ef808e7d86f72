"""Statuses of the controller, as codes."""

import re

import pytest
from bags import START

from parallel_robot.bags.history import ControllerStatus, decoded_status
from parallel_robot_control.messages import Status, status_message
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.faults import EMERGENCY_STOP
from parallel_robot_control.safety.limiting import LIMIT_CODE, LIMIT_TEXT, RAMP, TORQUE
from parallel_robot_model.messages import layouts
from parallel_robot_model.robots.contract import Fault
from parallel_robot_model.robots.registry import ROBOTS

STOPPED = Status('pid', faults.FAULTS[EMERGENCY_STOP], TORQUE | RAMP)


def message(values, stamp=START):
    return layouts.padded(
        layouts.diagnostic_array('controller: status', 2, 'text', values).encode(stamp)
    )


@pytest.mark.parametrize('robot', ROBOTS.values(), ids=ROBOTS)
def test_every_fault_has_a_code_and_a_text_of_its_own(robot):
    known = faults.of(robot)
    codes = [fault.key for fault in known.values()]
    assert len({*codes, 'none'}) == len({fault.text for fault in known.values()}) + 1
    assert len(codes) == len({*codes}) and all(re.fullmatch('[a-z][a-z0-9_]*', c) for c in codes)
    assert len(known) == len(robot.FAULTS) + len(faults.FAULTS)  # no number is used twice


def test_each_limit_has_a_code_of_its_own():
    assert LIMIT_CODE.keys() == LIMIT_TEXT.keys() and len({*LIMIT_CODE.values()}) == len(
        LIMIT_CODE
    )


def test_a_status_is_read_as_it_was_written():
    quiet = ControllerStatus(START, 's_fotsmc', 'none', 'none', ())
    assert decoded_status(status_message(START, Status('s_fotsmc', None, 0))) == quiet
    limits = ('torque', 'ramp')
    stopped = ControllerStatus(START, 'pid', 'emergency_stop', 'emergency stop', limits)
    assert decoded_status(status_message(START, STOPPED)) == stopped


@pytest.mark.parametrize(
    ('text', 'pose'),
    [('0.5, -1e-3, 1.5', (0.5, -1e-3, 1.5)), ('not known', ()), ('0.5, nan', ()), ('', ())],
)
def test_a_pose_that_was_told_is_numbers(text, pose):
    assert decoded_status(status_message(START, Status('pid', None, 0, pose=text))).pose == pose


def test_codes_do_not_depend_on_the_texts():
    fault = Fault('speed', 'said in other words')
    found = decoded_status(status_message(START, Status('pid', fault, 0)))
    assert (found.fault, found.fault_text) == fault


GOOD = {
    'law': 'pid',
    'fault': 'none',
    'limits that acted': 'none',
    'fault code': 'none',
    'limit codes': '',
}


@pytest.mark.parametrize(
    'values',
    [
        {},
        {'law': 'pid', 'fault code': 'none'},
        {key: GOOD[key] for key in GOOD if key != 'limit codes'},
        {key: GOOD[key] for key in GOOD if key != 'fault code'},
        GOOD | {'law': 'x' * 300},
        GOOD | {'fault': '\x1b[2J'},
        GOOD | {'fault code': '\x1b[2J'},
        GOOD | {'limit codes': 'torque,\x1b[2J'},
    ],
)
def test_what_is_not_understood_is_left_out(values):
    assert decoded_status(message(GOOD)) is not None
    assert decoded_status(message(values)) is None
    assert decoded_status(message(GOOD)[:40]) is None
