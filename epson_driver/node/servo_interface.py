# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The topics of streams of setpoints (docs/servo.md): each message is handed to the driver."""

from collections.abc import Callable
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

NEWEST_QOS = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""Only the newest setpoint counts; it suits publishers of either reliability."""


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
                kind, topic, self._callback(topic, read), NEWEST_QOS, callback_group=callback_group
            )

    def _callback(self, topic: str, read: Callable[..., Setpoint]) -> Callable[[Any], None]:
        def callback(message: Any) -> None:
            try:
                if isinstance(message, JointTrajectory) and not message.points:
                    self._stop(message)
                    return
                try:
                    setpoint = read(message, self._names, topic)
                except SetpointError as error:
                    self._bridge.to_loop(self._servo.refuse, topic, str(error))
                else:
                    self._bridge.to_loop(self._servo.take, setpoint)
            except DriverEndedError:
                return  # nobody is there to follow it
            except Exception as error:  # noqa: BLE001 - it is logged, and stops the arm
                self._bridge.failed(f'taking a setpoint on {topic}', error)

        return callback

    def _from_trajectory(
        self, message: JointTrajectory, names: tuple[str, ...], topic: str
    ) -> Setpoint:
        return from_trajectory(message, names, topic, self._clock.now().nanoseconds * 1e-9)
