# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How far the arm is behind a stream of setpoints: through ROS, the driver and a controller.

`python -m benchmark.servo` runs each kind of stream on each kind of controller, a process each,
and prints a table; figures of docs/servo.md. Streams have 4 ms of jitter, and 2 % are lost.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration, Time
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.cli import processes
from epson_driver.motion import Array

JITTER_S = 0.004
LOST = 0.02
WINDOW_S = 0.1
"""How far MoveIt Servo's windows reach into the future and the past, s."""

TIMEOUT_S = 60.0
MAX_LAG_S = 1.5
START = (0.0, 0.1, 0.2, 0.0, -0.5, 0.0)

CONTROLLERS: dict[str, tuple[str, ...]] = {
    'smooth': ('--controller=rc620', '--motion=smooth'),
    'point to point': ('--controller=rc620', '--motion=ptp'),
    'generic': ('--controller=generic', '--motion=ptp'),
    'fanuc': ('--controller=fanuc', '--motion=ptp'),
    'spel': ('--controller=spel',),
}
"""Kinds of simulated controllers, and their arguments."""

Wave = Callable[[float], tuple[float, float]]
"""Way and velocity of joint 1 at a time, s."""


def sine(t: float) -> tuple[float, float]:
    """0.5 Hz, 0.63 rad/s at most."""
    return 0.2 * (1.0 - np.cos(np.pi * t)), 0.2 * np.pi * np.sin(np.pi * t)


def ramp(t: float) -> tuple[float, float]:
    """To and fro at 0.5 rad/s, 2 s each way: a triangle."""
    phase = t % 4.0
    return (0.5 * phase, 0.5) if phase < 2.0 else (0.5 * (4.0 - phase), -0.5)


WAVES: dict[str, tuple[Wave, float]] = {'sine': (sine, 8.0), 'ramp': (ramp, 8.0)}


def stamp(kind: Any, seconds: float) -> Any:
    """Return a Time or a Duration."""
    return kind(sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))


@dataclass
class Stream:
    """A kind of stream: its topic, its type, and the message at a time."""

    topic: str
    kind: Any
    message: Callable[['User', Wave, float, float], Any]


def positions_only(user: 'User', wave: Wave, t: float, _begin: float) -> Any:
    """Return positions."""
    return Float64MultiArray(data=user.pose(wave(t)[0]))


def with_velocities(user: 'User', wave: Wave, t: float, _begin: float) -> Any:
    """Return positions and velocities."""
    way, velocity = wave(t)
    return JointState(name=user.names, position=user.pose(way), velocity=user.only_first(velocity))


def window(user: 'User', wave: Wave, t: float, begin: float) -> Any:
    """Return a window of MoveIt Servo: 20 ms apart."""
    message = JointTrajectory(joint_names=user.names)
    message.header.stamp = stamp(Time, begin + t - WINDOW_S)
    for ahead in np.arange(0.0, 2.0 * WINDOW_S + 1e-9, 0.02):
        way, velocity = wave(max(t - WINDOW_S + float(ahead), 0.0))
        message.points.append(
            JointTrajectoryPoint(
                positions=user.pose(way),
                velocities=user.only_first(velocity),
                time_from_start=stamp(Duration, float(ahead)),
            )
        )
    return message


STREAMS = {
    'positions': Stream('position_commands', Float64MultiArray, positions_only),
    'with velocities': Stream('joint_commands', JointState, with_velocities),
    'windows': Stream('servo', JointTrajectory, window),
}


class User:
    """A node that streams and records."""

    def __init__(self) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('benchmark')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self.states: list[tuple[float, float, float]] = []
        self.names: list[str] = []
        self._first: list[float] = []
        self._at: list[float] = []
        self._node.create_subscription(JointState, 'joint_states', self._on_state, 1000)
        self._publishers = {
            name: self._node.create_publisher(each.kind, f'epson_driver/{each.topic}', 10)
            for name, each in STREAMS.items()
        }
        self._enable = self._node.create_client(Trigger, 'epson_driver/enable')

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()

    def pose(self, way: float) -> list[float]:
        """Return where the run began, joint 1 by `way` farther."""
        return [self._first[0] + way, *self._first[1:]]

    def only_first(self, value: float) -> list[float]:
        """Return a value for joint 1 and 0 for the others."""
        return [value] + [0.0] * (len(self.names) - 1)

    def _on_state(self, message: Any) -> None:
        sent = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        self.names, self._at = list(message.name), list(message.position)
        self.states.append((sent, message.position[0], message.velocity[0]))

    def spin(self, until: Callable[[], Any]) -> None:
        """Take what comes until a condition holds. Raises TimeoutError."""
        ends = time.monotonic() + TIMEOUT_S
        while not until():
            if time.monotonic() > ends:
                raise TimeoutError
            self._executor.spin_once(timeout_sec=0.02)

    def enable(self) -> None:
        """Enable the arm, as soon as that works."""
        self.spin(lambda: self._enable.service_is_ready() and self.states)
        answer = None
        while answer is None or not answer.success:
            future = self._enable.call_async(Trigger.Request())
            self.spin(future.done)
            answer = future.result()

    def rest(self) -> None:
        """Wait until the arm has stood for 1.5 s: the stream before is over."""
        stood = time.monotonic()

        def still() -> bool:
            nonlocal stood
            if abs(self.states[-1][2]) > 1e-4:
                stood = time.monotonic()
            return time.monotonic() > stood + 1.5

        self.spin(still)

    def run(self, name: str, wave: Wave, duration: float, rate: float) -> tuple[float, float]:
        """Stream a wave, and return lag, s, and what is left of the error then, rms in rad."""
        self.rest()
        self._first = list(self._at)
        self.states.clear()
        random = np.random.default_rng(0)
        stream = STREAMS[name]
        begin = time.time()
        count = 0
        while (t := time.time() - begin) < duration:
            if random.random() >= LOST:
                message = stream.message(self, wave, t, begin)
                self._publishers[name].publish(message)
            count += 1
            due = begin + count / rate + JITTER_S * random.uniform(-1.0, 1.0)
            while (left := due - time.time()) > 0.0:
                self._executor.spin_once(timeout_sec=left)
        states = np.array([state[:2] for state in self.states])
        return best_lag(states[:, 0] - begin, states[:, 1] - self._first[0], wave, duration)


def best_lag(times: Array, ways: Array, wave: Wave, duration: float) -> tuple[float, float]:
    """Return the delay with which a wave is nearest to what was measured, and how near, rms."""
    chosen = (times > MAX_LAG_S) & (times < duration)
    found = (np.inf, 0.0)
    for lag in np.arange(-0.1, MAX_LAG_S, 0.002):
        wanted = np.array([wave(t - lag)[0] for t in times[chosen]])
        rms = float(np.sqrt(np.mean((ways[chosen] - wanted) ** 2)))
        found = min(found, (rms, float(lag)))
    return found[1], found[0]


def main() -> None:
    """Run what was chosen, and print a table."""
    parser = argparse.ArgumentParser(description='Lag of the arm behind streams of setpoints.')
    parser.add_argument('--controllers', nargs='+', default=list(CONTROLLERS))
    parser.add_argument('--rates', nargs='+', type=float, default=[50.0])
    args = parser.parse_args()
    print('| controller | stream | rate [Hz] | wave | lag [ms] | rms [mrad] |')
    print('|---|---|---|---|---|---|')
    for controller in args.controllers:
        with tempfile.TemporaryDirectory() as folder:
            run_controller(controller, args.rates, Path(folder))


def run_controller(name: str, rates: list[float], folder: Path) -> None:
    """Run all streams on one kind of controller."""
    arguments = CONTROLLERS[name]
    simulated = processes.sim_controller(folder / 'controller.log', *arguments, start=START)
    with processes.ended_at_exit(simulated):
        domain = processes.free_ros_domain()
        profile = arguments[0].split('=')[1]
        client = processes.client(
            folder / 'client.log', simulated.ports(), domain, controller=profile
        )
        with processes.ended_at_exit(client):
            os.environ.update(processes.ros_environment(domain))
            user = User()
            try:
                user.enable()
                for stream in STREAMS:
                    for rate in rates:
                        for wave, (function, duration) in WAVES.items():
                            lag, rms = user.run(stream, function, duration, rate)
                            print(
                                f'| {name} | {stream} | {rate:g} | {wave} | {lag * 1e3:.0f} | '
                                f'{rms * 1e3:.1f} |',
                                flush=True,
                            )
            finally:
                user.close()


if __name__ == '__main__':
    main()
