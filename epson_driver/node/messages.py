# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts the driver's values to ROS messages, and the driver's remedies to advice."""

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from industrial_msgs.msg import RobotMode, RobotStatus, TriState
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.outcome import Outcome
from epson_driver.driver.remedy import Remedy, with_remedy
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.node.trajectory_messages import duration_message
from epson_driver.simple_message import Mode, Status

WORDS = {
    Remedy.CONNECT: 'start the controller, or check robot_ip and the ports',
    Remedy.RELEASE_ESTOP: 'release it, call ~/reset_error (or reset at the controller), '
    'then ~/enable',
    Remedy.RESET: 'call ~/reset_error, then ~/enable',
    Remedy.TURN_TO_AUTO: 'turn it to AUTO, then call ~/enable',
    Remedy.ENABLE: 'call ~/enable',
    Remedy.END_STREAM: 'end it, let it hold still for a second, or call ~/stop',
    Remedy.ALLOW_OTHER_SPEED: 'or set require_planned_speed to false',
    Remedy.ALLOW_END_VELOCITY: 'or set allow_nonzero_velocity_at_trajectory_end',
}


def outcome_text(outcome: Outcome) -> str:
    return with_remedy(outcome.text, outcome.remedy, WORDS)


def error_text(error: CommandError) -> str:
    return with_remedy(str(error), error.remedy, WORDS)


class JointStateWriter:
    """Writes joint samples to a message, which is only valid until the next call of `write`."""

    def __init__(self, joint_names: Sequence[str], frame_id: str = '') -> None:
        zeros = [0.0] * len(joint_names)
        message = JointState(name=list(joint_names), position=zeros, velocity=zeros)
        message.header.frame_id = frame_id
        self._message = message
        self._positions = np.frombuffer(message.position)  # the message's own memory
        self._velocities = np.frombuffer(message.velocity)

    def write(self, sample: JointSample, stamp: Time) -> JointState:
        message = self._message
        message.header.stamp = stamp
        self._positions[:] = sample.positions
        self._velocities[:] = sample.velocities
        return message


class RobotStatusWriter:
    """Converts STATUS to RobotStatus. For an unchanged STATUS, the last message is reused."""

    def __init__(self) -> None:
        self._status = Status()
        self._message = robot_status(self._status, Time())

    def write(self, status: Status, stamp: Time) -> RobotStatus:
        if status == self._status:
            self._message.header.stamp = stamp
        else:
            self._status, self._message = status, robot_status(status, stamp)
        return self._message


def robot_status(status: Status, stamp: Time) -> RobotStatus:
    """Return a STATUS as industrial_msgs/RobotStatus. A value outside an enum becomes UNKNOWN."""
    message = RobotStatus()
    message.header.stamp = stamp
    known_mode = status.mode in (Mode.MANUAL, Mode.AUTO)
    message.mode.val = status.mode if known_mode else RobotMode.UNKNOWN
    for name in ('e_stopped', 'drives_powered', 'motion_possible', 'in_motion', 'in_error'):
        value = getattr(status, name)
        getattr(message, name).val = value if value in (0, 1) else TriState.UNKNOWN
    message.error_codes = [status.error_code] if status.error_code else []
    return message


def result(outcome: Outcome) -> FollowJointTrajectory.Result:
    text = outcome_text(outcome)
    return FollowJointTrajectory.Result(error_code=int(outcome.code), error_string=text)


def feedback(
    execution: GoalExecution, sample: JointSample, stamp: Time
) -> FollowJointTrajectory.Feedback:
    message = FollowJointTrajectory.Feedback()
    message.header.stamp = stamp
    message.joint_names = list(execution.goal.trajectory.joint_names)
    message.desired, message.actual, message.error = _points(execution, sample)
    return message


def controller_state(
    execution: GoalExecution, sample: JointSample, stamp: Time
) -> JointTrajectoryControllerState:
    message = JointTrajectoryControllerState()
    message.header.stamp = stamp
    message.joint_names = list(execution.goal.trajectory.joint_names)
    message.reference, message.feedback, message.error = _points(execution, sample)
    trajectory, target = execution.goal.trajectory, execution.target
    message.output = JointTrajectoryPoint(
        positions=trajectory.positions[target].tolist(),
        time_from_start=duration_message(float(trajectory.times[target])),
    )
    message.speed_scaling_factor = execution.speed(sample.time)
    return message


def idle_state(
    names: Sequence[str], sample: JointSample, stamp: Time
) -> JointTrajectoryControllerState:
    message = JointTrajectoryControllerState(speed_scaling_factor=1.0)
    message.joint_names = list(names)
    message.header.stamp = stamp
    message.feedback.positions = sample.positions.tolist()
    message.feedback.velocities = sample.velocities.tolist()
    return message


def _points(
    execution: GoalExecution, sample: JointSample
) -> tuple[JointTrajectoryPoint, JointTrajectoryPoint, JointTrajectoryPoint]:
    at_rest = (0.0, sample.positions, np.zeros_like(sample.velocities))
    time, positions, velocities = execution.desired or at_rest
    desired = JointTrajectoryPoint(
        positions=positions.tolist(),
        velocities=velocities.tolist(),
        time_from_start=duration_message(max(time, 0.0)),
    )
    actual = JointTrajectoryPoint(
        positions=sample.positions.tolist(),
        velocities=sample.velocities.tolist(),
        time_from_start=duration_message(max(sample.time - execution.started, 0.0)),
    )
    error = JointTrajectoryPoint(
        positions=(positions - sample.positions).tolist(),
        velocities=(velocities - sample.velocities).tolist(),
        time_from_start=actual.time_from_start,
    )
    return desired, actual, error
