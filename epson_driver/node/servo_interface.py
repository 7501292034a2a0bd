# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to the topics of setpoint streams (docs/servo.md).

A message contains one setpoint, or a window: a short trajectory that the next message replaces.
"""

import itertools
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from control_msgs.msg import JointJog
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from epson_driver.driver.servo.setpoint import ArrivalMonitor, Setpoint, Window, came_at
from epson_driver.motion import Array
from epson_driver.node.loop_bridge import DriverEndedError, NodeContext
from epson_driver.node.trajectory_messages import duration_in_s

MAX_AHEAD_S = 0.5
"""Maximum time from now to the end of a window (a short trajectory in a stream), s. A longer
trajectory must be sent as a goal."""

MAX_AGE_S = 0.5
"""Maximum time since the end of a window, s. An older message is late, or the clocks differ."""

MAX_POINTS = 500
"""Maximum number of points in a window: one per millisecond of MAX_AHEAD_S."""


class SetpointError(ValueError):
    """A message is not a valid setpoint."""


def from_trajectory(
    message: JointTrajectory, names: Sequence[str], source: str, now: float
) -> Setpoint:
    """Return the setpoint of a trajectory, which is a single point or a window.

    `now`: current ROS time, s.
    """
    last = message.points[-1]
    stamp = duration_in_s(message.header.stamp)
    ahead = duration_in_s(last.time_from_start) + (stamp - now if stamp else 0.0)
    if ahead > MAX_AHEAD_S:
        raise SetpointError(
            f'its last point is {ahead:.3g} s ahead, the maximum is {MAX_AHEAD_S:g} s: send long '
            'trajectories to ~/joint_trajectory or the action. Or synchronise the clocks'
        )
    if ahead < -MAX_AGE_S:
        raise SetpointError(
            f'its last point was {-ahead:.3g} s ago: the message is late, or the clocks differ'
        )
    positions = _values('positions', last.positions, message.joint_names, names)
    velocities = _values('velocities', last.velocities, message.joint_names, names)
    window = None if positions is None else _window(message, names, stamp - now if stamp else 0.0)
    return _setpoint(source, positions, velocities, window)


def from_joint_state(message: JointState, names: Sequence[str], source: str) -> Setpoint:
    return _setpoint(
        source,
        _values('position', message.position, message.name, names),
        _values('velocity', message.velocity, message.name, names),
    )


def from_positions(message: Float64MultiArray, names: Sequence[str], source: str) -> Setpoint:
    return _setpoint(source, _values('data', message.data, names, names), None)


def from_velocities(message: Float64MultiArray, names: Sequence[str], source: str) -> Setpoint:
    return _setpoint(source, None, _values('data', message.data, names, names))


def from_jog(message: JointJog, names: Sequence[str], source: str) -> Setpoint:
    """Return a velocity setpoint. Joints that the message does not name have the velocity 0."""
    if message.displacements:
        raise SetpointError('displacements are not supported: use velocities')
    _check_names(message.joint_names, names, complete=False)
    if len(message.velocities) != len(message.joint_names):
        raise SetpointError(
            f'{len(message.velocities)} velocities for {len(message.joint_names)} joints'
        )
    velocities = np.zeros(len(names))
    for name, velocity in zip(message.joint_names, message.velocities, strict=True):
        velocities[list(names).index(name)] = velocity
    return _setpoint(source, None, velocities)


def _window(message: JointTrajectory, names: Sequence[str], first: float) -> Window | None:
    """Return the window of a trajectory, or None if it has fewer than two points.

    The window starts at the last point before now. `first`: time from now to the start of the
    trajectory, s. Velocities are ignored unless all points have them.
    """
    passed = 0
    times = [first + duration_in_s(point.time_from_start) for point in message.points]
    for passed in range(len(times) - 1, -1, -1):
        if times[passed] <= 0.0:
            break
    times, points = times[passed:], message.points[passed:]
    if len(points) < 2:
        return None
    if len(points) > MAX_POINTS:
        raise SetpointError(f'more than {MAX_POINTS} points')
    if any(after <= before for before, after in itertools.pairwise(times)):
        raise SetpointError('time_from_start does not increase from point to point')
    joint_names = message.joint_names
    positions = [_values('positions', point.positions, joint_names, names) for point in points]
    if any(position is None for position in positions):
        raise SetpointError('some of its points have no positions')
    velocities = [_values('velocities', point.velocities, joint_names, names) for point in points]
    known = all(velocity is not None for velocity in velocities)
    return Window(np.array(times), np.array(positions), np.array(velocities) if known else None)


def _setpoint(
    source: str,
    positions: Array | None,
    velocities: Array | None,
    window: Window | None = None,
) -> Setpoint:
    if positions is None and velocities is None:
        raise SetpointError('it has neither positions nor velocities')
    return Setpoint(source, positions, velocities, window)


def _values(
    field: str, values: Sequence[float], joint_names: Sequence[str], names: Sequence[str]
) -> Array | None:
    """Return `values` of `joint_names` in the order of `names`, or None if `values` is empty."""
    _check_names(joint_names, names, complete=True)
    if not len(values):
        return None
    if len(values) != len(names):
        raise SetpointError(f'{len(values)} values in {field} for {len(names)} joints')
    order: Any = list(joint_names)
    return np.array(values, dtype=float)[[order.index(name) for name in names]]


def _check_names(joint_names: Sequence[str], names: Sequence[str], *, complete: bool) -> None:
    for name in joint_names:
        if name not in names:
            raise SetpointError(f'unknown joint {name!r}')
    if len(set(joint_names)) != len(joint_names):
        raise SetpointError('a joint occurs twice')
    missing = [name for name in names if name not in joint_names]
    if complete and missing:
        raise SetpointError(f'joints {", ".join(missing)} are missing')


SETPOINT_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""QoS of setpoints. The depth is enough for two simultaneous publishers. With best effort, the
node also accepts reliable publishers."""


class ServoInterface:
    def __init__(self, context: NodeContext, stop: Callable[[JointTrajectory], None]) -> None:
        self._node = context.node
        self._clock = self._node.get_clock()
        self._servo = context.driver.servo
        self._names = context.setup.model.joint_names
        self._bridge = context.bridge
        self._stop = stop
        readers: tuple[tuple[Any, str, Callable[..., Setpoint]], ...] = (
            (JointTrajectory, '~/servo', self._from_trajectory),
            (JointState, '~/joint_commands', from_joint_state),
            (Float64MultiArray, '~/position_commands', from_positions),
            (Float64MultiArray, '~/velocity_commands', from_velocities),
            (JointJog, '~/joint_jog', from_jog),
        )
        for kind, topic, read in readers:
            callback = self._callback(topic, read)
            self._node.create_subscription(
                kind, topic, callback, SETPOINT_QOS, callback_group=context.bridge.group
            )

    def publishers(self, topic: str) -> int:
        count: int = self._node.count_publishers(self._node.resolve_topic_name(topic))
        return count

    def _callback(
        self, topic: str, read: Callable[..., Setpoint]
    ) -> Callable[[Any, dict[str, Any]], None]:
        arrivals = ArrivalMonitor(time.monotonic())

        def callback(message: Any, info: dict[str, Any]) -> None:
            arrival = came_at(info.get('received_timestamp'))
            missed = arrivals.missed(info.get('publication_sequence_number'), arrival)
            try:
                if isinstance(message, JointTrajectory) and not message.points:
                    self._stop(message)
                    return
                try:
                    setpoint = read(message, self._names, topic)
                except SetpointError as error:
                    self._bridge.to_loop(self._servo.refuse, topic, str(error), arrival)
                else:
                    self._bridge.to_loop(
                        partial(self._servo.take, missed=missed), setpoint, arrival
                    )
            except DriverEndedError:
                return  # no driver can follow it
            except Exception as error:  # noqa: BLE001 - it is logged, and stops the arm
                self._bridge.failed(f'receiving a setpoint on {topic}', error)

        return callback

    def _from_trajectory(
        self, message: JointTrajectory, names: tuple[str, ...], topic: str
    ) -> Setpoint:
        return from_trajectory(message, names, topic, self._clock.now().nanoseconds * 1e-9)
