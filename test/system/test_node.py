# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node as a ROS user finds it: names, rates, parameters, start order, byte order."""

import itertools
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from support import patient
from support.cell import START, Cell
from support.ros_peer import RosPeer, trajectory

from epson_driver.cli import processes

PLAIN = ('--motion=ptp', '--state-period=0.02')
"""A controller without a planner, where it does not matter how it moves."""


def test_rates_and_fields(shared_cell: Cell) -> None:
    """Thesis requirement 1: joint_states at 1 Hz at least. Here every state message is one."""
    peer = shared_cell.peer
    seen = len(peer.joint_states)
    statuses = len(peer.robot_status)
    peer.wait_for(lambda: len(peer.joint_states) >= seen + 200, 'joint states')
    joints, status = len(peer.joint_states) - seen, len(peer.robot_status) - statuses
    assert 8.0 < joints / status < 12.5  # ten joint messages, then a status
    stamps = [s.header.stamp.sec + s.header.stamp.nanosec * 1e-9 for s in peer.joint_states[seen:]]
    assert all(late >= early for early, late in itertools.pairwise(stamps))
    assert joints / (stamps[-1] - stamps[0]) > 1.0
    newest = peer.robot_status[-1]
    assert newest.mode.val == 2
    assert newest.e_stopped.val == 0
    assert newest.drives_powered.val == 1
    assert newest.motion_possible.val == 1
    assert newest.in_motion.val == 0
    assert newest.in_error.val == 0
    assert list(newest.error_codes) == []


def test_diagnostics(shared_cell: Cell) -> None:
    peer = shared_cell.peer
    seen = len(peer.diagnostics)
    peer.wait_for(lambda: len(peer.diagnostics) > seen + 1, 'diagnostics')
    found = {status.name: status for status in peer.diagnostics[-1].status}
    assert set(found) == {
        'epson_driver: state link',
        'epson_driver: motion link',
        'epson_driver: io link',
        'epson_driver: arm',
    }
    for status in found.values():
        assert status.level == b'\x00', status
        assert status.hardware_id.startswith('127.0.0.1')
    values = {value.key: value.value for value in found['epson_driver: state link'].values}
    assert float(values['frame rate [Hz]']) > 1.0
    assert values['bad frames'] == '0'
    assert values['reconnects'] == '0'
    assert float(values['uptime [s]']) > 0.0
    values = {value.key: value.value for value in found['epson_driver: arm'].values}
    assert float(values['joint state rate [Hz]']) > 1.0
    assert float(values['joint state longest gap [ms]']) > 0.0
    assert values['arm gate'] == 'open'


def test_start_order_does_not_matter(tmp_path: Path) -> None:
    probe = processes.sim_controller(tmp_path / 'probe.log', *PLAIN)
    ports = probe.ports()
    assert probe.end() == 0
    domain = processes.free_ros_domain()
    client = processes.client(tmp_path / 'client.log', ports, domain, run=patient.COMMAND)
    peer = RosPeer(domain)
    try:
        peer.wait_for(lambda: peer.link_states, 'link_state')
        peer.wait_for(lambda: len(peer.robot_status) >= 2, 'robot_status without a controller')
        assert peer.robot_status[-1].mode.val == -1
        assert not peer.joint_states
        success, message = peer.call('enable')
        assert not success
        assert f'127.0.0.1:{ports.state}' in message
        controller = processes.sim_controller(tmp_path / 'controller.log', *PLAIN, ports=ports)
        with processes.ended_at_exit(controller):
            peer.wait_until_ready()
            peer.enable()
    finally:
        peer.close()
        assert client.end() == 0


@pytest.mark.parametrize('byte_order', ['auto', pytest.param('big', marks=pytest.mark.slow)])
def test_big_endian_controller(make_cell: Any, byte_order: str) -> None:
    cell = make_cell('--byte-order=big', byte_order=byte_order).ready()
    cell.peer.enable()
    there = [START[0] + 0.1, *START[1:]]
    assert cell.peer.goal(trajectory((0.0, START), (0.5, there))).result()[0] == 'succeeded'


def run_client(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'client', *arguments],
        env=processes.ros_environment(processes.free_ros_domain()),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    ('setting', 'words'),
    [
        ('byte_order:=middle', ('byte_order', 'middle', 'auto, little, big')),
        pytest.param('robot_model:=c9', ('c9.yaml', 'c3_a601s'), marks=pytest.mark.slow),
        pytest.param('motion_port:=70000', ('motion_port', '70000'), marks=pytest.mark.slow),
        pytest.param(
            'joint_names:=[a, b]', ('joint_names', '2 names', '6 joints'), marks=pytest.mark.slow
        ),
        pytest.param('state_timeout:=0.0', ('state_timeout', '0.0'), marks=pytest.mark.slow),
        pytest.param('motion_port:=eleven', ('motion_port', 'eleven'), marks=pytest.mark.slow),
        pytest.param(
            'robot_ip:=a..b',
            ("parameter robot_ip = 'a..b'", 'must be an IP address'),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            'robot_ip:=' + 'x' * 64,
            ('parameter robot_ip', 'must be an IP address'),
            marks=pytest.mark.slow,
        ),
        ('joint_names:=[]', ('parameter joint_names = []', 'must be a list of names')),
        pytest.param(
            'joint_signs:=[]',
            ('parameter joint_signs = []', 'needs one number'),
            marks=pytest.mark.slow,
        ),
        ('robot_ip:=', ('Failed to parse ROS arguments', 'robot_ip')),
    ],
)
def test_wrong_parameter_is_refused_with_its_name(setting: str, words: tuple[str, ...]) -> None:
    run = run_client('--ros-args', '-p', setting)
    assert run.returncode == 1, run.stderr
    for word in words:
        assert word in run.stderr
    assert 'Traceback' not in run.stderr


def test_a_folder_is_no_robot_model(tmp_path: Path) -> None:
    folder = tmp_path / 'arm.yaml'
    folder.mkdir()
    run = run_client('--ros-args', '-p', f'robot_model:={folder}')
    assert run.returncode == 1
    assert f'parameter robot_model = {str(folder)!r}: {folder}: is a folder, not a' in run.stderr
    assert 'Traceback' not in run.stderr


@pytest.mark.slow
def test_namespace_gives_each_robot_its_own_names(tmp_path: Path) -> None:
    domain = processes.free_ros_domain()
    running: list[processes.Process] = []
    peers: list[RosPeer] = []
    try:
        for index, name in enumerate(('left', 'right')):
            start = f'{0.1 * (index + 1)},0,0,0,0,0'
            log = tmp_path / f'{name}.log'
            controller = processes.sim_controller(log, *PLAIN, f'--start={start}')
            running.append(controller)
            ports = controller.ports()
            arguments = ['--ros-args', '-r', f'__ns:=/{name}']
            for port in ('motion', 'state', 'io', 'remote'):
                arguments += ['-p', f'{port}_port:={getattr(ports, port)}']
            environment = processes.ros_environment(domain)
            running.append(
                processes.Process(
                    *('client', arguments, tmp_path / f'{name}_c.log', environment),
                    run=patient.COMMAND,
                )
            )
            peers.append(RosPeer(domain, prefix=f'/{name}'))
        for index, peer in enumerate(peers):
            peer.wait_until_ready()
            assert abs(peer.position()[0] - 0.1 * (index + 1)) < 1e-6
        peers[0].enable()
        here = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
        goal = peers[0].goal(trajectory((0.0, here), (0.5, [0.3, *here[1:]])))
        assert goal.result()[0] == 'succeeded'
        assert abs(peers[1].assert_still()[0] - 0.2) < 1e-6
    finally:
        for peer in peers:
            peer.close()
        for process in running:
            process.end()
