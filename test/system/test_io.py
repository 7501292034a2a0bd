# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's I/O through ROS: `~/io_states`, `~/read_io`, `~/write_io`."""

import threading
from collections.abc import Iterator
from typing import Any

import pytest
from epson_msgs.msg import IoPoint, IoStates
from epson_msgs.srv import ReadIo, WriteIo
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from support.cell import Cell
from support.ros_peer import PATIENCE
from support.spin_thread import SpinThread

DI, DO = IoPoint.DIGITAL_INPUT, IoPoint.DIGITAL_OUTPUT
AO, GO = IoPoint.ANALOG_OUTPUT, IoPoint.GROUP_OUTPUT


class IoPeer:
    """A program that uses the I/O and records every IoStates message."""

    def __init__(self, domain: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain)
        self._node = Node('io_peer', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._changed = threading.Condition()
        self.states: list[IoStates] = []
        self._node.create_subscription(
            IoStates,
            '/epson_driver/io_states',
            self._keep,
            QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        )
        self._read = self._node.create_client(ReadIo, '/epson_driver/read_io')
        self._write = self._node.create_client(WriteIo, '/epson_driver/write_io')
        self._thread = SpinThread(self._executor)
        self._thread.start()

    def close(self) -> None:
        self._thread.end()
        self._node.destroy_node()
        self._context.shutdown()

    def _keep(self, message: IoStates) -> None:
        with self._changed:
            self.states.append(message)
            self._changed.notify_all()

    def wait_for(self, condition: Any, meaning: str) -> None:
        with self._changed:
            assert self._changed.wait_for(condition, PATIENCE), meaning

    def wait_until_valid(self) -> None:
        self.wait_for(lambda: self.states and self.states[-1].valid, 'values of the I/O')

    def value(self, io_type: int, index: int) -> int | None:
        """Return a point's value in the newest message, or None while it is unknown."""
        values = [
            area.values[index - area.start]
            for area in self.states[-1].ranges
            if area.type == io_type and area.start <= index < area.start + len(area.values)
        ]
        return values[0] if values else None

    def read(self, *addresses: tuple[int, int]) -> ReadIo.Response:
        points = [IoPoint(type=io_type, index=index) for io_type, index in addresses]
        return self._call(self._read, ReadIo.Request(points=points))

    def write(self, *settings: tuple[int, int, int]) -> WriteIo.Response:
        points = [
            IoPoint(type=io_type, index=index, value=value) for io_type, index, value in settings
        ]
        return self._call(self._write, WriteIo.Request(points=points))

    def _call(self, client: Any, request: Any) -> Any:
        assert client.wait_for_service(PATIENCE)
        done = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _future: done.set())
        assert done.wait(PATIENCE)
        return future.result()


@pytest.fixture
def make_io_peer() -> Iterator[Any]:
    peers: list[IoPeer] = []

    def make(domain: int) -> IoPeer:
        peers.append(IoPeer(domain))
        return peers[-1]

    yield make
    for peer in peers:
        peer.close()


def test_io_states_are_published_on_change_and_points_read_and_written(
    cell: Cell, make_io_peer: Any
) -> None:
    peer = make_io_peer(cell.domain)
    peer.wait_until_valid()
    assert peer.states[-1].message == ''
    assert peer.states[-1].header.stamp.sec > 0
    assert peer.value(DI, 3) == 0
    cell.pendant('io', 'DI', '3', 'on')
    peer.wait_for(lambda: peer.value(DI, 3) == 1, 'the input')

    answer = peer.write((DO, 0, 1), (GO, 1, 0x81), (AO, 1, -1500))
    assert answer.success, answer.message
    peer.wait_for(lambda: peer.value(DO, 0) == peer.value(DO, 15) == 1, 'the outputs')
    answer = peer.read((DO, 8), (AO, 1), (DI, 3), (GO, 1000))
    assert answer.success, answer.message
    assert [point.value for point in answer.points] == [1, -1500, 1, 0x8101]

    answer = peer.write((DO, 1, 1), (DO, 16, 1), (DI, 0, 1), (DO, 2, 7))
    assert not answer.success
    assert answer.message == 'DO 16 = 1: the controller has 0 to 15 (and 2 more)'
    results = [point.result for point in answer.points]
    assert results == [
        IoPoint.SUCCESS,
        IoPoint.INDEX_OUT_OF_RANGE,
        IoPoint.TYPE_FEATURE_UNSUPPORTED,
        IoPoint.VALUE_OUT_OF_RANGE,
    ]
    assert [point.message for point in answer.points] == [
        '',
        'DO 16 = 1: the controller has 0 to 15',
        'DI 0 = 1: an input cannot be written',
        'DO 2 = 7: must be 0 or 1',
    ]
    assert peer.read((DO, 1)).points[0].value == 1

    late = make_io_peer(cell.domain)  # latched: a late subscriber gets the newest
    late.wait_until_valid()
    assert late.value(DI, 3) == 1


@pytest.mark.invariant(6)
def test_estop_and_lost_controller_invalidate_the_values(
    make_cell: Any, make_io_peer: Any
) -> None:
    """The invalid state is published once with its reason, which services report, too."""
    cell: Cell = make_cell(io_timeout=1.0).ready()
    peer = make_io_peer(cell.domain)
    peer.wait_until_valid()
    cell.pendant('estop', 'press')
    peer.wait_for(lambda: not peer.states[-1].valid, 'invalid values')
    assert not peer.states[-1].ranges
    assert 'its I/O server is stopped' in peer.states[-1].message
    answer = peer.write((DO, 0, 1))
    assert not answer.success
    assert 'refused' in answer.message
    assert answer.points[0].message == answer.message
    assert answer.points[0].result == IoPoint.NOT_ASKED
    cell.pendant('estop', 'release')
    cell.pendant('reset')
    peer.wait_until_valid()

    seen = len(peer.states)
    cell.controller.kill()
    peer.wait_for(lambda: not peer.states[-1].valid, 'invalid values')
    assert 'no I/O link' in peer.states[-1].message
    answer = peer.read((DI, 0))
    assert not answer.success
    assert f'127.0.0.1:{cell.ports.io}' in answer.message
    cell.restart_controller()
    peer.wait_until_valid()
    assert [state.valid for state in peer.states[seen:]] == [False, True]
