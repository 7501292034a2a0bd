# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How the simulated arm of each profile follows streams of positions at 50 Hz, in virtual time."""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
from support.driver_harness import LIMITS, cell, options_of, pose
from support.event_loop import now
from support.streams import PERIOD, positions

from benchmark.moves import main
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.motion import Array
from epson_driver.profiles import load_controller_profile

SMOOTH = {'simulated': True, 'spel': False, 'rtmc': False}
"""Whether the simulated arm of each measured profile uses the smoother."""

HEIGHT, RAMP_SPEED = 0.2, 0.5  # rad, rad/s
SECONDS, SETTLED_S = 8.0, 3.0
CYCLE_S, MEAN_S = 0.002, 0.02
"""Period of the recording, and time over which velocities are averaged, s."""

Signal = Callable[[Any], tuple[Any, Any]]


def sine(t: Any) -> tuple[Any, Any]:
    """Return positions and velocities of a sine of 0.5 Hz at times t, rad and rad/s."""
    return HEIGHT * (1.0 - np.cos(np.pi * t)), HEIGHT * np.pi * np.sin(np.pi * t)


def ramp(t: Any) -> tuple[Any, Any]:
    """Return positions and velocities of a ramp that ends after 1 s, rad and rad/s."""
    return RAMP_SPEED * np.minimum(t, 1.0), RAMP_SPEED * float(t < 1.0)


async def followed(
    profile: str, signal: Signal, *, velocities: bool = False, noise: float = 0.0
) -> Array:
    """Return the positions of joint 1, rad, one each CYCLE_S, while it follows a signal."""
    random = np.random.default_rng(0)
    options = options_of(profile)  # type: ignore[no-untyped-call]
    async with cell(profile=profile, smooth=SMOOTH[profile], **options) as (harness, controller):
        period = load_controller_profile(profile).program.setpoint_period
        harness.driver.servo.settings = ServoSettings(period=period)
        await asyncio.sleep(0.5)
        places: list[float] = []
        step, start, due = controller.step, now(), 0.0

        def recorded(dt: float) -> None:
            nonlocal due
            due += dt
            while due >= CYCLE_S:
                due -= CYCLE_S
                step(CYCLE_S)
                places.append(float(controller.arm.commanded[0]))

        controller.step = recorded
        for count in range(round(SECONDS / PERIOD)):
            place, speed = signal(count * PERIOD)
            joints = pose(place + noise * random.standard_normal())
            speeds = speed * np.eye(len(joints))[0] if velocities else None
            harness.driver.servo.take(positions(joints, speeds))
            await asyncio.sleep(max(start + (count + 1) * PERIOD - now(), 0.0))
    return np.array(places)


def figures(places: Array) -> tuple[float, float, float]:
    """Return the lag behind the sine, s, the velocity's rms error and the mean jerk.

    The error is relative to the maximum velocity, and the jerk to its limit.
    """
    times = CYCLE_S * np.arange(1, len(places) + 1)
    use = (times > SETTLED_S) & (times < SECONDS - 0.1)
    times, places = times[use], places[use]
    lags = np.arange(0.0, 0.4, 0.002)
    lag = float(lags[np.argmin([np.std(places - sine(times - item)[0]) for item in lags])])
    count = round(MEAN_S / CYCLE_S)
    speeds = (places[count:] - places[:-count]) / MEAN_S
    wanted = sine(times[count:] - MEAN_S / 2.0 - lag)[1]
    jerk = float(np.abs(np.diff(places, 3)).mean()) / CYCLE_S**3 / LIMITS.jerk[0]
    return lag, float(np.sqrt(np.mean((speeds - wanted) ** 2))) / (HEIGHT * np.pi), jerk


async def measure(profile: str) -> None:
    """Print a row for each stream."""
    for name, options in (
        ('positions', {}),
        ('with velocities', {'velocities': True}),
        ('0.2 mrad of noise', {'noise': 2e-4}),
    ):
        lag, error, jerk = figures(await followed(profile, sine, **options))
        places = await followed(profile, ramp, **options)
        over = (places.max() - RAMP_SPEED) * 1e3
        cells = f'{lag * 1e3:.0f} ms', f'{error:.1%}', f'{jerk:.3f}', f'{over:.1f} mrad'
        print(f'| `{profile}` | {name} | {" | ".join(cells)} |', flush=True)


if __name__ == '__main__':
    main(measure, SMOOTH, __doc__)
