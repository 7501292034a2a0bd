# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A driver, its recorded events, and a simulated or scripted controller for it."""

import asyncio
import contextlib
import struct
from functools import cache
from typing import Any

import numpy as np

from epson_driver.driver import smoothing
from epson_driver.driver.arm_commands import ArmCommands
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.driver import Driver
from epson_driver.driver.goal.goal import Goal, GoalSettings
from epson_driver.driver.goal.goal_queue import GoalHandle
from epson_driver.driver.smoothing import SmoothingProcess
from epson_driver.driver.smoothing_worker import smoothed_trajectory
from epson_driver.motion import Array, Trajectory
from epson_driver.motion.smoother import plan
from epson_driver.profiles.profile import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.setup.setup import profile_defaults
from epson_driver.sim_controller.assembly import (
    new_controller,
    profile_project,
    program_network,
)
from epson_driver.sim_controller.network.servers import ControllerServers, Ports
from epson_driver.sim_controller.spel_host.spel_program import SpelSource
from epson_driver.spel import Program, build
from simulation.dds_bus import DdsBus
from support.event_loop import accepted, now, own_process, real_time, until

MODEL = load_robot_model('c3_a601s')
LIMITS = MODEL.limits
JOINTS = len(LIMITS.names)
HOME = np.zeros(JOINTS)


class PlannerOnTheSpot:
    """A planner that answers within the call."""

    ready = True

    def ask(self, request, limits, answer):
        answer(plan(request, limits))


class Recorder:
    """The driver's events with their times."""

    def __init__(self):
        self.samples = []
        self.statuses = []
        self.links = []

    def on_joints(self, sample):
        self.samples.append((now(), sample))

    def on_status(self, status):
        self.statuses.append((now(), status))

    def on_link_state(self, name, why):
        self.links.append((name, why))

    @property
    def status(self):
        return self.statuses[-1][1]


class Submitted:
    """A submitted goal and its outcome."""

    def __init__(self, goal):
        self.outcomes = []
        self.ended_at = None
        self.feedback = []
        self.handle = GoalHandle(goal, self._on_end, self._on_feedback)

    def _on_end(self, outcome):
        self.ended_at = now()
        self.outcomes.append(outcome)

    def _on_feedback(self, execution, sample):
        self.feedback.append((execution.target, sample))

    @property
    def outcome(self):
        assert len(self.outcomes) == 1, self.outcomes
        return self.outcomes[0]

    async def end(self):
        """Wait for the outcome."""
        await until(lambda: self.outcomes)
        return self.outcome


class Harness:
    """A running driver with its services, its events, and goals for it."""

    def __init__(self, ports: Any, **options: Any) -> None:
        self.process = own_process()
        settings = options.pop('settings', GoalSettings(require_planned_speed=False))
        defaults = {
            'host': '127.0.0.1',
            'motion_port': ports.motion,
            'state_port': ports.state,
            'remote_port': ports.remote,
            'byte_order': None,
            'state_timeout': 1.0,
            'limits': LIMITS,
            'model': MODEL.name,
        }
        self.events = Recorder()
        self.driver = Driver(Configuration(**defaults | options), self.events, settings)
        self.commands = ArmCommands(self.driver)

    async def __aenter__(self):
        self._task = asyncio.create_task(self.driver.run(), context=self.process)
        return self

    async def __aexit__(self, *_):
        await self.stop()

    async def stop(self):
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task

    @property
    def running(self):
        return not self._task.done()

    @property
    def gate(self):
        return self.driver.gate.reason

    @property
    def at(self):
        sample = self.driver.robot.sample
        assert sample is not None
        return sample.positions

    async def ready(self):
        """Wait for both links, joints and a status."""
        await until(
            lambda: (
                self.events.links
                and self.events.links[-1][0] == 'connected'
                and self.driver.robot.sample is not None
                and self.driver.robot.status is not None
            )
        )

    def submit(self, *points, step=0.6, tolerance=0.01, goal_time=0.0, start=None, ahead=None):
        """Submit a goal along the points, `step` s apart, from the arm's position or `start`.

        ahead: time until its start, s.
        """
        positions = np.vstack([self.at if start is None else start, *points])
        trajectory = Trajectory(LIMITS.names, np.arange(len(positions)) * step, positions)
        at = 0.0 if ahead is None else now() + ahead
        return self.execute(trajectory, tolerance, goal_time, start=at)

    def execute(self, trajectory, tolerance=0.01, goal_time=0.0, **fields):
        """Submit a trajectory as a goal."""
        submitted = Submitted(Goal(trajectory, np.full(JOINTS, tolerance), goal_time, **fields))
        self.process.copy().run(self.driver.goal_queue.submit, submitted.handle)
        return submitted

    async def until_moving(self):
        start = self.at
        await until(lambda: abs(self.at - start).max() > 1e-3)

    async def rests(self):
        """Return whether the arm is at rest for 0.2 s."""
        await asyncio.sleep(0.05)
        before = self.at
        await asyncio.sleep(0.2)
        return np.array_equal(before, self.at)


def plan_in_real_time(patch):
    """Prepare motions in real time within a loop of virtual time."""
    prepared = SmoothingProcess.prepared

    async def in_real_time(*arguments):
        with real_time():
            return await prepared(*arguments)

    patch.setattr(SmoothingProcess, 'prepared', in_real_time)
    patch.setattr(smoothing, 'TIMEOUT_S', 600.0)


def smooth_in_process(patch, delay=0.0):
    """Smooth goals in this process instead of a worker process, and take `delay` s for it."""

    async def prepared(process, trajectory, start, share=(1.0, 1.0), smoothing=None):
        await asyncio.sleep(delay)
        settings = smoothing or process._smoothing  # noqa: SLF001
        limits = process._limits.scaled(*share)  # noqa: SLF001
        return smoothed_trajectory(trajectory, start, limits, settings)

    patch.setattr(SmoothingProcess, 'prepared', prepared)
    patch.setattr(SmoothingProcess, 'make_ready', lambda process: None)


def open_gate(gate):
    """Open the gate without a controller."""
    with gate.enabling() as enabling:
        gate.open(enabling)


def pose(*values: float) -> Array:
    """Return joint angles, filled up with zeros."""
    return np.array([*values, *[0.0] * (JOINTS - len(values))])


@cache
def _built(files: tuple[tuple[str, str], ...]) -> Program:
    return build(dict(files))


@contextlib.asynccontextmanager
async def simulated(dialect=None, profile='simulated', model=None, *, smooth=False, start=None):
    """Run the simulated controller in this process; yield it and its ports.

    `profile`: a profile, with its SPEL+ program if it has one, or a profile's name. `model`: a
    robot's name. `smooth`: it moves smoothly, and planning takes no time. `start`: its initial
    joint positions.
    """
    if isinstance(profile, str):
        profile = load_controller_profile(profile)
    arm = MODEL if model is None else load_robot_model(model)
    spel = None
    if profile.spel.project:
        files = profile_project(profile, arm)
        spel = SpelSource(_built(tuple(files.items())), program_network(profile))
    planner = PlannerOnTheSpot() if smooth else None
    controller = new_controller(arm, profile, start, dialect=dialect, planner=planner, spel=spel)
    real_time = 0 if profile.program.interface == 'rtmc' else None
    servers = ControllerServers(controller, spel=spel and spel.network, rtmc_port=real_time)
    with DdsBus().used():
        ports = await servers.open('127.0.0.1', Ports(0, 0, 0, 0))
        task = asyncio.create_task(servers.run())
        try:
            yield controller, ports
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task
            await servers.close()


def options_of(profile, interface=None):
    """Return the options of a driver for a profile or a profile's name."""
    if isinstance(profile, str):
        profile = load_controller_profile(profile)
    defaults = profile_defaults(profile)
    interface = interface or defaults['interface']
    return {
        'delivery': delivery_rules(profile, interface, defaults['point_message']),
        'motors': profile.program.motors,
    }


@contextlib.asynccontextmanager
async def cell(*, enabled=True, smooth=False, profile='simulated', **options):
    """Run a driver with the simulated controller; yield both."""
    async with (
        simulated(smooth=smooth, profile=profile) as (controller, ports),
        Harness(ports, **options) as harness,
    ):
        await harness.ready()
        if enabled:
            await harness.commands.enable()
        yield harness, controller


class ScriptedController:
    """A controller scripted by a test: `reply(sequence)` returns the bytes that answer a point.

    It never moves. Its state port sends joints and a STATUS each `period` s. `shows_joints` and
    `shows_status` suppress one of them.
    """

    STATUS = (1, 0, 0, 0, 0, 2, 1)

    def __init__(self, reply=None, period=0.005):
        self._period = period
        self.shows_joints = True
        self.shows_status = True
        self.status = self.STATUS
        self.extra = b''
        self.received = []
        self.motion = None
        self._reply = reply or (lambda sequence: answer(1, sequence))

    async def __aenter__(self):
        self._tasks = set()
        self._servers = [
            await asyncio.start_server(self._serve(talk), '127.0.0.1', 0)
            for talk in (self._motion, self._state)
        ]
        motion, state = (server.sockets[0].getsockname()[1] for server in self._servers)
        self.ports = Ports(motion, state, 0, 0)
        return self

    async def __aexit__(self, *_):
        await accepted()
        for server in self._servers:
            server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _serve(self, talk):
        def accept(reader, writer):
            task = asyncio.create_task(self._attend(talk, reader, writer))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

        return accept

    async def _attend(self, talk, reader, writer):
        try:
            with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
                await talk(reader, writer)
        finally:
            writer.close()

    async def _motion(self, reader, writer):
        self.motion = writer
        while True:
            (length,) = struct.unpack('<i', await reader.readexactly(4))
            body = await reader.readexactly(length)
            sequence = struct.unpack_from('<i', body, 12)[0]
            self.received.append(sequence)
            writer.write(self._reply(sequence))

    async def _state(self, _reader, writer):
        while True:
            data, self.extra = self.extra, b''
            if self.shows_joints:
                data += frame(10, 1, 0, bytes(44))
            if self.shows_status:
                data += frame(13, 1, 0, struct.pack('<7i', *self.status))
            writer.write(data)
            await writer.drain()
            await asyncio.sleep(self._period)


def frame(msg_type, comm_type, reply_code, body):
    return struct.pack('<4i', 12 + len(body), msg_type, comm_type, reply_code) + body


def answer(code, sequence=0):
    return frame(10, 3, code, struct.pack('<i40x', sequence))


@contextlib.asynccontextmanager
async def scripted_cell(reply=None, *, enabled=True, controller=ScriptedController, **options):
    """Run a driver with a scripted controller; yield both."""
    async with controller(reply) as scripted, Harness(scripted.ports, **options) as harness:
        await harness.ready()
        if enabled:
            await harness.commands.enable()
        yield harness, scripted
