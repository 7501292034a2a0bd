# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One world: a driver, its controller, the network between them, and all users.

A world draws its profile, delays and timing from the seed and plays the events. Then it ends all
faults and acts like a person until the arm executes a small motion again. Everything runs in one
virtual loop, and garbage is collected at fixed moments, so that the same events give the same log
in every process. So a violation can be replayed, and its event list shortened.
"""

import asyncio
import contextlib
import gc
import logging
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np

from epson_driver.aio import Robot, Settings
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.outcome import End, Outcome
from epson_driver.driver.smoothing import (
    TIMEOUT_S,
    Smoothing,
    SmoothingProcess,
)
from epson_driver.profiles.profile import (
    ControllerProfile,
    load_controller_profile,
)
from epson_driver.robots import load_robot_model
from epson_driver.rtmc.feeder import Feeder
from epson_driver.setup.setup import make_setup
from epson_driver.sim_controller.arm.planner_process import PlannerProcess
from epson_driver.sim_controller.arm.streaming import Streaming
from epson_driver.sim_controller.assembly import (
    new_controller,
    profile_project,
    program_network,
)
from epson_driver.sim_controller.faults.fault_kinds import FaultError
from epson_driver.sim_controller.network.servers import ControllerServers, Ports
from epson_driver.sim_controller.spel_host.spel_program import SpelSource
from epson_driver.spel import Program, build
from simulation.arm_limits import ArmLimits
from simulation.at_controller import AtController
from simulation.dds_bus import DdsBus
from simulation.events import (
    CALM_KINDS,
    KINDS,
    number_of,
    prepared,
    real_time,
    smooth_profile,
)
from simulation.events import Event as Happening
from simulation.network import HOST, PROCESS, Network
from simulation.oracles import Arm, BrokenError, Outputs, Wishes
from simulation.panel_user import PanelUser
from simulation.processes import NodeProcess, RobotProcess
from simulation.users import ANSWER_S, Users
from simulation.virtual_loop import SOON_S, VirtualLoop
from simulation.workers import Workers

PROFILES = (
    *('simulated', 'simulated', 'generic', 'motoman', 'remote') * 2,
    *('spel', 'fanuc', 'abb', 'simulated'),
)
"""Profiles of worlds. Profiles with a high processor load are listed once, the others twice."""

SLOWEST_S = 2500.0
"""Maximum duration of a goal at the lowest speed, s."""

SETTLE_S = {'fanuc': 700.0, 'abb': SLOWEST_S, 'motoman': 10.0, 'generic': 10.0, 'remote': 15.0}
"""Maximum time for which an arm may continue without a request, s. Some controllers finish their
points (docs/safety.md), at the speed that was set: at least 1 %."""

SETTLE_OTHERS_S = 3.0
STATE_PERIODS_S = (0.005, 0.02, 0.05, 0.05, 0.05)
DELAYS_S = (0.0, 0.0005, 0.01, 0.05)
REAL_TIME_DELAY_S = 0.0005
PLANNING_S = (0.0, 0.05, 0.5)
STATE_TIMEOUT_S = 1.0
PERSON_S = 0.3
"""Minimum time for a person to find a remedy, s. It is longer if STATUS is sent less often."""

PROGRAM_FRACTION = 0.2
"""Fraction of worlds in which a Python program replaces the node."""

BRAKING_S = 1.0
"""Maximum time for an arm to notice a silent driver and to brake, s."""

MAX_ENDS = 8
"""Maximum number of connection ends in the calm final state. A driver has one at each of four
ports."""

MORE = 4
"""Tolerance for tasks and timers in the calm final state: the I/O link may be waiting for its next
attempt."""

RECOVERY_S = 60.0
"""Time within which the arm must work again after the faults have ended, s."""

MODEL = load_robot_model('c3_a601s')
SLOW = replace(MODEL, limits=replace(MODEL.limits, velocity=0.08 * MODEL.limits.velocity))
"""A model that reaches its top speeds even on the short distances of these goals."""

START = np.array([0.0, 0.2, 0.2, 0.0, -1.9, 0.0])
"""Start position of the arm, rad, from which its tool can move in every direction."""

OWN_PACE = ('fanuc', 'abb', 'remote')
"""Profiles whose controllers choose the duration of a goal."""


class World:
    """A world in a loop. `play` plays a list of events, after which the arm must work again.

    log: a line for each event, with its time. The same events give the same lines. situations:
    kinds of events, the arm's phase at the time, and its users.
    """

    start = START
    process: NodeProcess | RobotProcess

    def __init__(self, seed: str) -> None:
        self.rng = np.random.default_rng([number_of(seed), 2])
        self.log: list[str] = []
        self.situations: set[tuple[str, str, str, str]] = set()
        self.broken: BrokenError | None = None
        drawn, smooth = str(self.rng.choice(PROFILES)), smooth_profile(seed)
        self.real_time = real_time(seed)
        if self.real_time:
            drawn, smooth = 'rtmc', ''
        self.profile_name = smooth or drawn
        self.smooth = bool(smooth)
        self.profile: ControllerProfile = load_controller_profile(self.profile_name)
        program = self.profile.program
        self.statements = program.interface == 'statements'
        self.streams = (
            program.interface in ('streaming', 'rtmc') and program.point_message == 'joint_traj_pt'
        )
        self.smoothing = _smoothing(prepared(seed), self.profile)
        self.timed = self.profile_name not in OWN_PACE and not self.smoothing.time_optimal
        self.state_period = float(self.rng.choice(STATE_PERIODS_S))
        if not program.loaded:
            self.state_period = self.profile.state.period
        self.delay = float(self.rng.choice(DELAYS_S))
        if self.real_time:  # each target is answered before the next one is sent
            self.delay = min(self.delay, REAL_TIME_DELAY_S)
        status = 1 + self.profile.state.joint_positions_per_status
        self.person = max(PERSON_S, status * self.state_period + 3.0 * self.delay)
        self.rng.random()  # not used any more, but keeps the later draws of the known seeds
        self.remote = bool(self.profile.ports.remote) or bool(
            self.rng.random() < 0.4 and self.profile_name in ('simulated', 'spel')
        )
        self.in_python = bool(self.rng.random() < PROGRAM_FRACTION and program.smoothing == 'none')
        self.model = SLOW if self.smooth and not self.in_python else MODEL
        self.limits = self.model.limits
        self.network = Network(lambda: self.delay * (0.5 + self.rng.random()))
        self.loop = VirtualLoop(self.network, float(self.rng.choice(PLANNING_S)))
        stalled = self.network.stalled
        self.bus = DdsBus(self.network.delay, stalled.__contains__, self.loop.true_time)
        self.clock_off = 0.0
        """Offset of the system clock of the driver's machine, s."""
        self.workers = Workers(self.rng)
        self.wishes = Wishes()
        self.arm_limits = ArmLimits(self.limits, self.break_)
        self.events = 0
        self.users = Users(self)
        self.at_controller = AtController(self)
        self.panel: PanelUser | None = None
        self._calm = False
        """Whether the events contain no failure, so that nothing may close the gate."""
        self._processes = 0
        self._io = False
        self._over = False
        """Whether only the shutdown remains."""
        self._lives: list[Any] = []
        """Objects of all processes, also of dead ones, so that none is garbage collected."""

    # --- the world's course ----------------------------------------------------------------------

    def play(self, happenings: list[Happening]) -> None:
        self.loop.set_exception_handler(self._on_exception)
        gc.disable()  # so that lost objects are collected at the same moment in every process
        logging.getLogger('epson_driver').addHandler(handler := _Errors(self.break_))
        try:
            with (
                patch('socket.create_server', self.network.create_server),
                patch('time.thread_time', lambda: 0.0),
                patch('time.time', self.system_time),
                patch('time.monotonic', self.loop.time),
                patch(f'{Streaming.__module__}.Smoother', self.arm_limits.smoother),
                patch(f'{Feeder.__module__}.KnownMotion', self.arm_limits.known_motion),
                self.bus.used(),
                patch(f'{PlannerProcess.__module__}.start_worker', self.workers.start),
                patch(f'{SmoothingProcess.__module__}.start_worker', self.workers.start),
            ):
                self.loop.run_until_complete(self._play(happenings))
        except BrokenError as error:
            self.break_(error)
        finally:
            self._over = True
            self.loop.bury()
            gc.enable()
            logging.getLogger('epson_driver').removeHandler(handler)
        if self.broken is not None:
            raise self.broken

    async def _play(self, happenings: list[Happening]) -> None:
        kinds = {item.kind for item in happenings}
        self._calm, self._io = kinds <= CALM_KINDS, not kinds.isdisjoint(IO_KINDS)
        self.say(
            f'{self.profile_name}, state each {self.state_period:g} s, network '
            f'{self.delay:g} s{", Remote Ethernet" if self.remote else ""}'
            f'{", smooth" if self.smooth else ""}'
            f'{f", {self.smoothing}" if self.smoothing.wanted else ""}'
            f'{", a program in Python" if self.in_python else ""}'
        )
        async with self._controller():
            self.start_process()
            if not self.in_python and any(kind.startswith('panel_') for kind in kinds):
                self.panel = PanelUser(self.users, self.model)
            await self._until(lambda: self.process.linked, 10.0, 'the driver finds its controller')
            first = self._at_work
            if self.rng.random() < 0.8:
                self.at_controller.mend()
                await self.users.asked('enable')
            for happening in happenings:
                await asyncio.sleep(happening.after)
                self._raise()
                self.events += 1
                self._situation(happening)
                self.say(str(happening))
                await ACTS[happening.kind](self, **happening.parameters)
                self._look_at_gate()
            await self._recover()
            few = f'at most {MAX_ENDS // 2} connections are left'
            await self._until(lambda: len(self.network.ends) <= MAX_ENDS, ANSWER_S, few)
            few = f'about {first} tasks and timers of driver and controller are left, as at first'
            await self._until(lambda: self._at_work <= first + MORE, ANSWER_S, few)
            self.process.die()
            self._over = True

    @contextlib.asynccontextmanager
    async def _controller(self) -> Any:
        spel = None
        if self.profile.spel.project:
            spel = SpelSource(_program(self.profile_name), program_network(self.profile))
        token = PROCESS.set('controller')
        planner = PlannerProcess(self.limits) if self.smooth else None
        self.controller = new_controller(
            self.model,
            self.profile,
            start=START,
            state_period=self.state_period,
            planner=planner,
            spel=spel,
            seed=int(self.rng.integers(2**31)),
        )
        self.servers = ControllerServers(
            self.controller,
            planner,
            spel and spel.network,
            rtmc_port=0 if self.real_time else None,
        )
        self.ports = await self.servers.open(HOST, Ports(0, 0, 0, 0))
        settle = SETTLE_S.get(self.profile_name, SETTLE_OTHERS_S)
        look = self.arm_limits.look
        self.arm = Arm(self.controller, self.loop.true_time, self.wishes, settle, look)
        if self.profile.server.lost_client == 'keep':
            self.at_controller.keeps_points()
        self.outputs = Outputs(self.controller.io, self.loop.true_time, self.break_)
        running = asyncio.create_task(self.servers.run())
        running.add_done_callback(self.process_over)
        PROCESS.reset(token)
        try:
            yield
        finally:
            self.users.end_streams()
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
            await self.servers.close()

    async def _recover(self) -> None:
        """End all faults, and act like a person until the arm works again."""
        self.say('all faults end')
        if self.panel is not None:
            self.panel.close()
        self.users.end_streams()
        for port in self.ports:
            self.network.release(port)
        self.network.flips.clear()
        with contextlib.suppress(FaultError):
            self.controller.faults.clear()
        await self.users.scale(1.0)
        await self._until(lambda: not self.controller.faults.active(), 10.0, 'faults are over')
        requests = self.users.requests
        await self._until(lambda: not requests, ANSWER_S, 'every request is answered')
        await self._until(lambda: not self.controller.in_motion, SLOWEST_S, 'the arm rests')
        self._look_at_gate()
        started, message = self.loop.time(), ''
        while True:
            await asyncio.sleep(0.2)
            self._raise()
            await self._until(lambda: not self.controller.in_motion, RECOVERY_S, 'the arm rests')
            self.at_controller.mend()
            message = await self.users.asked('enable')
            if message.startswith('ok'):
                outcome = await self._outcome()
                if outcome.end is End.SUCCEEDED:
                    break
                message = outcome.text
                if (
                    'cancel it first' in message
                ):  # a slow goal of a Python program is still running
                    self.users.cancel_all()
            if self.loop.time() - started > RECOVERY_S:
                raise BrokenError(
                    f'9: the arm does not work again after {RECOVERY_S:g} s: {message}'
                )
        await self._until(lambda: not self.users.goals, self._timeout, 'every goal has ended')
        await asyncio.sleep(0.7)
        self._raise()

    @property
    def _timeout(self) -> float:
        """Maximum time for a short goal, s. The process that prepares it may hang."""
        return ANSWER_S + (TIMEOUT_S if self.smoothing.wanted else 0.0)

    @property
    def _at_work(self) -> int:
        left = self.loop.left()
        return left['controller'] + left[self.process.name]

    async def _outcome(self) -> Outcome:
        ended: list[Outcome] = []
        number = self.users.submit(
            np.array([[0.0, 0.0, 0.05, 0.0, 0.0, 0.0]]),
            0.5,
            from_here=not self.in_python,
            on_end=lambda _, outcome: ended.append(outcome),
        )
        await self._until(lambda: ended, self._timeout, f'goal {number} ends')
        return ended[0]

    def _look_at_gate(self) -> None:
        """Judge that the arm is enabled only after a request, and stays so in a calm world."""
        self.users.look_at_gate()
        why = self.at_controller.why_shut(self.users.held_up)
        if why is not None and self.process.gate:
            self.break_(BrokenError(f'4: the arm is enabled in spite of the {why}'))
        if self._calm and self.wishes.open and self.process.gate is False:
            self.break_(BrokenError('5: the arm is disabled, and nothing was wrong'))

    # --- the driver's process --------------------------------------------------------------------

    def start_process(self) -> None:
        self._processes += 1
        if self.in_python:
            self.process = RobotProcess(self, self._processes, self._robot, self.model)
        else:
            self.process = NodeProcess(self, self._processes, self._configuration(), self.model)
        self._lives.append(self.process)

    def _robot(self) -> Robot:
        ports = self.ports
        return Robot(
            HOST,
            controller=self.profile_name,
            motion_port=ports.motion,
            state_port=ports.state,
            io_port=ports.io if self._io else 0,
            remote_port=ports.remote if self.remote else 0,
            settings=Settings(require_planned_speed=False),
        )

    def _configuration(self) -> Configuration:
        profile, program = self.profile, self.profile.program
        return Configuration(
            host=HOST,
            motion_port=self.ports.motion,
            state_port=self.ports.state,
            io_port=self.ports.io if self._io else 0,
            io=profile.io,
            remote_port=self.ports.remote if self.remote else 0,
            byte_order=None,
            usual_byte_order=profile.byte_order,
            state_timeout=STATE_TIMEOUT_S,
            state_period=self.state_period,
            limits=self.limits,
            delivery=delivery_rules(profile, program.interface, program.point_message),
            client_timeout=profile.server.client_timeout,
            motors=program.motors,
            model=self.model.name,
            smoothing=self.smoothing,
        )

    async def driver_hangs(self, seconds: float) -> None:
        """Pause the driver's process, like SIGSTOP, while other events happen."""
        self.loop.hang(self.process.name)
        self.at_controller.hung(seconds)
        self.users.begin(self._go_on(self.process.name, seconds), 'a driver that hangs')

    async def _go_on(self, name: str, seconds: float) -> None:
        watched = self.profile.server.client_timeout
        await asyncio.sleep(seconds)
        if name not in self.loop.hanging:
            return
        moves = self.loop.time() - self.arm.moved < 0.1
        if watched and seconds > watched + BRAKING_S and moves and not self.wishes.person:
            self.break_(BrokenError(f'3: the arm moves while the driver hangs for {seconds:g} s'))
        self.loop.go_on(name)
        self.users.held_up = self.loop.time()

    async def driver_dies(self, seconds: float) -> None:
        self.process.die()
        await self._gone(seconds)

    async def driver_leaves(self, seconds: float, lost: bool) -> None:
        """Shut down the driver's process, or close the program's robot, for a while."""
        await asyncio.sleep(SOON_S)  # requests of this moment have started by then
        if isinstance(self.process, RobotProcess) and not self.process.linked:
            return  # it has nothing to release yet
        if self.process.name not in self.loop.hanging:  # a hanging process ends once it resumes
            self.wishes.closed(self.loop.time())
        await self.process.leave(lost=lost)
        if self.in_python:
            gc.collect()
        await self._gone(seconds)

    async def _gone(self, seconds: float) -> None:
        self.wishes.closed(self.loop.time())
        if self.process.died.done():
            self.users.driver_died()
        if self.panel is not None:
            self.panel.robot.driver_died()
        await asyncio.sleep(seconds)
        if isinstance(self.process, RobotProcess) and not self.process.died.done():
            self.process.come_back()
        else:
            self.start_process()

    def system_time(self) -> float:
        """Return the system clock of the driver's machine, s, which may have been set."""
        return self.loop.now + self.clock_off

    async def clock_set(self, seconds: float) -> None:
        self.clock_off += seconds

    async def clock_drifts(self, rate: float) -> None:
        self.loop.drift('controller', rate)

    def process_over(self, task: asyncio.Task[None]) -> None:
        """Report an error that ended a process as a broken invariant."""
        error = None if task.cancelled() else task.exception()
        if isinstance(error, BrokenError):
            self.break_(error)
        elif error is not None:
            self.break_(BrokenError(f'9: a process ended: {error!r}'))

    def on_joints(self, sample: Any) -> None:
        if self.panel is not None:
            self.panel.take(sample=sample)
        try:
            self.arm.published(sample.positions, unsure=self.at_controller.unsure)
        except BrokenError as error:
            self.break_(error)

    def on_status(self, status: Any) -> None:
        if self.panel is not None:
            self.panel.take(status=status)

    def on_link_state(self, name: str, why: str) -> None:
        if self.panel is not None:
            self.panel.robot.state.link = name
        self.say(f'link: {name}: {why}')

    # --- observations ----------------------------------------------------------------------------

    def say(self, text: str) -> None:
        self.log.append(f'{self.loop.now:.6f} {text}')

    def _situation(self, happening: Happening) -> None:
        users = '+'.join(
            name
            for name, there in (
                ('goal', bool(self.wishes.goals)),
                ('stream', bool(self.users.publishers)),
                ('request', bool(self.users.requests)),
                ('panel', self.panel is not None and self.panel.armed),
                ('python', self.in_python),
            )
            if there
        )
        moving = 'moving' if self.controller.in_motion else 'standing'
        phase = f'{moving}, {"open" if self.wishes.open else "closed"}'
        detail = str(happening.parameters.get('event') or happening.parameters.get('text') or '')
        kind = ' '.join([happening.kind, *detail.split()[:1]])
        self.situations.add((kind, phase, users or 'nobody', self.profile_name))

    def break_(self, error: BrokenError) -> None:
        if self.broken is None and not self._over:
            self.broken = error
            self.say(f'BROKEN: {error}')

    def _raise(self) -> None:
        if self.broken is not None:
            raise self.broken

    def _on_exception(self, _loop: Any, context: dict[str, Any]) -> None:
        error = context.get('exception')
        if isinstance(error, BrokenError):
            self.break_(error)
        else:
            self.break_(BrokenError(f'9: {context["message"]}: {error!r}'))

    async def _until(self, condition: Callable[[], object], patience: float, what: str) -> None:
        ends = self.loop.time() + patience
        while not condition():
            self._raise()
            if self.loop.time() > ends:
                raise BrokenError(f'9: after {patience:g} s it does not hold that {what}')
            await asyncio.sleep(0.02)


def _smoothing(how: str, profile: ControllerProfile) -> Smoothing:
    """Return the node's smoothing of goals: from the controller's profile, or drawn."""
    drawn = {}
    if how and profile.program.interface == 'streaming':
        drawn = (
            {'smoothing': 'resample', 'timing': how}
            if how == 'time_optimal'
            else {'smoothing': how}
        )
    return make_setup({'controller': profile.name, **drawn}).configuration.smoothing


@cache
def _program(profile_name: str) -> Program:
    return build(profile_project(load_controller_profile(profile_name), MODEL))


class _Errors(logging.Handler):
    """Treats log records with a traceback as violations."""

    def __init__(self, found: Callable[[BrokenError], None]) -> None:
        super().__init__(logging.ERROR)
        self._found = found

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info:
            self._found(BrokenError(f'9: {record.getMessage()}: {record.exc_info[1]!r}'))


IO_KINDS = ('read_output', 'write_output')


async def _nobody(**_: Any) -> None: ...


def _act(kind: str) -> Callable[..., Awaitable[None]]:
    owner, _, name = kind.partition('_')
    if owner == 'panel':
        return lambda world, **given: (getattr(world.panel, name, _nobody))(**given)
    if hasattr(World, kind):
        act: Callable[..., Awaitable[None]] = getattr(World, kind)
        return act
    where = 'users' if hasattr(Users, kind) else 'at_controller'
    return lambda world, **given: getattr(getattr(world, where), kind)(**given)


ACTS = {kind: _act(kind) for kind in KINDS}
"""Kind of event → its function."""


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    logger = logging.getLogger('epson_driver')
    before = logger.propagate
    logger.propagate = False
    try:
        yield
    finally:
        logger.propagate = before
