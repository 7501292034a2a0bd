# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The slow way back to where the safeguard door interrupted a motion (SPEL+ `Cont`)."""

from epson_driver.motion import Array, JointLimits, go
from epson_driver.sim_controller.arm.low_power import LowPower


class Recovery:
    """A slow move in joint space from where the arm stands to where its motion goes on.

    `start` and `target` have shape (n,), rad; `caps` are those of low power.
    """

    def __init__(self, limits: JointLimits, start: Array, target: Array, caps: LowPower) -> None:
        speed = caps.speed(limits, target - start)
        self._motion = go(limits, start, target, speed, caps.fraction)
        self._time = 0.0
        self._stopping = False

    @property
    def position(self) -> Array:
        """The commanded joint angles now, shape (n,), rad."""
        return self._motion.at(self._time)[0]

    @property
    def still(self) -> bool:
        """Whether it is over: the arm is there, or was stopped on the way."""
        return self._time >= self._motion.duration

    def stop(self) -> None:
        """Brake on the way."""
        if not self._stopping:
            self._stopping = True
            self._motion = self._motion.stop(self._time)
            self._time = 0.0

    def step(self, dt: float) -> None:
        """Let `dt` ≥ 0 s pass."""
        self._time += dt
