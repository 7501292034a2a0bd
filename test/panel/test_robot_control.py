# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel's control of a robot: arming, motion, STOP, and `demo --stay`."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip('websockets')

from support.panel_client import PanelClient
from support.ros_peer import PATIENCE

from epson_driver.cli.panel import PORT
from epson_driver.demo.run import TOO_BUSY
from epson_driver.motion import Trajectory
from epson_driver.panel.arming import ALIVE_WITHIN_S, Arming, NotArmedError
from epson_driver.panel.robot_control import STOP_ANSWER_S, RequestError, RobotControl
from epson_driver.panel.robot_state import (
    ERROR,
    INFO,
    MAX_AGES_S,
    WARN,
    RobotState,
    Simulation,
)
from epson_driver.panel.sim_pendant import NotSimulatedError, PendantThread
from epson_driver.processes import processes
from epson_driver.ros_panel import NoDriverError

PARAMETERS = {'robot_model': 'c3_a601s', 'robot_ip': '192.0.2.1', 'remote_port': 0}
NOW = 100.0


class Robot:
    """The panel's robot without ROS: a state, and the requests to the driver."""

    def __init__(self) -> None:
        self.state = RobotState(positions=np.zeros(6), link='connected')
        self.state.times = dict.fromkeys((*MAX_AGES_S, 'first joints', 'parameters'), NOW)
        self.parameters: dict[str, Any] = dict(PARAMETERS)
        self.logged: list[str] = []

        self.asked: list[Any] = []
        self.executed: list[Trajectory] = []
        self.goals: list[Any] = []
        self.served = True
        """Whether the driver's services are available."""

    def log(self, text: str, _level: int) -> None:
        self.logged.append(text)

    def cancel_goals(self) -> list[Any]:
        return []

    def execute(self, trajectory: Trajectory, _text: str, _say: Any) -> None:
        self.executed.append(trajectory)

    def trigger(self, name: str, say: Any) -> None:
        if not self.served:
            raise NoDriverError(f'no server for ~/{name}')
        self.asked.append(name)
        self.say = say

    def set_speed(self, factor: float, say: Any) -> None:
        if not self.served:
            raise NoDriverError('no server for ~/set_speed_scaling')
        self.asked.append((factor, say))


@pytest.fixture
def robot() -> Robot:
    return Robot()


def fail(what: str, error: BaseException) -> None:
    raise AssertionError(what) from error


@pytest.fixture
def pendants() -> Iterator[PendantThread]:
    result = PendantThread(time.monotonic, fail)
    yield result
    result.end()


def controlled(robot: Robot, pendants: PendantThread, *, allow_motion: bool) -> RobotControl:
    result = RobotControl(
        robot,  # type: ignore[arg-type]
        pendants.pendant,
        lambda: NOW,
        allow_motion=allow_motion,
    )
    result.arming.connect(1)
    result.arming.alive(1)
    return result


@pytest.fixture
def control(robot: Robot, pendants: PendantThread) -> RobotControl:
    return controlled(robot, pendants, allow_motion=True)


@pytest.mark.parametrize('name', ['c3_a601s', 'C3-A601S', 'vt6'])
def test_model_is_loaded_once_for_any_spelling(
    name: str, robot: Robot, control: RobotControl
) -> None:
    robot.parameters['robot_model'] = name
    control.update()
    model = control.model
    assert model is not None
    control.update()
    assert control.model is model


def test_missing_robot_model_is_logged_once_and_not_shown(
    robot: Robot, control: RobotControl
) -> None:
    control.update()
    robot.parameters['robot_model'] = '/no/such/file.yaml'
    for _ in range(3):
        control.update()
    assert control.model is None
    (message,) = robot.logged
    assert '/no/such/file.yaml' in message
    robot.parameters['robot_model'] = 'c3_a601s'
    control.update()
    assert control.model is not None


def test_distance_of_a_scara_shaft_from_the_start_is_in_mm(
    robot: Robot, control: RobotControl
) -> None:
    robot.parameters['robot_model'] = 'gx8_c652s'
    control.update()
    robot.state.positions = np.array([0.5, 0.5, -0.1, 0.0])
    names = tuple(f'joint_{number}' for number in range(1, 5))
    robot.state.joint_names = names
    for start, message in (
        ([0.5, 0.5, -0.1, 0.015], ''),
        ([0.5, 0.5, -0.15, 0.015], 'joint_3 is 50.0 mm away'),
        ([0.5, 0.4, -0.1, 0.0], 'joint_2 is 5.7° away'),
    ):
        there = Trajectory(names, np.array([0.0, 1.0]), np.array([start, start]))
        assert control.away_from_start(there) == message


@pytest.mark.invariant(1)
def test_arming_requires_parameters_newer_than_the_joint_states(
    robot: Robot, control: RobotControl
) -> None:
    """A driver of the same name, for a real robot, may have replaced the first."""
    robot.state.times['first joints'] = NOW - 1.0
    robot.state.times['parameters'] = NOW - 1.5
    with pytest.raises(NotArmedError, match='robot of the driver is still unknown'):
        control.arming.arm(1)
    robot.state.times['parameters'] = NOW - 0.5
    control.arming.arm(1)
    assert control.arming.holder == 1
    robot.state.times['first joints'] = NOW
    control.update()
    assert control.arming.holder is None


@pytest.mark.invariant(1)
def test_withheld_joints_keep_the_window_armed_but_allow_no_step(
    robot: Robot, control: RobotControl
) -> None:
    control.update()
    control.arming.arm(1)
    robot.state.times['joints'] -= MAX_AGES_S['joints'] + 0.01
    robot.state.times['joints withheld'] = NOW
    control.update()
    assert control.arming.holder == 1
    with pytest.raises(RequestError, match='does not report its joints now'):
        control.step(1, '1', 'world', 0.01, 1.0)
    robot.state.times['joints withheld'] -= MAX_AGES_S['joints'] + 0.01
    control.update()
    assert control.arming.holder is None


@pytest.mark.invariant(1)
def test_window_cannot_be_armed_while_the_first_joints_are_withheld(
    robot: Robot, control: RobotControl
) -> None:
    del robot.state.times['joints'], robot.state.times['first joints']
    robot.state.times['joints withheld'] = NOW
    with pytest.raises(NotArmedError, match='robot of the driver is still unknown'):
        control.arming.arm(1)


def test_controller_without_plans_gets_the_end_of_each_motion(
    robot: Robot, control: RobotControl
) -> None:
    control.update()
    robot.state.joint_names = tuple(f'joint_{number}' for number in range(1, 7))
    control.arming.arm(1)
    control.step(1, '2', 'world', 0.05, 1.0)
    whole = robot.executed[-1]
    assert len(whole.times) > 2
    robot.state.no_plans = 'it takes no points'
    control.step(1, '2', 'world', 0.05, 1.0)
    (goal,) = robot.executed[1:]
    np.testing.assert_array_equal(goal.positions, whole.positions[-1:])
    assert goal.times.tolist() == [whole.times[-1]]
    assert goal.velocities is None
    control.step(1, 'Z', 'world', 0.02, 1.0)
    assert len(robot.executed[-1].times) > 2  # which the driver sends as a line
    control.step(1, '2', 'world', 0.05, 0.01)
    slow = robot.executed[-1]
    assert control.model is not None
    assert 0.05 / slow.times[0] == pytest.approx(0.01 * control.model.limits.velocity[1])


def test_controller_refuses_plans_and_streams_with_its_reason(
    robot: Robot, control: RobotControl
) -> None:
    control.update()
    robot.state.joint_names = tuple(f'joint_{number}' for number in range(1, 7))
    robot.state.no_plans, robot.state.no_streams = 'it takes no points', 'it takes no stream'
    control.arming.arm(1)
    with pytest.raises(RequestError, match='no points'):
        control.execute(1, 'short', SHORT)
    with pytest.raises(RequestError, match='no stream'):
        control.jog(1, '1', 'world', 0.5)
    assert robot.executed == []


@pytest.mark.invariant(1)
@pytest.mark.parametrize('silent', ['joints', 'status', 'diagnostics'])
def test_robot_with_outdated_state_cannot_be_armed(
    silent: str, robot: Robot, control: RobotControl
) -> None:
    control.arming.arm(1)
    robot.state.times[silent] -= MAX_AGES_S[silent] + 0.01
    control.update()
    assert control.arming.holder is None
    with pytest.raises(NotArmedError, match='needs a visible robot'):
        control.arming.arm(1)


@pytest.mark.invariant(1)
def test_robot_not_known_to_be_simulated_requires_allow_motion(
    robot: Robot, pendants: PendantThread
) -> None:
    careful = controlled(robot, pendants, allow_motion=False)
    with pytest.raises(NotArmedError, match='--allow-motion'):
        careful.arming.arm(1)
    careful.update()
    robot.state.simulation = SIMULATED
    robot.state.times.setdefault('simulation', NOW)
    usual = dict(robot.parameters)
    robot.parameters |= {'remote_port': usual['remote_port'] + 1}  # of another controller
    with pytest.raises(NotArmedError, match='--allow-motion'):
        careful.arming.arm(1)
    robot.parameters |= usual
    careful.arming.arm(1)
    robot.state.times['simulation'] -= MAX_AGES_S['simulation'] + 0.01
    careful.arming.watch()
    assert careful.arming.holder is None


SIMULATED = Simulation({'estop': 'not active'})
SHORT = Trajectory(('a', 'b'), np.array([0.0, 1.0]), np.zeros((2, 2)))


@pytest.mark.invariant(3, 9)
def test_unanswered_stop_is_an_alarm_until_the_answer(
    robot: Robot, pendants: PendantThread
) -> None:
    now = NOW
    control = RobotControl(
        robot,  # type: ignore[arg-type]
        pendants.pendant,
        lambda: now,
        allow_motion=True,
    )
    control.stop()
    control.update()
    assert control.stop_alarm == ''
    now += STOP_ANSWER_S + 0.01
    control.update()
    assert control.stop_alarm == (
        'STOP was not delivered: no reply from the driver within 0.5 s. Press the E-stop.'
    )
    robot.say('~/stop: no motion was running', INFO)
    assert control.stop_alarm == ''
    control.stop()
    robot.say('~/stop: no standstill within 2 s', ERROR)
    assert control.stop_alarm.startswith('STOP failed: ~/stop: no standstill')
    assert control.stop_alarm in robot.logged


@pytest.mark.invariant(3, 9)
@pytest.mark.parametrize('served', [True, False])
def test_stop_of_a_silent_driver_is_an_alarm_immediately(
    served: bool, robot: Robot, control: RobotControl
) -> None:
    robot.served = served
    robot.state.times['diagnostics'] -= MAX_AGES_S['diagnostics'] + 0.01
    with contextlib.nullcontext() if served else pytest.raises(NoDriverError):
        control.stop()
    assert control.stop_alarm.startswith('STOP was not delivered: ')
    assert control.stop_alarm.endswith('Press the E-stop.')
    assert robot.asked == ['stop'] * served, 'it can still arrive'


@pytest.mark.invariant(3)
def test_unarmed_window_can_stop_and_disable_the_arm(robot: Robot, control: RobotControl) -> None:
    control.stop()
    control.disable()
    assert robot.asked == ['stop', 'disable']


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('enable', ()),
        ('reset_error', ()),
        ('set_speed', (0.5,)),
        ('write_output', (0, 1)),
        ('press', ('Motors', 'on')),
        ('go_to_start', ('short', SHORT)),
    ],
)
def test_unarmed_window_cannot_change_the_condition(
    robot: Robot, control: RobotControl, name: str, arguments: tuple[Any, ...]
) -> None:
    with pytest.raises(NotArmedError):
        getattr(control, name)(1, *arguments)
    assert robot.asked == []
    with pytest.raises(NotSimulatedError):
        control.press(1, 'E-stop', 'press')


def test_trajectory_with_other_number_of_joints_is_refused(
    robot: Robot, control: RobotControl
) -> None:
    control.arming.arm(1)
    with pytest.raises(RequestError, match='the robot model is unknown'):
        control.go_to_start(1, 'short', SHORT)
    control.update()
    robot.state.joint_names = tuple(f'joint_{number}' for number in range(1, 7))
    for ask in (control.execute, control.go_to_start):
        with pytest.raises(RequestError, match='has 2 joints, but the robot 6'):
            ask(1, 'short', SHORT)
    assert control.away_from_start(SHORT) == ''
    assert control.plan is None


def test_only_the_last_pending_speed_is_requested(robot: Robot, control: RobotControl) -> None:
    control.arming.arm(1)
    for factor in (0.9, 0.5, 0.2):
        control.set_speed(1, factor)
    ((factor, answered),) = robot.asked
    assert factor == 0.9
    answered('~/set_speed_scaling: refused', WARN)
    assert [factor for factor, _ in robot.asked] == [0.9, 0.2]
    robot.asked[-1][1]('done', INFO)
    assert len(robot.asked) == 2
    assert robot.logged == ['~/set_speed_scaling: refused']


def test_failed_speed_request_does_not_block_the_next(robot: Robot, control: RobotControl) -> None:
    """Otherwise the failed request would stay pending and the slider would have no effect."""
    control.arming.arm(1)
    robot.served = False
    with pytest.raises(NoDriverError):
        control.set_speed(1, 0.5)
    robot.served = True
    control.set_speed(1, 0.6)
    control.set_speed(1, 0.7)
    robot.served = False
    robot.asked[-1][1]('~/set_speed_scaling: no reply within 15 s', ERROR)
    assert robot.logged == [
        '~/set_speed_scaling: no reply within 15 s',
        'no server for ~/set_speed_scaling',
    ]
    robot.served = True
    control.set_speed(1, 0.8)
    assert [factor for factor, _ in robot.asked] == [0.6, 0.8]


class ArmingRules:
    """Arming of two windows, with a settable reason against it and a settable time."""

    def __init__(self) -> None:
        self.why: str | None = None
        self.ended: list[str] = []
        self.now = 100.0
        self.arming = Arming(lambda: self.why, self.ended.append, lambda: self.now)
        for browser in (1, 2):
            self.arming.connect(browser)
            self.arming.alive(browser)

    def may(self, browser: int) -> bool:
        try:
            with self.arming.held(browser):
                return True
        except NotArmedError:
            return False


@pytest.mark.invariant(1)
def test_window_is_armed_only_on_request() -> None:
    rules = ArmingRules()
    assert not rules.may(1)
    rules.arming.arm(1)
    with pytest.raises(NotArmedError, match='another window'):
        rules.arming.arm(2)
    assert not rules.arming.disarm('not its own', 2)
    assert rules.may(1)
    assert not rules.may(2)


@pytest.mark.invariant(4)
def test_disconnected_window_is_disarmed_and_ignored() -> None:
    rules = ArmingRules()
    rules.arming.arm(1)
    rules.arming.disconnect(1)
    assert rules.ended == ['the armed window of the panel was closed']
    assert not rules.may(1)
    with pytest.raises(NotArmedError, match='is disconnected'):
        rules.arming.arm(1)
    rules.arming.disconnect(2)
    assert len(rules.ended) == 1


@pytest.mark.invariant(4)
def test_lost_state_disarms_until_armed_again() -> None:
    rules = ArmingRules()
    rules.arming.arm(1)
    rules.why = 'no joint states'
    assert not rules.may(1)
    assert rules.ended == ['no joint states']
    with pytest.raises(NotArmedError, match='no joint states'):
        rules.arming.arm(1)
    rules.why = None
    assert not rules.may(1)


@pytest.mark.invariant(3, 4)
def test_window_without_heartbeat_is_disarmed() -> None:
    rules = ArmingRules()
    rules.arming.arm(1)
    for _ in range(5):
        rules.now += ALIVE_WITHIN_S
        rules.arming.alive(1)
        rules.arming.watch()
        assert rules.may(1)
    rules.now += ALIVE_WITHIN_S + 0.01
    rules.arming.alive(2)
    rules.arming.watch()
    assert rules.ended == ['the armed window is frozen, hidden or disconnected']
    with pytest.raises(NotArmedError, match='does not respond'):
        rules.arming.arm(1)
    rules.arming.arm(2)


def test_watch_disarms_without_a_request() -> None:
    rules = ArmingRules()
    rules.arming.arm(1)
    rules.arming.watch()
    assert rules.arming.holder == 1
    rules.why = 'no joint states'
    rules.arming.watch()
    assert rules.arming.holder is None


@pytest.mark.invariant(3)
def test_disarming_waits_for_the_running_request() -> None:
    """Otherwise a goal could be sent after all goals have been canceled."""
    rules = ArmingRules()
    rules.arming.arm(1)
    order: list[str] = []
    started, disconnected = threading.Event(), threading.Event()

    def disconnect() -> None:
        started.wait()
        rules.arming.disconnect(1)
        order.append('ended')
        disconnected.set()

    thread = threading.Thread(target=disconnect)
    thread.start()
    with rules.arming.held(1):
        started.set()
        assert not disconnected.wait(0.05)
        order.append('goal sent')
    thread.join()
    assert order == ['goal sent', 'ended']
    assert not rules.may(1)


DEMO = (sys.executable, '-m', 'epson_driver.cli', 'demo')


@pytest.mark.slow
def test_demo_stay_runs_until_interrupted(tmp_path: Path) -> None:
    run = subprocess.Popen(
        [*DEMO, '--stay', '--motion=ptp', f'--picture={tmp_path / "x.png"}'],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {'PYTHONUNBUFFERED': '1'},
    )
    assert run.stdout is not None
    output = ''
    try:
        while output.count('panel: http') < 2:  # before the run, and with the exports
            line = run.stdout.readline()
            if not line and 'this driver was stalled' in output:
                pytest.skip(
                    'the machine did not run the driver for 0.5 s: the demo says so and ends'
                )
            assert line, output
            output += line
        assert 'the arm followed the plan' in output or 'too busy to judge' in output
        assert re.search(r'(?m)^export ROS_DOMAIN_ID=\d+$', output)
        assert 'export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST\n' in output
        address = re.search(r'panel: http://127\.0\.0\.1:(\d+)/', output)
        assert address is not None, output
        with PanelClient(int(address[1])) as client:
            client.wait_for_lamp('Link', 'good')
            client.wait_for_lamp('Enabled', 'good')
    finally:
        run.send_signal(signal.SIGINT)
        run.stdout.read()
        assert run.wait(PATIENCE) in (0, TOO_BUSY)
    with pytest.raises(ConnectionError):
        PanelClient(int(address[1]))


@pytest.mark.slow
def test_demo_refuses_compare_together_with_stay() -> None:
    run = subprocess.run(
        [*DEMO, '--compare', '--stay'], capture_output=True, text=True, check=False
    )
    assert run.returncode == 2
    assert 'leave out --stay and --panel' in run.stderr


def test_demo_reports_missing_panel_dependencies() -> None:
    code = (
        'import sys; sys.modules["websockets"] = None; sys.argv = ["", "demo", "--panel"]\n'
        'from epson_driver.cli.__main__ import main; sys.exit(main())'
    )
    run = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert 'make demo ARGS=--panel' in ' '.join(run.stdout.split())


@pytest.mark.slow
def test_panel_of_sim_controller_ends_with_it(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(('127.0.0.1', PORT))
        except OSError:
            pytest.skip(f'port {PORT} is taken on this machine')
    environment = processes.ros_environment(processes.free_ros_domain())
    controller = processes.sim_controller(
        tmp_path / 'controller.log', '--panel', environment=environment
    )
    with processes.ended_at_exit(controller):
        controller.ports()
        assert controller.address() == f'http://127.0.0.1:{PORT}/'
        PanelClient(PORT).close()
        assert controller.end(signal.SIGTERM) == 0
    with pytest.raises(ConnectionError):
        PanelClient(PORT)
