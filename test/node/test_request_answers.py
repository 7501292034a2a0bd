# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""After any failure, each goal ends once and each setpoint is accepted or rejected."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from control_msgs.action import GripperCommand
from control_msgs.msg import JointJog
from rclpy.action import CancelResponse
from support.request_harness import Made, RosHandle, done
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.goal.goal_queue import GoalHandle
from epson_driver.driver.io.gripper_wiring import GripperWiring
from epson_driver.driver.outcome import End, ErrorCode, GoalRejectedError, Outcome
from epson_driver.node import goal_server, loop_bridge
from epson_driver.node.goal_server import GoalServer
from epson_driver.node.io_interface import GripperServer
from epson_driver.node.loop_bridge import DriverEndedError, GoalAction, NodeContext
from epson_driver.node.servo_interface import ServoInterface
from epson_driver.setup.setup import make_setup

SETUP = make_setup({})
LIMITS = SETUP.model.limits


@pytest.fixture
def made():
    made = Made()
    yield made
    made.loop.close()


def context(made, **driver):
    """Return an interface's context with a driver of these attributes."""
    return NodeContext(SimpleNamespace(**driver), SETUP, made.bridge)


# --- goals ------------------------------------------------------------------------------------


class Queue:
    """The driver's queue of goals, which ends canceled goals immediately."""

    def __init__(self):
        self.submitted = []

    def submit(self, handle):
        self.submitted.append(handle)

    def cancel(self, handle):
        handle.on_end(Outcome(End.CANCELED, ErrorCode.SUCCESSFUL, 'canceled, the arm is at rest'))


@pytest.fixture
def action(made, monkeypatch):
    """Return a function that makes an action and its queue from `prepare`."""
    monkeypatch.setattr(loop_bridge, 'ActionServer', lambda *_, **__: None)

    def make(prepare):
        queue = Queue()
        action = GoalAction(made.bridge, queue, None, '~/x', prepare, lambda outcome: outcome)
        return action, queue

    return make


def raises(error):
    async def prepare(_handle, _plan, _on_end):
        raise error

    return prepare


async def ready(_handle, _plan, on_end):
    return GoalHandle(None, on_end, lambda *_: None)


REJECTED = GoalRejectedError(ErrorCode.INVALID_JOINTS, 'no joint_7')


@pytest.mark.invariant(5, 9)
@pytest.mark.parametrize(
    ('prepare', 'cancels', 'how', 'expected'),
    [
        (raises(REJECTED), None, 'aborted', 'no joint_7'),
        (raises(REJECTED), 1, 'canceled', 'canceled before it could start'),
        (raises(DriverEndedError()), None, 'aborted', 'the driver has ended'),
        (raises(ZeroDivisionError('x')), None, 'aborted', '~/x failed: ZeroDivisionError: x'),
        (ready, 0, 'canceled', 'canceled before it could start'),
        (ready, 1, 'canceled', 'canceled before it could start'),
    ],
    ids=['rejected', 'rejected, canceled', 'ended', 'failed', 'before', 'during'],
)
def test_goal_that_does_not_reach_the_driver_ends_once_with_reason(
    made, action, prepare, cancels, how, expected
):
    goals, queue = action(prepare)
    handle = RosHandle(cancels)
    outcome = done(goals._execute(handle))
    assert outcome.text.startswith(expected)
    assert handle.ended == [how]
    assert not goals.busy
    made.turn()
    assert queue.submitted == []
    assert bool(made.faults) == ('failed' in expected)


@pytest.mark.invariant(3, 5)
def test_goal_canceled_during_submission_is_canceled_in_the_queue(made, action):
    goals, queue = action(ready)
    handle = RosHandle(2)
    executing = goals._execute(handle)
    executing.send(None)  # waits for its outcome
    made.turn()
    assert len(queue.submitted) == 1
    outcome = done(executing)
    assert outcome.text == 'canceled, the arm is at rest'
    assert handle.ended == ['canceled']


@pytest.mark.invariant(9)
def test_failing_cancel_request_is_rejected(made, action, monkeypatch):
    goals, _ = action(ready)
    handle, cancels = RosHandle(), []
    key = handle.goal_id.uuid
    assert goals._cancel(handle) is CancelResponse.ACCEPT  # the goal has ended
    goals._cancel_of[key] = partial(cancels.append, 'canceled')
    assert goals._cancel(handle) is CancelResponse.ACCEPT
    made.turn()
    assert cancels == ['canceled']
    monkeypatch.setattr(made.bridge, 'to_loop', lambda *_: 1 // 0)
    goals._logger.lines.clear()
    with monkeypatch.context() as patch:
        patch.setattr(made.bridge, 'failed', lambda what, error: made.faults.append(what))
        assert goals._cancel(handle) is CancelResponse.REJECT
    assert made.faults == ['canceling a goal']
    monkeypatch.undo()
    made.end()
    assert goals._cancel(handle) is CancelResponse.REJECT


class Commands:
    """Stops the arm, or raises `error`."""

    def __init__(self):
        self.error = None

    async def stop(self):
        if self.error is not None:
            raise self.error
        return 'stopped, the arm is at rest'


@pytest.fixture
def goals(made, monkeypatch):
    """Return a GoalServer with the genuine checks of requests."""
    monkeypatch.setattr(goal_server, 'GoalAction', lambda *_: None)

    async def make():
        return GoalServer(context(made, goal_queue=Queue()), Commands())

    return made.loop.run_until_complete(make())


def test_invalid_trajectory_of_a_topic_is_logged(made, goals, monkeypatch):
    on_trajectory = made.node.taken['~/joint_trajectory']
    point = JointTrajectoryPoint(positions=[0.0] * 6)
    message = JointTrajectory(joint_names=[*LIMITS.names[:5], 'mine'], points=[point])
    for error in (REJECTED, DriverEndedError()):

        def fails(_goal, error=error):
            raise error

        monkeypatch.setattr(goals.requests, 'checked_goal', fails)
        on_trajectory(message)
    assert made.node.log.lines == [
        ('warning', 'goal aborted: no joint_7'),
        ('warning', 'a trajectory was dropped: the driver has ended'),
    ]
    assert made.faults == []
    monkeypatch.setattr(goals.requests, 'checked_goal', lambda _: 1 // 0)
    on_trajectory(message)
    made.turn()
    assert made.faults[0].startswith('receiving a trajectory failed: ZeroDivisionError')


@pytest.mark.invariant(3)
@pytest.mark.parametrize('error', [None, CommandError('no reply to STOP')])
def test_empty_trajectory_stops_the_arm_and_logs_the_result(made, goals, error):
    goals._commands.error = error
    made.node.taken['joint_path_command'](JointTrajectory(joint_names=LIMITS.names))
    for _ in range(3):
        made.turn()
    severity, text = made.node.log.lines[-1]
    wanted = ('info', 'stopped, the arm is at rest') if error is None else ('error', str(error))
    assert (severity, text) == (wanted[0], f'empty trajectory: {wanted[1]}')


# --- streams ----------------------------------------------------------------------------------


class Servo:
    """Records accepted and rejected setpoints."""

    def __init__(self):
        self.taken = []
        self.refused = []

    def take(self, setpoint, _came, *, missed):
        assert not missed
        self.taken.append(setpoint)

    def refuse(self, topic, why, came):
        self.refused.append((topic, why, came))


@pytest.mark.invariant(9)
def test_setpoint_is_accepted_or_rejected_and_an_empty_one_stops(made, monkeypatch):
    servo, stopped = Servo(), []
    interface = ServoInterface(context(made, servo=servo), stopped.append)
    jog = made.node.taken['~/joint_jog']
    jog(JointJog(joint_names=['joint_1'], velocities=[0.1]), {})
    jog(JointJog(joint_names=['joint_9'], velocities=[0.1]), {})
    made.node.taken['~/servo'](JointTrajectory(), {})
    made.turn()
    assert len(servo.taken) == len(stopped) == 1
    ((topic, why, _came),) = servo.refused
    assert topic == '~/joint_jog'
    assert 'joint_9' in why
    monkeypatch.setattr(interface._servo, 'take', None)
    monkeypatch.setattr(interface, '_stop', lambda _: 1 // 0)
    made.node.taken['~/servo'](JointTrajectory(), {})
    made.turn()
    assert made.faults[0].startswith('receiving a setpoint on ~/servo failed: ZeroDivisionError')
    made.end()
    jog(JointJog(joint_names=['joint_1'], velocities=[0.1]), {})  # the driver has ended


# --- the gripper ------------------------------------------------------------------------------


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('error', 'logged'),
    [(DriverEndedError(), 'the driver has ended'), (ZeroDivisionError('x'), None)],
)
def test_gripper_goal_with_unknown_state_is_aborted(made, monkeypatch, error, logged):
    monkeypatch.setattr(loop_bridge, 'ActionServer', lambda *_, **__: None)
    wiring = GripperWiring(open_output=0, close_output=1, opened_input=0, closed_input=1)
    server = GripperServer(context(made, io=None), wiring)
    handle = RosHandle(request=GripperCommand.Goal())

    async def fails(_work):
        raise error

    monkeypatch.setattr(made.bridge, 'in_loop', fails)
    result = done(server._execute(handle))
    assert np.isnan(result.position)
    assert not result.reached_goal
    assert handle.ended == ['aborted']
    made.turn()
    if logged is None:
        assert made.faults == ['~/gripper_cmd failed: ZeroDivisionError: x']
    else:
        assert made.node.log.lines == [('warning', f'~/gripper_cmd: {logged}')]
    assert server._on_cancel(handle) is CancelResponse.ACCEPT
    made.end()
    assert server._on_cancel(handle) is CancelResponse.REJECT
