# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`Robot.show`: the panel of a Python Robot, without ROS. Its windows have no browser here."""

import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('websockets')

from support.api_harness import NO_ROS
from support.api_patience import be_patient
from support.browser import chromium
from support.panel_client import PanelClient
from support.panel_page import Page
from support.ros_peer import PATIENCE

from epson_driver import EpsonPoint, MotionError, Robot, RobotError
from epson_driver.processes.processes import EXECUTABLE

FAR = [1.5, 0.3, -0.2, 0.0, 0.6, 0.0]
FIRST = {'axis': '1', 'frame': 'world', 'share': 1.0}


def window_of(robot: Robot) -> PanelClient:
    client = PanelClient(int(robot.show().rstrip('/').rpartition(':')[2]))
    client.wait_for_lamp('Link', 'good')
    client.wait(lambda: 'controls' in client.parts, 'its controls')
    assert client.lives.wait(PATIENCE)
    return client


def armed(robot: Robot) -> PanelClient:
    client = window_of(robot)
    client.wait_for_lamp('Door', 'good')
    client.click('Arm')
    client.wait(lambda: client.armed, 'armed')
    return client


def until(condition: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, what
        time.sleep(0.02)


@pytest.fixture(scope='module')
def shown() -> Iterator[Robot]:
    with pytest.MonkeyPatch.context() as patch:
        be_patient(patch.setattr)
        with Robot.simulated(motion='ptp') as robot:
            yield robot


@pytest.fixture
def robot(shown: Robot) -> Robot:
    if not shown.status.enabled:
        shown.enable()
    until(lambda: _moved_home(shown), "the end of the previous test's motion")
    return shown


def _moved_home(robot: Robot) -> bool:
    try:
        robot.move_joints([0.0, 0.3, -0.2, 0.0, 0.6, 0.0], speed=1.0, acceleration=1.0)
    except MotionError as error:
        # the stop of the previous test may still end a motion that begins after its standstill
        if not any(cause in str(error) for cause in ('another motion', 'stopped on request')):
            raise
        return False
    return True


def test_panel_enables_steps_and_scales_the_speed(robot: Robot) -> None:
    with armed(robot) as client:
        client.click('Disable')
        client.wait_for_log('disable: the arm is disabled')
        client.wait_for_lamp('Enabled', 'warn')
        assert client.advice.endswith('press Enable')
        client.click('Enable')
        client.wait_for_lamp('Enabled', 'good')
        before = robot.joints
        client.ask('step', size=0.2, **FIRST)
        client.wait_for_log('step of 1: at the goal')
        np.testing.assert_allclose(robot.joints - before, [0.2, 0, 0, 0, 0, 0], atol=1e-3)
        client.set('Speed [%]', 50)
        client.wait(lambda: client.parts['controls']['speed'] == 0.5, 'half the speed')
        assert robot.speed_scaling == 0.5
        robot.set_speed_scaling(1.0)


@pytest.mark.invariant(3)
def test_jog_ends_without_further_requests(robot: Robot) -> None:
    with armed(robot) as client:
        before = robot.joints[0]
        end = time.monotonic() + PATIENCE
        while robot.joints[0] < before + 0.02:
            assert time.monotonic() < end, client.log
            client.ask('jog', **FIRST)
            time.sleep(0.025)
        assert robot.servo_end()
        at_rest = robot.joints
        time.sleep(0.3)
        np.testing.assert_array_equal(robot.joints, at_rest)


@pytest.mark.invariant(3)
@pytest.mark.parametrize('by', ['closing the window', 'Disarm', 'STOP'])
def test_stop_disarm_or_a_closed_window_ends_the_motion(by: str, robot: Robot) -> None:
    with armed(robot) as client:
        client.ask('go_to', name='far', **_values(robot, FAR))
        until(lambda: robot.status.moving, 'motion')
        if by == 'closing the window':
            client.close()
        else:
            client.click(by)
        until(lambda: not robot.status.moving, 'standstill')
        assert robot.joints[0] < FAR[0] - 0.1


def _values(robot: Robot, joints: list[float]) -> dict[str, float]:
    point = EpsonPoint.of(np.linalg.inv(robot.frames['base']) @ robot.forward(joints))
    return {axis: getattr(point, axis) for axis in 'xyzuvw'}


@pytest.mark.invariant(3)
def test_stop_of_the_panel_ends_a_motion_of_the_program(robot: Robot) -> None:
    with window_of(robot) as client:
        motion = robot.move_joints(FAR, wait=False)
        client.click('STOP')
        with pytest.raises(MotionError, match='stopped'):
            motion.wait(PATIENCE)


@pytest.mark.invariant(10)
def test_panel_never_replaces_a_motion_of_the_program(robot: Robot) -> None:
    with armed(robot) as client:
        motion = robot.move_joints(FAR, speed=0.4, wait=False)
        client.ask('step', size=0.2, **FIRST)
        client.wait_for_log('another motion runs or waits')
        motion.wait(PATIENCE)
        np.testing.assert_allclose(robot.joints, FAR, atol=1e-3)


@pytest.mark.invariant(6)
def test_estop_fault_log_and_points_are_shown(robot: Robot) -> None:
    robot.points.teach('pick')
    with window_of(robot) as client:
        client.wait(lambda: 'pick' in client.parts.get('taught', {}), 'the point')
        pose = client.parts['pose']['tool']
        np.testing.assert_allclose(client.parts['taught']['pick'], pose, atol=0.05)
        client.set('E-stop', 'press')
        client.wait_for_lamp('E-stop', 'bad')
        client.wait_for_log('arm disabled: the E-stop was pressed')
        assert client.advice.startswith('the E-stop is pressed → release the E-stop')
        robot.simulation.estop(pressed=False)
        robot.reset(enable=True)
        client.wait_for_lamp('Enabled', 'good')


@pytest.mark.invariant(9)
def test_hanging_driver_is_shown_as_an_undelivered_stop(robot: Robot) -> None:
    released = threading.Event()
    with window_of(robot) as client:
        hang = threading.Thread(target=robot._session.call, args=[released.wait])
        hang.start()
        try:
            client.click('STOP')
            why = (
                'STOP was not delivered: no reply from the driver within 0.5 s. Press the E-stop.'
            )
            client.wait(lambda: client.parts['alarms'] == [why], 'the alarm')
            client.wait_for_lamp('Link', 'unknown')
        finally:
            released.set()
            hang.join()
        client.wait_for_lamp('Link', 'good')


@pytest.mark.invariant(4)
def test_panel_without_permission_moves_no_real_robot(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    from epson_driver.panel.sim_pendant import PendantThread

    robot._session.run(robot._awaited._connection.page.close)
    monkeypatch.setattr(PendantThread, 'pendant', lambda *_: None)
    with window_of(robot) as client:
        client.click('Arm')
        client.wait_for_notification('this robot is real, or not known to be simulated')
        client.ask('step', size=0.2, **FIRST)
        client.wait_for_notification('not armed')
    robot._session.run(robot._awaited._connection.page.close)


@pytest.mark.invariant(9)
def test_failed_request_disables_the_arm_and_ends_the_panel(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fails(_commands: object) -> None:
        raise ZeroDivisionError('made for this test')

    page = robot._awaited._connection.page
    with armed(robot) as client:
        page = robot._awaited._connection.page
        monkeypatch.setattr('epson_driver.driver.arm_commands.ArmCommands.reset_error', fails)
        client.click('Reset error')
        until(lambda: page.ended.is_set(), 'the end of the panel')
    assert page.code == 1
    assert not robot.status.enabled
    assert 'made for this test' in caplog.text


@pytest.mark.invariant(4)
def test_closed_robot_closes_its_page_at_rest() -> None:
    with Robot.simulated(motion='ptp', enable=True) as robot:
        first = robot.show()
        assert robot.show() == first
        client = armed(robot)
        client.ask('step', size=0.5, **FIRST)
        until(lambda: robot.status.moving, 'motion')
    until(lambda: not client._threads[0].is_alive(), 'its window closes')
    with pytest.raises(OSError, match='refused'):
        PanelClient(int(first.rstrip('/').rpartition(':')[2]))
    assert 'panel' not in [thread.name for thread in threading.enumerate()]
    with pytest.raises(RobotError, match='no connection'):
        robot.show()


def test_show_reports_an_invalid_port_a_used_port_and_a_missing_package(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = int(robot.show().rstrip('/').rpartition(':')[2])
    robot._session.run(robot._awaited._connection.page.close)
    with pytest.raises(RobotError, match='port = 70000: must be'):
        robot.show(port=70000)
    refused = pytest.raises(RobotError, match=f'port {taken} of 127.0.0.1 cannot be opened')
    with socket.create_server(('127.0.0.1', taken)), refused:
        robot.show(port=taken)
    monkeypatch.setattr('epson_driver.panel.missing', lambda: True)
    with pytest.raises(RobotError, match=r"pip install 'epson_driver\[panel\]'"):
        robot.show()


def command(*arguments: str) -> 'subprocess.Popen[str]':
    """Start the panel without ROS."""
    return subprocess.Popen(
        [*EXECUTABLE, 'panel', '--port=0', *arguments],
        env=os.environ | {'PYTHONPATH': str(NO_ROS)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.slow
def test_simulated_panel_works_in_a_browser_without_ros() -> None:
    process = command('--simulated', '--robot=t6_602s')
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[1]
        with chromium() as browser:
            page = Page(browser, address)
            page.lamp('Door', 'good')
            page.page.locator('.joint').nth(3).wait_for()
            assert page.page.locator('.joint.near').count() == 0  # joint 3 is at home, an end
            page.armed()
            page.button('Enable').click()
            page.lamp('Enabled', 'good')
            page.page.get_by_label('Each press moves').select_option('1')

            def stepped() -> bool:
                page.armed()  # on a busy machine a window is disarmed, and a late step is dropped
                page.button('joint_2 plus').click(force=True)
                page.page.wait_for_timeout(2000)
                return 'step of 2: at the goal' in page.text('log')

            page.wait(stepped, 'a step')
            page.page.locator('#pendant summary').click()
            page.button('press').click()
            page.lamp('E-stop', 'bad')
            page.wait_for_text('advice', 'release the E-stop')
            assert page.errors == []
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE) == 0
            page.page.locator('#silence').wait_for()
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
def test_simulated_panel_shows_the_joints_of_a_project_that_runs(tmp_path: Path) -> None:
    text = 'Function main\n  Motor On\n  Print "moves"\n  Go P1\n  Wait Sw(5) = On\nFend\n'
    (tmp_path / 'main.prg').write_text(text)
    settings = 'robot: t6_602s\nsetup: P1 = JA(30, -20, -50, 10)\n'
    (tmp_path / 'spel.yaml').write_text(settings)
    changed = '--set=setup=P1 = JA(30, -20, -70, 10)'
    process = command('--simulated', f'--program={tmp_path}', changed)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[1]
        with chromium() as browser:
            page = Page(browser, address)
            for joint, value in enumerate(('30.0 °', '-20.0 °', '-70.0 mm', '10.0 °')):
                page.page.locator('.joint', has_text=value).nth(0).wait_for()
                assert value in page.page.locator('.joint').nth(joint).inner_text()
            assert page.page.locator('.joint').count() == 4
            assert page.errors == []
    finally:
        process.terminate()
        _, log = process.communicate()
    assert 'moves' in log


@pytest.mark.parametrize(
    ('arguments', 'code', 'text'),
    [
        (['--program=x'], 2, 'need --simulated and --program'),
        (['--simulated', '--set=a'], 2, 'need --simulated and --program'),
        ([], 1, 'the Python module rclpy is missing: add --simulated or robot.yaml'),
        (['--no-ros'], 2, 'needs robot.yaml or --simulated'),
    ],
)
def test_panel_without_ros_reports_wrong_arguments_and_missing_rclpy(
    arguments: list[str], code: int, text: str
) -> None:
    process = command(*arguments)
    _, error = process.communicate(timeout=PATIENCE)
    assert (process.returncode, 'Traceback' in error) == (code, False)
    assert text in error


@pytest.mark.slow
def test_panel_of_a_robot_file_needs_a_robot(tmp_path: Path) -> None:
    file = tmp_path / 'robot.yaml'
    settings = 'robot_ip: 127.0.0.1, motion_port: 1, state_port: 1'
    file.write_text(f'/**:\n  ros__parameters: {{{settings}}}\n', encoding='utf-8')
    process = command(str(file))
    _, error = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert error.splitlines()[-1].startswith('epson_driver panel: ')
    assert 'Connection refused' in error
