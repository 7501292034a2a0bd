# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""STOP is monitored until the arm rests, or an alarm is raised (docs/invariants.md, 3, 4, 9)."""

import asyncio
import contextlib
import struct

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from support.driver_harness import (
    Harness,
    ScriptedController,
    answer,
    cell,
    frame,
    pose,
    scripted_cell,
)
from support.event_loop import stand_still, until

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.stopping.motors import Action, MotorsError
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import JointPosition, JointTrajPt, ReplyCode, decode, reply

pytestmark = pytest.mark.invariant(3, 4, 9)

STOP = -4


class MovableController(ScriptedController):
    """A controller whose joint 1 moves at `speed`, rad/s. Its STATUS does not report motion."""

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
    """Return the diagnostics status of the arm."""
    diagnostics = Diagnostics(harness.driver, 'node', lambda _: 1)
    message = diagnostics.build(None, asyncio.get_running_loop().time())
    return message.status[-1]


def refuses_stop(controller, stops, obeys_after=None):
    """Make a simulated controller refuse STOP, the first `obeys_after` times or always."""
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
    """Run a driver with a long goal on a controller that refuses STOP."""
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


async def test_inv3_inv9_refused_stop_is_a_failure_and_the_motors_go_off(caplog):
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
    assert 'did not stop as requested: the controller refused STOP' in caplog.text
    assert 'motors switched off' in caplog.text


async def test_inv3_failed_switch_off_is_repeated_although_it_stopped_the_arm(monkeypatch):
    """On an EPSON controller the attempt first stops the program, and with it the arm."""
    async with disobedient() as (harness, controller, _, _):
        act, attempts = harness.driver.motors.act, []

        async def fail_at_first(action, timeout):
            attempts.append(action)
            if len(attempts) > 3:
                return await act(action, timeout)
            controller.apply(Event.STOP)
            await until(lambda: not controller.moving)
            raise MotorsError('not Ready', unanswered=True)

        monkeypatch.setattr(harness.driver.motors, 'act', fail_at_first)
        await rejection(harness.commands.stop())
        await until(lambda: controller.status().drives_powered == 0)
        assert attempts == [Action.MOTORS_OFF] * 4
        await asyncio.sleep(5.0)
        assert len(attempts) == 4


async def test_inv4_enable_ends_the_attempts_to_switch_the_motors_off(monkeypatch):
    async with disobedient() as (harness, controller, _, _):
        attempts = []

        async def fail(action, _timeout):
            attempts.append(action)
            controller.apply(Event.STOP)
            raise MotorsError('not Ready')

        monkeypatch.setattr(harness.driver.motors, 'act', fail)
        await rejection(harness.commands.stop())
        await until(lambda: len(attempts) > 2 and harness.driver.stopper.over)
        del controller.program.receive
        controller.apply(Event.START)
        await harness.commands.enable()
        count = len(attempts)
        await asyncio.sleep(5.0)
        assert len(attempts) == count
        assert harness.gate is None


async def test_inv3_refused_stop_is_repeated_until_the_arm_rests():
    """Without a remote port, STOP is the only means."""
    async with disobedient(obeys_after=3, remote_port=0) as (harness, controller, _, stops):
        text = await rejection(harness.commands.stop())
        assert 'the arm is at rest' in text or 'the arm is still moving' in text
        await until(lambda: not controller.moving)
        assert 0.0 < harness.at[0] < 1.4
        await until(lambda: harness.driver.stopper.over)
        count = len(stops)
        assert count == 4
        await asyncio.sleep(0.5)
        assert len(stops) == count
        assert 'refused STOP' in harness.gate
        assert arm(harness).level == DiagnosticStatus.ERROR
        await harness.commands.enable()
        assert arm(harness).level == DiagnosticStatus.OK
        assert (await harness.submit(pose(0.1), start=harness.at).end()).end is End.SUCCEEDED


@pytest.mark.parametrize('remote', [True, False], ids=['remote port', 'no remote port'])
async def test_inv9_disable_with_refused_stop_succeeds_only_at_rest(remote):
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
            assert 'the arm is still moving' in text
        assert 'refused STOP' in text
        assert harness.gate == 'disabled on request'
        controller.apply(Event.ESTOP_PRESS)
        await until(lambda: harness.driver.stopper.over)


@pytest.mark.parametrize('how', ['fault', 'empty trajectory', 'shut down'])
async def test_inv3_refused_stop_raises_an_alarm_whatever_sent_it(how):
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


async def test_inv9_acknowledged_stop_without_rest_is_a_failure():
    async with scripted_cell(controller=MovableController) as (harness, scripted):
        harness.submit(pose(0.5))
        scripted.speed = 0.2
        await until(lambda: harness.driver.robot.sample.velocities[0] > 0.1)
        text = await rejection(harness.commands.stop())
        assert 'the arm' in text
        assert 'moving' in text
        assert 'moving' in harness.gate
        await until(lambda: scripted.received.count(STOP) >= 3)
        scripted.speed = 0.0
        await until(lambda: harness.driver.stopper.over)


async def test_stop_of_a_jog_by_another_client_is_not_repeated():
    """The driver did not start the motion, and no goal is to blame."""
    async with scripted_cell(controller=MovableController, enabled=False) as (harness, scripted):
        scripted.speed = 0.2
        await until(lambda: harness.driver.robot.sample.velocities[0] > 0.1)
        assert 'the arm is still moving' in await rejection(harness.commands.stop())
        await asyncio.sleep(0.7)
        assert scripted.received == [STOP]
        scripted.speed = 0.0
        await until(lambda: harness.driver.stopper.over)
        assert 'the controller acknowledged STOP' in await harness.commands.stop()


async def test_inv9_stop_without_a_joint_state_is_a_failure():
    async with ScriptedController() as scripted:
        scripted.shows_joints = False
        async with Harness(scripted.ports) as harness:
            await until(lambda: harness.driver.motion_link.connected)
            text = await rejection(harness.commands.stop())
            assert 'no joint state shows whether the arm is at rest' in text


async def test_stop_of_an_arm_at_rest_is_quick():
    async with cell() as (harness, _):
        times = []
        for _ in range(5):
            before = asyncio.get_running_loop().time()
            await harness.commands.stop()
            times.append(asyncio.get_running_loop().time() - before)
        assert min(times) < 0.3, times  # REST_TIME and a STATUS: 0.05 and 0.055 s


# --- goals after unanswered points or an unanswered STOP ------------------------------------


@pytest.mark.invariant(5)
async def test_inv5_goal_after_a_goal_time_violation_waits_for_the_stop_reply():
    """The controller may still execute the first goal."""
    async with scripted_cell(lambda _: b'', controller=MovableController) as (harness, scripted):
        first = harness.submit(pose(0.3), step=0.05, goal_time=0.1)
        assert (await first.end()).code is ErrorCode.GOAL_TOLERANCE_VIOLATED
        second = harness.submit(pose(-0.3), step=0.05)
        await until(lambda: STOP in scripted.received)
        await asyncio.sleep(0.2)
        assert scripted.received == [0, STOP]
        assert not second.outcomes
        scripted.motion.write(answer(2) + answer(1))  # the point is refused, STOP succeeds
        await until(lambda: scripted.received == [0, STOP, 0])
        assert harness.gate is None


async def test_inv4_unanswered_stop_disables_and_ends_the_waiting_goal():
    """The controller may execute the first goal later."""
    async with scripted_cell(lambda _: b'', controller=MovableController) as (harness, scripted):
        first = harness.submit(pose(0.3), step=0.05, goal_time=0.1)
        await first.end()
        second = harness.submit(pose(-0.3), step=0.05)
        await second.end()
        assert 'no reply to STOP' in second.outcome.text
        assert 'no reply to STOP' in harness.gate
        assert scripted.received.count(0) == 1
        statistics = harness.driver.motion_link.statistics
        await until(lambda: statistics.connections == 2)  # late replies are discarded


async def test_inv9_late_reply_to_stop_is_a_success(monkeypatch):
    """An arm at rest does not replace the reply."""
    for module in ('arm_commands', 'stopping.stopper'):
        monkeypatch.setattr(f'epson_driver.driver.{module}.ANSWER_TIMEOUT_S', 10.0)

    def reply(sequence):
        return b'' if sequence == STOP else answer(1, sequence)

    async with scripted_cell(reply) as (harness, scripted):
        stopping = asyncio.create_task(harness.commands.stop())
        await until(lambda: STOP in scripted.received)
        await asyncio.sleep(3.0)  # the arm is at rest
        assert harness.gate is None
        scripted.motion.write(answer(1))
        await stopping
        assert harness.gate is None
        assert harness.driver.stopper.alarm is None


async def test_inv4_enable_sends_stop_to_clear_the_controllers_queue():
    silent = True
    async with scripted_cell(
        lambda _: b'' if silent else answer(1), controller=MovableController
    ) as (harness, scripted):
        assert scripted.received == []
        await harness.submit(pose(0.3), step=0.05, goal_time=0.1).end()
        await until(lambda: harness.gate is not None)
        await until(lambda: harness.driver.motion_link.statistics.connections == 2)
        await until(lambda: harness.driver.motion_link.connected)
        stops = scripted.received.count(STOP)
        assert 'no reply to STOP' in await rejection(harness.commands.enable())
        assert harness.gate is not None
        silent = False
        await until(lambda: harness.driver.stopper.over and harness.driver.motion_link.connected)
        await harness.commands.enable()
        assert scripted.received.count(STOP) >= stops + 2


# --- a reply that may belong to a point ---------------------------------------------------


async def test_inv9_ambiguous_stop_reply_needs_rest_in_the_joint_state():
    """One of two requests is answered, without a number."""
    settings = GoalSettings(reply_timeout=30.0)
    async with scripted_cell(
        lambda sequence: answer(1) if sequence == STOP else b'',
        controller=MovableController,
        settings=settings,
    ) as (harness, scripted):
        goal = harness.submit(pose(0.3), step=0.05)
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
async def test_inv9_stalled_process_does_not_report_stop_as_unanswered():
    """The reply is in the socket."""

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
async def test_inv9_stalled_process_reads_the_status_before_it_checks_stop():
    """The STATUS shows that STOP was refused because the motors are off."""

    def reply_and_stand_still(number):
        if number == STOP:
            drives_powered, *others = scripted.STATUS
            assert drives_powered
            scripted.status = (0, *others)
            asyncio.get_running_loop().call_later(0.002, stand_still, 30.0)
        return answer(2, number)

    async with scripted_cell(reply_and_stand_still) as (harness, scripted):
        harness.driver.stopper.stop()
        await until(lambda: harness.driver.stopper.over)
        assert harness.driver.stopper.alarm is None
        assert harness.gate == 'the motors are off'
