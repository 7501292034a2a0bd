# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The synchronous API with a controller in a thread of this process, and its threads."""

import asyncio
import contextlib
import inspect
import logging
import threading

import numpy as np
import pytest
from support.api_harness import FAR, ports_of
from support.api_patience import be_patient
from support.driver_harness import simulated
from support.sim_process import vacant_port

from epson_driver import ArgumentError, MotionError, Robot, RobotError, aio, robot
from epson_driver.api import simulation
from epson_driver.api.errors import RobotError as AnyRobotError
from epson_driver.api.simulation import SimulatedController
from epson_driver.api.threads import LoopThread
from epson_driver.sim_controller.condition.states import Event

PATIENCE = 60.0


@pytest.fixture(autouse=True)
def _timeout(monkeypatch):
    be_patient(monkeypatch.setattr)


class Cell:
    """A controller in a separate thread."""

    def __init__(self):
        self._thread = LoopThread('controller')
        self._stack = contextlib.AsyncExitStack()
        entered = self._thread.run(lambda: self._stack.enter_async_context(simulated()))
        self.controller, self.ports = entered

    def call(self, function):
        return self._thread.call(function)

    def robot(self, **more):
        return Robot(**ports_of(self.ports), **more)

    def close(self):
        self._thread.run(self._stack.aclose)
        self._thread.close()


@pytest.fixture(scope='module')
def cell():
    cell = Cell()
    yield cell
    cell.close()


def test_each_request_returns_the_driver_s_answer(cell):
    with cell.robot() as robot:
        assert 'enabled' in robot.enable()
        robot.move_waypoints([[0.02, 0, 0, 0, -0.5, 0], [0.04, 0, 0, 0, -0.5, 0]])
        assert robot.joints[:2] == pytest.approx([0.04, 0.0], abs=1e-3)
        here = robot.joints
        times, there = [0.0, 0.2], [here, here + 0.005]
        assert robot.move_trajectory(times, there).duration == pytest.approx(0.2)
        assert robot.joints == pytest.approx(there[-1], abs=1e-3)
        assert robot.ros_pose[:3] == pytest.approx(robot.tool_pose[:3, 3])
        assert np.linalg.norm(robot.ros_pose[3:]) == pytest.approx(1.0)
        robot.set_speed_scaling(0.5)
        assert robot.speed_scaling == 0.5
        with pytest.raises(ValueError, match=r'factor = 3\.0: must be 0'):
            robot.set_speed_scaling(3.0)
        assert 'acknowledged STOP' in robot.stop()
        assert 'disabled' in robot.disable()
        assert not robot.status.enabled
        with pytest.raises(RobotError, match='already connected'):
            robot.connect()
        assert robot.status.connected


@pytest.mark.invariant(5)
def test_cancel_of_an_aborted_motion_raises_its_error(cell):
    with cell.robot() as robot:
        robot.enable()
        motion = robot.move_joints(FAR, speed=0.02, wait=False)
        cell.call(lambda: cell.controller.apply(Event.ESTOP_PRESS))
        with pytest.raises(MotionError, match='E-stop'):
            motion.wait(PATIENCE)
        with pytest.raises(MotionError, match='E-stop'):
            motion.cancel()
        cell.call(lambda: cell.controller.apply(Event.ESTOP_RELEASE))
        robot.reset()


def test_failed_connect_leaves_no_thread_and_can_be_retried():
    before = threading.active_count()
    port = vacant_port()
    lost = Robot(motion_port=port, state_port=port, io_port=0)
    with pytest.raises(RobotError, match='refused'):
        lost.connect(0.1)
    assert threading.active_count() <= before
    with pytest.raises(RobotError, match=r'call connect\(\)'):
        lost.enable()
    with pytest.raises(RobotError, match='refused'):
        lost.connect(0.1)


@pytest.mark.invariant(3, 9)
def test_raising_callback_stops_the_arm(cell):
    with cell.robot() as robot:
        robot.enable()
        motion = robot.move_joints(FAR, speed=0.02, wait=False)
        robot._session.callbacks.wrap(lambda _pressed: 1 / 0)(True)
        with pytest.raises(MotionError, match='a callback failed: ZeroDivisionError'):
            motion.wait(PATIENCE)
        assert not robot.status.enabled


@pytest.mark.invariant(9)
def test_callback_error_after_close_is_logged(caplog):
    with caplog.at_level(logging.ERROR):
        Robot()._session.callbacks._failed(ZeroDivisionError('made for this test'))
    assert 'a callback failed (there is no connection' in caplog.text
    assert 'made for this test' in caplog.text


ASYNCHRONOUS = {'catch_up', 'measured'}
"""Members that only a program with an event loop needs."""


@pytest.mark.parametrize('name', ['Robot', 'Motion', 'Io', 'Gripper'])
def test_synchronous_members_have_the_signatures_and_docs_of_the_asynchronous(name):
    face, awaited = getattr(robot, name), getattr(aio, name)
    members = {member for member in dir(awaited) if not member.startswith('_')}
    members -= ASYNCHRONOUS | {'start', 'finish'}
    assert members <= set(vars(face))
    for member in members:
        mine, theirs = getattr(face, member), getattr(awaited, member)
        assert mine.__doc__
        assert not inspect.iscoroutinefunction(mine)
        if isinstance(theirs, property):
            assert isinstance(mine, property)
            assert inspect.signature(mine.fget) == inspect.signature(theirs.fget)
        else:
            assert mine.__doc__ == theirs.__doc__ or member == 'wait'
            signature = inspect.signature(mine)
            assert signature.parameters == inspect.signature(theirs).parameters
            moves = signature.return_annotation is robot.Motion
            assert moves == (member.startswith('move_') or member == 'replay')
    assert inspect.signature(robot.Robot).parameters == inspect.signature(aio.Robot).parameters
    assert robot.Robot.joints.__doc__ == aio.Robot.joints.__doc__


# --- the threads ------------------------------------------------------------------------------


@pytest.mark.invariant(9)
def test_closing_the_loop_ends_a_waiting_call():
    thread = LoopThread('test')
    running = threading.Event()
    errors = []

    async def forever():
        running.set()
        await asyncio.sleep(3600.0)

    def wait():
        with pytest.raises(AnyRobotError, match='was closed') as error:
            thread.run(forever)
        errors.append(str(error.value))

    waiting = threading.Thread(target=wait)
    waiting.start()
    assert running.wait(PATIENCE)
    thread.close()
    waiting.join(PATIENCE)
    assert errors == ['the robot was closed']
    with pytest.raises(AnyRobotError, match='the robot was closed'):
        thread.run(forever)


def test_call_from_the_loop_s_own_thread_raises():
    thread = LoopThread('test')

    def waits():
        with pytest.raises(AnyRobotError, match='cannot wait for itself'):
            thread.call(lambda: None)
        return 'raised'

    assert thread.call(waits) == 'raised'
    thread.close()


def test_callback_must_be_a_function():
    with pytest.raises(ArgumentError, match='callback = 3: must be a function'):
        Robot().on_estop(3)


# --- the simulated controller as a process ------------------------------------------------------


@pytest.fixture
def replaced_by(tmp_path, monkeypatch):
    """Return a function that replaces the simulated controller by a shell script."""

    def run(script):
        path = tmp_path / 'python'
        path.write_text(f'#!/bin/sh\n{script}\n')
        path.chmod(0o755)
        monkeypatch.setattr(simulation, 'module_command', lambda *_: [str(path)])
        return SimulatedController(['--robot', 'mars'])

    return run


@pytest.mark.parametrize(
    ('script', 'expected'),
    [
        ('echo usage >&2; echo epson_driver sim_controller: error: no robot >&2', 'no robot'),
        ('true', 'no output'),
    ],
)
def test_error_of_a_controller_that_does_not_start_has_its_message(replaced_by, script, expected):
    controller = replaced_by(f'{script}; exit 2')

    async def scenario():
        with pytest.raises(AnyRobotError, match=f'controller did not start: {expected}$'):
            await controller.start()
        await controller.close()
        await controller.close()  # no effect

    asyncio.run(scenario())


@pytest.mark.slow
def test_spel_controller_can_be_simulated():
    with Robot.simulated(controller='spel') as robot:
        robot.enable()
        robot.move_joints([0.1, 0, 0, 0, 0, 0])
    with pytest.raises(RobotError, match=r'--motion cannot be set for a SPEL. program'):
        Robot.simulated(controller='spel', motion='smooth').connect()


@pytest.mark.invariant(9)
def test_controller_that_ignores_sigterm_is_killed(replaced_by, monkeypatch, tmp_path):
    ready = tmp_path / 'ready'
    controller = replaced_by(f'trap "" TERM\ntouch {ready}\nexec sleep 1000')
    monkeypatch.setattr(simulation, 'START_TIMEOUT_S', 0.2)
    monkeypatch.setattr(simulation, 'END_TIMEOUT_S', 0.05)

    async def scenario():
        with pytest.raises(AnyRobotError, match=r'did not listen within 0\.2 s'):
            await controller.start()
        process = controller._process
        while not ready.exists():  # noqa: ASYNC110 - another process creates it
            await asyncio.sleep(0.01)
        await controller.close()
        assert process.returncode == -9

    asyncio.run(scenario())
