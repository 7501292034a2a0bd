# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node as a process: start, parameters, and end."""

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
"""Options of a controller without a planner, for tests that need no smooth motion."""


@pytest.mark.quick
def test_joint_states_exceed_1_hz_and_robot_status_has_its_fields(shared_cell: Cell) -> None:
    """Thesis requirement 1: joint_states at 1 Hz at least, here for every state message."""
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


def test_driver_started_before_the_controller_connects(tmp_path: Path) -> None:
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


def test_client_with_closed_standard_streams_works(
    make_cell: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise its first sockets would get the numbers 1 and 2, and receive the log."""
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


def test_driver_does_not_start_if_required_security_is_unavailable(
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
    ('arguments', 'words'),
    [
        ('--ros-args -p byte_order:=middle', ('byte_order', 'middle', 'auto, little, big')),
        (
            '--namespace=left --namespace=right --ros-args -p robot_model:=c9',
            ('/left/epson_driver: ', '/right/epson_driver: '),
        ),
        ('--namespace=left --namespace=left', ('/left/epson_driver: two robots',)),
        ('--namespace=not-a-name', ('--namespace not-a-name: ', 'nvalid')),
    ],
)
def test_invalid_argument_is_rejected_with_its_name(arguments: str, words: list[str]) -> None:
    run = run_client(*arguments.split())
    assert run.returncode == 1, run.stderr
    for word in words:
        assert word in run.stderr
    assert 'Traceback' not in run.stderr


TRACE_PARAMETERS = ('trace_file',)  # a file name would create a file

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
def test_inv7_odd_parameter_value_is_rejected_and_the_node_continues(make_cell: Any) -> None:
    cell = make_cell().ready()
    values = Values(cell)
    for name in values.names():
        if name in TRACE_PARAMETERS:
            continue
        before = values.get(name)
        row = ROWS.get(name)
        for odd, result in zip(ODD, values.set(name, ODD), strict=True):
            details = f'{name} = {str(odd)[:200]}: {result.reason[:200]}'
            if not result.successful:
                assert result.reason, details
                continue
            assert odd.type == before.type, details
            if row is None:  # for example use_sim_time
                continue
            assert row.now, details
            value = getattr(odd, FIELDS[odd.type])
            if row.low is not None and row.high is not None:
                assert row.low <= value <= row.high, details
        assert not values.set_all(name, ODD).successful
        final = values.get(name)
        assert final.type == before.type
        if row is not None:
            assert values.set(name, (before,))[0].successful == row.now
    assert values.set('no_such_parameter', ODD[2:4])[0].reason
    values.list_oddly()
    cell.peer.enable()
    assert len(cell.peer.joint_states)
    cell.client.check_alive()
    assert 'Traceback' not in cell.client.log_text()
    assert cell.client.end() == 0
