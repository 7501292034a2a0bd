# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A goal execution on a manual clock with a scripted controller."""

import contextlib

import numpy as np

from epson_driver.driver.delivery.delivery import PreparedTrajectory
from epson_driver.driver.delivery.streaming import STOP
from epson_driver.driver.goal.goal import Goal, GoalSettings
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_states import FINAL_STATES
from epson_driver.driver.goal.reference import SpeedScaling
from epson_driver.driver.outcome import GoalRejectedError
from epson_driver.driver.state.robot_state import RobotState
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.simple_message import (
    JointPosition,
    JointTrajPt,
    ReplyCode,
    Status,
    TriState,
    joint_data,
    reply,
)

NAMES = ('joint_1', 'joint_2')
LINE = ((0.0, 0.0), (0.5, 0.25), (1.0, 0.5))
CYCLE = ((0.0, 0.0), (0.5, 0.25), (0.0, 0.0))
DT = 0.005
LIMITS = JointLimits(
    NAMES, np.full(2, -9.0), np.full(2, 9.0), np.full(2, 2.0), np.full(2, 20.0), np.full(2, 200.0)
)


def goal_along(points, *, step=1.0, tolerance=(0.01, 0.01), goal_time=0.0, **fields):
    times = np.arange(len(points)) * step
    trajectory = Trajectory(NAMES, times, np.array(points, dtype=float))
    return Goal(trajectory, np.array(tolerance), goal_time, **fields)


def wire_of(points, durations):
    """Return the messages of points."""
    return [
        JointTrajPt(sequence, joint_data([float(value) for value in point]), 0.5, duration)
        for sequence, (point, duration) in enumerate(zip(points, durations, strict=True))
    ]


class Harness:
    """One goal. `sent` has all posted messages, and `broken` makes posting fail."""

    def __init__(
        self,
        points=LINE,
        *,
        settings=None,
        start=True,
        in_motion=TriState.FALSE,
        **options,
    ):
        self.now = 100.0
        self.goal = goal_along(points, **options)
        self.sent = []
        self.outcomes = []
        self.broken = False
        self.robot = RobotState(len(NAMES))
        self.in_motion = in_motion
        self.at = np.array(points[0], dtype=float)
        self._posted = []
        self.scaling = SpeedScaling()
        self.execution = GoalExecution(
            self.goal,
            settings or GoalSettings(),
            self._send,
            self._on_end,
            self.now,
            self.scaling,
        )
        self.wire = wire_of(points, [options.get('step', 1.0)] * len(points))
        self.handled_after = 0.0
        """Delay between reading and handling joints, s."""
        self.see(0.1)
        if start:
            self.start()

    def start(self, trajectory=None, delay=0.0):
        """Start the prepared motion: the goal's trajectory, or the given one."""
        trajectory = trajectory or self.goal.trajectory
        self.execution.start(PreparedTrajectory(trajectory, self.wire, delay), self.now)

    def set_speed(self, factor):
        """Set a speed scaling like the goal queue."""
        self.scaling.set(factor, self.now)
        if not factor:
            self.execution.pause(self.now)
        self.resume()

    def resume(self):
        """Resume a paused goal if the speed scaling permits it."""
        sample = self.robot.sample
        if self.state == 'paused' and self.scaling.target and sample is not None:
            with contextlib.suppress(GoalRejectedError):
                self.execution.resume(sample, LIMITS, 0.02)
                self.scaling.start_from_rest(self.now)
                rest = self.execution.goal.trajectory
                self.wire = wire_of(rest.positions, np.diff(rest.times, prepend=0.0))
                self.start(rest)

    def _send(self, message, on_reply):
        if self.broken:
            raise ConnectionError('test link is backing_off')
        self.sent.append(message)
        self._posted.append(on_reply)

    def _on_end(self, outcome):
        assert self.execution.state in FINAL_STATES
        self.outcomes.append(outcome)

    @property
    def state(self):
        return self.execution.state.value

    @property
    def outcome(self):
        assert len(self.outcomes) == 1, self.outcomes
        return self.outcomes[0]

    @property
    def sequences(self):
        return [message.sequence for message in self.sent]

    @property
    def stops(self):
        return self.sent.count(STOP)

    def answer(self, code=ReplyCode.SUCCESS, message=-1):
        """Answer a sent message, by default the newest."""
        self._posted[message](reply(JointPosition(), code), self.now)

    def refuse(self, message=-1):
        self.answer(ReplyCode.FAILURE, message)

    def joints(self, position=None):
        if position is not None:
            self.at = np.array(position, dtype=float)
        self.robot.on_joints(joint_data(self.at.tolist()), self.now)
        self.execution.on_state(self.robot, self.now + self.handled_after)

    def status(self, **fields):
        """Deliver a STATUS to the robot state and the execution."""
        self.robot.on_status(Status(**{'in_motion': self.in_motion, **fields}), self.now)
        self.execution.on_state(self.robot, self.now)

    def see(self, seconds, *, status=True, moving=0.0):
        """Let time pass with regular joint states and STATUS.

        `moving`: speed of joint 1, rad/s.
        """
        for count in range(round(seconds / DT)):
            self.now += DT
            self.at = self.at + np.array([moving * DT, 0.0])
            self.joints()
            if status and count % 11 == 10:
                self.status()

    def pass_time(self, seconds):
        """Let time pass without messages."""
        self.now += seconds

    def move_to(self, position, seconds=0.2):
        """Move the arm there in a straight line."""
        start, end = self.at, np.array(position, dtype=float)
        steps = round(seconds / DT)
        self.in_motion = TriState.TRUE if self.in_motion != TriState.UNKNOWN else self.in_motion
        for step in range(1, steps + 1):
            self.now += DT
            self.joints(start + (end - start) * step / steps)
        if self.in_motion != TriState.UNKNOWN:
            self.in_motion = TriState.FALSE

    def go_and_answer(self):
        """Execute the newest point like the EPSON controller: move, then answer."""
        self.move_to(self.sent[-1].joints[: len(NAMES)])
        self.answer()

    def finish_points(self):
        """Execute all points. The arm is at the last one, and no message has arrived since."""
        while self.state == 'streaming':
            self.go_and_answer()
