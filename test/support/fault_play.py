# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What becomes of a goal, of the arm and of the links when a fault strikes: one cell at a time.

A cell is a fault, a controller's profile, the interface by which it gets its motion, and the phase
of the motion in which the fault strikes. `play` runs it: the real driver, the simulated controller
and TCP between them, in the virtual time of `event_loop`, so that its times are those of the
driver and the controller, however busy the machine is. In every cell

* a goal ends once, with the true outcome, its code and a sentence that names the cause;
* no joint leaves its range or exceeds its velocity limit, braking included;
* no joint state is published while the state link is down;
* the arm gate closes, and a new goal is refused with the reason;
* when the fault is over, both links are there again, and the gate is closed still;
* nothing but STOP is sent, and the arm that has come to rest stays where it is, until `~/enable`;
* after what a person must do at the controller, and `~/enable`, a new goal succeeds.

`fault_cells.py` has the cells; `python -m benchmark.faults` runs them all and draws them.
"""

import asyncio
import contextlib
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.profiles import load_controller_profile
from epson_driver.setup.setup import profile_defaults
from epson_driver.sim_controller.condition.states import Event, RejectedError
from epson_driver.sim_controller.faults.faults import parse
from support.driver_harness import Harness, pose, simulated
from support.event_loop import now, until
from support.fault_cells import STATE_TIMEOUT, STOPPED, USUAL, WIDER, Cell, Row
from support.fault_strikes import STRIKES, watch
from support.streams import positions, sending

REPLY_TIMEOUT = 0.4

LONG_CAUSE_TIME = 1.0
"""How long a goal waits for the STATUS that says why, s: as long as a busy machine may need."""

LONGEST = 20.0
"""How long one cell may take before it fails, s."""

QUIET = 0.25
"""How long the arm is watched before it is enabled, s."""

STANDS = 1e-4
"""A joint that is slower stands, rad/s."""

ON_ITS_WAY = 0.02
"""An arm that has gone so far moves, rad."""

NEARLY = 0.05
"""An arm that is so near to its goal is about to arrive, rad."""

AT_GOAL = 0.01
"""The tolerance of the goals here, rad."""

SPEED = 0.3
"""Of a stream of setpoints, rad/s."""


@dataclass(frozen=True)
class Played:
    """What became of a cell. Times in s: of the controller, from the fault on and after its end.

    end: of the goal, or what there was instead; code: its result code. rest: until the arm stood.
    recovery: until the links were back and the arm was enabled, without what a person took.
    """

    end: str
    code: int | None
    text: str
    gate: str
    rest: float
    recovery: float


class Witness:
    """Sees every step of the controller: when the arm moved last, and whether it kept its limits.

    A step is as long as the loop's timers let it be, so what is seen of the velocity is a mean.
    """

    def __init__(self, controller: Any) -> None:
        self.moved = now()
        self._controller = controller
        self._step = controller.step
        controller.step = self.step

    def step(self, seconds: float) -> None:
        """Let time pass, and look at what the arm did."""
        controller = self._controller
        limits = controller.model.limits
        commanded, actual = controller.arm.commanded.copy(), where(controller)
        self._step(seconds)
        way = np.abs(controller.arm.commanded - commanded)
        assert np.all(way <= limits.velocity * seconds * (1.0 + 1e-6) + 1e-9), way / seconds
        at = controller.arm.commanded
        assert np.all(at >= limits.position_min - 1e-9), at
        assert np.all(at <= limits.position_max + 1e-9), at
        if np.abs(where(controller) - actual).max() > STANDS * seconds:
            self.moved = now()


def no_joints_without_a_link(harness: Any) -> None:
    """Have the harness fail when joints are published while the state link is down."""
    take = harness.events.on_joints

    def on_joints(sample: Any) -> None:
        assert harness.driver.state_link.connected
        take(sample)

    harness.events.on_joints = on_joints


@contextlib.asynccontextmanager
async def cell_of(profile, interface=USUAL, *, smooth=False, **options):
    """Run a driver as the profile says, with its controller; yield both, and what is sent."""
    defaults = profile_defaults(profile)
    if interface == 'download':
        defaults['interface'] = 'download'
    rules = delivery_rules(profile, defaults['interface'], defaults['point_message'])
    settings = GoalSettings(
        reply_timeout=REPLY_TIMEOUT,
        cause_timeout=LONG_CAUSE_TIME,
        require_planned_speed=False,
    )
    async with simulated(profile=profile, smooth=smooth) as (controller, ports):
        options = {
            'delivery': rules,
            'usual_byte_order': profile.byte_order,
            'state_timeout': STATE_TIMEOUT,
            'settings': settings,
            'limits': WIDER,
            'client_timeout': profile.server.client_timeout,
        } | options
        if profile.program.motors == 'restart':
            options['motors'] = 'restart'
        if not profile.ports.remote:
            options['remote_port'] = 0
        if profile.program.interface == 'statements':
            options['state_period'] = profile.state.period
        async with Harness(ports, **options) as harness:
            servo = harness.driver.servo
            servo.settings = replace(servo.settings, reply_timeout=REPLY_TIMEOUT)
            sent = watch(controller)
            await harness.ready()
            yield harness, controller, sent


def where(controller):
    """Return where the arm is, rad: what its encoders would say without a fault."""
    return controller.servo.actual.copy()


async def person(controller, event):
    """Let a person do something at the controller, again and again until it is allowed."""
    async with asyncio.timeout(LONGEST / 2):
        while True:
            try:
                controller.apply(event)
            except RejectedError:
                await asyncio.sleep(0.02)
            else:
                return


async def make_ready(harness, controller, *, reset=False):
    """Reset and switch the motors on, by the driver's services where it has a remote port."""
    remote = harness.driver.configuration.remote_port
    if reset:
        await until(lambda: not controller.in_motion)
        if remote:
            await harness.commands.reset_error()
        else:
            await person(controller, Event.RESET)
    if not remote:
        await person(controller, Event.MOTORS_ON)
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
    """Return whether both links are there, with joints and a status."""
    driver = harness.driver
    return (
        driver.state_link.connected
        and driver.motion_link.connected
        and driver.robot.sample is not None
        and driver.robot.status is not None
    )


async def standing(controller):
    """Wait until the arm has come to rest, and so have its servos."""
    await until(lambda: not controller.in_motion)
    before = None
    while before is None or np.abs(before - where(controller)).max() > 1e-9:
        before = where(controller)
        await asyncio.sleep(0.05)


async def play(cell: Cell) -> Played:
    """Run a cell and look at everything. Raises AssertionError, or TimeoutError where it hangs."""
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
        struck = now()
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
            assert harness.gate in refused.text

        await until(lambda: not controller.faults.active())
        began, recovery = now(), 0.0
        if not row.boots:
            await until(lambda: linked(harness))
            recovery += now() - began
        await standing(controller)
    rest = max(witness.moved - struck, 0.0)
    stands = where(controller)
    if outcome is not None:
        _check(cell, row, outcome, np.abs(stands - row.points[-1]).max())
    began = now()
    for event in row.repair:
        await person(controller, event)
    if row.boots:
        controller.faults.start(parse('reboot for=0.2'))
        await until(lambda: not controller.faults.active() and linked(harness))
    await make_ready(harness, controller, reset=row.reset)
    await until(lambda: linked(harness))
    recovery += now() - began
    await asyncio.sleep(QUIET)
    assert harness.gate is not None
    assert np.abs(where(controller) - stands).max() < 1e-6
    assert len(sent) == points

    began = now()
    await harness.commands.enable()
    recovery += now() - began
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
    """See that a goal has ended as if nothing had happened, and that another one succeeds."""
    assert harness.gate is None
    assert outcome is None or outcome.end in (End.SUCCEEDED, End.CANCELED), outcome
    again = harness.submit(harness.at + pose(0.0, 0.0, 0.1), step=0.3)
    assert (await again.end()).end is End.SUCCEEDED, again.outcome
    if outcome is None:
        return Played('no goal', None, '', '', 0.0, 0.0)
    return Played(outcome.end.value, int(outcome.code), outcome.text, '', 0.0, 0.0)


async def _reason(harness: Any, pattern: str) -> str:
    """Return why the gate is closed: what the controller says of it later is added."""
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
    """Bring the motion to the phase in which the fault strikes; return its goal, if it has one."""
    begin = where(controller)
    if cell.phase == 'standing':
        return None
    if cell.interface == 'setpoints':
        first = now()
        ramp = sending(harness, lambda _time: positions(pose(SPEED * (now() - first))))
        await stream.enter_async_context(ramp)
        await until(lambda: np.abs(where(controller) - begin).max() > ON_ITS_WAY)
        return None
    goal = harness.submit(*row.points, step=0.4)
    if cell.phase == 'starting':
        await until(lambda: goal.outcomes or sent)
    elif cell.phase == 'arriving':
        end = row.points[-1]
        await until(lambda: goal.outcomes or np.abs(where(controller) - end).max() < NEARLY)
    else:
        await until(lambda: goal.outcomes or np.abs(where(controller) - begin).max() > ON_ITS_WAY)
    return goal


def _check(cell: Cell, row: Row, outcome: Any, distance: float) -> None:
    """See that the outcome of a goal is the true one, with its cause; `distance`: to the goal."""
    if outcome.end is End.SUCCEEDED:
        assert cell.phase in ('arriving', 'stopping'), outcome
        assert distance <= AT_GOAL, outcome
        return
    if cell.phase == 'stopping':
        assert re.search(f'{row.text}|{STOPPED}', outcome.text), outcome.text
        return
    assert (outcome.end, outcome.code) == (End.ABORTED, row.code), outcome
    assert re.search(row.text, outcome.text), outcome.text
