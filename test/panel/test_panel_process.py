# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The panel beside a real driver and a simulated controller, all processes of their own."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip('websockets')

from support.cell import LASTS, START, Cell, cell_with
from support.fleet import Fleet
from support.panel_client import PanelClient, PanelProcess
from support.ros_peer import PATIENCE, trajectory
from websockets.exceptions import InvalidStatus

from epson_driver.processes import processes
from epson_driver.processes.interrupt import ENDING

SENT = 'goal sent: swing'


@pytest.fixture(scope='module')
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    found = Cell(tmp_path_factory.mktemp('cell'))
    try:
        yield found.ready()
    finally:
        found.close()


@pytest.fixture(scope='module')
def shared(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelProcess]:
    found = PanelProcess(tmp_path_factory.mktemp('panel'), cell.domain)
    yield found
    assert found.end() == 0


@pytest.fixture
def panel(shared: PanelProcess, cell: Cell) -> Iterator[PanelProcess]:
    """The panel, with the arm disabled, at rest where it began."""
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
    """Press Enable and wait for the lamp: of many answers the driver logs only some."""
    client.wait_for_lamp('Arm gate', 'warn')
    client.click('Enable')
    client.wait_for_lamp('Arm gate', 'good')


def goals_sent(client: PanelClient) -> int:
    """Return how many goals the log tells of."""
    return sum(SENT in line for line in client.log)


def back(cell: Cell, start: list[float] = START) -> None:
    """Bring the controller's arm to where the swing begins, or elsewhere: it is another one."""
    cell.controller.end()
    cell.restart_controller(start)
    cell.peer.wait_until_ready()


def test_it_shows_the_robot(cell: Cell, panel: PanelProcess) -> None:
    with panel.window() as client:
        client.wait(lambda: len((client.parts.get('pose') or {}).get('tool', [])) == 6, 'a pose')
        assert client.parts['arm']['packed']['meshes']
        assert client.parts['controls']['joints'][-1] == 'joint_6'
        client.wait_for_lamp('Mode', 'good')
        client.wait_for_lamp('E-stop', 'good')
        client.wait_for_lamp('Door', 'good')
        client.wait_for_lamp('Arm gate', 'warn')
        assert '→ press Enable' in client.advice
        assert client.point(1, 0) == 0


@pytest.mark.invariant(6)
def test_an_estop_turns_the_lamp_and_says_what_to_do(cell: Cell, panel: PanelProcess) -> None:
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


@pytest.mark.quick
@pytest.mark.invariant(1)
def test_nothing_moves_until_the_window_is_armed(cell: Cell, panel: PanelProcess) -> None:
    cell.peer.enable()
    with panel.window() as client:
        for label in ('Enable', 'Reset error', 'Execute', 'Go to its start, slowly'):
            client.notifications.clear()
            client.click(label)
            client.wait_for_notification('not armed')
        for name, value in (('Tasks', 'continue'), ('Motors', 'on'), ('Speed [%]', 50)):
            client.notifications.clear()
            client.set(name, value)
            client.wait_for_notification('not armed')
        cell.peer.assert_still()
        assert set(cell.peer.speed_scaling) <= {1.0}


@pytest.mark.invariant(1)
def test_one_window_cannot_press_the_buttons_of_another(cell: Cell, panel: PanelProcess) -> None:
    cell.peer.enable()
    with panel.armed(), panel.window() as other:
        for label in ('Execute', 'Go to its start, slowly'):
            other.click(label)
        other.click('Arm')
        other.wait_for_notification('another window of the panel is armed')
        cell.peer.assert_still()


@pytest.mark.invariant(3)
def test_any_window_stops_the_arm_at_once(cell: Cell, panel: PanelProcess) -> None:
    with moving(cell, panel) as client, panel.window() as other:
        other.click('STOP')
        client.wait_for_log('swing: ', after=SENT)
        cell.peer.assert_still()
        client.wait_for_log('~/stop: ', after=SENT)
    back(cell)


@pytest.mark.invariant(3)
def test_a_window_that_is_gone_takes_its_goal_with_it(cell: Cell, panel: PanelProcess) -> None:
    moving(cell, panel).close()
    with panel.window() as other:
        other.wait_for_log('the armed window of the panel is gone', after=SENT)
        other.wait_for_log('swing: ', after=SENT)
        cell.peer.assert_still()
        assert not other.armed
    back(cell)


@pytest.mark.invariant(3)
def test_a_page_that_hangs_takes_its_goal_with_it_though_its_connection_stays(
    cell: Cell, panel: PanelProcess
) -> None:
    with moving(cell, panel) as client:
        client.freeze()
        client.wait_for_log('the armed window is frozen, hidden or cut off', after=SENT)
        client.wait_for_log('swing: ', after=SENT)
        cell.peer.assert_still()
        client.click('Arm')
        client.wait_for_notification('no sign of life')
    back(cell)


@pytest.mark.invariant(3)
@pytest.mark.parametrize(
    'number', [signal.SIGHUP, *(pytest.param(each, marks=pytest.mark.slow) for each in ENDING[:3])]
)
def test_a_panel_that_ends_takes_its_goal_with_it(
    cell: Cell, tmp_path: Path, number: signal.Signals
) -> None:
    cell.peer.call('disable')
    panel = PanelProcess(tmp_path, cell.domain)
    try:
        client = moving(cell, panel)
        assert panel.process.end(number) == 0
        cell.peer.assert_still()
        with pytest.raises(ConnectionError):
            PanelClient(panel.port)
        client.close()
    finally:
        panel.end()
    back(cell)


@pytest.mark.invariant(6)
def test_a_controller_that_vanishes_turns_the_lamps_and_disarms(
    cell: Cell, panel: PanelProcess
) -> None:
    with panel.armed() as client:
        before = client.newest_log()
        cell.controller.kill()
        client.wait_for_lamp('Link', 'bad')
        client.wait_for_lamp('Door', 'unknown')
        client.wait_for_log('panel disarmed', after=before)
        client.wait(lambda: not client.armed, 'disarmed')
        cell.restart_controller()
        cell.peer.wait_until_ready()
        client.wait_for_lamp('Link', 'good')
        client.wait_for_lamp('Door', 'good')
        assert not client.armed


def test_speed_outputs_and_faults(cell: Cell, panel: PanelProcess) -> None:
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


@pytest.mark.invariant(3)
@pytest.mark.parametrize('end', ['silence', 'release', 'a closed window', 'disarming'])
def test_what_is_moved_by_hand_stops_with_the_hand(
    end: str, cell: Cell, panel: PanelProcess
) -> None:
    with panel.armed() as client:
        enable(client)
        began = cell.peer.position()[0]
        until = time.monotonic() + PATIENCE
        while cell.peer.position()[0] < began + 0.005:
            assert time.monotonic() < until, client.log
            client.ask('jog', axis='1', frame='world', share=0.1)
            time.sleep(0.03)
        if end == 'release':
            client.ask('jog', share=0)
        elif end == 'a closed window':
            client.close()
        elif end == 'disarming':
            client.click('Disarm')
        cell.peer.wait_until_still()
        cell.peer.assert_still()
    back(cell)


@pytest.mark.slow
def test_a_goal_from_elsewhere_in_the_room_is_refused_at_the_wrong_place(
    cell: Cell, panel: PanelProcess
) -> None:
    back(cell, [0.5, *START[1:]])
    with panel.armed() as client:
        enable(client)
        client.click('Execute')
        client.wait_for_notification('28.6° away from the start of swing: go there first')
        client.click('Go to its start, slowly')
        client.wait_for_log('to the start of swing: at the goal')
        assert abs(cell.peer.position()[0]) < 0.02


@pytest.mark.slow
def test_windows_that_come_and_go_disturb_nobody(panel: PanelProcess) -> None:
    """Their controls are made and refreshed while they vanish."""
    with panel.window() as client:
        for number in range(60):
            window = PanelClient(panel.port)
            if number % 3:
                window.wait(lambda window=window: 'lamps' in window.parts, 'a part of it')
            if number % 3 == 2:
                window.wait(lambda window=window: 'history' in window.parts, 'the rest')
            window.close()
        client.click('Arm')
        client.wait(lambda: client.armed, 'armed')
        client.click('Disarm')


def test_no_other_page_gets_in(panel: PanelProcess) -> None:
    for origin in ('http://evil.example', None):
        with pytest.raises(InvalidStatus) as refused:
            PanelClient(panel.port, origin)
        assert refused.value.response.status_code == 403


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
def test_a_taken_port_is_an_error_with_a_sentence(panel: PanelProcess) -> None:
    found = run(f'--port={panel.port}')
    assert found.returncode == 1
    assert f'epson_driver panel: port {panel.port} of 127.0.0.1 cannot be opened' in found.stderr
    assert '--port' in found.stderr
    assert 'Traceback' not in found.stderr


@pytest.mark.quick
def test_without_the_extra_it_says_how_to_get_it() -> None:
    found = run(before='sys.modules["websockets"] = None')
    assert found.returncode == 1
    assert "pip install 'epson_driver[panel]'" in found.stderr
    assert 'make demo ARGS=--panel' in found.stderr


@pytest.mark.quick
@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['--port=70000'], '70000'),
        pytest.param(['--host=999.1.1.1'], '999.1.1.1', marks=pytest.mark.slow),
        pytest.param(
            ['--trajectory=/no/such/file.yaml'], '/no/such/file.yaml', marks=pytest.mark.slow
        ),
    ],
)
def test_bad_arguments_are_named(arguments: list[str], said: str) -> None:
    found = run('--port=0', *arguments)
    assert found.returncode in (1, 2)
    assert said in found.stderr
    assert 'Traceback' not in found.stderr


@pytest.mark.slow
def test_beyond_this_machine_the_address_has_a_token(tmp_path: Path) -> None:
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


@pytest.mark.slow
@pytest.mark.invariant(1)
def test_a_robot_that_may_be_real_is_moved_only_if_the_panel_may(tmp_path: Path) -> None:
    """Without a remote port nobody says that it is simulated."""
    cell = Cell(tmp_path, remote_port=0)
    panels = []
    try:
        cell.ready()
        for number, arguments in enumerate(((), ('--allow-motion',))):
            folder = tmp_path / str(number)
            folder.mkdir()
            panels.append(PanelProcess(folder, cell.domain, *arguments))
        careful, bold = panels
        with careful.window() as client:
            client.click('Arm')
            client.wait_for_notification('--allow-motion')
            assert not client.armed
            assert not client.parts['controls']['simulated']
            client.wait_for_lamp('Door', 'unknown')
        with bold.window() as client:
            client.click('Arm')
            client.wait(lambda: client.armed, 'armed')
    finally:
        for panel in panels:
            panel.end()
        cell.close()


@pytest.mark.slow
@pytest.mark.invariant(3, 4)
def test_the_program_for_real_controllers_is_driven_in_the_same_way(tmp_path: Path) -> None:
    """Its E-stop aborts the program: what the panel shows next, the restarted program sends."""
    cell = cell_with(tmp_path, 'spel')
    try:
        cell.ready()
        panel = PanelProcess(tmp_path, cell.domain)
        try:
            with moving(cell, panel) as client:
                client.click('STOP')
                client.wait_for_log('swing: ', after=SENT)
                cell.peer.assert_still()
                client.set('E-stop', 'press')
                client.wait_for_lamp('E-stop', 'bad')
                client.wait(lambda: 'release the E-stop' in client.advice, 'advice')
                client.set('E-stop', 'release')
                client.wait_for_log('pendant: E-stop release')
                panel.arm(client)
                client.click('Reset error')
                client.wait_for_lamp('E-stop', 'good')
                cell.peer.assert_still()
                panel.arm(client)
                enable(client)
                client.wait_for_lamp('Arm gate', 'good')
        finally:
            assert panel.end() == 0
    finally:
        cell.close()


@pytest.mark.slow
@pytest.mark.invariant(1)
def test_a_driver_that_comes_back_for_another_controller_is_asked_again(tmp_path: Path) -> None:
    """ROS takes the driver that was killed for present yet, and nothing says that it changed."""
    cell = Cell(tmp_path)
    try:
        cell.ready()
        panel = PanelProcess(tmp_path, cell.domain, patience=False)
        try:
            with panel.armed() as client:
                cell.client.kill()
                client.wait(lambda: not client.armed, 'disarmed')
                cell._parameters |= {'remote_port': 0}  # as with a real controller
                cell.restart_client()
                while not any('--allow-motion' in each for each in client.notifications):
                    client.notifications.clear()
                    client.click('Arm')
                    client.wait(lambda: client.notifications or client.armed, 'an answer')
                    assert not client.armed
                    time.sleep(0.2)
                client.wait_for_lamp('Link', 'good')
                client.wait_for_lamp('Door', 'unknown')
        finally:
            assert panel.end() == 0
    finally:
        cell.close()


@pytest.mark.slow
@pytest.mark.invariant(3)
def test_several_robots_are_in_one_panel_and_one_stop_is_for_all(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path, together=True, names=('left', 'right'))
    try:
        fleet.enabled()
        panel = PanelProcess(tmp_path, fleet.domain)
        try:
            with (
                PanelClient(panel.port, robot='left') as left,
                PanelClient(panel.port, robot='right') as right,
            ):
                for client in (left, right):
                    client.wait_for_lamp('E-stop', 'good')
                    found = {each['label'] for each in client.parts['robots']}
                    assert found == {'left', 'right'}
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
                    lambda: any(other.items() <= each.items() for each in left.parts['robots']),
                    'the other window is told',
                )
                assert left.lamp('E-stop') == 'good'
                left.show('right')
                left.wait_for_lamp('E-stop', 'bad')
        finally:
            assert panel.end() == 0
    finally:
        fleet.close()
