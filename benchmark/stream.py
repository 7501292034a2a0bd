# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The jerk of the simulated arm behind a stream of setpoints: 50 Hz, a 0.5 Hz sine of 0.2 rad."""

import numpy as np

from benchmark.limit_sets import limit_set
from epson_driver.driver.servo.servo import STOP_WITHIN_S
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.driver.servo.stream import StreamFilter
from epson_driver.motion.setpoint_tracker import SetpointTracker, servo_limits
from epson_driver.sim_controller.arm.setpoint_follower import CYCLE_S, SetpointFollower

DURATION_S, SETTLED_S = 8.0, 2.0
AMPLITUDE, FREQUENCY = 0.2, 0.5


def mean_jerk(noise: float) -> float:
    """Return the arm's mean jerk as a fraction of its limit, with `noise` rad rms of noise."""
    settings, limits = ServoSettings(), limit_set('full')
    random = np.random.default_rng(0)
    home = np.zeros(len(limits.names))
    slow = servo_limits(limits, settings.scale, STOP_WITHIN_S)
    stream, tracker = StreamFilter(slow), SetpointTracker(slow, home)
    follower = SetpointFollower(limits, home)
    accelerations = []
    for time in np.arange(0.0, DURATION_S, settings.period):
        position = AMPLITUDE * (1.0 - np.cos(2.0 * np.pi * FREQUENCY * time))
        stream.add(time, home + position + noise * random.standard_normal(len(home)))
        tracker.follow(settings.period, stream.aim(time + CYCLE_S))
        follower.append(tracker.step(settings.period)[0], settings.period)
        for _ in range(round(settings.period / CYCLE_S)):
            follower.step(CYCLE_S)
            if time > SETTLED_S:
                accelerations.append(follower.state[2])
    jerks = np.abs(np.diff(accelerations, axis=0)).mean(axis=0) / CYCLE_S
    return float(np.max(jerks / limits.jerk))
