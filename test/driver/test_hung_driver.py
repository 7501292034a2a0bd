# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A driver that stalls in a motion: the controller stops the arm, and the driver reports it.

The driver stalls like a stopped process (`event_loop.hanging`) in virtual time. The controller
runs, and messages wait in the driver's sockets.
"""

import asyncio
import contextlib
import re
import struct
from itertools import product

import numpy as np
import pytest
from support import driver_harness
from support.driver_harness import Harness, options_of, pose, simulated
from support.event_loop import hanging, now, until
from support.examples import one_in, quickly
from support.fault_play import cell_of, make_ready
from support.streams import positions, sending, velocities

from epson_driver.driver.outcome import End
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.link import WireEvent
from epson_driver.profiles import load_controller_profile
from epson_driver.share import share_path
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.simple_message import GetVersion, MessageType

TIMEOUTS = {'simulated': 1.0, 'spel': 0.5}
"""Client timeouts of the profiles with a watchdog, s. Others have none."""

BRAKING = 0.35
"""Braking time at the speeds of these tests, s, including the detection by SPEL+."""

LATER = 1.05
"""Maximum time to the stop of simulated controllers, in timeouts."""

HUNG = 'this driver was stalled for [0-9.]+ s, the controller waits (1|0.5) s'
"""Text of goal and gate, although the controller reports the timeout on both of its ports."""

KINDS = {
    'smooth': ('simulated', True, 'streaming'),
    'from point to point': ('simulated', False, 'streaming'),
    'download': ('simulated', True, 'download'),
    'scaled': ('simulated', True, 'streaming'),
    'spel': ('spel', False, 'streaming'),
}
PROFILES = share_path('config', 'controllers', 'simulated.yaml').parent
HEARTBEAT = struct.pack('<4i', 12, MessageType.PING, 1, 0)
STOP = struct.pack('<i', -4)
FAR = pose(2.0, 0.5, -0.4)


class Arm:
    """Position of the controller's arm, and the time of its last motion."""

    def __init__(self, controller):
        self.moved = now()
        self._controller = controller
        self._step = controller.step
        controller.step = self.step

    @property
    def at(self):
        return self._controller.arm.commanded.copy()

    def step(self, seconds):
        before = self.at
        self._step(seconds)
        if np.abs(self.at - before).max() > 1e-9:
            self.moved = now()


class Inbox:
    """A driver that receives setpoints like from ROS, and queues them while it stalls."""

    def __init__(self, harness):
        self.driver = self.servo = self
        self._servo = harness.driver.servo
        self._process = harness.process

    def take(self, setpoint):
        loop = asyncio.get_running_loop()
        loop.call_soon(self._servo.take, setpoint, context=self._process.copy())


@contextlib.asynccontextmanager
async def cell(kind):
    name, smooth, interface = KINDS[kind]
    profile = load_controller_profile(name)
    options = options_of(profile, interface) | {'client_timeout': profile.server.client_timeout}
    async with driver_harness.cell(profile=profile, smooth=smooth, **options) as (
        harness,
        controller,
    ):
        harness.driver.servo.settings = ServoSettings(period=profile.program.setpoint_period)
        yield harness, controller, Arm(controller)


def timeout_of(kind):
    return TIMEOUTS[KINDS[kind][0]]


async def closed(harness):
    """Return the reason of the closed gate."""
    await until(lambda: harness.gate is not None)
    return harness.gate


async def works_again(harness, arm):
    """Check that nothing moves before `~/enable`, and that a goal succeeds after it."""
    await asyncio.sleep(0.5)
    at = arm.at
    await asyncio.sleep(1.0)
    assert np.array_equal(arm.at, at)
    refused = harness.submit(at + 0.05)
    assert 'not enabled' in (await refused.end()).text
    await harness.commands.enable()
    await asyncio.sleep(0.3)
    assert np.array_equal(arm.at, at)
    again = harness.submit(at + 0.05)
    assert (await again.end()).end is End.SUCCEEDED


@pytest.mark.invariant(3, 4, 5)
@pytest.mark.parametrize(
    ('kind', 'points'),
    quickly([('smooth', 12)], product(KINDS, [1, 12])),
)
async def test_stalled_driver_stops_the_arm_and_its_goal_reports_it(kind, points):
    async with cell(kind) as (harness, _, arm):
        path = np.linspace(FAR / points, FAR, points)
        goal = harness.submit(*path, step=10.0 / points)
        await harness.until_moving()
        await asyncio.sleep(0.8)
        with hanging():
            start = now()
            await asyncio.sleep(2.0)
            assert arm.moved - start < LATER * timeout_of(kind) + BRAKING
            at = arm.at
            assert at[0] < 1.0
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert re.match(f'this machine is too busy: {HUNG}, end other pro', outcome.text), outcome
        assert outcome.text.startswith(await closed(harness))
        assert np.array_equal(arm.at, at)
        await works_again(harness, arm)


@pytest.mark.invariant(3, 4)
@pytest.mark.parametrize(
    ('kind', 'stream'),
    one_in(
        3,
        [('smooth', 'positions'), ('from point to point', 'velocities'), ('spel', 'velocities')],
        several=True,
    ),
)
async def test_stream_that_continues_through_a_stall_of_the_driver_ends(kind, stream):
    def setpoint_at(t):
        return velocities(pose(0.3)) if stream == 'velocities' else positions(pose(0.3 * t))

    async with cell(kind) as (harness, _, arm):
        async with sending(Inbox(harness), setpoint_at):
            await until(lambda: arm.at[0] > 0.2)
            with hanging():
                start = now()
                await asyncio.sleep(1.5)
                assert arm.moved - start < LATER * timeout_of(kind) + BRAKING
                at = arm.at
            assert re.search(HUNG, await closed(harness))
            await asyncio.sleep(1.2)
            assert np.array_equal(arm.at, at)
        await works_again(harness, arm)


@pytest.mark.invariant(3, 5)
@pytest.mark.parametrize('kind', one_in(2, KINDS))
@pytest.mark.parametrize(
    ('share', 'ends'), one_in(2, [(1.001, True), (0.94, False)], several=True)
)
async def test_stall_ends_the_goal_only_if_as_long_as_the_timeout(kind, share, ends):
    """Stalls are repeated, so they start at any time after a heartbeat."""
    async with cell(kind) as (harness, _, arm):
        stall = share * timeout_of(kind)
        heartbeat = harness.driver.heartbeat
        goal = harness.submit(*np.linspace(FAR / 12, FAR, 12), step=0.3)
        await harness.until_moving()
        await asyncio.sleep(0.1)
        while not goal.outcomes:
            with hanging():
                await asyncio.sleep(stall)
            await asyncio.sleep(0.053)
        if ends:
            assert re.search(HUNG, goal.outcome.text), goal.outcome.text
            assert heartbeat.longest_gap > timeout_of(kind)
            return
        assert goal.outcome.end is End.SUCCEEDED, goal.outcome.text
        assert np.abs(arm.at - FAR).max() < 0.01
        assert stall <= heartbeat.longest_gap < timeout_of(kind)


@pytest.mark.parametrize(
    ('share', 'cause'), [(0.1, 'the driver or the network was delayed'), (0.6, HUNG)]
)
async def test_heartbeat_timeout_of_the_controller_is_reported_with_the_stall(share, cause):
    async with cell('smooth') as (harness, controller, _):
        goal = harness.submit(FAR, step=10.0)
        await harness.until_moving()
        with hanging():
            await asyncio.sleep(share * timeout_of('smooth'))
            controller.program.client_silent(timeout_of('smooth'))
        assert re.search(cause, (await goal.end()).text)


@pytest.mark.slow
async def test_first_stall_of_a_driver_is_reported_with_the_remedy():
    async with cell('smooth') as (harness, _, arm):
        texts = []
        for _ in range(2):
            goal = harness.submit(arm.at + 0.5, step=3.0)  # the failed PING is read first
            await harness.until_moving()
            await asyncio.sleep(0.5)
            with hanging():
                await asyncio.sleep(1.5)
            texts.append((await goal.end()).text)
            await asyncio.sleep(0.5)
            await harness.commands.enable()
    assert re.match('this machine is too busy: .* higher priority', texts[0]), texts
    assert re.match(HUNG, texts[1]), texts


@pytest.mark.parametrize('kind', one_in(2, ['smooth', 'spel']))
async def test_long_motion_succeeds_with_heartbeats_alone(kind):
    async with cell(kind) as (harness, _, arm):
        goal = harness.submit(FAR / 2, step=1.5)
        assert (await goal.end()).end is End.SUCCEEDED
        sent = harness.driver.motion_link.statistics.frames_sent
        await asyncio.sleep(1.0)  # an arm at rest needs none
        assert harness.driver.motion_link.statistics.frames_sent == sent
        assert (await harness.submit(arm.at + 0.1).end()).end is End.SUCCEEDED


async def test_heartbeats_start_before_the_first_point_and_have_their_period():
    sent = []

    async with cell('from point to point') as (harness, _, _arm):
        harness.driver.motion_link.trace = lambda event, data: sent.append((now(), event, data))
        goal = harness.submit(FAR, step=4.0)
        await harness.until_moving()
        await asyncio.sleep(2.0)
        harness.driver.goal_queue.cancel(goal.handle)
        await goal.end()
        await asyncio.sleep(1.0)
    frames = [(at, data) for at, event, data in sent if event is WireEvent.SENT]
    beats = [time for time, data in frames if data == HEARTBEAT]
    assert frames[0][1] == HEARTBEAT
    assert frames[1][1][4] == MessageType.JOINT_TRAJ_PT
    assert len(beats) > 40
    assert max(np.diff(beats)) < TIMEOUTS['simulated'] / 20 + 0.001
    answers = [data for _, event, data in sent if event is WireEvent.RECEIVED]
    assert all(data[4] == MessageType.JOINT_POSITION for data in answers)
    ((stopped, _),) = [(at, data) for at, data in frames if data[16:20] == STOP]
    assert beats[-1] < stopped + 0.3


@pytest.mark.slow
async def test_enable_queries_the_program_version_again_after_a_wrong_one(monkeypatch):
    """The controller has received heartbeats on this connection and stops an arm without them."""
    async with cell('from point to point') as (harness, controller, _arm):
        assert (await harness.submit(pose(0.1), step=1.0).end()).end is End.SUCCEEDED
        versions = [(0, 2, 0), (0, 1, 0)]
        monkeypatch.setattr(Controller, 'version', lambda _: GetVersion(versions.pop()))
        controller.faults.start(parse('cut port=state for=0.2'))
        await closed(harness)
        await until(lambda: harness.driver.state_link.connected)
        await asyncio.sleep(0.5)
        await harness.commands.enable()
        assert (await harness.submit(FAR, step=4.0).end()).end is End.SUCCEEDED


@pytest.mark.parametrize(('name', 'timeout'), [('simulated', 0.0), ('generic', 0.5)])
async def test_other_controllers_receive_no_heartbeats(name, timeout):
    """Either the driver's profile has no client_timeout, or the program does not support it."""
    sent = []

    options = {'client_timeout': timeout}
    async with simulated(profile=name) as (_, ports), Harness(ports, **options) as harness:
        await harness.ready()
        await harness.commands.enable()
        harness.driver.motion_link.trace = lambda event, data: sent.append((event, data))
        goal = harness.submit(pose(0.05), step=0.5)
        await harness.until_moving()
        with hanging():
            await asyncio.sleep(2.0)
        assert (await goal.end()).end is End.SUCCEEDED
    assert {data[4] for event, data in sent if event is WireEvent.SENT} == {
        MessageType.JOINT_TRAJ_PT
    }


@pytest.mark.parametrize(
    ('name', 'longest'),
    [('generic', 1.2), ('fanuc', 0.7), ('abb', 3.5), ('motoman', 1.2)],
)
async def test_programs_without_heartbeats_execute_their_queue_during_a_stall(name, longest):
    """This is the table of docs/safety.md. A Motoman's queue is 0.8 s and one waiting point."""
    async with cell_of(load_controller_profile(name)) as (harness, controller, _):
        await make_ready(harness, controller)
        await harness.commands.enable()
        arm = Arm(controller)
        harness.submit(*np.linspace(FAR / 12, FAR, 12), step=0.3)
        await harness.until_moving()
        await asyncio.sleep(0.2)
        with hanging():
            start = now()
            await asyncio.sleep(5.0)
            assert arm.moved - start < longest
            assert (np.abs(arm.at - FAR).max() < 0.01) == (name == 'abb')
