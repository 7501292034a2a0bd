# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The time of a move besides its motion, and of I/O, through the Python API.

The API and the simulated controller run in this process, in virtual time. A motion lasts from the
first to the last change of the commanded joint positions. Smoothing in the driver takes 20 ms.
"""

import argparse
import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np
from support.api_harness import robot_cell
from support.event_loop import now, run

from epson_driver import aio
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.driver.smoothing import Smoothing, SmoothingProcess
from epson_driver.driver.smoothing_worker import smoothed_trajectory
from epson_driver.motion import Trajectory
from epson_driver.sim_controller.core import Controller
from epson_driver.simple_message import IoType

REQUIRED_S = {'simulated': 0.08, 'motoman': 0.08, 'rtmc': 0.08, 'spel': 0.2, 'remote': 0.35}
"""Maximum mean time of a move besides its motion, by profile, s."""

REQUIRED_IO_S = 0.025
"""Maximum mean time of a read, and of the reaction to an input, s."""

REPEATS = 8
SMOOTHING_S = 0.02
MOVED = 1e-9  # rad
START = (0.0, 0.3, -0.3, 0.0, 0.6, 0.0)
ANGLE, LENGTH = 0.3, 0.04  # rad, m
PATIENCE_S = 600.0


class Besides:
    """Measures the time of a call without the motion of a controller's arm.

    `motion` is the duration of the last motion, s, and `ratios` are those of all motions to their
    planned durations, if the calls return a Motion.
    """

    def __init__(self, controller: Controller) -> None:
        self.motion = 0.0
        self.ratios: list[float] = []
        self._arm = controller.arm
        self._places: list[tuple[float, np.ndarray]] = []
        step = controller.step

        def recorded(dt: float) -> None:
            step(dt)
            self._places.append((now(), self._arm.commanded.copy()))

        controller.step = recorded  # type: ignore[method-assign]

    async def of(self, move: Awaitable[object]) -> float:
        self._places.clear()
        begin = now()
        result = await move
        times = np.array([time for time, _ in self._places])
        steps = np.abs(np.diff([place for _, place in self._places], axis=0)).max(axis=1)
        moving = np.flatnonzero(steps > MOVED)
        self.motion = float(times[moving[-1] + 1] - times[moving[0]])
        if isinstance(result, aio.Motion):
            self.ratios.append(self.motion / result.duration)
        return now() - begin - self.motion


async def _smoothed(
    process: SmoothingProcess,
    trajectory: Trajectory,
    start: np.ndarray,
    share: tuple[float, float] = (1.0, 1.0),
    smoothing: Smoothing | None = None,
) -> tuple[Trajectory, str]:
    await asyncio.sleep(SMOOTHING_S)
    limits, settings = process._limits.scaled(*share), process._smoothing  # noqa: SLF001
    return smoothed_trajectory(trajectory, start, limits, smoothing or settings)


async def _here(_scope: PlanningCancellation, work: Callable[[], object]) -> object:
    return work()


async def moves(robot: aio.Robot, controller: Controller) -> tuple[dict[str, float], float]:
    """Return the mean times of joint moves and lines besides their motion, s.

    The second value is the highest ratio of a motion's duration to the planned one.
    """
    await robot.move_joints(START, speed=1.0, acceleration=1.0)
    home = robot.joints.copy()
    besides = Besides(controller)
    times: dict[str, list[float]] = {'joint move': [], 'line': []}
    for count in range(REPEATS):
        away = 1 - count % 2
        target = home + away * ANGLE * np.eye(len(home))[0]
        move = robot.move_joints(target, speed=1.0, acceleration=1.0)
        times['joint move'].append(await besides.of(move))
    for count in range(REPEATS):
        pose = robot.forward(home).copy()
        pose[2, 3] -= LENGTH * (1 - count % 2)
        line = robot.move_line(pose, speed=0.25, acceleration=5.0)
        times['line'].append(await besides.of(line))
    return {name: float(np.mean(values)) for name, values in times.items()}, max(besides.ratios)


async def inputs(robot: aio.Robot, controller: Controller) -> dict[str, float]:
    """Return the mean times of a read, and from a change of an input to the end of `wait`, s."""
    reads, waits = [], []
    for count in range(REPEATS):
        await asyncio.sleep(0.3 + 0.017 * count)
        begin = now()
        await robot.io.read('DI', 3)
        reads.append(now() - begin)
        waiting = asyncio.create_task(robot.io.wait('DI', 3, 1 - count % 2))
        await asyncio.sleep(0.3 + 0.017 * count)
        begin = now()
        controller.io.set_input(IoType.DIGITAL_INPUT, 3, 1 - count % 2)
        await waiting
        waits.append(now() - begin)
    return {'read': float(np.mean(reads)), 'wait for an input': float(np.mean(waits))}


async def measure(profile: str) -> None:
    async with robot_cell(profile=profile, smooth=True) as (robot, controller):
        times, ratio = await moves(robot, controller)
        for name, seconds in times.items():
            _show(profile, f'{name} besides its motion', seconds, REQUIRED_S[profile])
        print(f'{profile}, motion / planned: at most {ratio:.2f}')
        for name, seconds in (await inputs(robot, controller)).items():
            _show(profile, name, seconds, REQUIRED_IO_S)


def _show(profile: str, name: str, seconds: float, required: float) -> None:
    missed = '' if seconds <= required else '  MISSED'
    text = f'{profile}, {name}: {seconds * 1e3:.0f} ms, required {required * 1e3:.0f} ms{missed}'
    print(text, flush=True)


@contextmanager
def short_planning() -> Iterator[None]:
    """Plan and smooth in this process, so that virtual time does not depend on the machine."""
    with (
        patch.object(SmoothingProcess, 'prepared', _smoothed),
        patch.object(SmoothingProcess, 'make_ready', lambda _: None),
        patch.object(PlanningCancellation, 'in_thread', _here),
    ):
        yield


def main(
    measured: Callable[[str], Coroutine[object, object, None]],
    profiles: Iterable[str],
    description: str | None,
) -> None:
    """Measure the profiles that the command names, or all."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('profiles', nargs='*', default=profiles, help='default: all')
    logging.disable(logging.ERROR)
    with short_planning():
        for profile in parser.parse_args().profiles:
            run(measured(profile), PATIENCE_S)


if __name__ == '__main__':
    main(measure, list(REQUIRED_S), __doc__)
