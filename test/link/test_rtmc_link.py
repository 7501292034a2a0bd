# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver and a simulated RC800 with Real-time Motion Control, in virtual time without DDS."""

import asyncio
import contextlib
import time
from functools import partial

import numpy as np
import pytest
from support.driver_harness import pose
from support.event_loop import now, until
from support.examples import one_in
from support.rtmc_cell import CYCLE, MODEL, goal, rtmc_cell, usage

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.inhibit import Purpose
from epson_driver.driver.outcome import End
from epson_driver.error_texts import ErrorTexts, load_error_texts
from epson_driver.robots import load_robot_model
from epson_driver.rtmc import transport
from epson_driver.rtmc.messages import MOVED_DATA, Request, RtmcMessage, decode, decode_text
from epson_driver.rtmc.transport import Arrival
from epson_driver.sim_controller.condition.states import Event, Motors, Power
from epson_driver.simple_message import TriState

LIMITS = MODEL.limits
ROUNDING = 1.0 + 1e-4  # of positions in messages, in units of a limit
FAR = pose(0.9, 0.3)


def within_limits(cell, limits=LIMITS):
    return max(usage(cell.targets, limits)) <= ROUNDING


def braked(cell):
    """Return whether the last targets repeat a position, and all respect the limits."""
    return np.array_equal(*cell.targets[-2:]) and within_limits(cell)


def moves_sent(cell):
    return cell.numbers.count(Request.MOVE)


async def silent(cell, seconds=1.0):
    """Return whether no target is sent for a time."""
    await until(lambda: not cell.port.enabled)
    before = moves_sent(cell)
    await asyncio.sleep(seconds)
    return moves_sent(cell) == before and not cell.port.enabled


@pytest.mark.invariant(2)
async def test_inv2_goal_is_executed_on_time_within_the_limits(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        submitted = goal(harness, pose(0.3, 0.1), pose(0.6, -0.1))
        outcome = await submitted.end()
        assert outcome.end is End.SUCCEEDED, outcome
        assert harness.at == pytest.approx(pose(0.6, -0.1), abs=1e-4)
        assert within_limits(cell)
        timing = harness.driver.goal_queue.last_timing
        assert timing.executed < timing.planned + 0.4
        assert await silent(cell)


async def test_enabling_switches_motors_and_power_on_but_not_the_motion_mode(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        condition = cell.controller.condition
        assert (condition.motors, condition.power) == (Motors.ON, Power.HIGH)
        assert Request.SET_MODE not in cell.numbers
        order = [cell.numbers.index(n) for n in (Request.CONNECT, Request.CHECK_MODEL)]
        assert order == sorted(order)
        assert await silent(cell)
        await harness.commands.disable()
        assert cell.controller.condition.motors is not Motors.ON


async def test_second_goal_continues_from_rest(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        for target in (pose(0.3), pose(-0.2), pose(0.1, 0.1)):
            assert (await goal(harness, target).end()).end is End.SUCCEEDED
            assert harness.at == pytest.approx(target, abs=1e-4)
        assert within_limits(cell)


async def test_joints_arrive_in_each_cycle_of_a_motion(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, _):
        submitted = goal(harness, FAR)
        await harness.until_moving()
        before, at = len(harness.events.samples), now()
        await asyncio.sleep(0.2)
        assert len(harness.events.samples) - before == pytest.approx((now() - at) / 0.002, abs=3)
        await submitted.end()


@pytest.mark.invariant(3)
@pytest.mark.parametrize('delay', one_in(2, [0.0, 0.013, 0.05, 0.2, 0.35, 0.6]))
async def test_inv3_stop_brakes_within_the_limits(monkeypatch, delay):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        submitted = goal(harness, FAR)
        await asyncio.sleep(delay)
        await harness.commands.stop()
        outcome = await submitted.end()
        assert outcome.end is End.ABORTED
        stopped = harness.at
        assert not cell.targets or within_limits(cell)
        assert await silent(cell)
        assert harness.at == pytest.approx(stopped, abs=1e-5)
        assert (await goal(harness, pose(0.1)).end()).end is End.SUCCEEDED
        assert within_limits(cell) or delay == 0.0


@pytest.mark.invariant(3)
async def test_inv3_stop_leaves_the_path_within_the_buffer(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        goal(harness, FAR)
        await asyncio.sleep(0.35)
        sent = moves_sent(cell)
        stopping = asyncio.create_task(harness.commands.stop())
        await until(lambda: moves_sent(cell) > sent + 2)
        velocities = np.diff(np.array(cell.targets)[:, 0])
        await stopping
        braking = np.diff(np.array(cell.targets)[sent:, 0])
        assert velocities[-1] > 0.0
        assert braking[-1] == 0.0
        assert braking.argmax() <= 4  # braking begins with the next targets


async def test_cancel_and_pause(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        submitted = goal(harness, FAR)
        await harness.until_moving()
        harness.driver.goal_queue.set_speed(0.0)
        await asyncio.sleep(1.0)
        paused = harness.at
        assert await silent(cell)
        harness.driver.goal_queue.set_speed(1.0)
        await until(lambda: abs(harness.at - paused).max() > 0.05)
        harness.driver.goal_queue.cancel(submitted.handle)
        assert (await submitted.end()).end is End.CANCELED
        assert within_limits(cell)


@pytest.mark.invariant(4)
@pytest.mark.parametrize('event', [Event.ESTOP_PRESS, Event.DOOR_OPEN, Event.MOTORS_OFF])
async def test_inv4_event_ends_the_goal_and_nothing_moves_afterwards(monkeypatch, event):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        submitted = goal(harness, FAR)
        await harness.until_moving()
        cell.controller.apply(event)
        outcome = await submitted.end()
        assert outcome.end is End.ABORTED
        assert harness.gate is not None
        if event is Event.DOOR_OPEN:
            inhibit = harness.driver.why_not(Purpose.REPORT, now())
            assert 'safeguard' in inhibit.text
            cell.controller.apply(Event.DOOR_CLOSE)
        if event is Event.ESTOP_PRESS:
            with pytest.raises(CommandError, match='E-stop'):
                await harness.commands.enable()
            cell.controller.apply(Event.ESTOP_RELEASE)
            await asyncio.sleep(0.5)
            await harness.commands.reset_error()
        stopped = harness.at
        await asyncio.sleep(0.5)
        await harness.commands.enable()
        assert await silent(cell)
        assert harness.at == pytest.approx(stopped, abs=0.05)
        assert (await goal(harness, pose(0.1)).end()).end is End.SUCCEEDED


async def test_controllers_own_text_of_an_unknown_error_is_requested_once(monkeypatch):
    texts = ErrorTexts(load_error_texts())
    async with rtmc_cell(monkeypatch, errors=texts) as (harness, cell):
        cell.controller.raise_error(4321, text='Robot 1: a tool is\nmissing')
        await asyncio.sleep(0.5)
        text = harness.driver.why_not(Purpose.REPORT, now()).text
        assert 'in error 4321 (Robot 1: a tool is\\nmissing)' in text
        assert cell.numbers.count(Request.MESSAGES) == 1
        cell.controller.apply(Event.RESET)
        cell.controller.raise_error(5042, text='another')
        await asyncio.sleep(0.5)
        assert texts[5042] == load_error_texts()[5042]
        assert 4321 not in load_error_texts()


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    ('data', 'text'),
    [
        (b'', ''),
        (bytes(4), ''),
        (b'\3\0abc\5\0hot\xff\0', 'hot\ufffd'),
        (b'\xff\xff' + bytes(9), ''),
        (b'\0\0\xff\xff' + b'x' * 999, 'x' * 200),
    ],
)
def test_inv7_any_reply_has_an_error_text_or_none(data, text):
    assert decode_text(data) == text


@pytest.mark.invariant(2)
async def test_inv2_cycle_of_the_controller_is_measured(monkeypatch):
    async with rtmc_cell(monkeypatch, speed=2.0) as (harness, cell):
        for target in (FAR, pose(0.1)):
            assert (await goal(harness, target, step=0.8).end()).end is End.SUCCEEDED
            timing = harness.driver.goal_queue.last_timing
            assert timing.executed < timing.planned + 0.5
        assert max(usage(cell.targets, LIMITS, CYCLE / 2.0)) <= ROUNDING


@pytest.mark.invariant(2)
async def test_inv2_thread_that_is_slow_during_the_measurement_sends_nothing_faster(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        delays = [0.0] * 15 + [0.0055] * 60

        def late(data):
            moved = delays and decode(data).number == Request.MOVE
            cell._loop.call_later(delays.pop(0) if moved else 0.0, cell.arrive, data)

        cell.reply = late
        outcome = await goal(harness, FAR).end()
        assert outcome.end is End.SUCCEEDED, outcome
        assert not delays
        assert within_limits(cell)


@pytest.mark.invariant(2)
async def test_inv2_controller_with_a_shorter_cycle_than_measured_is_stopped(monkeypatch, caplog):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        assert (await goal(harness, pose(0.1)).end()).end is End.SUCCEEDED
        assert await silent(cell)
        cell.speed = 2.0
        assert (await goal(harness, FAR, step=3.0).end()).end is End.ABORTED
        assert 'takes a target each 1 ms' in caplog.text
        assert abs(harness.at[0]) < 0.2
        assert await silent(cell)
        assert braked(cell)
        await harness.commands.recover()
        assert (await goal(harness, FAR).end()).end is End.SUCCEEDED


@pytest.mark.invariant(4)
async def test_inv4_arm_that_was_moved_meanwhile_does_not_start(monkeypatch, caplog):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        joints = cell.port._joints

        def moved(change, request):
            change(cell.port, request)
            cell.port._joints = lambda: [joints()[0] + 0.05, *joints()[1:]]

        changes = cell.port._CHANGES
        power = partial(moved, changes[Request.SET_POWER])
        monkeypatch.setitem(changes, Request.SET_POWER, lambda _port, request: power(request))
        assert (await goal(harness, FAR).end()).end is End.ABORTED
        assert 'the arm has moved' in caplog.text
        assert not cell.targets
        assert await silent(cell)


async def test_silent_controller_ends_link_and_goal(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        submitted = goal(harness, FAR)
        await harness.until_moving()
        cell.delivers = False
        outcome = await submitted.end()
        assert outcome.end is End.ABORTED
        assert 'no STATUS' in outcome.text or 'link was lost' in outcome.text
        await until(lambda: not harness.driver.motion_link.connected)
        cell.delivers = True
        await harness.ready()
        assert harness.gate is not None
        await harness.commands.recover()  # the buffer ran empty
        assert await silent(cell)
        assert (await goal(harness, pose(0.1)).end()).end is End.SUCCEEDED


@pytest.mark.invariant(9)
async def test_inv9_controller_that_answers_no_target_is_connected_again(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        submitted = goal(harness, FAR)
        await harness.until_moving()
        send = cell.reply
        cell.reply = lambda data: decode(data).number == Request.MOVE or send(data)
        assert (await submitted.end()).end is End.ABORTED
        await until(lambda: any('no reply for 5 s' in why for _, why in harness.events.links))
        cell.reply = send
        await harness.ready()
        await harness.commands.recover()
        assert (await goal(harness, pose(0.1)).end()).end is End.SUCCEEDED


def wrong_reply(_harness, cell):
    cell.arrive(RtmcMessage(Request.MODE, 0, 1).encode())


def reply_of_another_controller(_harness, cell):
    message = RtmcMessage(Request.MOVE, 0, 1, MOVED_DATA.pack(1, *[0.0] * 6, 0))
    cell._transport.arrive(Arrival(5, message.encode(), now()))


def missing_reply(harness, _cell):
    harness.driver.motion_link.reconnect('a reply is missing')


def failing(*_arguments):
    raise RuntimeError('a defect')


def failing_callback(harness, _cell):
    events, works = harness.events, harness.events.on_joints

    def fails_once(sample):
        events.on_joints = works
        failing(sample)

    events.on_joints = fails_once


def failing_stop(harness, _cell):
    feeder = harness.driver.motion_link._motion._feeder

    def fails():
        feeder.stopped = True
        failing()

    feeder.stop = fails
    harness.driver.motion_link.reconnect('a reply is missing')


def failing_motion(harness, _cell):
    harness.driver.motion_link._motion._feeder.fill = failing


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('fail', 'ends'),
    [
        (wrong_reply, contextlib.nullcontext()),
        (reply_of_another_controller, contextlib.nullcontext()),
        (missing_reply, contextlib.nullcontext()),
        (failing_stop, contextlib.nullcontext()),
        (failing_callback, pytest.raises(RuntimeError, match='a defect')),
        (failing_motion, pytest.raises(RuntimeError, match='a defect')),
    ],
)
async def test_inv9_end_of_the_link_brakes_within_the_limits(monkeypatch, fail, ends):
    with ends:
        async with rtmc_cell(monkeypatch) as (harness, cell):
            submitted = goal(harness, FAR)
            await asyncio.sleep(0.45)
            velocity = np.abs(np.subtract(*cell.targets[-2:])).max() / CYCLE
            fail(harness, cell)
            outcome = await submitted.end()
            rests = await silent(cell)
    assert velocity > 0.1 * LIMITS.velocity[0]
    assert outcome.end is End.ABORTED
    assert rests
    assert braked(cell)
    assert cell.port.motion.ran_empty == 0


@pytest.mark.invariant(10)
async def test_inv10_second_controller_ends_the_link_but_not_by_leaving(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        cell._transport.arrive(Arrival(5, None, now()))
        await asyncio.sleep(0.5)
        assert harness.driver.motion_link.connected
        reply_of_another_controller(harness, cell)
        await until(lambda: any('two controllers' in why for _, why in harness.events.links))


@pytest.mark.invariant(3)
async def test_inv3_driver_that_ends_waits_for_a_slow_stop(monkeypatch):
    slow = LIMITS.scaled(1.0, 0.02)
    async with rtmc_cell(monkeypatch, limits=slow) as (harness, cell):
        goal(harness, pose(3.0), step=4.0)
        await until(lambda: len(cell.targets) > 1000)
        await harness.stop()
        assert np.array_equal(*cell.targets[-2:])
        assert within_limits(cell, slow)
        assert cell.port.motion.ran_empty == 0


async def test_arm_at_a_goal_stays_reported_at_rest(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, _):
        assert (await goal(harness, pose(0.3)).end()).end is End.SUCCEEDED
        before = len(harness.events.statuses)
        await asyncio.sleep(0.5)
        after = harness.events.statuses[before:]
        assert len(after) > 5
        assert all(status.in_motion == TriState.FALSE for _, status in after)


async def test_goal_at_the_end_of_the_motion_before_it_is_executed(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, _):
        motion, submitted = harness.driver.motion_link._motion, []
        done = motion._done

        def goal_first(task):
            if not submitted:
                submitted.append(goal(harness, pose(0.1)))
            done(task)

        monkeypatch.setattr(motion, '_done', goal_first)
        assert (await goal(harness, pose(0.3)).end()).end is End.SUCCEEDED
        await until(lambda: submitted)
        assert (await submitted[0].end()).end is End.SUCCEEDED


async def test_transport_is_closed_if_the_link_ends_while_opening_it(monkeypatch):
    opened = []

    class SlowTransport:
        def __init__(self, *_address, **_peer):
            opened.append(self)
            self.closed = False
            time.sleep(0.05)

        def close(self):
            self.closed = True

    monkeypatch.setattr(transport, 'Transport', SlowTransport)
    opening = asyncio.create_task(transport.connect('127.0.0.1', 7000))
    await until(lambda: opened)
    opening.cancel()
    await asyncio.wait([opening])
    assert opening.cancelled()
    assert opened[0].closed


async def test_other_model_is_refused(monkeypatch):
    other = load_robot_model('c4_a601s')
    async with rtmc_cell(monkeypatch, enabled=False, configured=other) as (harness, _):
        text = 'C8-C901S, not a C4-A601S'
        await until(lambda: any(text in why for _, why in harness.events.links))


async def test_driver_that_ends_brakes_first(monkeypatch):
    async with rtmc_cell(monkeypatch) as (harness, cell):
        goal(harness, FAR)
        await harness.until_moving()
        await harness.stop()
        assert within_limits(cell)
        assert cell.numbers[-2:] == [Request.SET_MODE, Request.CONNECT]
        assert cell.port.motion.ran_empty == 0
