# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A stopped stream moves nothing until it pauses, whatever other publishers send."""

import asyncio
import contextlib
from collections import deque
from itertools import product

import numpy as np
import pytest
from support.driver_harness import HOME, Harness, ScriptedController, cell, pose
from support.event_loop import now, run, until
from support.examples import quickly
from support.streams import JOG, SERVO, positions, sending, velocities, window

from epson_driver.driver.servo.restart_interlock import RELEASE_S, RestartInterlock
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.sim_controller.condition.states import Event

ALL_STILL = velocities(HOME)


def jog(_time):
    return velocities(pose(0.3))


def zero_each(period):
    """Return a velocity stream that is zero once per period, s."""
    return lambda time: ALL_STILL if time % period < 0.02 else velocities(pose(0.3))


def swing(time):
    return positions(pose(0.25 * np.sin(0.5 * np.pi * time)))


def swinging_window(time):
    def state(ahead):
        phase = 0.5 * np.pi * (time + ahead)
        return pose(0.25 * np.sin(phase)), pose(0.125 * np.pi * np.cos(phase))

    return window(state)


def moving_window(begin, speed):
    return window(lambda ahead: (pose(begin + speed * ahead), pose(speed)))


async def estop_and_back(harness, controller):
    controller.apply(Event.ESTOP_PRESS)
    await asyncio.sleep(1.0)
    for event in (Event.ESTOP_RELEASE, Event.RESET, Event.MOTORS_ON):
        controller.apply(event)
        await asyncio.sleep(0.1)
    await asyncio.sleep(0.3)
    await harness.commands.enable()


async def disabled_and_back(harness, controller):
    await harness.commands.stop()
    await harness.commands.disable()
    controller.apply(Event.MOTORS_ON)
    await asyncio.sleep(0.3)
    await harness.commands.enable()


async def cut_and_back(harness, _controller):
    harness.driver.motion_link.reconnect('for the test')
    await until(lambda: harness.gate is not None)
    await harness.ready()
    await asyncio.sleep(0.5)
    await harness.commands.enable()


async def only_stopped(harness, _controller):
    await harness.commands.stop()


STOPS = [only_stopped, estop_and_back, disabled_and_back, cut_and_back]
STREAMS = {
    'a key': (jog,),
    'a key and an idle stick': (jog, lambda _: ALL_STILL),
    'a key that flickers': (zero_each(0.5),),
    'positions': (swing,),
    'windows': (swinging_window,),
    'two of positions': (swing, lambda time: positions(pose(0.1))),
}


@pytest.mark.invariant(3, 4)
@pytest.mark.parametrize(
    ('streams', 'stop'),
    quickly([('windows', estop_and_back)], product(STREAMS, STOPS)),
)
async def test_inv4_continuing_stream_moves_nothing_after_stop_and_enable(streams, stop):
    async with cell(smooth=True) as (harness, controller), contextlib.AsyncExitStack() as on:
        for stream in STREAMS[streams]:
            await on.enter_async_context(sending(harness, stream))
        await asyncio.sleep(1.1)
        await stop(harness, controller)
        assert harness.gate is None
        there = harness.at
        seen = len(harness.events.samples)
        await asyncio.sleep(6.0)
        moved = [s.positions - there for _, s in harness.events.samples[seen:]]
        assert np.abs(moved).max() < 1e-4


@pytest.mark.invariant(4)
async def test_inv4_silence_before_the_stop_does_not_release_a_stream():
    async with cell(smooth=True) as (harness, _):
        await asyncio.sleep(3.0)
        await harness.commands.stop()
        async with sending(harness, jog):
            await asyncio.sleep(2.0)
        assert abs(harness.at[0]) < 1e-6
        await asyncio.sleep(1.1 * RELEASE_S)
        async with sending(harness, jog):
            await until(lambda: harness.at[0] > 0.05)


@pytest.mark.invariant(4)
async def test_inv4_joystick_released_for_one_second_moves_the_arm_again():
    async with cell(smooth=True) as (harness, _):
        start = now()

        def stick(_time):
            return ALL_STILL if 1.0 < now() - start < 2.2 else velocities(pose(0.3))

        async with sending(harness, stick):
            await asyncio.sleep(0.8)
            await harness.commands.stop()
            there = harness.at[0]
            await asyncio.sleep(1.2)
            assert harness.at[0] == pytest.approx(there, abs=1e-4)
            await until(lambda: harness.at[0] > there + 0.1)
            assert now() - start > 2.2


async def test_position_stream_after_estop_resumes_from_the_arm_position():
    """ros2_control first holds the old position, and its next goal starts at the arm."""
    async with cell(smooth=True) as (harness, controller):
        to = pose(0.05)
        async with sending(harness, lambda _: positions(to)):
            await until(lambda: harness.at[0] > 0.02)
            await estop_and_back(harness, controller)
            there = harness.at
            assert there[0] < 0.045
            await asyncio.sleep(2.0)
            np.testing.assert_allclose(harness.at, there, atol=1e-4)
            to = there + pose(0.01)
            await until(lambda: np.abs(harness.at - to).max() < 1e-3)


async def test_diagnostics_report_the_time_until_a_stopped_stream_is_released():
    async with cell(smooth=True) as (harness, _), sending(harness, jog):
        await asyncio.sleep(0.5)
        assert not harness.driver.servo.blocked(now())
        await harness.commands.stop()
        await asyncio.sleep(0.1)
        ((topic, left),) = harness.driver.servo.blocked(now()).items()
        assert topic == JOG
        assert 0.9 < left <= RELEASE_S
        diagnostics = Diagnostics(harness.driver, 'x', lambda _: 2)
        values = diagnostics.build(None, now()).status[-1].values
        (text,) = [value.value for value in values if value.key.endswith(JOG)]
        assert 's more without a setpoint that requests motion, publishers: 2' in text


def test_gap_with_missed_messages_does_not_release_a_stream():
    """A stalled process finds only the newest message in its queue."""
    interlock = RestartInterlock()
    interlock.trip(0.0)
    interlock.receive(JOG, velocities(pose(0.3)), 0.1, missed=False)
    interlock.receive(JOG, velocities(pose(0.3)), 5.0, missed=True)
    assert not interlock.permits(JOG)
    interlock.receive(JOG, velocities(pose(0.3)), 6.1, missed=False)
    assert interlock.permits(JOG)


@pytest.mark.invariant(4)
def test_inv4_stream_older_than_the_driver_must_pause_first():
    """Messages before the first one received, a zero, may have asked for motion."""
    for first in (ALL_STILL, velocities(pose(0.3))):
        interlock = RestartInterlock()
        interlock.receive(JOG, first, 0.0, missed=True)
        for time in (0.02, 0.5, 1.4):
            interlock.receive(JOG, velocities(pose(0.3)), time, missed=False)
            assert not interlock.permits(JOG)
        interlock.receive(JOG, velocities(pose(0.3)), 2.4, missed=False)
        assert interlock.permits(JOG)


def test_message_with_an_old_arrival_time_does_not_release_a_stream():
    """The system clock was set forward while the message was queued."""
    interlock = RestartInterlock()
    interlock.trip(0.0)
    for moment in (0.5, 1.4, 2.3, -2.6, 2.4):
        interlock.receive(JOG, velocities(pose(0.3)), moment, missed=False)
        assert not interlock.permits(JOG)


def held(time):
    return window(lambda ahead: (pose(0.03 + 4e-7 * np.sin(37 * (time + ahead))), pose(5e-5)))


@pytest.mark.parametrize('hold', [held, lambda _: positions(pose(0.03)), lambda _: ALL_STILL])
def test_stream_that_holds_still_for_one_second_is_released(hold):
    """A filter leaves small velocities in a window, so the positions decide."""
    interlock = RestartInterlock()
    interlock.trip(0.0)
    times = np.arange(0.0, 1.2, 0.02)
    asked = [interlock.receive(SERVO, hold(time), time, missed=False) for time in times]
    assert not any(asked[1:])
    interlock.receive(SERVO, swinging_window(1.2), 1.2, missed=False)
    assert interlock.permits(SERVO)


def test_creeping_position_does_not_release_a_stream():
    interlock = RestartInterlock()
    interlock.trip(0.0)
    for count in range(500):
        interlock.receive(SERVO, positions(pose(3e-7 * count)), 0.02 * count, missed=False)
    assert not interlock.permits(SERVO)


# --- random sequences ------------------------------------------------------------------------


class Oracle:
    """Decides which setpoint may start a stream, from messages and stops alone.

    In the second before that setpoint, every message of its topic must have asked for no motion,
    and no stop may have happened. Messages of a followed stream do not count, because a stream may
    pause and start again.
    """

    def __init__(self, harness):
        self._servo = harness.driver.servo
        self._received = deque()
        self._start = self._servo._start
        self._servo._start = self._checked
        self.stopped = -np.inf
        self.started = 0
        self._followed = set()

    def send(self, setpoint):
        while self._received and now() - self._received[0][0] > RELEASE_S:
            self._received.popleft()
        self._received.append((now(), setpoint))
        if self._servo.take(setpoint) is None and self._servo.source == setpoint.source:
            self._followed.add(setpoint)

    def send_invalid(self, source):
        invalid = velocities(np.full(len(HOME), np.inf), source=source)
        self._received.append((now(), invalid))
        if self._servo.source == source:
            self._followed.add(invalid)
        self._servo.refuse(source, 'for the test')

    def _checked(self, setpoint, sample, time, arrival):
        assert time - self.stopped >= RELEASE_S
        held = None
        for received, other in self._received:
            if other.source != setpoint.source or time - received >= RELEASE_S - 1e-9:
                continue
            if other is setpoint or other in self._followed:
                continue
            assert other.velocities is None or not other.velocities.any()
            assert other.window is None or not np.ptp(other.window.positions, axis=0).any()
            if other.positions is not None:
                held = other.positions if held is None else held
                np.testing.assert_array_equal(other.positions, held)
        self.started += 1
        self._start(setpoint, sample, time, arrival)


async def publisher(oracle, random):
    """Send bursts of setpoints on two topics, with pauses and restarts.

    They are positions, windows that hold or move, velocities, zeros, and invalid setpoints.
    """
    while True:
        topic = random.choice([JOG, SERVO])
        await asyncio.sleep(random.choice([0.0, 0.3, 0.9, 1.2, 3.0]))
        kind = random.integers(0, 8)
        value = random.uniform(-0.09, 0.09)
        for count in range(random.integers(1, 20)):
            if random.random() < 0.03:
                oracle.send_invalid(topic)
            elif topic == SERVO and kind < 2:
                oracle.send(positions(pose(value + (1e-3 * count if kind else 0.0))))
            elif topic == SERVO and kind < 4:
                speed = 0.05 * (kind - 2)
                start = value + 0.2 * speed * count
                oracle.send(moving_window(start, speed))
            elif kind < 6:
                oracle.send(velocities(HOME, source=topic))
            else:
                oracle.send(velocities(pose(value), source=topic))
            await asyncio.sleep(random.choice([0.05, 0.2, 0.5]))


async def stop_somehow(harness, controller, random):
    """Stop the arm or close and reopen its gate, and return the time of the stop."""
    how, stopped = random.integers(0, 4), now()
    if how == 0:
        await harness.commands.stop()
        return stopped
    if how == 1:
        harness.driver.disable('for the test')
    elif how == 2:
        harness.driver.motion_link.reconnect('for the test')
    else:
        powered = controller.status
        controller.status = (1, 1, *powered[2:])
        await until(lambda: harness.gate is not None)
        controller.status = powered
    await until(lambda: harness.gate is not None)
    stopped = now()
    await harness.ready()
    await until(lambda: not harness.driver.robot.status.e_stopped)
    await harness.commands.enable()
    return stopped


@pytest.mark.invariant(4)
@pytest.mark.parametrize(
    ('seed', 'sequences'),
    [
        pytest.param(1, 300, marks=pytest.mark.slow),
        *(pytest.param(seed, 1000, marks=pytest.mark.soak) for seed in range(2, 12)),
    ],
)
def test_inv4_random_publishers_do_not_move_a_stopped_arm(seed, sequences):
    """10,000 sequences in all. The controller only counts the points."""

    async def check():
        random = np.random.default_rng(seed)
        controller = ScriptedController(period=0.1)
        async with controller, Harness(controller.ports) as harness:
            await harness.ready()
            await harness.commands.enable()
            oracle = Oracle(harness)
            async with asyncio.TaskGroup() as group:
                senders = [
                    group.create_task(publisher(oracle, np.random.default_rng([seed, item])))
                    for item in range(int(random.integers(1, 11)))
                ]
                for _ in range(sequences):
                    await asyncio.sleep(random.choice([0.1, 0.5, 1.5, 3.0]))
                    oracle.stopped = await stop_somehow(harness, controller, random)
                    sent = len(controller.received)
                    await asyncio.sleep(oracle.stopped + 0.99 * RELEASE_S - now())
                    assert {*controller.received[sent:]} <= {-4}
                for sender in senders:
                    sender.cancel()
            assert oracle.started >= sequences / 50

    run(check(), patience=3600.0)
