# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One world: a driver, its controller, the network between them, and everybody who uses them."""

import asyncio
import contextlib
import logging
import re
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextvars import copy_context
from functools import cache, partial
from typing import Any
from unittest.mock import patch

import numpy as np

from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal import Goal, GoalSettings
from epson_driver.driver.goal.goal_queue import GoalHandle
from epson_driver.driver.outcome import End, Outcome
from epson_driver.driver.servo.setpoint import Setpoint, Window
from epson_driver.motion import Array, Trajectory
from epson_driver.profiles.profile import ControllerProfile, load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import SpelSource, new_controller, program_network
from epson_driver.sim_controller.condition.states import (
    Door,
    EStop,
    Event,
    Mode,
    RejectedError,
    Tasks,
)
from epson_driver.sim_controller.faults.faults import ANSWER_TIME_S, FaultError, parse
from epson_driver.sim_controller.network.servers import ControllerServers, Ports
from epson_driver.sim_controller.spel_host.profile_project import profile_project
from epson_driver.spel import Program, build
from simulation.events import KINDS, number_of
from simulation.events import Event as Happening
from simulation.network import HOST, PROCESS, Network
from simulation.oracles import Arm, BrokenError, Wishes
from simulation.panel_user import PanelUser
from simulation.virtual_loop import VirtualLoop

PROFILES = ('rc620', 'rc620', 'rc700a', 'generic', 'spel', 'fanuc', 'abb', 'motoman', 'remote')
SLOWEST_S = 700.0
"""How long a goal may take at the lowest speed, s."""

SETTLE_S = {'fanuc': SLOWEST_S, 'abb': SLOWEST_S, 'motoman': 10.0, 'generic': 10.0, 'remote': 15.0}
"""How long an arm may go on when nobody wants that any more, s: some controllers go to the points
they have (docs/safety.md), at the speed that was set: 1 % at least."""

SERVICES = ('stop', 'enable', 'disable', 'reset_error')

SETTLE_OTHERS_S = 3.0
STATE_PERIODS_S = (0.005, 0.02, 0.05)
DELAYS_S = (0.0, 0.0005, 0.01, 0.05)
STATE_TIMEOUT_S = 1.0
ANSWER_S = 30.0
"""How long a request may stay without an answer, s."""

BRAKING_S = 1.0
"""How long an arm may take to notice a silent driver late, and to brake, s."""

UNSURE_S = 1.0
"""How long changed bits may be under way, s."""

RECOVERY_S = 60.0
"""Within which the arm must work again once the faults are over, s."""

MODEL = load_robot_model('c3_a601s')
LIMITS = MODEL.limits
JOINTS = len(LIMITS.names)
REACH_RAD = 0.6

CLOSING = (
    'ESTOP_PRESS',
    'MOTORS_OFF',
    'DOOR_OPEN',
    'MODE_MANUAL',
)
"""What a person does at the controller after which the arm must be enabled again."""

ON_ANY_PORT = ('cut', 'half_open', 'delay', 'jitter', 'coalesce', 'one_byte')
"""Faults that can strike the remote port, too."""


class World:
    """A world in a loop. `play` lets a list of events happen; then the arm must work again.

    log: a line for each thing that happened, with its time; the same events give the same lines.
    situations: which kinds of events met the arm in which phase, with whom at it.
    """

    def __init__(self, seed: str) -> None:
        self.rng = np.random.default_rng([number_of(seed), 2])
        self.log: list[str] = []
        self.situations: set[tuple[str, str, str, str]] = set()
        self.broken: BrokenError | None = None
        self.profile_name = str(self.rng.choice(PROFILES))
        self.profile: ControllerProfile = load_controller_profile(self.profile_name)
        self.statements = self.profile.program.interface == 'statements'
        self.state_period = float(self.rng.choice(STATE_PERIODS_S))
        if self.statements:
            self.state_period = self.profile.state.period
        self.links = ('remote',) if self.statements else ('motion', 'state')
        """Ports that the driver needs: without one the arm must be enabled again."""
        self.delay = float(self.rng.choice(DELAYS_S))
        self.on_the_way = bool(
            self.rng.random() < 0.3
            and self.profile.program.joins_goals
            and self.profile.program.interface == 'streaming'
        )
        self.network = Network(lambda: self.delay * float(self.rng.uniform(0.5, 1.5)))
        self.loop = VirtualLoop(self.network)
        self.wishes = Wishes()
        self.events = 0
        self.goals = 0
        self._streams: dict[int, asyncio.Task[None]] = {}
        self._requests: set[asyncio.Task[None]] = set()
        self._handles: dict[int, GoalHandle] = {}
        self._process = 0
        self._unsure_until = 0.0
        """Until when what is published may be wrong: bits were changed, and still arrive."""
        self._over = False
        """Whether what is left only ends."""
        self._driver: Driver | None = None
        self._lives: list[Any] = []
        """What dead processes had, too: nothing of theirs is collected while others go on."""
        self._panel: PanelUser | None = None

    # --- the world's course ----------------------------------------------------------------------

    def play(self, happenings: list[Happening]) -> None:
        """Let everything happen. Raises BrokenError for what did not hold."""
        self.loop.set_exception_handler(self._on_exception)
        logging.getLogger('epson_driver').addHandler(handler := _Errors(self._break))
        try:
            with (
                patch('socket.create_server', self.network.create_server),
                patch('time.thread_time', lambda: 0.0),
            ):
                self.loop.run_until_complete(self._play(happenings))
        except BrokenError as error:
            self._break(error)
        finally:
            self._over = True
            self.loop.bury()
            logging.getLogger('epson_driver').removeHandler(handler)
        if self.broken is not None:
            raise self.broken

    async def _play(self, happenings: list[Happening]) -> None:
        self.say(
            f'{self.profile_name}, state each {self.state_period:g} s, network '
            f'{self.delay:g} s{", goals on the way" if self.on_the_way else ""}'
        )
        async with self._controller():
            self._start_driver()
            if any(each.kind.startswith('panel_') for each in happenings):
                self._panel = PanelUser(self, MODEL)
            await self._until(self._linked, 10.0, 'the driver finds its controller')
            if self.rng.random() < 0.8:
                self._person()
                await self._asked('enable')
            for happening in happenings:
                await asyncio.sleep(happening.after)
                self._raise()
                self.events += 1
                self._situation(happening)
                self.say(str(happening))
                await ACTS[happening.kind](self, **happening.parameters)
            await self._recover()
            self._raise()
            self.loop.kill(self._name)
            self._over = True

    @contextlib.asynccontextmanager
    async def _controller(self) -> Any:
        spel = None
        if self.profile.spel.project:
            spel = SpelSource(_program(self.profile_name), program_network(self.profile))
        token = PROCESS.set('controller')
        self.controller = new_controller(
            MODEL,
            self.profile,
            state_period=self.state_period,
            spel=spel,
            seed=int(self.rng.integers(2**31)),
        )
        self.servers = ControllerServers(self.controller, spel=spel and spel.network)
        self.ports = await self.servers.open(HOST, Ports(0, 0, 0, 0))
        self._settle = SETTLE_S.get(self.profile_name, SETTLE_OTHERS_S)
        self.arm = Arm(self.controller, self.loop.time, self.wishes, self._settle)
        running = asyncio.create_task(self.servers.run())
        running.add_done_callback(self._process_over)
        PROCESS.reset(token)
        try:
            yield
        finally:
            for task in self._streams.values():
                task.cancel()
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
            await self.servers.close()

    async def _recover(self) -> None:
        """End all faults, and do what a person would until the arm works again."""
        self.say('all faults end')
        if self._panel is not None:
            self._panel.close()
        for stream in self._streams.values():
            stream.cancel()
        self._streams.clear()
        for port in self.ports:
            self.network.release(port)
        self.network.flips.clear()
        with contextlib.suppress(FaultError):
            self.controller.faults.clear()
        self._scale(1.0)
        await self._until(lambda: not self.controller.faults.active(), 10.0, 'faults are over')
        await self._until(lambda: not self._requests, ANSWER_S, 'every request is answered')
        await self._until(lambda: not self.controller.in_motion, SLOWEST_S, 'the arm rests')
        begun, said = self.loop.time(), ''
        while True:
            await asyncio.sleep(0.5)
            self._raise()
            await self._until(lambda: not self.controller.in_motion, RECOVERY_S, 'the arm rests')
            self._person()
            said = await self._asked('enable')
            if said.startswith('ok'):
                handle = self._submit(np.array([[0.0, 0.0, 0.05, 0.0, 0.0, 0.0]]), 1.0, True)
                outcome = await self._outcome(handle)
                if outcome.end is End.SUCCEEDED:
                    break
                said = outcome.text
            if self.loop.time() - begun > RECOVERY_S:
                raise BrokenError(f'the arm does not work again after {RECOVERY_S:g} s: {said}')
        await self._until(lambda: not self._handles, ANSWER_S, 'every goal has ended')
        await asyncio.sleep(1.0)

    async def _outcome(self, handle: GoalHandle) -> Outcome:
        await self._until(lambda: handle.outcome is not None, ANSWER_S, 'a goal ends')
        assert handle.outcome is not None
        return handle.outcome

    def _person(self) -> None:
        """Do at the controller what helps, whatever is wrong there."""
        condition = self.controller.condition
        todo = [
            (condition.estop is EStop.PRESSED, 'ESTOP_RELEASE'),
            (condition.door is Door.OPEN, 'DOOR_CLOSE'),
            (condition.mode is Mode.MANUAL, 'MODE_AUTO'),
            (condition.paused or condition.tasks is Tasks.RECOVERING, 'STOP'),
            (True, 'RESET'),
            (True, 'START'),
            (not self._remote, 'MOTORS_ON'),
        ]
        for wanted, event in todo:
            if wanted:
                self._apply(event)

    # --- what is done ----------------------------------------------------------------------------

    async def goal(self, step: float, offsets: list[list[float]], from_here: bool) -> None:
        """Hand in a goal."""
        self._submit(np.array(offsets), step, from_here)

    def _submit(self, offsets: Array, step: float, from_here: bool) -> GoalHandle:
        at = self.arm.at.copy()
        points: Array = np.clip(at + offsets, -REACH_RAD, REACH_RAD)
        points = np.clip(points, LIMITS.position_min, LIMITS.position_max)
        apart = np.ptp(np.vstack([at, points]), axis=0)
        step = max(step, 1.5 * float(np.max(apart / LIMITS.velocity)))
        times = np.arange(1.0, len(points) + 1.0) * step
        if from_here:
            times, points = np.append(0.0, times), np.vstack([at, points])
        return self._handles[self.hand_in(Trajectory(LIMITS.names, times, points))]

    def hand_in(
        self,
        trajectory: Trajectory,
        on_end: Callable[[int, Outcome], object] = lambda *_: None,
        *,
        wanted: bool = True,
    ) -> int:
        """Hand in a goal; return its number. `wanted`: somebody wants it now."""
        number = self.goals = self.goals + 1
        goal = Goal(trajectory, np.full(JOINTS, 0.01), 0.0)
        ended = partial(self._ended, number, on_end)
        self._handles[number] = handle = GoalHandle(goal, ended, lambda *_: None)
        if wanted and self.wishes.open is not False:
            self.wishes.goal(number, self.loop.time())
        self._in_driver(lambda driver: driver.goal_queue.submit(handle))
        return number

    def _ended(
        self, number: int, on_end: Callable[[int, Outcome], object], outcome: Outcome
    ) -> None:
        handle = self._handles.pop(number, None)
        on_end(number, outcome)
        self.say(f'goal {number}: {outcome.end.value}: {outcome.text}')
        if handle is None:
            self._break(BrokenError(f'5: goal {number} ended twice: {outcome.text}'))
            return
        handle.outcome = outcome
        self.wishes.goals.discard(number)
        if outcome.end is End.SUCCEEDED:
            away = np.abs(self.arm.at - handle.goal.trajectory.positions[-1]).max()
            if away > 0.0101 + 2e-3:
                self._break(BrokenError(f'5: goal {number} succeeded {away:.4f} rad away'))

    async def cancel(self) -> None:
        """Cancel the newest goal."""
        if self._handles:
            self.cancel_goal(max(self._handles))

    def cancel_goal(self, number: int) -> None:
        """Cancel a goal: nobody wants it any more."""
        self.wishes.goals.discard(number)
        handle = self._handles[number]
        self._in_driver(lambda driver: driver.goal_queue.cancel(handle))

    async def scale(self, factor: float) -> None:
        """Set the speed scaling."""
        self._scale(factor)

    def _scale(self, factor: float) -> None:
        def change(driver: Driver) -> None:
            try:
                driver.goal_queue.scaling.set(factor, self.loop.time())
            except ValueError as error:
                self.say(f'refused: {error}')

        self._in_driver(change)

    async def service(self, name: str) -> None:
        """Call a service of the node."""
        self.request(name)

    def request(self, name: str, say: Callable[[str], object] = lambda _: None) -> None:
        """Call a service; who wants motion after a stop wants it afterwards."""
        if name == 'stop':
            self.wishes.nothing(self.loop.time())
        elif name == 'disable':
            self.wishes.closed(self.loop.time())
        self._request_of(self._answered(name, say))

    async def _answered(self, name: str, say: Callable[[str], object]) -> None:
        process = self._name
        try:
            async with asyncio.timeout(ANSWER_S):
                say(await self._asked(name))
        except TimeoutError:
            if process == self._name and process not in self.loop.hanging:
                self._break(BrokenError(f'9: ~/{name} has no answer after {ANSWER_S:g} s'))

    async def _asked(self, name: str) -> str:
        """Ask the driver for something, as a service does; return its answer."""
        answer: asyncio.Future[str] = self.loop.create_future()
        began, process = self.wishes.open, self._name
        if name == 'enable':
            self.wishes.open = None if self.wishes.open is False else self.wishes.open
            self._closed_meanwhile = False

        async def ask(commands: ArmCommands) -> None:
            try:
                said = f'ok: {await getattr(commands, name)()}'
            except CommandError as error:
                said = f'no: {error}'
            if not answer.done():
                answer.set_result(said)

        if self._driver is not None:
            asking = self._context.copy().run(self.loop.create_task, ask(self._commands))
            self._lives.append(asking)
        while not answer.done():
            if process != self._name or self._driver is None:
                answer.set_result('no: the driver died')
                break
            await asyncio.wait([answer], timeout=0.1)
        said = answer.result()
        self.say(f'~/{name}: {said}')
        if name == 'enable':
            if said.startswith('ok'):
                self.wishes.open = None if self._closed_meanwhile else True
            elif self.wishes.open is None and began is False:
                self.wishes.open = False
        return said

    async def stream(
        self, publisher: int, kind: str, speed: list[float], period: float, zero_each: int
    ) -> None:
        """Let a publisher send setpoints until it is ended."""
        await self.end_stream(publisher)
        sending = self._send(kind, speed, period, zero_each)
        self._streams[publisher] = self.loop.create_task(sending)

    async def _send(self, kind: str, speed: list[float], period: float, zero_each: int) -> None:
        begin, count = self.arm.at.copy(), 0
        while True:
            zero = bool(zero_each) and count % zero_each == 0
            self._take(kind, np.array(speed) * (0.0 if zero else 1.0), begin, count * period)
            count += 1
            await asyncio.sleep(period)

    async def one_setpoint(
        self, publisher: int, kind: str, speed: list[float], period: float, zero_each: int
    ) -> None:
        """Let one setpoint come."""
        self._take(kind, np.array(speed), self.arm.at.copy(), period * (publisher + zero_each))

    def _take(self, kind: str, speed: Any, begin: Any, time: float) -> None:
        """Let a setpoint come on the topic of its kind."""
        swing = begin + speed * np.sin(time)
        if kind in ('velocities', 'zeros'):
            speed = speed if kind == 'velocities' else np.zeros(JOINTS)
            setpoint = Setpoint('~/joint_jog', None, speed)
            moves = bool(np.any(speed))
        elif kind == 'positions':
            setpoint, moves = Setpoint('~/servo', swing, None), True
        else:
            times = np.arange(0.0, 0.105, 0.01)
            ways = np.array([begin + speed * np.sin(time + each) for each in times])
            speeds = np.array([speed * np.cos(time + each) for each in times])
            setpoint = Setpoint('~/servo', ways[-1], speeds[-1], Window(times, ways, speeds))
            moves = bool(np.any(speed))
        self._follow(setpoint, moves=moves)

    def jog(self, velocities: Array, *, wanted: bool) -> None:
        """Let velocities come from the panel."""
        moves = wanted and bool(np.any(velocities))
        self._follow(Setpoint('~/joint_jog', None, velocities), moves=moves)

    def _follow(self, setpoint: Setpoint, *, moves: bool) -> None:
        now = self.loop.time()
        if not self.statements:  # which follow no streams
            self.wishes.setpoint(setpoint.source, now, moves=moves)
        self._in_driver(lambda driver: driver.servo.take(setpoint, now))

    async def end_stream(self, publisher: int) -> None:
        """Let a publisher send no more."""
        task = self._streams.pop(publisher, None)
        if task is not None:
            task.cancel()

    async def at_panel(self, what: str, parameters: dict[str, Any]) -> None:
        """Let a person do something at the panel."""
        assert self._panel is not None
        await getattr(self._panel, what)(**parameters)

    async def pendant(self, event: str) -> None:
        """Let a person do something at the controller."""
        self._apply(event)

    def _apply(self, event: str) -> None:
        closes = event in CLOSING or (event == 'STOP' and self.profile.program.motors == 'restart')
        try:
            with self.servers.pacer.present():
                self.controller.apply(Event[event])
        except RejectedError as error:
            self.say(f'{event} is refused: {error}')
            return
        if closes:
            self._close()
        if (event in ('STOP', 'RESET') and self.wishes.open) or (
            event == 'MOTORS_OFF' and self.profile.program.kind == 'motoman'
        ):  # a goal that comes before the next STATUS switches a Motoman's motors on
            self.wishes.open, self._closed_meanwhile = None, True
        if event == 'CONTINUE':
            self.wishes.person = True
            self.loop.call_later(20.0, setattr, self.wishes, 'person', False)

    def _close(self) -> None:
        self._closed_meanwhile = True
        self.wishes.closed(self.loop.time())

    async def fault(self, text: str) -> None:
        """Let the controller or its connections fail."""
        name = text.split()[0]
        if self.statements and name in ON_ANY_PORT:
            text = f'{re.sub(" port=[a-z]+", "", text)} port=remote'
        fault = parse(text)
        with contextlib.suppress(FaultError), self.servers.pacer.present():  # there are many
            self.controller.faults.start(fault)
            if name == 'cut':  # of the remote port it begins a little later
                self.loop.call_later(ANSWER_TIME_S if self.statements else 0.0, self._close)
        self._closed_meanwhile = True

    async def clear_faults(self) -> None:
        """End the controller's faults."""
        with self.servers.pacer.present():
            self.controller.faults.clear()

    def _number_of(self, port: str) -> int:
        number: int = getattr(self.ports, 'remote' if self.statements else port)
        return number

    async def network_stall(self, port: str, seconds: float) -> None:
        """Let nothing pass on a port for a while."""
        number = self._number_of(port)
        self.network.stall(number)
        self.loop.call_later(seconds, self.network.release, number)

    async def network_reset(self, port: str) -> None:
        """End the connections of a port."""
        self.network.reset(self._number_of(port))
        if port in self.links or self.statements:
            self._close()

    async def network_half_close(self, port: str) -> None:
        """Let the controller see the end of what its clients send."""
        self.network.half_close(self._number_of(port))

    async def network_flip(self, port: str, byte: int, bit: int) -> None:
        """Change a bit of what the controller sends next on a port."""

        def flipped(data: bytes) -> bytes:
            at = byte % len(data)
            return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]

        self.network.flips[self._number_of(port)] = flipped
        self._unsure_until = self.loop.time() + UNSURE_S

    async def driver_hangs(self, seconds: float) -> None:
        """Let the driver's process stand still, as SIGSTOP does."""
        watched = self.profile.server.client_timeout
        self.loop.hang(self._name)
        if self.controller.faults.active() or self.network.flips:  # read only afterwards
            self._unsure_until = self.loop.time() + seconds + UNSURE_S
        await asyncio.sleep(seconds)
        if watched and seconds > watched + BRAKING_S and self.loop.time() - self.arm.moved < 0.1:
            self._break(BrokenError(f'3: the arm moves while the driver hangs for {seconds:g} s'))
        self.loop.go_on(self._name)

    async def driver_dies(self, seconds: float) -> None:
        """Kill the driver's process, and start it again after a while."""
        self.loop.kill(self._name)
        self._driver = None
        self._handles.clear()
        if self._panel is not None:
            self._panel.robot.driver_died()
        self._close()
        await asyncio.sleep(seconds)
        self._start_driver()

    async def second_client(self, port: str, seconds: float) -> None:
        """Let somebody else connect to a port, and leave again."""
        self._request_of(self._stranger(port, seconds))

    async def _stranger(self, port: str, seconds: float) -> None:
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(5.0):
                _, writer = await asyncio.open_connection(HOST, self._number_of(port))
            if self._number_of(port) == self.ports.remote:
                writer.write(b'$Login,\r\n')
            await asyncio.sleep(seconds)
            writer.close()

    def _request_of(self, work: Coroutine[Any, Any, None]) -> None:
        task = self.loop.create_task(work)
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)

    # --- the driver's process --------------------------------------------------------------------

    @property
    def _name(self) -> str:
        return f'driver {self._process}'

    @property
    def _remote(self) -> bool:
        return bool(self.profile.ports.remote)

    def _start_driver(self) -> None:
        self._process += 1
        self._context = copy_context()
        self._context.run(PROCESS.set, self._name)
        profile, program = self.profile, self.profile.program
        configuration = Configuration(
            host=HOST,
            motion_port=self.ports.motion,
            state_port=self.ports.state,
            remote_port=self.ports.remote if self._remote else 0,
            byte_order=None,
            usual_byte_order=profile.byte_order,
            state_timeout=STATE_TIMEOUT_S,
            state_period=self.state_period,
            limits=LIMITS,
            delivery=delivery_rules(profile, program.interface, program.point_message),
            client_timeout=profile.server.client_timeout,
            motors='restart' if profile.program.motors == 'restart' else 'remote_ethernet',
            on_the_way=self.on_the_way,
        )
        self._driver = driver = self._context.run(Driver, configuration, self, GoalSettings())
        running = self._context.run(self.loop.create_task, driver.run())
        running.add_done_callback(self._process_over)
        self._commands = ArmCommands(driver)
        self._lives += [driver, running]

    def _process_over(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if isinstance(error, BrokenError):
            self._break(error)
        elif error is not None:
            self._break(BrokenError(f'9: a process ended: {error!r}'))

    def _in_driver(self, call: Callable[[Driver], object]) -> None:
        """Call the driver as a callback of its node does: in its process, when that runs."""
        driver = self._driver
        if driver is not None:
            self.loop.call_soon(call, driver, context=self._context)

    @property
    def gate(self) -> bool | None:
        """Whether the driver says that the arm is enabled; None: it says nothing."""
        driver = self._driver
        if driver is None or self._name in self.loop.hanging:
            return None
        return driver.gate.reason is None

    def _linked(self) -> bool:
        driver = self._driver
        return (
            driver is not None
            and driver.state_link.connected
            and driver.motion_link.connected
            and driver.robot.sample is not None
            and driver.robot.status is not None
        )

    def on_joints(self, sample: Any) -> None:
        """Judge what the driver publishes."""
        if self._panel is not None:
            self._panel.take(sample=sample)
        if self.controller.faults.active() or self.network.flips:
            self._unsure_until = self.loop.time() + UNSURE_S
        elif self.loop.time() > self._unsure_until:
            self._judge(self.arm.published, sample.positions)

    def on_status(self, status: Any) -> None:
        """Have the panel see it."""
        if self._panel is not None:
            self._panel.take(status=status)

    def on_link_state(self, name: str, why: str) -> None:
        """Take it into the log."""
        if self._panel is not None:
            self._panel.robot.state.link = name
        self.say(f'link: {name}: {why}')

    # --- what is seen ----------------------------------------------------------------------------

    def say(self, text: str) -> None:
        """Write a line of the log."""
        self.log.append(f'{self.loop.time():.6f} {text}')

    def _situation(self, happening: Happening) -> None:
        users = '+'.join(
            name
            for name, there in (
                ('goal', bool(self.wishes.goals)),
                ('stream', bool(self._streams)),
                ('request', bool(self._requests)),
                ('panel', self._panel is not None and self._panel.armed),
            )
            if there
        )
        moving = 'moving' if self.controller.in_motion else 'standing'
        phase = f'{moving}, {"open" if self.wishes.open else "closed"}'
        detail = str(happening.parameters.get('event') or happening.parameters.get('text') or '')
        kind = ' '.join([happening.kind, *detail.split()[:1]])
        self.situations.add((kind, phase, users or 'nobody', self.profile_name))

    def _judge(self, oracle: Callable[..., None], *arguments: Any) -> None:
        try:
            oracle(*arguments)
        except BrokenError as error:
            self._break(error)

    def _break(self, error: BrokenError) -> None:
        if self.broken is None and not self._over:
            self.broken = error
            self.say(f'BROKEN: {error}')

    def _raise(self) -> None:
        if self.broken is not None:
            raise self.broken

    def _on_exception(self, _loop: Any, context: dict[str, Any]) -> None:
        error = context.get('exception')
        if isinstance(error, BrokenError):
            self._break(error)
        else:
            self._break(BrokenError(f'9: {context["message"]}: {error!r}'))

    async def _until(self, condition: Callable[[], object], patience: float, what: str) -> None:
        ends = self.loop.time() + patience
        while not condition():
            self._raise()
            if self.loop.time() > ends:
                raise BrokenError(f'9: after {patience:g} s it does not hold that {what}')
            await asyncio.sleep(0.02)


@cache
def _program(profile_name: str) -> Program:
    return build(profile_project(load_controller_profile(profile_name).spel, MODEL))


class _Errors(logging.Handler):
    """Takes what is logged with a traceback for a failure."""

    def __init__(self, found: Callable[[BrokenError], None]) -> None:
        super().__init__(logging.ERROR)
        self._found = found

    def emit(self, record: logging.LogRecord) -> None:
        """Report it."""
        if record.exc_info:
            self._found(BrokenError(f'9: {record.getMessage()}: {record.exc_info[1]!r}'))


def _act(kind: str) -> Callable[..., Awaitable[None]]:
    if kind in SERVICES:
        return lambda world: world.service(kind)
    if kind.startswith('panel_'):
        return lambda world, **parameters: world.at_panel(kind[len('panel_') :], parameters)
    act: Callable[..., Awaitable[None]] = getattr(World, kind)
    return act


ACTS = {kind: _act(kind) for kind in KINDS}
"""Kind of event → what it does."""


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Log nothing meanwhile."""
    logger = logging.getLogger('epson_driver')
    before = logger.propagate
    logger.propagate = False
    try:
        yield
    finally:
        logger.propagate = before
