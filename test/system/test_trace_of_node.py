# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Traces of the real node, recorded by its parameters."""

from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from support.cell import START, Cell
from support.ros_peer import RosPeer, trajectory

from epson_driver.link.connection import WireEvent
from epson_driver.trace.recording import read_recording

TARGET = [0.2, 0.0, 0.3, 0.1, -0.6, 0.1]
SENT = WireEvent.SENT


def set_parameter(peer: RosPeer, name: str, value: Any) -> Any:
    client = AsyncParameterClient(peer.node, 'epson_driver')
    peer.wait_for(client.services_are_ready, 'parameter services')
    response = peer.complete(client.set_parameters([Parameter(name, value=value)]))
    return response.results[0]


def plan() -> Any:
    return trajectory((0.0, START), (0.3, TARGET), (0.6, START))


def test_trace_records_a_goal_until_the_parameter_is_cleared(
    make_cell: Any, tmp_path: Path
) -> None:
    cell: Cell = make_cell(trace_folder=tmp_path, trace_file='run-%Y.pcap').ready()
    cell.peer.enable()
    ended, _, text = cell.peer.goal(plan()).result()
    assert ended == 'succeeded', text
    assert set_parameter(cell.peer, 'trace_file', '').successful
    cell.peer.wait_for(lambda: 'trace_file was cleared' in cell.client.log_text(), 'its end')
    [path] = tmp_path.glob('run-2*.pcap')
    points = sum(step.event is SENT for step in read_recording(path))
    assert points >= 3


def test_invalid_trace_file_is_rejected_and_trace_size_respected(
    make_cell: Any, tmp_path: Path
) -> None:
    path = tmp_path / 'traces' / 'a.pcap'
    cell: Cell = make_cell(trace_folder=path.parent).ready()
    peer = cell.peer
    for outside in (str(tmp_path / 'a.pcap'), '../a.pcap', '~nosuchuser/x', '~', '.', '%D'):
        result = set_parameter(peer, 'trace_file', outside)
        assert not result.successful
        assert 'trace_file must be the name of a file' in result.reason
    elsewhere = set_parameter(peer, 'trace_folder', str(tmp_path))
    assert not elsewhere.successful
    assert 'read-only' in elsewhere.reason
    assert set_parameter(peer, 'trace_file', path.name).successful
    again = set_parameter(peer, 'trace_file', path.name)
    assert not again.successful
    assert 'File exists' in again.reason
    assert set_parameter(peer, 'trace_size', 0.02).successful
    peer.wait_for(lambda: 'maximum size, 0.02 MB' in cell.client.log_text(), 'its size')
    assert 20_000 <= path.stat().st_size < 40_000
    steps = read_recording(path)
    servers = {step.server[1] for step in steps}
    assert {cell.ports.motion, cell.ports.state} <= servers
    count = len(peer.joint_states)
    peer.wait_for(lambda: len(peer.joint_states) > count, 'more joint states')


def test_node_s_end_completes_the_trace(make_cell: Any, tmp_path: Path) -> None:
    path = tmp_path / 'a.pcap'
    cell: Cell = make_cell(trace_folder=tmp_path, trace_file=path.name).ready()
    assert cell.client.end() == 0
    steps = read_recording(path)
    closed = {step.server[1] for step in steps if step.event is WireEvent.CLOSED}
    assert {cell.ports.motion, cell.ports.state} <= closed
    assert 'the driver ended' in cell.client.log_text()
