# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""STOP is seen through to rest, or the alarm is raised (docs/invariants.md, 3, 4 and 9)."""

import asyncio
import contextlib
import logging
import struct

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from support.driver_harness import (
    JOINTS,
    LIMITS,
    Harness,
    ScriptedController,
    Submitted,
    answer,
    cell,
    frame,
    pose,
    scripted_cell,
)
from support.event_loop import run, stand_still, until

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.goal.goal import Goal, GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.motion import Trajectory
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import JointPosition, JointTrajPt, ReplyCode, decode, reply

pytestmark = pytest.mark.invariant(3, 4, 9)

STOP = -4


class MovableController(ScriptedController):
    """One whose joint 1 a test moves, at `speed` rad/s. Its STATUS knows nothing of motion."""

    STATUS = (1, 0, 0, 0, -1, 2, 1)

    def __init__(self, reply=None):
        super().__init__(reply)
        self.at = 0.0
        self.speed = 0.0

    async def _state(self, _reader, writer):
        while True:
            self.at += self.speed * 0.005
            joints = struct.pack('<i10f', 0, self.at, *[0.0] * 9)
            data = frame(10, 1, 0, joints) + frame(13, 1, 0, struct.pack('<7i', *self.status))
            writer.write(data)
            await writer.drain()
            await asyncio.sleep(0.005)


async def rejection(coroutine):
    with pytest.raises(CommandError) as caught:
        await coroutine
    return str(caught.value)


def arm(harness):
    """Return what /diagnostics says of the arm."""
    diagnostics = Diagnostics(harness.driver, 'node', lambda _: 1)
    message = diagnostics.build(None, asyncio.get_running_loop().time())
    return message.status[-1]


def refuses_stop(controller, stops, obeys_after=None):
    """Have a simulated controller refuse STOP and go on; after so many it obeys."""
    obey = controller.program.receive

    def receive(received):
        message = decode(received).message
        stop = isinstance(message, JointTrajPt) and message.sequence == STOP
        if stop:
            stops.append(message.sequence)
        if not stop or (obeys_after is not None and len(stops) > obeys_after):
            obey(received)
        else:
            controller.send_reply(reply(JointPosition(message.sequence), ReplyCode.FAILURE))

    controller.program.receive = receive


@contextlib.asynccontextmanager
async def disobedient(obeys_after=None, **options):
    """Run a driver with an arm that goes a long way, on a controller that refuses STOP."""
    async with cell(enabled=False, **options) as (harness, controller):
        controller.apply(Event.MOTORS_ON)
        await until(lambda: harness.driver.robot.status.drives_powered == 1)
        await harness.commands.enable()
        stops = []
        refuses_stop(controller, stops, obeys_after)
        goal = harness.submit(pose(1.5), step=15.0)
        await harness.until_moving()
        yield harness, controller, goal, stops


# --- a controller that refuses STOP -----------------------------------------------------------


def test_inv3_inv9_a_stop_that_is_refused_is_no_success_and_the_motors_go_off(caplog):
    """docs/invariants.md, 3 and 9."""

    async def scenario():
        async with disobedient() as (harness, controller, goal, stops):
            text = await rejection(harness.commands.stop())
            assert 'the controller refused STOP (FAILURE reply)' in text
            assert 'refused STOP' in goal.outcome.text
            assert 'refused STOP' in harness.gate
            diagnosis = arm(harness)
            assert diagnosis.level == DiagnosticStatus.ERROR
            assert 'the controller refused STOP' in diagnosis.message
            assert 'the controller refused STOP' in harness.driver.stopper.alarm
            await until(lambda: controller.status().drives_powered == 0)  # by the remote port
            await until(lambda: not controller.moving)
            assert harness.at[0] < 1.4
            assert len(stops) >= 2
            refused = harness.submit(pose(0.1), start=harness.at)
            assert 'not enabled' in refused.outcome.text

    with caplog.at_level(logging.ERROR):
        run(scenario())
    texts = [record.getMessage() for record in caplog.records]
    assert any('not stopped as asked: the controller refused STOP' in text for text in texts)
    assert any('the motors were switched off' in text for text in texts)


async def test_inv3_a_refused_stop_is_sent_again_while_the_arm_moves_and_no_longer():
    """docs/invariants.md, 3: without a remote port STOP is all there is."""
    async with disobedient(obeys_after=3, remote_port=0) as (harness, controller, _, stops):
        text = await rejection(harness.commands.stop())
        assert 'the arm stands' in text or 'the arm still moves' in text
        await until(lambda: not controller.moving)
        assert 0.0 < harness.at[0] < 1.4
        await until(lambda: harness.driver.stopper.over)
        count = len(stops)
        assert count == 4
        await asyncio.sleep(0.5)
        assert len(stops) == count
        assert 'refused STOP' in harness.gate
        assert arm(harness).level == DiagnosticStatus.ERROR  # until somebody enables the arm
        await harness.commands.enable()
        assert arm(harness).level == DiagnosticStatus.OK
        assert (await harness.submit(pose(0.1), start=harness.at).end()).end is End.SUCCEEDED


@pytest.mark.parametrize('remote', [True, False], ids=['remote port', 'no remote port'])
async def test_inv9_disable_of_an_arm_that_refuses_stop(remote):
    """docs/invariants.md, 9: success only if the arm was seen to stand."""
    options = {} if remote else {'remote_port': 0}
    async with disobedient(**options) as (harness, controller, _, _stops):
        if remote:
            try:
                text = await harness.commands.disable()
                assert not controller.moving
            except CommandError as error:
                text = str(error)
            await until(lambda: controller.status().drives_powered == 0)
        else:
            text = await rejection(harness.commands.disable())
            assert controller.moving
            assert 'the arm still moves' in text
        assert 'refused STOP' in text
        assert harness.gate == 'disabled on request'
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: harness.driver.stopper.over)


@pytest.mark.parametrize('how', ['fault', 'empty trajectory', 'shut down'])
async def test_inv3_whatever_sends_the_stop_its_rejection_is_noticed(how):
    """docs/invariants.md, 3."""
    async with disobedient(obeys_after=1, remote_port=0) as (
        harness,
        controller,
        _goal,
        stops,
    ):
        if how == 'fault':
            harness.driver.goal_queue.execution.fault('for the test')
        elif how == 'shut down':
            await harness.driver.shut_down()
        else:
            await rejection(harness.commands.stop())
        await until(lambda: harness.driver.stopper.alarm)
        await until(lambda: not controller.moving)
        assert harness.at[0] < 1.4
        assert len(stops) == 2
        assert harness.gate is not None


async def test_inv9_an_arm_that_moves_on_after_stop_was_taken_is_no_success():
    """docs/invariants.md, 9: it says yes and does nothing."""
    async with MovableController() as scripted, Harness(scripted.ports) as harness:
        await harness.ready()
        await harness.commands.enable()
        harness.submit(pose(0.5))
        scripted.speed = 0.2
        await until(lambda: harness.driver.robot.sample.velocities[0] > 0.1)
        text = await rejection(harness.commands.stop())
        assert 'the arm' in text
        assert 'moves' in text
        assert 'moves' in harness.gate
        await until(lambda: scripted.received.count(STOP) >= 3)
        scripted.speed = 0.0
        await until(lambda: harness.driver.stopper.over)


async def test_an_arm_that_somebody_jogs_is_left_alone():
    """Nothing of ours moves it: STOP is not repeated, and no goal is to blame."""
    async with MovableController() as scripted, Harness(scripted.ports) as harness:
        await harness.ready()
        scripted.speed = 0.2
        await until(lambda: harness.driver.robot.sample.velocities[0] > 0.1)
        assert 'the arm still moves' in await rejection(harness.commands.stop())
        await asyncio.sleep(0.7)
        assert scripted.received == [STOP]
        scripted.speed = 0.0
        await until(lambda: harness.driver.stopper.over)
        assert 'the controller acknowledged STOP' in await harness.commands.stop()


async def test_inv9_a_stop_that_no_joint_state_shows_is_no_success():
    """docs/invariants.md, 9."""
    async with ScriptedController() as scripted:
        scripted.shows_joints = False
        async with Harness(scripted.ports) as harness:
            await until(lambda: harness.driver.motion_link.connected)
            text = await rejection(harness.commands.stop())
            assert 'no joint state shows whether the arm stands' in text


async def test_a_stop_of_an_arm_that_stands_is_quick():
    async with cell() as (harness, _):
        times = []
        for _ in range(5):
            before = asyncio.get_running_loop().time()
            await harness.commands.stop()
            times.append(asyncio.get_running_loop().time() - before)
        assert min(times) < 0.3, times  # REST_TIME and a STATUS: 0.05 and 0.055 s


# --- a goal after one whose points or STOP nobody answered ------------------------------------


def submitted_goal(harness, to, goal_time=0.0):
    """Hand in a goal of two points from where the arm is, at 0."""
    trajectory = Trajectory(
        LIMITS.names, np.array([0.0, 0.05]), np.vstack([np.zeros(JOINTS), pose(to)])
    )
    goal = Goal(trajectory, np.full(JOINTS, 0.01), goal_time=goal_time)
    submitted = Submitted(goal)
    harness.driver.goal_queue.submit(submitted.handle)
    return submitted


@pytest.mark.invariant(5)
async def test_inv5_after_a_goal_time_violation_the_next_goal_waits_until_stop_is_answered():
    """docs/invariants.md, 3 and 5: the controller may still be busy with the first."""
    async with (
        MovableController(lambda _: b'') as scripted,
        Harness(scripted.ports) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        first = submitted_goal(harness, 0.3, goal_time=0.1)
        assert (await first.end()).code is ErrorCode.GOAL_TOLERANCE_VIOLATED
        second = submitted_goal(harness, -0.3)
        await until(lambda: STOP in scripted.received)
        await asyncio.sleep(0.2)
        assert scripted.received == [0, STOP]
        assert not second.outcomes
        scripted.motion.write(answer(2) + answer(1))  # the point is refused now, STOP is taken
        await until(lambda: scripted.received == [0, STOP, 0])
        assert harness.gate is None


async def test_inv4_a_stop_that_is_never_answered_disables_the_arm_and_ends_the_goal_that_waits():
    """docs/invariants.md, 4: then the controller starts the motion that it had been given."""
    async with (
        MovableController(lambda _: b'') as scripted,
        Harness(scripted.ports) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        first = submitted_goal(harness, 0.3, goal_time=0.1)
        await first.end()
        second = submitted_goal(harness, -0.3)
        await second.end()
        assert 'no reply to STOP' in second.outcome.text
        assert 'no reply to STOP' in harness.gate
        assert scripted.received.count(0) == 1
        statistics = harness.driver.motion_link.statistics
        await until(lambda: statistics.connections == 2)  # no late reply answers anything


async def test_inv9_a_stop_that_is_answered_late_but_in_time_is_a_success(monkeypatch):
    """docs/invariants.md, 9: an arm that stands meanwhile says nothing about the answer."""
    for module in ('arm_commands', 'stopping.stopper'):
        monkeypatch.setattr(f'epson_driver.driver.{module}.ANSWER_TIMEOUT_S', 10.0)

    async with (
        ScriptedController(lambda number: b'' if number == STOP else answer(1, number)) as it,
        Harness(it.ports) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        stopping = asyncio.create_task(harness.commands.stop())
        await until(lambda: STOP in it.received)
        await asyncio.sleep(3.0)  # the arm stands all the time
        assert harness.gate is None
        it.motion.write(answer(1))
        await stopping
        assert harness.gate is None
        assert harness.driver.stopper.alarm is None


async def test_inv4_enable_has_the_controller_drop_what_it_may_still_have():
    """docs/invariants.md, 4: what it has in its queue, too."""
    silent = [True]
    async with (
        MovableController(lambda _: b'' if silent[0] else answer(1)) as scripted,
        Harness(scripted.ports) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        assert scripted.received == []
        await submitted_goal(harness, 0.3, goal_time=0.1).end()
        await until(lambda: harness.gate is not None)
        await until(lambda: harness.driver.motion_link.statistics.connections == 2)
        await until(lambda: harness.driver.motion_link.connected)
        stops = scripted.received.count(STOP)
        assert 'no reply to STOP' in await rejection(harness.commands.enable())
        assert harness.gate is not None
        silent[0] = False
        await until(lambda: harness.driver.stopper.over and harness.driver.motion_link.connected)
        await harness.commands.enable()
        assert scripted.received.count(STOP) >= stops + 2


# --- STOP's reply in the place of a point's ---------------------------------------------------


async def test_inv9_a_reply_that_may_be_a_points_confirms_no_standstill_but_the_state_does():
    """docs/invariants.md, 9: of two requests one is answered, without a number."""
    settings = GoalSettings(reply_timeout=30.0)
    async with (
        MovableController(lambda sequence: answer(1) if sequence == STOP else b'') as scripted,
        Harness(scripted.ports, settings=settings) as harness,
    ):
        await harness.ready()
        await harness.commands.enable()
        goal = submitted_goal(harness, 0.3)
        await until(lambda: scripted.received == [0])
        scripted.speed = 0.2
        await until(lambda: harness.driver.robot.sample.velocities[0] > 0.1)
        harness.driver.goal_queue.cancel(goal.handle)
        await until(lambda: scripted.received[:2] == [0, STOP])
        await asyncio.sleep(0.3)
        assert not goal.outcomes  # the arm moves
        scripted.speed = 0.0
        await goal.end()
        assert goal.outcome.end is End.CANCELED
        assert 'a reply is missing' in goal.outcome.text
        assert harness.gate is not None


@pytest.mark.invariant(9)
async def test_a_process_that_was_not_scheduled_does_not_take_stop_for_unanswered():
    """docs/invariants.md, 9: the reply waits in the socket."""

    def reply(number):
        stand_still(30.0)
        return answer(1, number)

    async with scripted_cell(reply) as (harness, scripted):
        harness.driver.stopper.stop()
        await until(lambda: harness.driver.stopper.over)
        assert scripted.received == [STOP]
        assert harness.driver.stopper.alarm is None
        assert harness.gate is None


@pytest.mark.invariant(9)
async def test_inv9_a_process_that_stood_still_has_not_waited_for_the_status_that_says_why():
    """docs/invariants.md, 9: the motors are off, which is why STOP was refused: to be read yet."""

    def reply_and_stand_still(number):
        if number == STOP:
            drives_powered, *others = scripted.STATUS
            assert drives_powered
            scripted.status = (0, *others)
            asyncio.get_running_loop().call_later(0.002, stand_still, 30.0)
        return answer(2, number)

    scripted = ScriptedController(reply_and_stand_still)

    async with scripted, Harness(scripted.ports) as harness:
        await harness.ready()
        await harness.commands.enable()
        harness.driver.stopper.stop()
        await until(lambda: harness.driver.stopper.over)
        assert harness.driver.stopper.alarm is None
        assert harness.gate == 'the motors are off'
