# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Effects of a fault on a goal, the arm and the links, one cell at a time.

A cell is a fault, a controller's profile, the interface of its motion, and the phase of the motion
in which the fault happens. `play` runs it with the real driver, the simulated controller and TCP
between them. The virtual time of `event_loop` makes its times independent of the machine's load.
In every cell

* a goal ends once, with the true outcome, its code and the cause;
* no joint exceeds its range or its velocity limit, braking included;
* no joint state is published while the state link is down;
* the arm gate closes, and a new goal is refused with the reason;
* after the fault, both links are connected and the gate is still closed;
* until `~/enable`, only STOP is sent, and the arm stays at rest;
* after the user's repair at the controller and `~/enable`, a new goal succeeds.

`fault_cells.py` has the cells, and `python -m benchmark.faults` runs and draws all of them.
"""

import asyncio
import contextlib
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event, RejectedError
from epson_driver.sim_controller.faults.fault_kinds import parse
from support.driver_harness import LIMITS, Harness, options_of, pose, simulated
from support.event_loop import now, until
from support.fault_cells import STATE_TIMEOUT, STOPPED, USUAL, WIDER, Cell, Row
from support.fault_strikes import STRIKES, watch
from support.streams import positions, sending

REPLY_TIMEOUT = 0.4

LONG_CAUSE_TIME = 1.0
"""Time for which a goal waits for a STATUS with the cause, s, long enough for a busy machine."""

LONGEST = 20.0
"""Maximum duration of a cell, s."""

QUIET = 0.25
"""Time for which the arm is observed before it is enabled, s."""

AT_REST = 1e-4
"""Maximum speed of a joint at rest, rad/s."""

IN_MOTION = 0.02
"""Distance after which a goal counts as in motion, rad."""

ARRIVING = 0.05
"""Distance to the end of a goal that is about to arrive, rad."""

AT_GOAL = 0.01
"""Goal tolerance, rad."""

MOTORS = {'restart': 'restart', 'rtmc': 'rtmc'}
"""How the motors are switched, where it is not by Remote Ethernet."""

SPEED = 0.3
"""Speed of a stream of setpoints, rad/s."""


@dataclass(frozen=True)
class Played:
    """The result of a cell.

    end: the goal's end, or its replacement. code: its result code. rest: time from the fault to
    rest, s of the controller. recovery: time until links and arm are available again, s of the
    controller, without the user's repair.
    """

    end: str
    code: int | None
    text: str
    gate: str
    rest: float
    recovery: float


class Witness:
    """Observes every step of the controller: the last motion and the limits.

    The duration of a step depends on the loop's timers, so the measured velocity is a mean. An
    arm that takes real-time targets moves once per cycle.
    """

    def __init__(self, controller: Any) -> None:
        self.moved = now()
        self._controller = controller
        self._cycle = controller.profile.rtmc.cycle if controller.real_time else 0.0
        self._unmoved = 0.0
        self._step = controller.step
        controller.step = self.step

    def step(self, seconds: float) -> None:
        """Advance the controller, and check the arm's motion."""
        controller = self._controller
        limits = controller.model.limits
        commanded, actual = controller.arm.commanded.copy(), where(controller)
        self._step(seconds)
        distance = np.abs(controller.arm.commanded - commanded)
        span = max(seconds, min(self._unmoved + seconds, self._cycle))
        self._unmoved = 0.0 if distance.any() else span
        rounding = 1e-3 if self._cycle else 1e-6  # a step may end a little after a cycle
        allowed = limits.velocity * span * (1.0 + rounding) + 1e-9
        assert np.all(distance <= allowed), distance / span
        at = controller.arm.commanded
        assert np.all(at >= limits.position_min - 1e-9), at
        assert np.all(at <= limits.position_max + 1e-9), at
        if np.abs(where(controller) - actual).max() > AT_REST * seconds:
            self.moved = now()


def no_joints_without_a_link(harness: Any) -> None:
    """Make the harness fail if joints are published while the state link is down."""
    take = harness.events.on_joints

    def on_joints(sample: Any) -> None:
        assert harness.driver.state_link.connected
        take(sample)

    harness.events.on_joints = on_joints


@contextlib.asynccontextmanager
async def cell_of(profile, interface=USUAL, *, smooth=False, **options):
    """Run a driver with a profile's settings and its controller; yield both and the sent moves."""
    settings = GoalSettings(
        reply_timeout=REPLY_TIMEOUT,
        cause_timeout=LONG_CAUSE_TIME,
        require_planned_speed=False,
    )
    async with simulated(profile=profile, smooth=smooth) as (controller, ports):
        options = {
            **options_of(profile, interface if interface == 'download' else None),
            'motors': MOTORS.get(profile.program.motors, 'remote_ethernet'),
            'state_timeout': STATE_TIMEOUT,
            'settings': settings,
            'limits': WIDER if profile.program.interface != 'rtmc' else LIMITS,
            'client_timeout': profile.server.client_timeout,
        } | options
        if not profile.ports.remote:
            options['remote_port'] = 0
        if not profile.program.loaded:
            options['state_period'] = profile.state.period
        async with Harness(ports, **options) as harness:
            servo = harness.driver.servo
            servo.settings = replace(servo.settings, reply_timeout=REPLY_TIMEOUT)
            sent = watch(controller)
            await harness.ready()
            yield harness, controller, sent


def where(controller):
    """Return the arm's true position, rad, which its encoders would measure without a fault."""
    return controller.servo.actual.copy()


async def user_action(controller, event):
    """Perform a user's action at the controller, repeatedly until it is permitted."""
    async with asyncio.timeout(LONGEST / 2):
        while True:
            try:
                controller.apply(event)
            except RejectedError:
                await asyncio.sleep(0.02)
            else:
                return


async def make_ready(harness, controller, *, reset=False):
    """Reset and switch the motors on, by the driver's services if it has a remote port."""
    remote = harness.driver.configuration.remote_port
    if reset:
        await until(lambda: not controller.in_motion)
        if remote:
            await harness.commands.reset_error()
        else:
            await user_action(controller, Event.RESET)
    if not remote:
        await user_action(controller, Event.MOTORS_ON)
    await until(lambda: not remote or not controller.in_motion)
    if not remote or reset:
        await until(
            lambda: (
                (status := harness.driver.robot.status) is not None
                and status.in_error == 0
                and (remote or status.drives_powered == 1)
            )
        )


def linked(harness):
    """Return whether both links are connected, with joints and a status."""
    driver = harness.driver
    return (
        driver.state_link.connected
        and driver.motion_link.connected
        and driver.robot.sample is not None
        and driver.robot.status is not None
    )


async def standing(controller):
    """Wait until the arm and its servos are at rest."""
    await until(lambda: not controller.in_motion)
    before = None
    while before is None or np.abs(before - where(controller)).max() > 1e-9:
        before = where(controller)
        await asyncio.sleep(0.05)


async def play(cell: Cell) -> Played:
    """Run a cell with all checks. Raises AssertionError or TimeoutError if one fails."""
    async with asyncio.timeout(LONGEST):
        profile = load_controller_profile(cell.profile)
        async with cell_of(profile, cell.interface) as (harness, controller, sent):
            return await _play(cell, harness, controller, sent)


async def _play(cell: Cell, harness: Any, controller: Any, sent: list[Any]) -> Played:
    row = cell.row
    await make_ready(harness, controller)
    await harness.commands.enable()
    no_joints_without_a_link(harness)
    witness = Witness(controller)
    async with contextlib.AsyncExitStack() as stream:
        goal = await _reach(cell, row, harness, controller, sent, stream)
        fault_time = now()
        strike = asyncio.create_task(_strike(row, harness, controller))
        for event in row.events:
            controller.apply(event)
        if row.fault:
            controller.faults.start(parse(row.fault))
        if row.canceled and goal is not None:
            harness.driver.goal_queue.cancel(goal.handle)
        outcome = None if goal is None else await goal.end()
        await strike
        if row.harmless:
            return await _unharmed(harness, outcome)
        await until(lambda: harness.gate is not None)
        points = len(sent)
        reason = await _reason(harness, row.gate)
        if harness.driver.robot.sample is not None:
            refused = harness.submit(harness.at).outcome
            assert refused.code is ErrorCode.INVALID_GOAL
            assert re.search(row.gate, refused.text)

        await until(lambda: not controller.faults.active())
        start, recovery = now(), 0.0
        if not row.boots:
            await until(lambda: linked(harness))
            recovery += now() - start
        await standing(controller)
    rest = max(witness.moved - fault_time, 0.0)
    position = where(controller)
    if outcome is not None:
        _check(cell, row, outcome, np.abs(position - row.points[-1]).max())
    start = now()
    for event in row.repair:
        await user_action(controller, event)
    if row.boots:
        controller.faults.start(parse('reboot for=0.2'))
        await until(lambda: not controller.faults.active() and linked(harness))
    await make_ready(harness, controller, reset=row.reset)
    await until(lambda: linked(harness))
    recovery += now() - start
    await asyncio.sleep(QUIET)
    assert harness.gate is not None
    assert np.abs(where(controller) - position).max() < 1e-6
    assert len(sent) == points

    start = now()
    await harness.commands.enable()
    recovery += now() - start
    assert harness.gate is None
    again = harness.submit(harness.at + pose(0.0, 0.0, 0.1), step=0.3)
    assert (await again.end()).end is End.SUCCEEDED, again.outcome
    if goal is not None and outcome is not None:
        assert len(goal.outcomes) == 1
        return Played(outcome.end.value, int(outcome.code), outcome.text, reason, rest, recovery)
    ended = 'stream ended' if cell.interface == 'setpoints' else 'no goal'
    return Played(ended, None, '', reason, rest, recovery)


async def _strike(row: Row, harness: Any, controller: Any) -> None:
    if row.strike:
        await STRIKES[row.strike](harness, controller)


async def _unharmed(harness: Any, outcome: Any) -> Played:
    """Check that a goal is unaffected by the fault and that another one succeeds."""
    assert harness.gate is None
    assert outcome is None or outcome.end in (End.SUCCEEDED, End.CANCELED), outcome
    again = harness.submit(harness.at + pose(0.0, 0.0, 0.1), step=0.3)
    assert (await again.end()).end is End.SUCCEEDED, again.outcome
    if outcome is None:
        return Played('no goal', None, '', '', 0.0, 0.0)
    return Played(outcome.end.value, int(outcome.code), outcome.text, '', 0.0, 0.0)


async def _reason(harness: Any, pattern: str) -> str:
    """Return the reason of the closed gate with the controller's later explanation."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(LONG_CAUSE_TIME):
            await until(lambda: re.search(pattern, harness.gate))
    assert re.search(pattern, harness.gate), harness.gate
    reason: str = harness.gate
    return reason


async def _reach(
    cell: Cell,
    row: Row,
    harness: Any,
    controller: Any,
    sent: list[Any],
    stream: contextlib.AsyncExitStack,
) -> Any:
    """Bring the motion to the phase of the fault, and return its goal or None."""
    start = where(controller)
    if cell.phase == 'standing':
        return None
    if cell.interface == 'setpoints':
        first = now()
        ramp = sending(harness, lambda _time: positions(pose(SPEED * (now() - first))))
        await stream.enter_async_context(ramp)
        await until(lambda: np.abs(where(controller) - start).max() > IN_MOTION)
        return None
    goal = harness.submit(*row.points, step=0.4)
    if cell.phase == 'starting':
        await until(lambda: goal.outcomes or sent)
    elif cell.phase == 'arriving':
        end = row.points[-1]
        await until(lambda: goal.outcomes or np.abs(where(controller) - end).max() < ARRIVING)
    else:
        await until(lambda: goal.outcomes or np.abs(where(controller) - start).max() > IN_MOTION)
    return goal


def _check(cell: Cell, row: Row, outcome: Any, distance: float) -> None:
    """Check that a goal's outcome is true and names its cause. `distance`: to the goal."""
    if outcome.end is End.SUCCEEDED:
        assert cell.phase in ('arriving', 'stopping'), outcome
        assert distance <= AT_GOAL, outcome
        return
    if cell.phase == 'stopping':
        assert re.search(f'{row.text}|{STOPPED}', outcome.text), outcome.text
        return
    assert (outcome.end, outcome.code) == (End.ABORTED, row.code), outcome
    assert re.search(row.text, outcome.text), outcome.text
