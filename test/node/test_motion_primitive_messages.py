# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motion primitives read from messages, errors with motion, field and rule, and tool changes."""

from types import SimpleNamespace

import numpy as np
import pytest
from control_msgs.action import ExecuteMotionPrimitiveSequence
from control_msgs.msg import MotionArgument, MotionPrimitive, MotionPrimitiveSequence
from geometry_msgs.msg import PoseStamped

from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.node.loop_bridge import DriverEndedError
from epson_driver.node.motion_primitives import (
    MotionPrimitives,
    ToolBusyError,
    primitive_result,
    primitives_from_message,
)
from epson_driver.node.node import ClientNode
from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import rotation_of_uvw
from epson_driver.tool_motion.motion_sequence import Kind
from epson_driver.trace import TraceError

LIMITS = load_robot_model('c3_a601s').limits
JOINTS = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
NAN = float('nan')


def pose(x=0.1, y=0.2, z=0.3, *, quaternion=(0.0, 0.0, 0.0, 1.0), frame=''):
    message = PoseStamped()
    message.header.frame_id = frame
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = x, y, z
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion
    return message


def motion(kind, *, joints=(), poses=(), blend_radius=0.0, **arguments):
    return MotionPrimitive(
        type=kind,
        joint_positions=list(joints),
        poses=list(poses),
        blend_radius=blend_radius,
        additional_arguments=[
            MotionArgument(argument_name=name, argument_value=value)
            for name, value in arguments.items()
        ],
    )


def read(*motions):
    return primitives_from_message(
        MotionPrimitiveSequence(motions=list(motions)), LIMITS, 'left_base_link'
    )


def test_kinds_of_primitives_equal_the_constants_of_the_message():
    for kind in Kind:
        assert getattr(MotionPrimitive, kind.name) == kind.value
    assert MotionPrimitive().type == MotionPrimitive.UNKNOWN == -1


def test_each_kind_of_motion_is_read():
    half = np.sqrt(0.5)
    turned = pose(quaternion=(0.0, 0.0, half, half), frame='left_base_link')
    joint, line, arc = read(
        motion(0, joints=JOINTS, velocity=0.5, acceleration=2.0),
        motion(50, poses=[turned], move_time=3.0),
        motion(51, poses=[turned, pose(0.4, 0.5, 0.6, quaternion=(0.0,) * 4)], blend_radius=0.01),
    )
    assert (joint.kind, line.kind, arc.kind) == tuple(Kind)
    assert joint.target.tolist() == JOINTS
    assert (joint.velocity, joint.acceleration, joint.move_time) == (0.5, 2.0, 0.0)
    assert line.velocity is None
    assert line.move_time == 3.0
    assert np.allclose(line.target[:3, :3], rotation_of_uvw(np.array([np.pi / 2, 0.0, 0.0])))
    assert np.allclose(line.target[:, 3], [0.1, 0.2, 0.3, 1.0])
    assert arc.via is not None
    assert arc.via.tolist() == [0.4, 0.5, 0.6]
    assert arc.blend_radius == 0.01


def test_quaternion_becomes_the_rotation_matrix():
    angles = np.array([0.3, -0.4, 0.5])
    rotation = rotation_of_uvw(angles)
    w = np.sqrt(1.0 + np.trace(rotation)) / 2.0
    x = (rotation[2, 1] - rotation[1, 2]) / (4.0 * w)
    y = (rotation[0, 2] - rotation[2, 0]) / (4.0 * w)
    z = (rotation[1, 0] - rotation[0, 1]) / (4.0 * w)
    (line,) = read(motion(50, poses=[pose(quaternion=(x, y, z, w))]))
    assert np.allclose(line.target[:3, :3], rotation, atol=1e-12)


DEGREES = [45.0, -30.0, 20.0, 0.0, 10.0, 0.0]
WRONG = {
    'no motions': ((), 'trajectory has 0 motions: must have 1 to 256'),
    'too many': ((motion(0, joints=JOINTS),) * 257, 'trajectory has 257 motions'),
    'type': ((motion(-1),), r'motions\[0\]: type = -1: must be one of LINEAR_JOINT \(0\)'),
    'unknown type': ((motion(52, poses=[pose()]),), 'type = 52: must be one of'),
    'second motion': (
        (motion(0, joints=JOINTS), motion(0)),
        r'motions\[1\]: joint_positions has',
    ),
    'joints': ((motion(0, joints=JOINTS[:5]),), 'has 5 values: must have 6, for joint_1'),
    'degrees': ((motion(0, joints=DEGREES),), 'look like degrees'),
    'outside': ((motion(0, joints=[3.0, *JOINTS[1:]]),), 'joint_1: position 3 rad is outside'),
    'not finite': ((motion(0, joints=[NAN, *JOINTS[1:]]),), 'is not finite'),
    'both': ((motion(0, joints=JOINTS, poses=[pose()]),), 'LINEAR_JOINT has 1 poses: must have 0'),
    'no pose': ((motion(50),), 'LINEAR_CARTESIAN has 0 poses: must have 1'),
    'a pose and joints': ((motion(50, poses=[pose()], joints=JOINTS),), 'must be empty'),
    'no via': (
        (motion(51, poses=[pose()]),),
        'has 1 poses: must have 2, the end and an intermediate position',
    ),
    'frame': ((motion(50, poses=[pose(frame='world')]),), "'world': must be in left_base_link"),
    'quaternion': (
        (motion(50, poses=[pose(quaternion=(0.0,) * 4)]),),
        r'poses\[0\]: the quaternion .* has length 0: must be 1',
    ),
    'quaternion nan': ((motion(50, poses=[pose(quaternion=(NAN, 0.0, 0.0, 1.0))]),), 'be finite'),
    'place': ((motion(50, poses=[pose(NAN)]),), r'poses\[0\]: the position .* finite'),
    'via': ((motion(51, poses=[pose(), pose(0.0, NAN)]),), r'poses\[1\]: the position'),
    'argument': (
        (motion(0, joints=JOINTS, speed=1.0),),
        "unknown name 'speed', must be one of velocity, acceleration, move_time",
    ),
    'velocity': ((motion(0, joints=JOINTS, velocity=0.0),), 'velocity = 0.0: must be a number'),
    'acceleration': ((motion(0, joints=JOINTS, acceleration=NAN),), 'acceleration = nan: must be'),
    'move_time': ((motion(0, joints=JOINTS, move_time=-1.0),), 'move_time = -1.0: must be'),
    'blend radius': ((motion(0, joints=JOINTS, blend_radius=-1.0),), 'blend_radius = -1.0: must'),
}


@pytest.mark.parametrize('name', WRONG)
def test_invalid_sequence_is_rejected_with_motion_field_and_rule(name):
    motions, words = WRONG[name]
    with pytest.raises(GoalRejectedError, match=words) as caught:
        read(*motions)
    assert caught.value.code is ErrorCode.INVALID_GOAL


def test_duplicate_argument_is_rejected():
    message = motion(0, joints=JOINTS, velocity=0.5)
    message.additional_arguments *= 2
    with pytest.raises(GoalRejectedError, match='additional_arguments has velocity twice'):
        read(message)


def test_error_codes_unknown_to_the_action_become_invalid_goal():
    result = ExecuteMotionPrimitiveSequence.Result
    for code in ErrorCode:
        result_message = primitive_result(Outcome(End.ABORTED, code, 'why'))
        known = code in (result.SUCCESSFUL, result.INVALID_GOAL, result.OLD_HEADER_TIMESTAMP)
        assert result_message.error_code == (code if known else result.INVALID_GOAL)
        assert result_message.error_string == 'why'


def test_set_tool_is_rejected_during_a_sequence():
    with pytest.raises(ToolBusyError):
        MotionPrimitives.set_tool(SimpleNamespace(busy=True), np.eye(4))


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('error', 'expected'),
    [
        (TraceError('trace_folder: No space left on device'), 'trace_folder: No space left'),
        (DriverEndedError(), 'the driver has ended'),
        (ZeroDivisionError('x'), 'setting parameters failed: x'),
    ],
)
def test_failed_parameter_change_is_reported(error, expected):
    def fails(_changes):
        raise error

    bridge = SimpleNamespace(failed=lambda what, failure: f'{what} failed: {failure}')
    node = SimpleNamespace(_set_parameters=fails, _bridge=bridge)
    result = ClientNode._on_set_parameters(node, [])
    assert not result.successful
    assert expected in result.reason
