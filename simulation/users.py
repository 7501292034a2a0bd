# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Users of the driver: goals, tool motions, streams of publishers, services, outputs.

Their requests and the answers are recorded in the world's wishes.
"""

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, Protocol

import numpy as np

from epson_driver.api.errors import RobotError
from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.driver.outcome import End, Outcome
from epson_driver.driver.servo.setpoint import Setpoint, Window
from epson_driver.motion import Array, JointLimits, Trajectory
from simulation.oracles import RELEASE_S, Arm, BrokenError, Outputs, Wishes
from simulation.processes import TOLERANCE_RAD, DiedError, NodeProcess, RobotProcess
from simulation.virtual_loop import VirtualLoop

ANSWER_S = 30.0
"""Timeout of a request, s."""

REACH_RAD = 0.6
"""Maximum distance of goals from the arm's first position."""

READ_RAD = 2e-3
"""Tolerance between the arm's position and its encoders, rad."""

SETTLED_RAD = 1e-3
"""Distance from a successful goal within which the arm must not move away any more, rad. At a
larger distance within the tolerance, the arm may still have to execute its last points."""

LATEST_S = 1.0
"""Time after a stop or cancel within which a goal may still succeed, s, because the arm had
already arrived."""

SOONER_S = 0.05
"""Tolerance for a success before the planned time, s, because the time stamps of the state are
inexact."""

SAME_RAD = 1e-6
"""Minimum change of position that counts as a request for motion, rad."""

AHEAD_S = 0.05
"""Lead of the setpoints of a program that uses the current position, s."""

IMPOSSIBLE = {'no number': np.nan, 'degrees': 57.3, 'huge': 1e308}
"""Velocities sent by a faulty program, rad/s."""


class Hand(Protocol):
    """A person at the controller."""

    def mend(self) -> None: ...


class WorldInterface(Protocol):
    """The parts of the world used by users."""

    loop: VirtualLoop
    rng: np.random.Generator
    wishes: Wishes
    arm: Arm
    outputs: Outputs
    at_controller: Hand
    process: NodeProcess | RobotProcess
    start: Array
    limits: JointLimits
    timed: bool
    """Whether the controller respects the duration of a goal."""
    statements: bool
    """Whether the controller is moved by Remote Ethernet, without a program."""
    streams: bool
    """Whether the controller follows streams."""
    person: float
    """Reaction time of a person, s. STATUS has reached the driver by that time."""

    def system_time(self) -> float: ...

    def say(self, text: str) -> None: ...

    def break_(self, error: BrokenError) -> None: ...


class Users:
    """All users. Methods are events of the world, or requests of the panel."""

    def __init__(self, world: WorldInterface) -> None:
        self.loop, self.rng, self.wishes, self.say = world.loop, world.rng, world.wishes, world.say
        self._world = world
        self.goals: dict[int, float] = {}
        """Goals that have not ended, and the earliest time of success of each, loop time, s."""
        self.publishers: dict[int, asyncio.Task[None]] = {}
        self.held_up = 0.0
        """Time of the last stall of driver or network, s."""
        self.requests: set[asyncio.Task[None]] = set()
        self._positions: dict[str, tuple[float, Array | None]] = {}
        """Topic → time and value of the last position, s and rad."""
        self._received: dict[str, str] = {}
        """Topic → the last process that received it. A new process has missed the earlier
        setpoints."""
        self._count = 0
        self._enabling = 0
        """Number of pending requests to enable."""
        self._enables = self._disabled = 0
        """Number of requests to enable, and of successful requests to disable."""
        self._looked = (False, 0)
        """Whether the gate was closed at the last check, and `_enables` at that time."""

    @property
    def gate(self) -> bool | None:
        """Whether the driver reports an enabled arm. None: it reports nothing."""
        return self._world.process.gate

    def driver_died(self) -> None:
        self.goals.clear()

    # --- goals -------------------------------------------------------------------------------

    async def goal(self, step: float, offsets: list[list[float]], from_here: bool) -> None:
        self.submit(np.array(offsets), step, from_here=from_here)

    def submit(
        self,
        offsets: Array,
        step: float,
        *,
        from_here: bool,
        on_end: Callable[[int, Outcome], object] = lambda *_: None,
    ) -> int:
        limits, at, start = self._world.limits, self._world.arm.at.copy(), self._world.start
        points: Array = np.clip(at + offsets, start - REACH_RAD, start + REACH_RAD)
        points = np.clip(points, limits.position_min, limits.position_max)
        if self._world.statements:  # such a controller accepts only a target
            points = points[-1:]
        apart = np.ptp(np.vstack([at, points]), axis=0)
        step = max(step, 1.5 * float(np.max(apart / limits.velocity)))
        times = np.arange(1.0, len(points) + 1.0) * step
        if from_here:
            times, points = np.append(0.0, times), np.vstack([at, points])
        return self.hand_in(Trajectory(limits.names, times, points), on_end)

    def hand_in(
        self,
        trajectory: Trajectory,
        on_end: Callable[[int, Outcome], object] = lambda *_: None,
        *,
        wanted: bool = True,
    ) -> int:
        """Submit a goal and return its number. `wanted`: motion is requested now."""
        timed = self._world.timed and isinstance(self._world.process, NodeProcess)
        number = self._want(trajectory.duration - SOONER_S if timed else 0.0, wanted=wanted)
        self._world.process.hand_in(number, trajectory, partial(self._ended, number, on_end))
        return number

    async def move_tool(self, ways: list[list[float]], blend: float, speed: float) -> None:
        number = self._want(0.0)
        ended = partial(self._ended, number, lambda *_: None)
        self._world.process.move_tool(number, ways, blend, speed, ended)

    def _want(self, takes: float, *, wanted: bool = True) -> int:
        number = self._count = self._count + 1
        now = self.loop.time()
        self.goals[number] = now + takes
        if wanted and self.wishes.open is not False:
            self.wishes.goal(number, now)
        return number

    def _ended(
        self,
        number: int,
        on_end: Callable[[int, Outcome], object],
        outcome: Outcome,
        target: Array | None,
    ) -> None:
        soonest = self.goals.pop(number, None)
        on_end(number, outcome)
        now, arm, wishes = self.loop.time(), self._world.arm, self.wishes
        self.say(f'goal {number}: {outcome.end.value}: {outcome.text}')
        if soonest is None:
            self._world.break_(BrokenError(f'5: goal {number} ended twice: {outcome.text}'))
            return
        wishes.goals.discard(number)
        given_up = wishes.given_up.pop(number, now)
        if outcome.end is not End.SUCCEEDED:
            return
        if now - max(given_up, self.held_up) > LATEST_S:
            text = (
                f'5: goal {number} succeeded {now - given_up:.1f} s after its last request ended'
            )
            self._world.break_(BrokenError(text))
        away = TOLERANCE_RAD if target is None else float(np.abs(arm.at - target).max())
        if away > TOLERANCE_RAD + READ_RAD:
            self._world.break_(BrokenError(f'5: goal {number} succeeded {away:.4f} rad away'))
        if now < soonest:
            text = f'5: goal {number} succeeded {soonest - now:.3f} s before it can have'
            self._world.break_(BrokenError(text))
        if target is not None and away < SETTLED_RAD and not wishes.any(now):
            arm.rest(target, away)

    async def cancel(self) -> None:
        if self.goals:
            self.cancel_goal(max(self.goals))

    def cancel_all(self) -> None:
        """Cancel every goal, as the refusal of another goal advises."""
        for number in list(self.goals):
            self.cancel_goal(number)

    def cancel_goal(self, number: int) -> None:
        if self._world.process.cancel(number):
            self.wishes.give_up([number], self.loop.time())

    async def scale(self, factor: float) -> None:
        def change() -> None:
            try:
                self._world.process.scale(factor)
            except ValueError as error:
                self.say(f'refused: {error}')

        self._world.process.call(change)

    # --- services ----------------------------------------------------------------------------

    async def stop(self) -> None:
        self.request('stop')

    async def enable(self) -> None:
        self.request('enable')

    async def mend(self) -> None:
        await asyncio.sleep(self._world.person)
        self._world.at_controller.mend()
        self.request('enable')

    async def disable(self) -> None:
        self.request('disable')

    async def reset_error(self) -> None:
        self.request('reset_error')

    def request(self, name: str, say: Callable[[str], object] = lambda _: None) -> None:
        """Call a service of the driver, such as stop or enable."""
        if name == 'stop':
            self.wishes.nothing(self.loop.time())
        elif name == 'disable':
            self.wishes.closed(self.loop.time())

        async def answered() -> None:
            say(await self.asked(name))

        self.begin(answered(), f'~/{name}')

    async def asked(self, name: str) -> str:
        process = self._world.process
        self.look_at_gate()
        self._enabling += name == 'enable'
        self._enables += name == 'enable'
        enables, disabled = self._enables, self._disabled
        try:
            message = await self._answer(name)
        finally:
            self._enabling -= name == 'enable'
        self.look_at_gate()
        self._disabled += name == 'disable' and message.startswith('ok')
        last = self._enables == enables and process is self._world.process
        if self._disabled > disabled and last and self.gate:
            text = '4: the arm is enabled without a request, after an answered ~/disable'
            self._world.break_(BrokenError(text))
        return message

    def look_at_gate(self) -> None:
        """Report a violation if the arm was enabled without a request."""
        closed, enables = self._looked
        if closed and self.gate and not self._enabling and self._enables == enables:
            text = '4: the arm is enabled without a request'
            self._world.break_(BrokenError(text))
        self._looked = self.gate is False, self._enables - (self._enabling > 0)

    async def _answer(self, name: str) -> str:
        wishes, process = self.wishes, self._world.process
        began = wishes.open
        if name == 'enable':
            wishes.open = None if wishes.open is False else wishes.open
            wishes.closed_meanwhile = False
        try:
            message = f'ok: {await process.ask(lambda: process.command(name))}'
        except (CommandError, RobotError) as error:
            message = f'no: {error}'
        except DiedError:
            message = 'no: the driver died'
        self.say(f'~/{name}: {message}')
        ok = message.startswith('ok')
        if name == 'enable':
            if ok:
                wishes.open = None if wishes.closed_meanwhile else True
            elif wishes.open is None and began is False:
                wishes.open = False
        elif name in ('stop', 'disable') and ok and not wishes.any(self.loop.time()):
            self._world.arm.said_to_stand(name)
        return message

    def begin(self, work: Coroutine[Any, Any, None], what: str) -> None:
        """Start a request, which must be answered unless the driver hangs or dies."""
        process = self._world.process

        async def within() -> None:
            try:
                async with asyncio.timeout(ANSWER_S):
                    await work
            except TimeoutError:
                if not process.hangs and not process.died.done():
                    text = f'9: {what} has no answer after {ANSWER_S:g} s'
                    self._world.break_(BrokenError(text))

        task = self.loop.create_task(within())
        self.requests.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: 'asyncio.Task[None]') -> None:
        self.requests.discard(task)
        error = None if task.cancelled() else task.exception()
        if isinstance(error, BrokenError):
            self._world.break_(error)
        elif error is not None:
            self._world.break_(BrokenError(f'9: a request failed: {error!r}'))

    # --- streams -----------------------------------------------------------------------------

    async def stream(
        self, publisher: int, kind: str, speed: list[float], period: float, zero_each: int
    ) -> None:
        await self.end_stream(publisher)
        sending = self._send(kind, speed, period, zero_each)
        self.publishers[publisher] = self.loop.create_task(sending)

    async def _send(self, kind: str, speed: list[float], period: float, zero_each: int) -> None:
        start, count = self._world.arm.at.copy(), 0
        while True:
            zero = bool(zero_each) and count % zero_each == 0
            self._take(kind, np.array(speed) * (0.0 if zero else 1.0), start, count * period)
            count += 1
            await asyncio.sleep(period)

    async def one_setpoint(
        self, publisher: int, kind: str, speed: list[float], period: float, zero_each: int
    ) -> None:
        start = self._world.arm.at.copy()
        self._take(kind, np.array(speed), start, period * (publisher + zero_each))

    async def wrong_setpoint(self, kind: str, topic: str) -> None:
        at, wrong = self._world.arm.at.copy(), np.full(len(self._world.start), IMPOSSIBLE[kind])
        setpoint = Setpoint('~/servo', at, wrong)
        if topic == '~/joint_jog':
            setpoint = Setpoint(topic, None, wrong * np.nan)
        self._follow(setpoint)

    def _take(self, kind: str, speed: Any, begin: Any, time: float) -> None:
        process = self._world.process
        if process.hangs and isinstance(process, RobotProcess):
            return
        swing = begin + speed * np.sin(time)
        if kind in ('velocities', 'zeros'):
            speed = speed if kind == 'velocities' else np.zeros(len(begin))
            setpoint = Setpoint('~/joint_jog', None, speed)
            moves = bool(np.any(speed))
        elif kind in ('positions', 'from here'):
            if kind == 'from here':  # like programs that read the position in each cycle
                swing = self._world.arm.at + speed * AHEAD_S
            setpoint, moves = Setpoint('~/servo', swing, None), True
        else:
            times = np.arange(0.0, 0.105, 0.01)
            ways = begin + np.multiply.outer(np.sin(time + times), speed)
            speeds = np.multiply.outer(np.cos(time + times), speed)
            setpoint = Setpoint('~/servo', ways[-1], speeds[-1], Window(times, ways, speeds))
            moves = bool(np.any(speed))
        self._want_setpoint(setpoint, moves=moves)

    def jog(self, velocities: Array, *, wanted: bool) -> None:
        moves = wanted and bool(np.any(velocities))
        self._want_setpoint(Setpoint('~/joint_jog', None, velocities), moves=moves)

    def _want_setpoint(self, setpoint: Setpoint, *, moves: bool) -> None:
        if self._world.streams:
            node, now = isinstance(self._world.process, NodeProcess), self.loop.time()
            source = setpoint.source if node else 'servo()'
            if self._stays(source, setpoint, now) and not self._leads(source, setpoint):
                moves = False
            self.wishes.setpoint(source, now, moves=moves)
        self._follow(setpoint)

    def _stays(self, source: str, setpoint: Setpoint, now: float) -> bool:
        """Return whether a position is unchanged, which requests no motion (docs/servo.md)."""
        received, before = self._positions.get(source, (-np.inf, None))
        positions = setpoint.positions
        if setpoint.window is not None or positions is None:
            return False
        stays = before is not None and bool(np.abs(positions - before).max() <= SAME_RAD)
        stays = stays and now - received < RELEASE_S
        self._positions[source] = now, before if stays else positions
        return stays

    def _leads(self, source: str, setpoint: Setpoint) -> bool:
        """Return whether an unchanged position is a target that the arm has not reached yet."""
        topic, positions = self.wishes.topics.get(source), setpoint.positions
        if topic is None or positions is None:
            return False
        return topic.free and bool(np.abs(positions - self._world.arm.at).max() > SAME_RAD)

    def _follow(self, setpoint: Setpoint) -> None:
        process = self._world.process
        missed = self._received.get(setpoint.source, process.name) != process.name
        self._received[setpoint.source] = process.name
        received = int(self._world.system_time() * 1e9) + 1  # data read immediately has not waited
        process.call(partial(process.take, setpoint, received, missed))

    async def end_stream(self, publisher: int) -> None:
        task = self.publishers.pop(publisher, None)
        if task is not None:
            task.cancel()

    def end_streams(self) -> None:
        for task in self.publishers.values():
            task.cancel()
        self.publishers.clear()

    # --- outputs -----------------------------------------------------------------------------

    async def read_output(self, index: int) -> None:
        async def read() -> None:
            process = self._world.process
            with self._world.outputs.reading(index) as held:
                try:
                    value = await process.ask(lambda: process.read(index))
                except (IoUnavailableError, RobotError, DiedError) as error:
                    self.say(f'output {index}: {error}')
                else:
                    self.say(f'output {index} is {value}')
                    if value not in held:
                        text = f'8: output {index} is read as {value}, which it was not'
                        self._world.break_(BrokenError(text))

        self.begin(read(), '~/read_io')

    async def write_output(self, index: int, value: int) -> None:
        async def write() -> None:
            process = self._world.process
            with self._world.outputs.writing(index, value) as writing:
                try:
                    await process.ask(lambda: process.write(index, value))
                except (IoUnavailableError, RobotError, DiedError) as error:
                    self.say(f'output {index} = {value}: {error}')
                else:
                    self.say(f'output {index} = {value}: done')
                    writing.done()

        self.begin(write(), '~/write_io')
