# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A ROS node that streams to a driver and records where the arm is."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from benchmark.servo_streams import JITTER_S, LOST, STREAMS, Arm, Wave
from epson_driver.motion import Array

TIMEOUT_S = 60.0
STILL_S = 1.2
"""An arm that has stood for so long is at rest, and the stream before is over, s."""

STILL = 1e-3
"""A slower arm stands, rad/s."""


class User:
    """The node. Close it in the end."""

    def __init__(self) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('benchmark')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self.states: list[tuple[float, list[float], list[float]]] = []
        self._names: list[str] = []
        self._node.create_subscription(JointState, 'joint_states', self._on_state, 1000)
        self._publishers = {
            name: self._node.create_publisher(each.kind, f'epson_driver/{each.topic}', 10)
            for name, each in STREAMS.items()
        }
        self._enable = self._node.create_client(Trigger, 'epson_driver/enable')
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown()

    def _on_state(self, message: Any) -> None:
        sent = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        self._names = list(message.name)
        self.states.append((sent, list(message.position), list(message.velocity)))

    def _spin(self, until: Callable[[], Any]) -> None:
        ends = time.monotonic() + TIMEOUT_S
        while not until():
            if time.monotonic() > ends:
                raise TimeoutError(f'nothing happened for {TIMEOUT_S:g} s')
            time.sleep(0.01)

    def enable(self) -> None:
        """Enable the arm, as soon as that works. Raises TimeoutError."""
        self._spin(lambda: self._enable.service_is_ready() and self.states)
        ends = time.monotonic() + TIMEOUT_S
        while True:
            future = self._enable.call_async(Trigger.Request())
            self._spin(future.done)
            answer = future.result()
            if answer is not None and answer.success:
                return
            if time.monotonic() > ends:
                raise TimeoutError(f'~/enable: {answer.message if answer else "no answer"}')
            time.sleep(0.2)

    def rest(self) -> float:
        """Wait until the arm has stood for STILL_S; return since when it did, as time.time()."""
        since = time.time()
        seen = len(self.states)

        def still() -> bool:
            nonlocal since, seen
            for sent, _, velocities in self.states[seen:]:
                if max(map(abs, velocities)) > STILL:
                    since = sent
            seen = len(self.states)
            return time.time() > since + STILL_S

        self._spin(still)
        return since

    def stream(self, name: str, wave: Wave, duration: float, rate: float) -> 'Recording':
        """Stream a wave from where the arm stands, and return what the arm did meanwhile."""
        self.rest()
        first = list(self.states[-1][1])
        self.states.clear()
        arm = Arm(self._names, first)
        random = np.random.default_rng(0)
        stream, publisher = STREAMS[name], self._publishers[name]
        begin = time.time()
        count = 0
        while (t := time.time() - begin) < duration:
            if random.random() >= LOST:
                publisher.publish(stream.message(arm, wave, t, begin))
            count += 1
            due = begin + count / rate + JITTER_S * random.uniform(-1.0, 1.0)
            time.sleep(max(due - time.time(), 0.0))
        return Recording(self, begin, first)


class Recording:
    """What an arm did since the begin of a stream, for as long as it is asked."""

    def __init__(self, user: User, begin: float, first: list[float]) -> None:
        self._user = user
        self.begin = begin
        self._first = first[0]

    def taken(self) -> 'Taken':
        """Return what has come so far: joint states go on coming meanwhile."""
        states = list(self._user.states)
        return Taken(
            np.array([sent for sent, _, _ in states]) - self.begin,
            np.array([positions for _, positions, _ in states]),
            self._first,
            np.abs([velocities for _, _, velocities in states]).max(axis=0),
        )


@dataclass(frozen=True)
class Taken:
    """Joint states of a recording, shape (k,) or (k, n), and what follows from them.

    times: s since the stream's begin. positions: rad. first: where joint 1 was then, rad.
    fastest: the largest velocity of each joint, rad/s, shape (n,).
    """

    times: Array
    positions: Array
    first: float
    fastest: Array

    @property
    def ways(self) -> Array:
        """How far joint 1 was from where it began, rad, shape (k,)."""
        return self.positions[:, 0] - self.first
