# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What fails in any part of the client's process ends it, once, with all arms stopped."""

import asyncio
import gc
import logging

import pytest

from epson_driver.node import client_process
from epson_driver.node.client_process import Failures, _drive, _tell_ends


@pytest.fixture
def failures():
    loop = asyncio.new_event_loop()
    yield Failures(loop), loop
    loop.close()


@pytest.mark.invariant(9)
def test_a_failure_is_told_once_however_many_ways_it_comes(failures, caplog):
    told, loop = failures
    error = ZeroDivisionError('made for this test')
    told.in_loop(loop, {'message': 'a task failed', 'exception': error})
    told.tell('the same again', error)
    assert told.happened.is_set()
    (record,) = caplog.records
    assert record.levelno == logging.CRITICAL
    assert record.getMessage() == 'a task failed: all arms are stopped, and the driver ends'


def test_what_asyncio_only_warns_of_ends_nothing(failures, caplog):
    told, loop = failures
    told.in_loop(loop, {'message': 'socket.send() raised exception.'})
    assert not told.happened.is_set()
    assert 'socket.send()' in caplog.text


@pytest.mark.invariant(9)
def test_a_thread_that_fails_after_the_loop_has_ended_is_told_all_the_same(caplog):
    loop = asyncio.new_event_loop()
    told = Failures(loop)
    loop.close()
    told.in_thread('the thread rclpy ended', ZeroDivisionError('made for this test'))
    assert told.happened.is_set()
    assert 'the thread rclpy ended' in caplog.text


@pytest.mark.invariant(9)
def test_a_driver_that_ends_by_itself_is_a_failure_whichever_way_it_ends(caplog):
    async def ended():
        pass

    async def failed():
        raise ZeroDivisionError('made for this test')

    async def scenario():
        told = Failures(asyncio.get_running_loop())
        forever = asyncio.create_task(asyncio.sleep(3600.0))
        _tell_ends([forever], told)
        assert not told.happened.is_set()
        tasks = [asyncio.create_task(each()) for each in (ended, failed)]
        await asyncio.wait(tasks)
        forever.cancel()
        await asyncio.wait([forever])
        _tell_ends([*tasks, forever], told)
        assert told.happened.is_set()

    asyncio.run(scenario())
    told = [record.getMessage().partition(':')[0] for record in caplog.records]
    assert told == ['a driver ended', 'a driver ended', 'a driver was cancelled']
    assert 'nobody asked for it' in caplog.text
    assert 'made for this test' in caplog.text


class Ros:
    """The thread that serves ROS."""

    def start(self):
        pass


class Client:
    """A client whose arm cannot be stopped."""

    def __init__(self, error):
        self._error = error

    async def run(self):
        await asyncio.sleep(3600.0)

    async def shut_down(self):
        raise self._error


@pytest.mark.invariant(3, 9)
@pytest.mark.parametrize(
    ('error', 'failed'),
    [(ZeroDivisionError('made for this test'), True), (TimeoutError(), False)],
)
def test_an_arm_that_could_not_be_stopped_is_told(monkeypatch, caplog, error, failed):
    """A TimeoutError says only that results may not have been published."""

    def made(_nodes, clients, _make):
        clients.append(Client(error))
        return True

    monkeypatch.setattr(client_process, '_make_clients', made)

    async def scenario():
        told, signaled = Failures(asyncio.get_running_loop()), asyncio.Event()
        signaled.set()
        assert await _drive([], [], Ros(), signaled, told) == 0
        assert told.happened.is_set() == failed

    try:
        asyncio.run(scenario())
    finally:
        gc.unfreeze()
    assert ('stopping an arm failed' in caplog.text) == failed


@pytest.mark.parametrize('error', [RuntimeError, ValueError])
def test_a_parameter_of_ros_itself_that_cannot_be_is_said(monkeypatch, capfd, error):
    def fails(*_, **__):
        raise error('use_sim_time: must be a bool')

    monkeypatch.setattr(client_process, 'Node', fails)
    nodes = []
    assert not client_process._make_nodes(['left'], nodes, 'epson_driver')
    assert nodes == []
    assert 'use_sim_time: must be a bool' in capfd.readouterr().err
