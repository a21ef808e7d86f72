"""Why the controller gives up its law for the safe action."""

from __future__ import annotations

from parallel_robot_model.planar_3rrr.kinematics import FOUND, STATUS_TEXT

NONE = FOUND  # the outcomes of the forward kinematics are the first faults
TORQUE_NOT_FINITE = 10
SPEED = 11
POSITION_JUMP = 12
REFERENCE_JUMP = 13
TYPE_1 = 14
TYPE_2 = 15
STATES_STALE = 16
REFERENCE_STALE = 17
STATES_DISAGREE = 18
REFERENCES_DISAGREE = 19
EMERGENCY_STOP = 20

FAULT_TEXT = {
    **STATUS_TEXT,
    TORQUE_NOT_FINITE: 'the law gave a torque that is not finite',
    SPEED: 'a joint is faster than its limit',
    POSITION_JUMP: 'a joint angle jumped: faster than its limit from one state to the next',
    REFERENCE_JUMP: 'the reference jumped: faster than the limit from one sample to the next',
    TYPE_1: 'a leg is close to being stretched or folded (type 1 singularity)',
    TYPE_2: 'the platform is close to yielding (type 2 singularity)',
    STATES_STALE: 'no joint state came for too long',
    REFERENCE_STALE: 'no reference came for too long',
    STATES_DISAGREE: 'joint states contradict one another: two publishers',
    REFERENCES_DISAGREE: 'references contradict one another: two publishers',
    EMERGENCY_STOP: 'emergency stop',
}
