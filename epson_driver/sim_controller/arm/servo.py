# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The servos and encoders: from commanded to reported joint positions.

Each joint follows its command with a first-order lag, solved exactly for a command that is linear
between steps. The joint's motion is a weighted mean of earlier commands. So it never exceeds the
command's velocity, acceleration or jerk, and never overshoots.
"""

import math

import numpy as np

from epson_driver.motion import Array

SETTLE_JERK = 10.0
"""Jerk within one step, rad/s³, below which a joint is set to its command."""

SETTLE_DISTANCE = 1e-12
"""Distance, rad, at which a joint is set to its command whatever the step."""

MIN_STEP_S = 1e-9
"""Shortest step, s.

A shorter one is ignored, and its change of command counts in the next step.
"""


class Servo:
    """The servos of n joints, initially at rest at `start`, shape (n,), rad.

    `lag` ≥ 0 is the delay of the joints behind the command, s (0: none). `encoder` rounds the
    reported positions to whole pulses, with `pulses`, shape (n,), per rad (or m), NaN where
    unknown. Raises ValueError for other numbers.
    """

    def __init__(self, start: Array, pulses: Array, lag: float, encoder: bool) -> None:
        if not 0.0 <= lag < math.inf:
            raise ValueError(f'lag = {lag}: must be finite and not negative')
        if start.shape != pulses.shape or start.ndim != 1:
            raise ValueError(f'{pulses.size} pulses per unit for {start.size} joints')
        self._pulses = pulses if encoder else None
        self._lag = lag
        self._frozen: dict[int, float] = {}
        self._rest = np.zeros_like(start)
        self._command = start.copy()
        self._actual = start.copy()
        self._velocity = self._rest
        self._settled = True
        self._pushed = False

    @property
    def position(self) -> Array:
        """The positions that the encoders report now, shape (n,), rad."""
        position = self._actual.copy()
        if self._pulses is not None:
            counted = np.rint(position * self._pulses) / self._pulses
            position = np.where(np.isnan(counted), position, counted)
        for joint, value in self._frozen.items():
            position[joint] = value
        return position

    @property
    def velocity(self) -> Array:
        """The joint velocities that the encoders report, shape (n,), rad/s."""
        velocity = self._velocity.copy()
        for joint in self._frozen:
            velocity[joint] = 0.0
        return velocity

    @property
    def settled(self) -> bool:
        """Whether all joints are at rest exactly at a constant command."""
        return self._settled

    @property
    def actual(self) -> Array:
        """The true joint positions, shape (n,), rad, independent of the encoders."""
        return self._actual

    def step(self, commanded: Array, dt: float) -> None:
        """Advance by `dt` ≥ 0 s, while the command changes to `commanded`, shape (n,), rad."""
        unchanged = bool((commanded == self._command).all())
        if self._settled and unchanged:
            return
        self._settled = False
        if dt < MIN_STEP_S:
            return
        before = commanded if self._pushed else self._command
        self._command, self._pushed = commanded.copy(), False
        speed = (commanded - before) / dt
        if self._lag == 0.0:
            self._velocity = speed
            self._arrive(unchanged)
            return
        # Behind a command of constant speed a joint lags by `behind`. The rest decays.
        behind = self._lag * speed
        lag = behind + (before - self._actual - behind) * math.exp(-dt / self._lag)
        self._actual = commanded - lag
        self._velocity = lag / self._lag
        if unchanged and float(np.abs(lag).max()) <= max(SETTLE_DISTANCE, SETTLE_JERK * dt**3):
            self._velocity = self._rest
            self._arrive(unchanged)

    def _arrive(self, settled: bool) -> None:
        self._actual = self._command
        self._settled = settled

    def freeze(self, joint: int | None) -> None:
        """Freeze the encoder of a joint (index from 0). None unfreezes all encoders."""
        if joint is None:
            self._frozen.clear()
        else:
            self._frozen.setdefault(joint, float(self.position[joint]))

    def jump(self, position: Array) -> None:
        """Move the joints, shape (n,), rad, as after a push or while the controller was off.

        They return to the command with the next step.
        """
        self._actual = position.copy()
        self._velocity = self._rest
        self._settled = bool((self._actual == self._command).all())
        self._pushed = True

    def place(self, position: Array) -> None:
        """Set the position of joints without power, shape (n,), rad."""
        self._command = position.copy()
        self._arrive(settled=True)
        self._velocity = self._rest
        self._pushed = False
