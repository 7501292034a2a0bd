# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node as a process: its parameters, odd ones among them, and its end."""

import itertools
import math
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import (
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from support import patient
from support.cell import START, Cell
from support.ros_peer import PATIENCE, RosPeer, trajectory

from epson_driver.processes import processes
from epson_driver.setup.table import TABLE, joint_rows

PLAIN = ('--motion=ptp', '--state-period=0.02')
"""A controller without a planner, where it does not matter how it moves."""


@pytest.mark.quick
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


@pytest.mark.quick
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


def test_a_client_whose_standard_streams_are_closed_works_and_ends_well(
    make_cell: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its first sockets would be numbers 1 and 2, and what is logged would go into them."""
    closing = ('sh', '-c', 'exec "$@" <&- >&- 2>&-', 'sh')
    monkeypatch.setattr(patient, 'COMMAND', closing + patient.COMMAND)
    cell = make_cell(smoothing='resample').ready()
    descriptors = Path(f'/proc/{cell.client.process_id}/fd')
    assert {str((descriptors / number).readlink()) for number in '012'} == {'/dev/null'}
    cell.peer.enable()
    there = [START[0] + 0.1, *START[1:]]
    assert cell.peer.goal(trajectory((0.0, START), (0.5, there))).result()[0] == 'succeeded'
    cell.client.send(signal.SIGTERM)
    assert cell.client.wait(PATIENCE) == 0


def run_client(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'client', *arguments],
        env=processes.ros_environment(processes.free_ros_domain()),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_where_security_is_asked_for_and_cannot_be_had_the_driver_does_not_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """No keystore, or a middleware built without security (docs/security.md)."""
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    for keystore in (tmp_path / 'none', tmp_path):
        (tmp_path / 'enclaves').mkdir(exist_ok=True)
        monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(keystore))
        assert run_client().returncode == 1


@pytest.mark.parametrize(
    ('setting', 'words'),
    [
        ('byte_order:=middle', ('byte_order', 'middle', 'auto, little, big')),
        pytest.param(
            'robot_model:=c9', ('no robot model c9', 'lists all'), marks=pytest.mark.slow
        ),
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
            ('parameter joint_signs = []', 'must be a list'),
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


OF_TRACES = ('trace_file',)  # a name of a file here makes a file

ROWS = {row.name: row for row in (*TABLE, *joint_rows('joint_1'))}

ODD = (
    ParameterValue(type=0),
    ParameterValue(type=99),
    *(ParameterValue(type=1, bool_value=value) for value in (False, True)),
    *(
        ParameterValue(type=2, integer_value=value)
        for value in (0, -1, 2**31, 2**63 - 1, -(2**63))
    ),
    *(
        ParameterValue(type=3, double_value=value)
        for value in (math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, -5e-324, -0.0, -1.0)
    ),
    *(
        ParameterValue(type=4, string_value=value)
        for value in ('', ' ', 'x' * 100_000, 'a\nb', 'ä🤖', '../x', '1e300', 'nan')
    ),
    ParameterValue(type=5, byte_array_value=[b'\x00', b'\xff']),
    ParameterValue(type=6, bool_array_value=[True]),
    ParameterValue(type=7, integer_array_value=[]),
    ParameterValue(type=7, integer_array_value=[2**63 - 1]),
    ParameterValue(type=8, double_array_value=[math.nan]),
    ParameterValue(type=9, string_array_value=['', '']),
    ParameterValue(type=9, string_array_value=[]),
)

FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value'}


class Values:
    """The node's parameters through its services."""

    def __init__(self, cell: Cell) -> None:
        self._peer = cell.peer
        self._clients = {
            kind: cell.peer.node.create_client(kind, f'/epson_driver/{name}')
            for kind, name in (
                (SetParameters, 'set_parameters'),
                (SetParametersAtomically, 'set_parameters_atomically'),
                (GetParameters, 'get_parameters'),
                (ListParameters, 'list_parameters'),
            )
        }

    def _call(self, request: Any, kind: Any) -> Any:
        client = self._clients[kind]
        assert client.wait_for_service(30.0)
        return self._peer.complete(client.call_async(request))

    def set(self, name: str, values: tuple[ParameterValue, ...]) -> Any:
        parameters = [Parameter(name=name, value=value) for value in values]
        return self._call(SetParameters.Request(parameters=parameters), SetParameters).results

    def set_all(self, name: str, values: tuple[ParameterValue, ...]) -> Any:
        parameters = [Parameter(name=name, value=value) for value in values]
        request = SetParametersAtomically.Request(parameters=parameters)
        return self._call(request, SetParametersAtomically).result

    def get(self, name: str) -> ParameterValue:
        return self._call(GetParameters.Request(names=[name]), GetParameters).values[0]

    def names(self) -> list[str]:
        return list(self._call(ListParameters.Request(), ListParameters).result.names)

    def list_oddly(self) -> None:
        for prefixes, depth in ((['', '.', 'a..b', 'constraints.'], 2**64 - 1), (['x' * 9999], 1)):
            request = ListParameters.Request(prefixes=prefixes, depth=depth)
            self._call(request, ListParameters)


@pytest.mark.invariant(7)
def test_inv7_an_odd_value_is_refused_with_a_reason_and_the_node_goes_on(make_cell: Any) -> None:
    cell = make_cell().ready()
    values = Values(cell)
    for name in values.names():
        if name in OF_TRACES:
            continue
        before = values.get(name)
        row = ROWS.get(name)
        for odd, result in zip(ODD, values.set(name, ODD), strict=True):
            said = f'{name} = {str(odd)[:200]}: {result.reason[:200]}'
            if not result.successful:
                assert result.reason, said
                continue
            assert odd.type == before.type, said
            if row is None:  # use_sim_time and the like
                continue
            assert row.now, said
            value = getattr(odd, FIELDS[odd.type])
            if row.low is not None and row.high is not None:
                assert row.low <= value <= row.high, said
        assert not values.set_all(name, ODD).successful
        held = values.get(name)
        assert held.type == before.type
        if row is not None:
            assert values.set(name, (before,))[0].successful == row.now
    assert values.set('no_such_parameter', ODD[2:4])[0].reason
    values.list_oddly()
    cell.peer.enable()
    assert len(cell.peer.joint_states)
    cell.client.check_alive()
    assert 'Traceback' not in cell.client.log_text()
    assert cell.client.end() == 0
