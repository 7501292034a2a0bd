# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The user of the soak test: a ROS node that acts step by step, and the person at the pendant."""

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalStatus, GoalStatusArray
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from diagnostic_msgs.msg import DiagnosticArray
from epson_msgs.msg import IoPoint
from epson_msgs.srv import ReadIo, SetSpeedScaling
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from support.spin_thread import SpinThread
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.remote_ethernet.client import RemoteError, execute

PATIENCE_S = 120.0
"""Timeout after which a missing answer counts as a hang, s."""

FAR = 0.05
"""Maximum distance of the arm from a successful goal, rad."""

STANDS = 1e-6
"""Maximum change between joint states that counts as at rest, rad."""

STREAM_PERIOD_S = 0.02
JOINTS = [f'joint_{number}' for number in range(1, 7)]
ENDS = {
    GoalStatus.STATUS_SUCCEEDED: 'succeeded',
    GoalStatus.STATUS_CANCELED: 'canceled',
    GoalStatus.STATUS_ABORTED: 'aborted',
}


@dataclass(eq=False)
class SentGoal:
    """An accepted goal and its target. `result` is a future."""

    handle: Any
    target: list[float]
    result: Any
    at_end: list[float] | None = None
    """Joints of the first state after its result, rad."""


class SoakUser:
    """Acts like a user's program and waits for each answer. Its node has a separate thread."""

    def __init__(self, domain: int, remote_port: int) -> None:
        self._remote_port = remote_port
        self._context = Context()
        self._context.init(domain_id=domain)
        self._node = Node('soak', context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        node, driver = self._node, 'epson_driver'
        self._action = ActionClient(
            node, FollowJointTrajectory, f'{driver}/follow_joint_trajectory'
        )
        self._triggers = {
            name: node.create_client(Trigger, f'{driver}/{name}')
            for name in ('stop', 'enable', 'disable', 'reset_error')
        }
        self._read = node.create_client(ReadIo, f'{driver}/read_io')
        self._speed = node.create_client(SetSpeedScaling, f'{driver}/set_speed_scaling')
        self._parameters = node.create_client(SetParameters, f'{driver}/set_parameters')
        self._stream = node.create_publisher(Float64MultiArray, f'{driver}/position_commands', 10)
        self._states = 0
        self._joints: list[float] = []
        self._changed = threading.Condition()
        self._streams: deque[tuple[str, str]] = deque(maxlen=2)
        """`stream followed` and `setpoints received` of the last reports."""
        self._ended: dict[bytes, int] = {}
        self._twice: list[str] = []
        node.create_subscription(JointState, 'joint_states', self._on_joints, 10)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        node.create_subscription(
            GoalStatusArray,
            f'{driver}/follow_joint_trajectory/_action/status',
            self._on_status,
            10,
        )
        self._thread = SpinThread(self._executor)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and leave ROS."""
        self._thread.end()
        self._node.destroy_node()
        self._context.shutdown()

    def problems(self) -> list[str]:
        """Return violations seen in the status topic of the goals."""
        return self._twice

    # --- goals ---

    def goal(self, seconds: float, angle: float) -> SentGoal:
        """Send a goal from the current position, and wait until it is accepted."""
        here = self.joints()
        target = [angle, *here[1:]]
        message = JointTrajectory(joint_names=JOINTS)
        for step in range(4):
            fraction = step / 3.0
            at = [(1.0 - fraction) * a + fraction * b for a, b in zip(here, target, strict=True)]
            whole, part = divmod(fraction * seconds, 1.0)
            duration = Duration(sec=int(whole), nanosec=int(part * 1e9))
            message.points.append(JointTrajectoryPoint(positions=at, time_from_start=duration))
        goal = FollowJointTrajectory.Goal(trajectory=message)
        handle = self._complete(lambda: self._action.send_goal_async(goal))
        if not handle.accepted:
            raise RuntimeError('a goal was not accepted')
        result = self._in_executor(handle.get_result_async)
        return SentGoal(handle, target, result)

    def cancel(self, goal: SentGoal) -> None:
        """Request its cancellation, and wait for the answer."""
        self._complete(goal.handle.cancel_goal_async)

    def result(self, goal: SentGoal) -> tuple[str, str]:
        """Wait for its end and return the outcome and the sentence."""
        answer = self._wait(goal.result)
        if goal.at_end is None:
            goal.at_end = self.joints()
        return ENDS.get(answer.status, f'status {answer.status}'), answer.result.error_string

    def distance(self, goal: SentGoal) -> float:
        """Return the distance of the arm from the goal after its end, rad."""
        at = goal.at_end or self.joints()
        return max(abs(a - b) for a, b in zip(at, goal.target, strict=True))

    # --- everything else ---

    def stream(self, seconds: float, angle: float) -> None:
        """Stream positions for `seconds`, starting at the current one, and wait for the end."""
        here = self.joints()
        steps = max(int(seconds / STREAM_PERIOD_S), 1)
        for step in range(1, steps + 1):
            at = [here[0] + (angle - here[0]) * step / steps, *here[1:]]
            self._stream.publish(Float64MultiArray(data=at))
            time.sleep(STREAM_PERIOD_S)
        with self._changed:
            self._streams.clear()
            if not self._changed.wait_for(self._stream_ended, PATIENCE_S):
                raise TimeoutError('the stream does not end')

    def _stream_ended(self) -> bool:
        """Return whether no setpoint was received or followed between two reports of the driver.

        On a busy machine, the driver receives the last setpoints seconds late.
        """
        return (
            len(self._streams) == 2 and len(set(self._streams)) == 1 and 'none' in self._streams[0]
        )

    def call(self, name: str) -> tuple[bool, str]:
        """Call a service without arguments."""
        answer = self._complete(lambda: self._triggers[name].call_async(Trigger.Request()))
        return answer.success, answer.message

    def enabled(self) -> None:
        """Reset and enable repeatedly until the driver accepts goals again."""
        for client in (*self._triggers.values(), self._read, self._speed, self._parameters):
            if not client.wait_for_service(PATIENCE_S):
                raise TimeoutError(f'no service {client.srv_name}')
        until = time.monotonic() + PATIENCE_S
        while True:
            success, message = self.call('enable')
            if success:
                return
            if time.monotonic() > until:
                raise TimeoutError(f'the arm cannot be enabled: {message}')
            self.call('reset_error')
            time.sleep(0.1)

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter of the driver."""
        content = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=content)])
        (result,) = self._complete(lambda: self._parameters.call_async(request)).results
        if not result.successful:
            raise RuntimeError(f'{name} = {value}: {result.reason}')

    def speed(self, factor: float) -> None:
        """Set the speed scaling."""
        request = SetSpeedScaling.Request(factor=factor)
        answer = self._complete(lambda: self._speed.call_async(request))
        if not answer.success:
            raise RuntimeError(answer.message)

    def read(self) -> None:
        """Read an input."""
        point = IoPoint(type=IoPoint.DIGITAL_INPUT, index=0)
        request = ReadIo.Request(points=[point])
        self._complete(lambda: self._read.call_async(request))

    def pendant(self, command: str) -> None:
        """Do a person's action at the controller, repeated until it is accepted."""
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                asyncio.run(execute('127.0.0.1', self._remote_port, [command], PATIENCE_S))
            except (RemoteError, ConnectionError):
                if time.monotonic() > until:
                    raise
                time.sleep(0.1)
            else:
                return

    # --- the arm ---

    def joints(self, newer: int = 1) -> list[float]:
        """Return joints received after this call, rad."""
        with self._changed:
            wanted = self._states + newer
            if not self._changed.wait_for(lambda: self._states >= wanted, PATIENCE_S):
                raise TimeoutError(f'no joint states for {PATIENCE_S:g} s')
            return list(self._joints)

    def at_rest(self) -> None:
        """Wait until the arm is at rest."""
        until = time.monotonic() + PATIENCE_S
        before = self.joints()
        while True:
            now = self.joints(newer=10)
            if max(abs(a - b) for a, b in zip(before, now, strict=True)) < STANDS:
                return
            before = now
            if time.monotonic() > until:
                raise TimeoutError('the arm does not come to rest')

    def _on_joints(self, message: JointState) -> None:
        with self._changed:
            self._states += 1
            self._joints = list(message.position)
            self._changed.notify_all()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        values = {item.key: item.value for status in message.status for item in status.values}
        with self._changed:
            self._streams.append((values['stream followed'], values['setpoints received']))
            self._changed.notify_all()

    def _on_status(self, message: GoalStatusArray) -> None:
        """Check that a goal does not change its state after its end."""
        for item in message.status_list:
            key = bytes(item.goal_info.goal_id.uuid)
            known = self._ended.get(key)
            if known is not None and item.status != known:
                self._twice.append(f'a goal ended twice: {known}, then {item.status}')
            if item.status in ENDS:
                self._ended[key] = item.status

    # --- waiting ---

    def _in_executor(self, send: Callable[[], Any]) -> Any:
        """Send in the thread that receives the answers, and return the answer's future."""
        return self._wait(self._executor.create_task(send))

    def _complete(self, send: Callable[[], Any]) -> Any:
        return self._wait(self._in_executor(send))

    @staticmethod
    def _wait(future: Any) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        if not done.wait(PATIENCE_S):
            raise TimeoutError(f'no answer within {PATIENCE_S:g} s')
        return future.result()
