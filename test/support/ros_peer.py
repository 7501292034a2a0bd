# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A ROS node in a thread that records the driver's messages for assertions."""

import itertools
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from diagnostic_msgs.msg import DiagnosticArray
from epson_msgs.srv import SetSpeedScaling
from industrial_msgs.msg import RobotStatus
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from support.spin_thread import SpinThread

PATIENCE = 120.0
"""Time limit for an event, s. No assertion depends on it."""

JOINTS = [f'joint_{i}' for i in range(1, 7)]
STATUS_NAMES = {
    GoalStatus.STATUS_SUCCEEDED: 'succeeded',
    GoalStatus.STATUS_CANCELED: 'canceled',
    GoalStatus.STATUS_ABORTED: 'aborted',
}


def trajectory(*points: tuple[float, list[float]], names: list[str] = JOINTS) -> JointTrajectory:
    """Return a message from (time_from_start in s, positions) pairs."""
    message = JointTrajectory(joint_names=names)
    for seconds, positions in points:
        whole, fraction = divmod(seconds, 1.0)
        duration = Duration(sec=int(whole), nanosec=round(fraction * 1e9))
        message.points.append(JointTrajectoryPoint(positions=positions, time_from_start=duration))
    return message


def stamp(message: Any) -> float:
    """Return the time of a message with a header, s."""
    seconds: float = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
    return seconds


class Goal:
    """A goal sent to the driver, with its feedback and result."""

    def __init__(self, peer: 'RosPeer', message: JointTrajectory, **fields: Any) -> None:
        self.feedback: list[Any] = []
        self._peer = peer
        goal = FollowJointTrajectory.Goal(trajectory=message, **fields)
        future = peer.in_executor(
            lambda: peer.action.send_goal_async(
                goal, lambda message: self.feedback.append(message.feedback)
            )
        )
        self.handle = peer.complete(future)
        assert self.handle.accepted
        self._result = peer.in_executor(self.handle.get_result_async)

    @property
    def done(self) -> bool:
        return self._result.done()

    def cancel(self) -> None:
        self._peer.complete(self._peer.in_executor(self.handle.cancel_goal_async))

    def result(self) -> tuple[str, int, str]:
        """Return the final status (`succeeded`, …), the error code, and the error string."""
        answer = self._peer.complete(self._result)
        return (
            STATUS_NAMES[answer.status],
            answer.result.error_code,
            answer.result.error_string,
        )


class Contexts:
    """The ROS contexts of this process, one per domain, shared by its peers."""

    def __init__(self) -> None:
        self._open: dict[int, Context] = {}
        self._peers: Counter[int] = Counter()

    def take(self, domain: int) -> Context:
        """Return the context of a domain. Call `give` when it is not needed any more."""
        if domain not in self._open:
            self._open[domain] = Context()
            self._open[domain].init(domain_id=domain)
        self._peers[domain] += 1
        return self._open[domain]

    def give(self, domain: int) -> None:
        """Shut a domain's context down with its last peer, so the next peer discovers afresh."""
        self._peers[domain] -= 1
        if not self._peers[domain]:
            self._open.pop(domain).shutdown()


CONTEXTS = Contexts()
NUMBERS = itertools.count(1)
"""Numbers for unique node names."""


class RosPeer:
    """Records all messages that the driver publishes."""

    def __init__(
        self,
        domain: int,
        prefix: str = '',
        node: str = 'epson_driver',
        contexts: Contexts = CONTEXTS,
    ) -> None:
        self._domain, self._contexts = domain, contexts
        context = contexts.take(domain)
        self.node = Node(  # without unused entities, which the executor would poll
            f'peer_{next(NUMBERS)}',
            context=context,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._changed = threading.Condition()
        self.joint_states: list[JointState] = []
        self.robot_status: list[RobotStatus] = []
        self.link_states: list[str] = []
        self.diagnostics: list[DiagnosticArray] = []
        self.controller_states: list[JointTrajectoryControllerState] = []
        """Messages with a reference, which exists during a goal only."""
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        driver = f'{prefix}/{node}'
        for kind, topic, kept, qos in (
            (JointState, f'{prefix}/joint_states', self.joint_states, 1000),
            (RobotStatus, f'{prefix}/robot_status', self.robot_status, 100),
            (DiagnosticArray, '/diagnostics', self.diagnostics, 10),
        ):
            self._subscribe(kind, topic, kept.append, qos)
        self._subscribe(
            JointTrajectoryControllerState,
            f'{driver}/controller_state',
            self._keep_state,
            100,
        )
        self._subscribe(
            String,
            f'{driver}/link_state',
            lambda message: self.link_states.append(message.data),
            latched,
        )
        self.trajectory_topic = self.node.create_publisher(
            JointTrajectory, f'{driver}/joint_trajectory', 10
        )
        self.action = ActionClient(
            self.node, FollowJointTrajectory, f'{driver}/follow_joint_trajectory'
        )
        self._services = {
            name: self.node.create_client(Trigger, f'{driver}/{name}')
            for name in ('stop', 'enable', 'disable', 'reset_error')
        }
        self.speed_scaling: list[float] = []
        self._subscribe(
            Float64,
            f'{driver}/speed_scaling',
            lambda message: self.speed_scaling.append(message.data),
            latched,
        )
        self._set_speed = self.node.create_client(SetSpeedScaling, f'{driver}/set_speed_scaling')
        self._thread = SpinThread(self._executor)
        self._thread.start()

    def close(self) -> None:
        self._thread.end()
        self.node.destroy_node()
        self._contexts.give(self._domain)

    def _keep_state(self, message: JointTrajectoryControllerState) -> None:
        if message.reference.positions:
            self.controller_states.append(message)

    def _subscribe(
        self, kind: Any, topic: str, store: Callable[[Any], None], qos: QoSProfile | int
    ) -> None:
        """Store a topic's messages. Event callbacks are off because they cost executor time."""

        def callback(message: Any) -> None:
            with self._changed:
                store(message)
                self._changed.notify_all()

        self.node.create_subscription(
            kind,
            topic,
            callback,
            qos,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    def wait_for(
        self, condition: Callable[[], Any], meaning: str, patience: float = PATIENCE
    ) -> Any:
        """Wait until `condition()` is true, checked at each message. Fails with `meaning`."""
        with self._changed:
            until = time.monotonic() + patience
            while not (value := condition()):
                left = until - time.monotonic()
                assert left > 0, f'{meaning}: not within {patience:g} s'
                self._changed.wait(min(left, 0.1))
            return value

    def in_executor(self, send: Callable[[], Any]) -> Any:
        """Send an action's request in the executor's thread, and return the reply's future.

        rclpy's action client registers a request after sending it, so a reply that another
        thread takes earlier would be lost.
        """
        return self.complete(self._executor.create_task(send))

    def complete(self, future: Any) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _future: done.set())
        assert done.wait(PATIENCE), f'no answer within {PATIENCE:g} s'
        return future.result()

    def wait_until_ready(self) -> None:
        """Wait for joints, a status of a connected controller, and the driver's entry points."""
        assert self.action.wait_for_server(PATIENCE)
        for client in self._services.values():
            assert client.wait_for_service(PATIENCE)
        self.wait_for(lambda: self.joint_states, 'joint_states')
        self.wait_for(
            lambda: self.robot_status and self.robot_status[-1].mode.val != -1, 'robot_status'
        )
        self.wait_for(lambda: 'connected' in self.link_states[-1:], 'link_state connected')

    @contextmanager
    def client(self, kind: Any, name: str, **options: Any) -> Iterator[Any]:
        """Yield a client of an available service, and destroy it at the end."""
        client = self.node.create_client(kind, name, **options)
        try:
            assert client.wait_for_service(PATIENCE)
            yield client
        finally:
            self.node.destroy_client(client)

    def begin_call(self, service: str) -> Any:
        """Call `~/stop`, `~/enable`, … and return the future of the reply."""
        client = self._services[service]
        return self.in_executor(lambda: client.call_async(Trigger.Request()))

    def call(self, service: str) -> tuple[bool, str]:
        """Call `~/stop`, `~/enable`, … and return (success, message)."""
        client = self._services[service]
        assert client.wait_for_service(PATIENCE)
        answer = self.complete(client.call_async(Trigger.Request()))
        return answer.success, answer.message

    def set_speed(self, factor: float) -> tuple[bool, str]:
        """Call `~/set_speed_scaling` and return (success, message)."""
        assert self._set_speed.wait_for_service(PATIENCE)
        request = SetSpeedScaling.Request(factor=factor)
        answer = self.complete(self._set_speed.call_async(request))
        return answer.success, answer.message

    def goal(self, message: JointTrajectory, **fields: Any) -> Goal:
        return Goal(self, message, **fields)

    def enable(self) -> None:
        success, message = self.call('enable')
        assert success, message

    def newer(self, count: int = 1) -> list[JointState]:
        """Return `count` joint states that are stamped after this call.

        A message received after this call may be older, because results of goals overtake joint
        states.
        """
        old, now = len(self.joint_states), time.time()

        def there() -> bool:
            nonlocal old
            while old < len(self.joint_states) and stamp(self.joint_states[old]) <= now:
                old += 1
            return len(self.joint_states) >= old + count

        self.wait_for(there, 'new joint states')
        return self.joint_states[old : old + count]

    def position(self) -> np.ndarray:
        """Return joint positions measured after this call."""
        return np.array(self.newer()[0].position)

    def wait_for_motion(self, start: np.ndarray | None = None) -> None:
        """Wait until the joints are away from `start` (default: from their present position)."""
        start = self.position() if start is None else start
        self.wait_for(
            lambda: np.abs(np.array(self.joint_states[-1].position) - start).max() > 0.01,
            'motion',
        )

    def wait_until_still(self, seconds: float = 0.5) -> np.ndarray:
        """Wait until joints and controller report standstill for `seconds`, and return the joints.

        Time stamps count, not messages: a controller that was not scheduled sends a burst.
        """
        start = len(self.joint_states)

        def still() -> bool:
            states = self.joint_states[start:]
            if not states or self.robot_status[-1].in_motion.val != 0:
                return False
            until = stamp(states[-1]) - seconds
            moved = (state for state in reversed(states) if state.position != states[-1].position)
            return stamp(next(moved, states[0])) <= until

        self.wait_for(still, 'standstill')
        return np.array(self.joint_states[-1].position)

    def assert_still(self, states: int = 30) -> np.ndarray:
        """Assert that the next joint states are equal, and return the position."""
        first, *others = self.newer(states)
        for state in others:
            assert list(state.position) == list(first.position)
        return np.array(first.position)
