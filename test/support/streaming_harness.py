# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A smoothly moving arm alone, sampled at 1 kHz, with a planner on the same clock."""

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np

from epson_driver.motion.smoother import MERGE_TOLERANCE
from epson_driver.profiles.profile_rules import FieldsUsed
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm.executor import Point
from epson_driver.sim_controller.arm.streaming import DeadlineCounters, Streaming
from support.controller_harness import SIMULATED, InlinePlanner

LIMITS = load_robot_model('c3_a601s').limits
HOME = np.zeros(6)
DT = 0.001
PERIOD = 0.02


def curve_points(count, amplitude=0.4):
    """Return points of a curve from rest at HOME, shape (count, 6), rad."""
    phase = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count))
    curve = amplitude * np.outer(phase, [1.0, -0.6, 0.4, 0.8, -0.5, 1.2])
    curve[:, 1] += 0.1 * np.sin(3.0 * np.pi * phase)
    return curve


class StreamingHarness:
    """The arm, the waiting points, and the commanded motion. `taken` counts accepted points.

    positions, velocities: commanded values at the start and after each step.
    """

    def __init__(
        self, delay=0.012, start=HOME, uses=FieldsUsed.BOTH, low_power_limits=None, **settings
    ):
        self.planner = InlinePlanner(delay)
        self.timing = DeadlineCounters()
        self.failures: list[Any] = []
        self.arm = Streaming(
            LIMITS,
            start,
            self.planner,
            self.timing,
            self.failures.append,
            replace(SIMULATED.motion, **settings),
            uses,
            low_power_limits,
        )
        self.waiting: deque[Any] = deque()
        self.taken = 0
        self.positions = [self.arm.position]
        self.velocities = [self.arm.velocity]

    def send(self, points, period=PERIOD, velocity=0.0, first=0):
        """Queue points, which the arm accepts when it has room."""
        for sequence, target in enumerate(np.asarray(points, dtype=float), start=first):
            duration = period if sequence else 0.0
            self.waiting.append(Point(sequence, target, velocity, duration))
        self._give()

    def run(self, seconds):
        for _ in range(round(seconds / DT)):
            self._step()

    def rest(self, most=30.0):
        """Run until the arm has reached all points, and return the time needed, s."""
        steps = 0
        while self.arm.moving or self.waiting:
            assert steps * DT < most, 'it does not come to rest'
            self._step()
            steps += 1
        return steps * DT

    def until_still(self, most=2.0):
        """Run until the arm is at rest, and return the time needed, s."""
        steps = 0
        while not self.arm.at_rest:
            assert steps * DT < most, 'the arm does not come to rest'
            self._step()
            steps += 1
        return steps * DT

    @property
    def trace(self):
        """The commanded positions, shape (k, 6), rad."""
        return np.array(self.positions)

    def _step(self):
        self.arm.step(DT)
        self.planner.step(DT)
        self._give()
        self.positions.append(self.arm.position)
        self.velocities.append(self.arm.velocity)

    def _give(self):
        while self.waiting and self.arm.has_room:
            self.arm.take(self.waiting.popleft())
            self.taken += 1


def assert_within_limits(harness, limits=LIMITS, since=0):
    """Check every step, from differences of the commanded positions alone."""
    trace = harness.trace[since:]
    assert np.all(trace >= limits.position_min)
    assert np.all(trace <= limits.position_max)
    for order, limit in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        differences = np.abs(np.diff(trace, order, axis=0)) / DT**order
        assert np.all(differences <= limit * 1.001), f'derivative {order}'
    # the velocities match the positions
    velocities = np.array(harness.velocities[since:])
    slip = np.diff(trace, axis=0) - DT * (velocities[1:] + velocities[:-1]) / 2.0
    assert np.all(np.abs(slip) <= 0.5 * limits.jerk * DT**3)


def assert_passes(harness, points):
    """Assert that the arm passes each point in order and ends exactly at the last one."""
    step = 0
    for index, point in enumerate(points):
        while True:
            assert step < len(harness.positions), f'point {index} is missed'
            reach = np.abs(harness.velocities[step]) * DT + MERGE_TOLERANCE + 1e-5
            if np.all(np.abs(harness.positions[step] - point) <= reach):
                break
            step += 1
    assert harness.arm.position.tolist() == points[-1].tolist()
    assert not harness.arm.velocity.any()
