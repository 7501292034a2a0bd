# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The topics of setpoint streams (docs/servo.md). Each message is passed to the driver."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from control_msgs.msg import JointJog
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from epson_driver.driver.servo.arrivals import Arrivals, came_at
from epson_driver.driver.servo.setpoint import Setpoint
from epson_driver.node.loop_bridge import DriverEndedError, NodeContext
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
"""QoS of setpoints. The depth allows two publishers at the same time. Best effort matches
publishers of either reliability."""


class ServoInterface:
    """Subscribes to the topics of streams. Must be created in the driver's event loop.

    `stop` is called in the executor's thread with a trajectory without points.
    """

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
        """Return the number of publishers of a stream topic."""
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
                return  # no driver can follow it
            except Exception as error:  # noqa: BLE001 - it is logged, and stops the arm
                self._bridge.failed(f'taking a setpoint on {topic}', error)

        return callback

    def _from_trajectory(
        self, message: JointTrajectory, names: tuple[str, ...], topic: str
    ) -> Setpoint:
        return from_trajectory(message, names, topic, self._clock.now().nanoseconds * 1e-9)
