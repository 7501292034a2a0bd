# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The topics of streams of setpoints (docs/servo.md): each message is handed to the driver."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from control_msgs.msg import JointJog
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.servo.setpoint import Setpoint
from epson_driver.node.loop_bridge import DriverEndedError, LoopBridge
from epson_driver.node.setpoint_messages import (
    SetpointError,
    from_jog,
    from_joint_state,
    from_positions,
    from_trajectory,
    from_velocities,
)

SETPOINT_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=10,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""Several, as two publishers may send at once; it suits publishers of either reliability."""


GAP_S = 0.2
"""Messages lost in a shorter gap of a topic are the network's; in a longer one, this process was
held up, and newer messages took their places."""

LONGEST_WAIT_S = 10.0
"""A message that seems to have waited longer came when the system clock was set."""

DISCOVERY_S = 10.0
"""After the start of this process, s: a publisher that is discovered so late may have been sending
before, to the driver that was here then."""

MAX_PUBLISHERS = 32
"""Of a topic, whose messages are counted; of more the latest."""


class Arrivals:
    """Tells a topic's silence from messages that this process was too late to see.

    Few messages wait, so who is held up for a second may not have seen a second of silence.
    A publisher numbers its messages; which of them sent one, ROS does not say. `started`: when
    this process began to listen, monotonic time, s.
    """

    def __init__(self, started: float) -> None:
        self._started = started
        self._newest: list[int] = []
        self._came = 0.0

    def missed(self, number: int | None, came: float) -> bool:
        """Return whether others came before a message and since the one before it.

        `number`: publication_sequence_number of the message; None where the middleware has none.
        `came`: monotonic time, s.
        """
        gap, self._came = came - self._came, came
        if number is None:
            return False
        before = max((each for each in self._newest if each < number), default=0)
        if before:
            self._newest.remove(before)
        self._newest = [*self._newest[-(MAX_PUBLISHERS - 1) :], number]
        if not before:  # new here: later, what it sent so far was not for us
            return number > 1 and came - self._started < DISCOVERY_S
        return number - before > 1 and gap > GAP_S


def came_at(received: int | None) -> float:
    """Return when a message came, monotonic time in s: it may have waited for its callback.

    `received`: when the middleware took it from the network, ns of the system clock; none or 0
    where it does not say.
    """
    waited = time.time() - received * 1e-9 if received else 0.0
    return time.monotonic() - (waited if 0.0 <= waited <= LONGEST_WAIT_S else 0.0)


class ServoInterface:
    """Subscribes to the topics of streams. Make it in the driver's event loop.

    `stop` is called, in the executor's thread, with a trajectory without points.
    """

    def __init__(
        self,
        node: Node,
        servo: Servo,
        joint_names: tuple[str, ...],
        bridge: LoopBridge,
        stop: Callable[[JointTrajectory], None],
        callback_group: CallbackGroup,
    ) -> None:
        self._node = node
        self._clock = node.get_clock()
        self._servo = servo
        self._names = joint_names
        self._bridge = bridge
        self._stop = stop
        readers: tuple[tuple[Any, str, Callable[..., Setpoint]], ...] = (
            (JointTrajectory, '~/servo', self._from_trajectory),
            (JointState, '~/joint_commands', from_joint_state),
            (Float64MultiArray, '~/position_commands', from_positions),
            (Float64MultiArray, '~/velocity_commands', from_velocities),
            (JointJog, '~/joint_jog', from_jog),
        )
        for kind, topic, read in readers:
            node.create_subscription(
                kind,
                topic,
                self._callback(topic, read),
                SETPOINT_QOS,
                callback_group=callback_group,
            )

    def publishers(self, topic: str) -> int:
        """Return how many publishers a topic of streams has."""
        count: int = self._node.count_publishers(self._node.resolve_topic_name(topic))
        return count

    def _callback(
        self, topic: str, read: Callable[..., Setpoint]
    ) -> Callable[[Any, dict[str, Any]], None]:
        arrivals = Arrivals(time.monotonic())

        def callback(message: Any, info: dict[str, Any]) -> None:
            came = came_at(info.get('received_timestamp'))
            missed = arrivals.missed(info.get('publication_sequence_number'), came)
            try:
                if isinstance(message, JointTrajectory) and not message.points:
                    self._stop(message)
                    return
                try:
                    setpoint = read(message, self._names, topic)
                except SetpointError as error:
                    self._bridge.to_loop(self._servo.refuse, topic, str(error), came)
                else:
                    self._bridge.to_loop(partial(self._servo.take, missed=missed), setpoint, came)
            except DriverEndedError:
                return  # nobody is there to follow it
            except Exception as error:  # noqa: BLE001 - it is logged, and stops the arm
                self._bridge.failed(f'taking a setpoint on {topic}', error)

        return callback

    def _from_trajectory(
        self, message: JointTrajectory, names: tuple[str, ...], topic: str
    ) -> Setpoint:
        return from_trajectory(message, names, topic, self._clock.now().nanoseconds * 1e-9)
