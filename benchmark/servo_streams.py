# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the benchmark of streams sends: ways of joint 1 over time, and messages that carry them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

JITTER_S = 0.004
LOST = 0.02
WINDOW_S = 0.1
"""How far MoveIt Servo's windows reach into the future and the past, s."""

Wave = Callable[[float], tuple[float, float]]
"""Way, rad, and velocity, rad/s, of joint 1 at a time ≥ 0 s; the way is 0 at first."""


def sine(t: float) -> tuple[float, float]:
    """0.5 Hz, 0.63 rad/s at most."""
    return 0.2 * (1.0 - np.cos(np.pi * t)), 0.2 * np.pi * np.sin(np.pi * t)


def ramp(t: float) -> tuple[float, float]:
    """To and fro at 0.5 rad/s, 1 s each way: a triangle."""
    phase = t % 2.0
    return (0.5 * phase, 0.5) if phase < 1.0 else (0.5 * (2.0 - phase), -0.5)


def steps(t: float) -> tuple[float, float]:
    """Steps of 0.08 rad to and fro, each of 1 s."""
    return (0.08 if t % 2.0 >= 1.0 else 0.0), 0.0


def jog(t: float) -> tuple[float, float]:
    """A key that is held for 1 s and released for 0.5 s, each way: 0.4 rad/s."""
    phase = t % 3.0
    if phase < 1.0:
        return 0.4 * phase, 0.4
    if phase < 1.5:
        return 0.4, 0.0
    return (0.4 * (2.5 - phase), -0.4) if phase < 2.5 else (0.0, 0.0)


WAVES: dict[str, Wave] = {'sine': sine, 'ramp': ramp, 'steps': steps, 'jog': jog}


@dataclass(frozen=True)
class Arm:
    """Where a run begins: names and positions of the joints."""

    names: list[str]
    first: list[float]

    def pose(self, way: float) -> list[float]:
        """Return where the run began, joint 1 by `way` farther."""
        return [self.first[0] + way, *self.first[1:]]

    def only_first(self, value: float) -> list[float]:
        """Return a value for joint 1 and 0 for the others."""
        return [value] + [0.0] * (len(self.names) - 1)


@dataclass(frozen=True)
class Stream:
    """A kind of stream: its topic, its type, and message(arm, wave, t, begin), times in s."""

    topic: str
    kind: Any
    message: Callable[[Arm, Wave, float, float], Any]


def positions(arm: Arm, wave: Wave, t: float, _begin: float) -> Any:
    """Return positions alone, as forward_command_controller's users send them."""
    return Float64MultiArray(data=arm.pose(wave(t)[0]))


def with_velocities(arm: Arm, wave: Wave, t: float, _begin: float) -> Any:
    """Return positions and velocities, as ros2_control's hardware sends them."""
    way, velocity = wave(t)
    return JointState(name=arm.names, position=arm.pose(way), velocity=arm.only_first(velocity))


def velocities(arm: Arm, wave: Wave, t: float, _begin: float) -> Any:
    """Return velocities alone."""
    return Float64MultiArray(data=arm.only_first(wave(t)[1]))


def window(arm: Arm, wave: Wave, t: float, begin: float) -> Any:
    """Return a window of MoveIt Servo: points 20 ms apart."""
    message = JointTrajectory(joint_names=arm.names)
    message.header.stamp = _stamp(Time, begin + t - WINDOW_S)
    for after in np.arange(0.0, 2.0 * WINDOW_S + 1e-9, 0.02):
        way, velocity = wave(max(t - WINDOW_S + float(after), 0.0))
        message.points.append(
            JointTrajectoryPoint(
                positions=arm.pose(way),
                velocities=arm.only_first(velocity),
                time_from_start=_stamp(Duration, float(after)),
            )
        )
    return message


def _stamp(kind: Any, seconds: float) -> Any:
    return kind(sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))


STREAMS = {
    'positions': Stream('position_commands', Float64MultiArray, positions),
    'with velocities': Stream('joint_commands', JointState, with_velocities),
    'windows': Stream('servo', JointTrajectory, window),
    'velocities': Stream('velocity_commands', Float64MultiArray, velocities),
}
