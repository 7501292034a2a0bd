# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A stand-in for ros2_control's joint_trajectory_controller.

It follows trajectory.cpp and joint_trajectory_controller.cpp (jazzy). A new trajectory replaces
the old one immediately, and starts at its stamp, or now if that is zero. It is connected from the
measured state to its first point, and quintic between points with accelerations. Cancel holds the
present position. The arm follows its commands with one cycle of delay.
"""

import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from rclpy.action import ActionServer, CancelResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from epson_driver.motion import Array, JointLimits
from support.ros_peer import CONTEXTS, PATIENCE
from support.spin_thread import SpinThread

NAME = 'joint_trajectory_controller'
ACTION = f'/{NAME}/follow_joint_trajectory'
NS = 1_000_000_000
PERIOD_S = 0.004
FEEDBACK_S = 0.05


def ns(message: Any) -> int:
    """Return a Time or a Duration, ns."""
    return int(message.sec * NS + message.nanosec)


def between(begin: Array, end: Array, h: float, t: float) -> Array:
    """Return the state (3, n) at time t on the quintic of duration h between two states."""
    (p, v, a), (q, w, b) = begin, end
    d = q - p
    c = [
        p,
        v,
        a / 2,
        (20 * d - (8 * w + 12 * v) * h - (3 * a - b) * h**2) / (2 * h**3),
        (-30 * d + (14 * w + 16 * v) * h + (3 * a - 2 * b) * h**2) / (2 * h**4),
        (12 * d - 6 * (w + v) * h + (b - a) * h**2) / (2 * h**5),
    ]
    return np.array(
        [
            sum(c[k] * t**k for k in range(6)),
            sum(k * c[k] * t ** (k - 1) for k in range(1, 6)),
            sum(k * (k - 1) * c[k] * t ** (k - 2) for k in range(2, 6)),
        ]
    )


@dataclass
class Followed:
    """A trajectory: its points as states, shape (k, 3, n), and the state at acceptance."""

    begin: int
    times: list[int]
    states: Array
    before: Array
    accepted: int

    def at(self, now: int) -> Array:
        """Return the commanded state at a time, ns."""
        since = now - self.begin
        if since < self.times[0]:
            whole = (self.begin + self.times[0] - self.accepted) / NS
            return between(self.before, self.states[0], whole, (now - self.accepted) / NS)
        if since >= self.times[-1]:
            rest = np.zeros_like(self.states[-1])
            rest[0] = self.states[-1][0]
            return rest
        index = int(np.searchsorted(self.times, since, side='right')) - 1
        h = (self.times[index + 1] - self.times[index]) / NS
        into = (since - self.times[index]) / NS
        return between(self.states[index], self.states[index + 1], h, into)


class JtcLike:
    """A controller in a separate thread. `commanded`: time, ns, and state of each cycle.

    ahead: error of its clock, ns. reports: publish `~/controller_state`, too.
    """

    def __init__(
        self, domain: int, names: tuple[str, ...], start: list[float], *, reports: bool = True
    ) -> None:
        self.names, self.ahead = names, 0
        self.commanded: list[tuple[int, Array]] = []
        self.accepted: list[FollowJointTrajectory.Goal] = []
        self._domain = domain
        self._lock = threading.Lock()
        self._state = np.array([start, np.zeros(len(names)), np.zeros(len(names))])
        self._followed: Followed | None = None
        self._active: tuple[Any, Future] | None = None
        self.node = Node(NAME, context=CONTEXTS.take(domain))
        self._states = self.node.create_publisher(JointState, 'joint_states', 10)
        self._reports = (
            self.node.create_publisher(JointTrajectoryControllerState, '~/controller_state', 10)
            if reports
            else None
        )
        self.server = ActionServer(
            self.node,
            FollowJointTrajectory,
            '~/follow_joint_trajectory',
            self._execute,
            handle_accepted_callback=self._accepted,
            cancel_callback=self._cancel,
        )
        # smooth_goals only checks its name
        self.node.create_service(Trigger, '~/query_state', lambda _, response: response)
        self._executor = SingleThreadedExecutor(context=self.node.context)
        self._executor.add_node(self.node)
        self._closing = False
        self._spinning = SpinThread(self._executor)
        self._cycling = threading.Thread(target=self._cycle)
        self._spinning.start()
        self._cycling.start()

    def close(self) -> None:
        self._closing = True
        self._cycling.join(PATIENCE)
        self._spinning.end()
        self.node.destroy_node()
        CONTEXTS.give(self._domain)

    # --- the executor's thread --------------------------------------------------------------

    def _accepted(self, handle: Any) -> None:
        goal = handle.request
        points = goal.trajectory.points
        order = [goal.trajectory.joint_names.index(name) for name in self.names]
        states = np.array([[p.positions, p.velocities, p.accelerations] for p in points])
        now, stamp = self.now(), ns(goal.trajectory.header.stamp)
        with self._lock:
            self._end('abort', -1, 'Current goal preempted by new incoming action.')
            measured = self._state.copy()
            measured[2] = 0.0
            self._followed = Followed(
                stamp or now,
                [ns(point.time_from_start) for point in points],
                states[:, :, order],
                measured,
                now,
            )
            self._active = (handle, Future())
            self.accepted.append(goal)
        handle.execute()

    async def _execute(self, handle: Any) -> FollowJointTrajectory.Result:
        assert self._active is not None
        how, code, text = await self._active[1]
        getattr(handle, how)()
        return FollowJointTrajectory.Result(error_code=code, error_string=text)

    def _cancel(self, _handle: Any) -> CancelResponse:
        with self._lock:
            self._followed = None  # holds the present position
            self._executor.create_task(self._end_locked, 'canceled', 0, '')
        return CancelResponse.ACCEPT

    def _end_locked(self, *how: Any) -> None:
        with self._lock:
            self._end(*how)

    def _end(self, how: str, code: int, text: str) -> None:
        if self._active is not None:
            self._active[1].set_result((how, code, text))
            self._active = None

    def abort(self, code: int, text: str) -> None:
        """Abort the running goal, like after a tolerance violation."""
        with self._lock:
            self._followed = None
            self._executor.create_task(self._end_locked, 'abort', code, text)

    # --- the control loop -------------------------------------------------------------------

    def now(self) -> int:
        """Return the time on its clock, ns."""
        return self.node.get_clock().now().nanoseconds + self.ahead

    def _cycle(self) -> None:
        fed = 0
        while not self._closing:
            time.sleep(PERIOD_S)
            now = self.now()
            with self._lock:
                measured = self._state
                if (followed := self._followed) is not None:
                    self._state = followed.at(now)
                    if now >= followed.begin + followed.times[-1]:
                        self._followed = None
                        self._executor.create_task(self._end_locked, 'succeed', 0, 'Goal reached')
                else:
                    self._state = np.array([self._state[0], *np.zeros_like(self._state[1:])])
                self.commanded.append((now, self._state))
                active = self._active
            message = JointState(
                name=list(self.names),
                position=measured[0].tolist(),
                velocity=measured[1].tolist(),
            )
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, NS)
            self._states.publish(message)
            if self._reports is not None:
                report = JointTrajectoryControllerState(joint_names=message.name)
                report.header = message.header
                report.feedback.positions = message.position
                report.feedback.velocities = message.velocity
                self._reports.publish(report)
            if active is not None and now - fed >= FEEDBACK_S * NS:
                fed = now
                feedback = FollowJointTrajectory.Feedback(joint_names=list(self.names))
                feedback.header.stamp = message.header.stamp
                feedback.desired.positions = self._state[0].tolist()
                if followed is not None:
                    since = max(now - followed.begin, 0)
                    passed = feedback.desired.time_from_start
                    passed.sec, passed.nanosec = divmod(since, NS)
                feedback.actual.positions = measured[0].tolist()
                active[0].publish_feedback(feedback)


def limit_usage(commanded: list[tuple[int, Array]], limits: JointLimits) -> dict[str, float]:
    """Return the largest velocity, acceleration, jerk and jump of the commands.

    All are fractions of the limits. Jerk is the change of acceleration in a cycle. A jump is the
    part of a cycle's displacement that its velocities and accelerations do not explain.
    """
    times = np.array([time for time, _ in commanded]) / NS
    q, v, a = np.moveaxis(np.array([state for _, state in commanded]), 1, 0)
    h = np.diff(times)[:, None]
    slip = np.abs(np.diff(q, axis=0) - h * (v[1:] + v[:-1]) / 2 + h**2 * np.diff(a, axis=0) / 12)
    return {
        'velocity': float((np.abs(v) / limits.velocity).max()),
        'acceleration': float((np.abs(a) / limits.acceleration).max()),
        'jerk': float((np.abs(np.diff(a, axis=0)) / h / limits.jerk).max()),
        'jump': float((slip / (limits.jerk * h**3 / 4 + 1e-9)).max()),
    }
