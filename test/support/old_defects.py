# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Old defects that are reintroduced one by one, and the seeds that find them.

Each is a minimal patch of the current code with a seed that finds it. If a change of the worlds
makes the seed miss it, `PYTHONPATH=.:test .venv/bin/python -m support.old_defects NAME` searches
for another one.
"""

import argparse
import asyncio
import contextlib
import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import patch

from epson_driver.driver.arm_commands import ArmCommands
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.io.io_client import Io
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.driver.servo import restart_interlock
from epson_driver.driver.servo.restart_interlock import RestartInterlock
from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.driver.stopping.arm_gate import EnableRequest
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.panel.arming import Arming
from epson_driver.sim_controller.core import Controller
from simulation.events import events_of
from simulation.oracles import BrokenError
from simulation.world import World, quiet

Patch = Callable[[Any, str, Any], object]
"""patch(owner, name, value) until the defect is removed."""

Defect = Callable[[Patch], None]

DEFECTS: dict[str, tuple[str, Defect]] = {}
"""Defects by name, each with the seed that finds it."""


def found_by(*, seed: int) -> Callable[[Defect], Defect]:
    """Add a defect to DEFECTS."""

    def enter(defect: Defect) -> Defect:
        DEFECTS[defect.__name__] = (str(seed), defect)
        return defect

    return enter


async def _never(*_: Any) -> Any:
    await asyncio.Event().wait()


@found_by(seed=1)
def a_held_stream_is_followed_at_once(put: Patch) -> None:
    put(restart_interlock, 'RELEASE_S', 0.0)


@found_by(seed=1)
def a_stop_blocks_no_stream(put: Patch) -> None:
    put(RestartInterlock, 'trip', lambda self, now: None)
    put(RestartInterlock, 'block', lambda self, source: None)
    put(RestartInterlock, 'permits', lambda self, source: True)


@found_by(seed=1)
def a_silent_stream_goes_on(put: Patch) -> None:
    init = Servo.__init__

    def patient(self: Any, *arguments: Any) -> None:
        init(self, *arguments)
        self.settings = ServoSettings(timeout=math.inf)

    put(Servo, '__init__', patient)


@found_by(seed=1)
def a_goal_ends_twice(put: Patch) -> None:
    end = GoalQueue._end_unstarted

    def twice(self: Any, handle: Any, why: str, *rest: Any) -> None:
        end(self, handle, why, *rest)
        handle.on_end(handle.outcome)

    put(GoalQueue, '_end_unstarted', twice)


@found_by(seed=1)
def a_goal_succeeds_before_it_began(put: Patch) -> None:
    put(GoalExecution, '_plan_time', property(lambda self: math.inf))
    put(GoalExecution, '_check_timeouts', lambda self, now: None)


@found_by(seed=66)
def a_goal_that_waits_outlives_a_stop(put: Patch) -> None:
    put(GoalQueue, 'stopping', lambda self, why: contextlib.nullcontext())


@found_by(seed=3)
def stop_is_not_sent(put: Patch) -> None:
    put(Stopper, 'stop', lambda self: None)


@found_by(seed=3)
def a_stop_is_not_answered(put: Patch) -> None:
    put(ArmCommands, 'stop', _never)


@found_by(seed=1)
def a_stop_is_a_success_before_the_arm_stands(put: Patch) -> None:
    async def at_once(self: Any, timeout: float) -> bool:
        return True

    put(Stopper, 'wait', at_once)
    put(Stopper, 'doubt', None)


@found_by(seed=8)
def disable_does_not_end_enabling(put: Patch) -> None:
    put(EnableRequest, 'cancel', lambda self, why: None)


@found_by(seed=21)
def a_lost_link_leaves_the_gate_open(put: Patch) -> None:
    fault = Driver.fault

    def only_else(self: Any, why: str, **more: Any) -> None:
        if 'link was lost' not in why:
            fault(self, why, **more)

    put(Driver, 'fault', only_else)


@found_by(seed=1)
def old_joints_are_published(put: Patch) -> None:
    take = Driver._on_state_packet

    def late(self: Any, packet: Any) -> None:
        kept = vars(self).setdefault('kept', [])
        kept.append(packet)
        take(self, kept[0] if len(kept) > 200 else packet)

    put(Driver, '_on_state_packet', late)


@found_by(seed=385)
def a_lost_write_is_repeated_later(put: Patch) -> None:
    write = Io.write

    async def again(self: Any, settings: Any) -> Any:
        try:
            return await write(self, settings)
        except IoUnavailableError:
            loop = asyncio.get_running_loop()
            loop.call_later(8.0, lambda: loop.create_task(_tried(write(self, settings))))
            raise

    put(Io, 'write', again)


async def _tried(work: Any) -> None:
    with contextlib.suppress(IoUnavailableError):
        await work


@found_by(seed=103)
def a_page_that_is_gone_stays_armed(put: Patch) -> None:
    put(Arming, 'disconnect', lambda self, browser: self._connected.discard(browser))
    put(Arming, '_is_alive', lambda self, browser: True)


@found_by(seed=14)
def an_arm_outlives_its_client(put: Patch) -> None:
    put(Controller, 'client_lost', lambda self: None)


@contextlib.contextmanager
def put_back(name: str) -> Iterator[None]:
    """Reintroduce a defect during the block."""
    with contextlib.ExitStack() as stack:

        def put(owner: Any, attribute: str, value: Any) -> None:
            stack.enter_context(patch.object(owner, attribute, value))

        DEFECTS[name][1](put)
        yield


def finds(seed: str, name: str) -> str | None:
    """Return the failure of a seed with a defect, or None.

    Raises RuntimeError if the seed fails without the defect.
    """
    with put_back(name):
        broken = _broken(seed)
    if broken is not None and (without := _broken(seed)) is not None:
        raise RuntimeError(f'seed {seed} fails without the defect: {without}')
    return broken


def _broken(seed: str) -> str | None:
    """Return the failure of a seed in its world, or None."""
    with quiet():
        try:
            World(seed).play(events_of(seed))
        except BrokenError as error:
            return str(error)
    return None


def main() -> None:
    """Search for seeds that find defects."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('defects', nargs='*', help='names (default: all)', default=[*DEFECTS])
    for name in parser.parse_args().defects:
        for seed in map(str, itertools.count(1)):
            if (broken := finds(seed, name)) is not None:
                print(name, seed, broken, flush=True)
                break


if __name__ == '__main__':
    main()
