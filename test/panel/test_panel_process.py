# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel with a driver and a simulated controller, each in a separate process."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip('websockets')

from support.cell import LASTS, START, Cell
from support.fleet import Fleet
from support.panel_client import PanelClient, PanelProcess
from support.ros_peer import PATIENCE, trajectory
from websockets.exceptions import InvalidStatus

from epson_driver.processes import processes

SENT = 'goal sent: swing'


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    with closing(Cell(tmp_path_factory.mktemp('cell'))) as result:
        yield result.ready()


@pytest.fixture(scope='module')
def shared(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    result = PanelProcess(tmp_path_factory.mktemp('panel'), cell.domain)
    yield result
    assert result.end() == 0


@pytest.fixture
def panel(shared: PanelProcess, cell: Cell) -> Iterator[PanelProcess]:
    """The panel, with the arm disabled and at rest."""
    cell.peer.call('disable')
    yield shared
    shared.close_windows()


def moving(cell: Cell, panel: PanelProcess) -> PanelClient:
    """Open a window, arm it, enable the arm and execute the swing from it."""
    client = panel.armed()
    enable(client)
    before = goals_sent(client)
    client.click('Execute')
    client.wait(lambda: goals_sent(client) > before, SENT)
    cell.peer.wait_for_motion()
    return client


def enable(client: PanelClient) -> None:
    """Press Enable and wait for the lamp: the driver does not log every repeated reply."""
    client.wait_for_lamp('Enabled', 'warn')
    client.click('Enable')
    client.wait_for_lamp('Enabled', 'good')


def goals_sent(client: PanelClient) -> int:
    """Return the number of goals in the log."""
    return sum(SENT in line for line in client.log)


def move_arm_to(cell: Cell, start: list[float] = START) -> None:
    """Restart the controller with the arm at `start` (default: the start of the swing)."""
    cell.controller.end()
    cell.restart_controller(start)
    cell.peer.wait_until_ready()


def test_page_shows_the_robot(cell: Cell, panel: PanelProcess) -> None:
    with panel.window() as client:
        client.wait(lambda: len((client.parts.get('pose') or {}).get('tool', [])) == 6, 'a pose')
        assert client.parts['arm']['packed']['meshes']
        assert client.parts['controls']['joints'][-1] == 'joint_6'
        client.wait_for_lamp('Mode', 'good')
        client.wait_for_lamp('E-stop', 'good')
        client.wait_for_lamp('Door', 'good')
        client.wait_for_lamp('Enabled', 'warn')
        assert '→ press Enable' in client.advice
        assert client.point(1, 0) == 0


@pytest.mark.invariant(6)
def test_estop_and_door_change_lamps_and_advice(cell: Cell, panel: PanelProcess) -> None:
    with panel.window() as client:
        client.set('E-stop', 'press')
        client.wait_for_lamp('E-stop', 'bad')
        client.wait(lambda: 'release the E-stop' in client.advice, 'advice')
        client.wait_for_log('pendant: E-stop press')
        client.set('E-stop', 'release')
        client.wait_for_log('pendant: E-stop release')
        cell.pendant('reset')
        client.wait_for_lamp('E-stop', 'good')
        client.set('Door', 'open')
        client.wait_for_lamp('Door', 'bad')
        client.set('Door', 'close')
        client.wait_for_lamp('Door', 'good')
        cell.pendant('continue')


@pytest.mark.invariant(3)
def test_stop_of_any_window_stops_the_arm(cell: Cell, panel: PanelProcess) -> None:
    with moving(cell, panel) as client, panel.window() as other:
        other.click('STOP')
        client.wait_for_log('swing: ', after=SENT)
        cell.peer.assert_still()
        client.wait_for_log('~/stop: ', after=SENT)
    move_arm_to(cell)


@pytest.mark.invariant(3)
def test_closed_window_cancels_its_goal(cell: Cell, panel: PanelProcess) -> None:
    moving(cell, panel).close()
    with panel.window() as other:
        other.wait_for_log('the armed window of the panel was closed', after=SENT)
        other.wait_for_log('swing: ', after=SENT)
        cell.peer.assert_still()
        assert not other.armed
    move_arm_to(cell)


@pytest.mark.invariant(3)
def test_panel_cancels_its_goal_at_exit(cell: Cell, tmp_path: Path) -> None:
    cell.peer.call('disable')
    panel = PanelProcess(tmp_path, cell.domain)
    try:
        client = moving(cell, panel)
        assert panel.process.end(signal.SIGTERM) == 0
        cell.peer.assert_still()
        with pytest.raises(ConnectionError):
            PanelClient(panel.port)
        client.close()
    finally:
        panel.end()
    move_arm_to(cell)


def test_speed_outputs_and_faults_can_be_set(cell: Cell, panel: PanelProcess) -> None:
    with panel.armed() as client:
        client.set('Speed [%]', 40)
        cell.peer.wait_for(lambda: cell.peer.speed_scaling[-1] == 0.4, 'the speed')
        client.set('Switch output', '3')
        client.wait(lambda: client.point(2, 3) == 1, 'output 3 on')
        client.set('Switch output', '3')
        client.wait(lambda: client.point(2, 3) == 0, 'it off')
        client.set('Input', 5)
        client.click('Switch this input')
        client.wait(lambda: client.point(1, 5) == 1, 'input 5 on')
        client.set('Fault', 'delay')
        client.set('Details', 'seconds=nonsense')
        client.click('Start this fault')
        client.wait_for_log('nonsense')
        client.set('Details', 'seconds=0.01 for=1')
        client.click('Start this fault')
        client.wait_for_log('fault: delay seconds=0.01 for=1')
        client.click('Clear all faults')
        client.wait_for_log('faults cleared')
        client.set('Speed [%]', 100)
        cell.peer.wait_for(lambda: cell.peer.speed_scaling[-1] == 1.0, 'the speed')
        client.click('Disarm')
        client.wait(lambda: not client.armed, 'disarmed')


def run(*arguments: str, before: str = '') -> subprocess.CompletedProcess[str]:
    code = f'import sys; {before}\nfrom epson_driver.cli.__main__ import main; sys.exit(main())'
    return subprocess.run(
        [sys.executable, '-c', code, 'panel', *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )


@pytest.mark.quick
def test_port_in_use_is_reported() -> None:
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
        result = run(f'--port={port}')
    assert result.returncode == 1
    assert f'epson_driver panel: port {port} of 127.0.0.1 cannot be opened' in result.stderr
    assert 'choose another port' in result.stderr
    assert 'Traceback' not in result.stderr


@pytest.mark.quick
def test_missing_extra_is_reported_with_install_command() -> None:
    result = run(before='sys.modules["websockets"] = None')
    assert result.returncode == 1
    assert "pip install 'epson_driver[panel]'" in result.stderr
    assert 'make demo ARGS=--panel' in result.stderr


@pytest.mark.quick
@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--port=70000'], '70000'),
        pytest.param(['--host=999.1.1.1'], '999.1.1.1', marks=pytest.mark.slow),
        pytest.param(
            ['--trajectory=/no/such/file.yaml'], '/no/such/file.yaml', marks=pytest.mark.slow
        ),
    ],
)
def test_invalid_argument_is_named(arguments: list[str], message: str) -> None:
    result = run('--port=0', *arguments)
    assert result.returncode in (1, 2)
    assert message in result.stderr
    assert 'Traceback' not in result.stderr


def test_address_for_other_machines_has_a_token(tmp_path: Path) -> None:
    panel = PanelProcess(tmp_path, processes.free_ros_domain(), '--host=0.0.0.0')
    try:
        assert '?token=' in panel.address
        token = panel.address.partition('?token=')[2]
        assert len(token) >= 32
        with pytest.raises(InvalidStatus):
            PanelClient(panel.port)
        cookie = f'epson_driver_panel_{panel.port}={token}'
        PanelClient(panel.port, headers={'Cookie': cookie}).close()
    finally:
        assert panel.end() == 0


def refused_to_arm(client: PanelClient) -> None:
    """Click until the panel knows the robot and asks for --allow-motion. It never arms."""
    while not any('--allow-motion' in notification for notification in client.notifications):
        client.notifications.clear()
        client.click('Arm')
        client.wait(lambda: client.notifications or client.armed, 'an answer')
        assert not client.armed
        time.sleep(0.2)


@pytest.mark.invariant(1)
def test_real_robot_requires_allow_motion(tmp_path: Path) -> None:
    """A robot without a remote port is not known to be simulated."""
    cell = Cell(tmp_path, remote_port=0)
    panels = []
    try:
        cell.ready()
        for number, arguments in enumerate(((), ('--allow-motion',))):
            folder = tmp_path / str(number)
            folder.mkdir()
            panels.append(PanelProcess(folder, cell.domain, *arguments))
        default_panel, motion_panel = panels
        with default_panel.window() as client:
            refused_to_arm(client)
            assert not client.parts['controls']['simulated']
            client.wait_for_lamp('Door', 'unknown')
        with motion_panel.window() as client:
            motion_panel.arm(client)
    finally:
        for panel in panels:
            panel.end()
        cell.close()


@pytest.mark.invariant(1)
def test_restarted_driver_is_queried_again_before_arming(tmp_path: Path) -> None:
    """ROS discovery still lists the killed driver, so the change is not visible there."""
    with closing(Cell(tmp_path)) as cell:
        cell.ready()
        panel = PanelProcess(tmp_path, cell.domain, patience=False)
        try:
            with panel.armed() as client:
                cell.client.kill()
                client.wait(lambda: not client.armed, 'disarmed')
                cell._parameters |= {'remote_port': 0}  # like a real controller
                cell.restart_client()
                refused_to_arm(client)
                client.wait_for_lamp('Link', 'good')
                client.wait_for_lamp('Door', 'unknown')
        finally:
            assert panel.end() == 0


@pytest.mark.invariant(3)
def test_one_panel_shows_and_stops_several_robots(tmp_path: Path) -> None:
    with closing(Fleet(tmp_path, together=True)) as fleet:
        fleet.enabled()
        panel = PanelProcess(tmp_path, fleet.domain)
        try:
            with (
                PanelClient(panel.port, robot='left') as left,
                PanelClient(panel.port, robot='right') as right,
            ):
                for client in (left, right):
                    client.wait_for_lamp('E-stop', 'good')
                    result = {part['label'] for part in client.parts['robots']}
                    assert result == {'left', 'right'}
                for name, peer in fleet.peers.items():
                    peer.goal(trajectory((LASTS, [1.0, *fleet.start[name][1:]])))
                for peer in fleet.peers.values():
                    peer.wait_for_motion()
                left.click('STOP')
                for client, peer in zip((left, right), fleet.peers.values(), strict=True):
                    peer.wait_until_still()
                    client.wait_for_log('~/stop: ')
                fleet.pendant('right', 'estop', 'press')
                right.wait_for_lamp('E-stop', 'bad')
                other = {'label': 'right', 'colour': 'bad'}
                left.wait(
                    lambda: any(other.items() <= part.items() for part in left.parts['robots']),
                    "the other robot's state",
                )
                assert left.lamp('E-stop') == 'good'
                left.show('right')
                left.wait_for_lamp('E-stop', 'bad')
        finally:
            assert panel.end() == 0
