# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How far a simulated arm is behind a policy that sends setpoints by `Robot.servo`.

Real processes in real time, so the machine must be quiet; test/api/test_streams.py does the same
in virtual time, with the derivatives of what the controller executes.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from epson_driver import Robot
from epson_driver.motion import Array

RATE = 30.0
AMPLITUDE, FREQUENCY = 0.2, 0.25
SETTLED_S = 2.0
"""The beginning, which is not judged, s."""


def policy(passed: float | Array, frequency: float = FREQUENCY) -> Array:
    """Return joint 1, rad, at times since the beginning, s."""
    return np.asarray(AMPLITUDE * np.sin(2.0 * np.pi * frequency * np.asarray(passed)))


def behind(times: Array, ways: Array, wave: Callable[[Array], Array]) -> tuple[float, float]:
    """Return the delay with which a wave is nearest to what was measured, s, and the rms."""
    chosen = times > SETTLED_S
    lags = np.arange(-0.1, 1.5, 0.002)
    off = [ways[chosen] - wave(times[chosen] - lag) for lag in lags.tolist()]
    rms = np.sqrt(np.mean(np.square(off), axis=1))
    return float(lags[rms.argmin()]), float(rms.min())


def main() -> None:
    """Measure once and print a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--controller', default='rc620')
    parser.add_argument('--rate', type=float, default=RATE, help='setpoints per second')
    parser.add_argument('--frequency', type=float, default=FREQUENCY, help='of the sine, Hz')
    arguments = parser.parse_args()
    seconds, rate, frequency = arguments.seconds, arguments.rate, arguments.frequency
    rows: list[tuple[float, float]] = []
    late, taken = 0.0, 0
    with Robot.simulated(controller=arguments.controller, enable=True) as robot:
        robot.on_joints(lambda sample: rows.append((sample.time, float(sample.positions[0]))))
        begin = time.time()
        for number in range(round(seconds * rate)):
            passed = time.time() - begin
            late = max(late, passed - number / rate)
            others = [0.0] * (len(robot.model.joint_names) - 1)
            robot.servo([float(policy(passed, frequency)), *others])
            taken += 1
            time.sleep(max(begin + (number + 1) / rate - time.time(), 0.0))
        robot.servo_end()
    times, ways = np.array([(at - begin, way) for at, way in rows if at - begin < seconds]).T
    lag, rms = behind(times, ways, lambda each: policy(each, frequency))
    print(
        f'{taken} setpoints taken, the latest {1e3 * late:.0f} ms late; the arm is '
        f'{1e3 * lag:.0f} ms behind, {1e3 * rms:.1f} mrad beside it (rms)'
    )


if __name__ == '__main__':
    main()
