# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What point-to-point motion consists of: statements, their motions, and a stop between."""

from dataclasses import dataclass

from epson_driver.motion import Array, LineMotion
from epson_driver.motion.joint_stop import JointStop
from epson_driver.motion.path_motion import PathMotion
from epson_driver.sim_controller.arm.executor import Way

Stop = LineMotion | PathMotion | JointStop


@dataclass(slots=True, eq=False)
class Statement:
    """A `Go`: its target, fractions of the limits, when its motion may begin, s.

    duration: how long it takes at least, s; 0: no matter. executed: whether the program goes on
    after it, though the arm may still decelerate. begun: whether the arm has begun it. cp: whether
    it is executed as soon as the arm decelerates. way: how it goes there, if not straight.
    """

    target: Array
    speed: float
    accel: float
    ready: float
    duration: float = 0.0
    executed: bool = False
    begun: bool = False
    cp: bool = False
    way: Way | None = None


@dataclass(slots=True, eq=False)
class Leg:
    """The motion of a statement since `begin`, s, at a speed, at low power or not.

    decelerates: whether its deceleration has begun, and the next statement with it.
    """

    statement: Statement
    motion: LineMotion | PathMotion
    begin: float
    speed: float
    low_power: bool
    decelerates: bool = False

    @property
    def braking(self) -> float:
        """When its deceleration begins, s."""
        return self.begin + self.motion.braking

    @property
    def end(self) -> float:
        """When it ends, s."""
        return self.begin + self.motion.duration


@dataclass(frozen=True, slots=True, eq=False)
class Brake:
    """A stop since `begin`, s."""

    motion: Stop
    begin: float

    @property
    def end(self) -> float:
        """When the arm stands, s."""
        return self.begin + self.motion.duration
