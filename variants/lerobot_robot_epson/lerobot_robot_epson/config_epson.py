# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The configuration of an arm, for the command line and Python."""

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig

from epson_driver import Robot as Arm
from epson_driver import Settings


@dataclass(kw_only=True)
class EpsonArm:
    """The arm, its limits and its connection.

    host: controller, or None for a new simulated arm that starts at `start`, rad (m).
    controller, model: names of epson_driver. ports: motion, state, io and remote ports other than
    the defaults. speed, acceleration: fractions of the joint limits, (0, 1]. timeout: time from
    the last action to braking, s, more than two periods of the actions. trace_file: a new pcap
    file.
    """

    host: str | None = None
    controller: str = 'simulated'
    model: str = 'c3_a601s'
    ports: dict[str, int] = field(default_factory=dict)
    start: list[float] | None = None
    speed: float = 0.06
    acceleration: float = 0.5
    timeout: float = 0.07
    trace_file: str | None = None

    def make_arm(self) -> Arm:
        """Return the arm, not connected. Raises ValueError or FileNotFoundError."""
        if not 0.0 < self.speed <= 1.0:
            raise ValueError(f'speed = {self.speed}: must be more than 0, and 1 at most')
        settings = Settings(
            servo_scale=self.acceleration, servo_timeout=self.timeout, trace_file=self.trace_file
        )
        kind = {'controller': self.controller, 'model': self.model, 'settings': settings}
        if self.host is None:
            return Arm.simulated(**kind, start=self.start)
        return Arm(self.host, **kind, **{f'{key}_port': port for key, port in self.ports.items()})


@RobotConfig.register_subclass('epson')
@dataclass(kw_only=True)
class EpsonRobotConfig(RobotConfig, EpsonArm):
    """An arm that follows actions, with cameras."""

    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@TeleoperatorConfig.register_subclass('epson_leader')
@dataclass(kw_only=True)
class EpsonLeaderConfig(TeleoperatorConfig, EpsonArm):
    """A leader arm, whose joints are the actions of a follower of the same model.

    hand: source of motion, 'keys' or 'wave'. A wave moves joint 1 to `amplitude`, rad (m), and
    back every `period` s.
    """

    hand: str = 'keys'
    amplitude: float = 0.4
    period: float = 4.0
