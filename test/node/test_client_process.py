# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A failure in any part of the client's process stops all arms and ends the process once."""

import asyncio
import gc
import logging

import pytest

from epson_driver.node import client_process
from epson_driver.node.client_process import Failures, _drive, _report_ended, _unused_files


@pytest.fixture
def failures():
    loop = asyncio.new_event_loop()
    yield Failures(loop), loop
    loop.close()


@pytest.mark.invariant(9)
def test_repeated_failure_is_logged_once(failures, caplog):
    reporter, loop = failures
    error = ZeroDivisionError('made for this test')
    reporter.in_loop(loop, {'message': 'a task failed', 'exception': error})
    reporter.report('the same again', error)
    assert reporter.happened.is_set()
    (record,) = caplog.records
    assert record.levelno == logging.CRITICAL
    assert record.getMessage() == 'a task failed: stopping all arms and the driver'


def test_asyncio_warning_does_not_end_the_process(failures, caplog):
    reporter, loop = failures
    reporter.in_loop(loop, {'message': 'socket.send() raised exception.'})
    assert not reporter.happened.is_set()
    assert 'socket.send()' in caplog.text


@pytest.mark.invariant(9)
def test_thread_failure_after_the_loop_s_end_is_logged(caplog):
    loop = asyncio.new_event_loop()
    reporter = Failures(loop)
    loop.close()
    reporter.in_thread('the thread rclpy ended', ZeroDivisionError('made for this test'))
    assert reporter.happened.is_set()
    assert 'the thread rclpy ended' in caplog.text


def test_parameter_file_without_a_section_for_the_nodes_is_reported(tmp_path):
    file = tmp_path / 'cell.yaml'
    file.write_text('other:\n  ros__parameters: {robot_ip: 127.0.0.2}\n')
    words = ['client', '--ros-args', '--params-file', str(file)]
    (sentence,) = _unused_files(words, ['/epson_driver'])
    assert sentence.endswith('it has parameters for /other, not for /epson_driver')
    assert not list(_unused_files(words, ['/epson_driver', '/other']))


@pytest.mark.invariant(9)
def test_driver_task_that_ends_is_a_failure(caplog):
    async def ended():
        pass

    async def failed():
        raise ZeroDivisionError('made for this test')

    async def scenario():
        reporter = Failures(asyncio.get_running_loop())
        forever = asyncio.create_task(asyncio.sleep(3600.0))
        _report_ended([forever], reporter)
        assert not reporter.happened.is_set()
        tasks = [asyncio.create_task(function()) for function in (ended, failed)]
        await asyncio.wait(tasks)
        forever.cancel()
        await asyncio.wait([forever])
        _report_ended([*tasks, forever], reporter)
        assert reporter.happened.is_set()

    asyncio.run(scenario())
    messages = [record.getMessage().partition(':')[0] for record in caplog.records]
    assert messages == ['a driver ended', 'a driver ended', 'a driver was cancelled']
    assert '(internal) unexpected task exit' in caplog.text
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
def test_failed_stop_at_shutdown_is_reported(monkeypatch, caplog, error, failed):
    """A TimeoutError is no failure: it only means that results may be unpublished."""

    def make(_nodes, clients, _make):
        clients.append(Client(error))
        return True

    monkeypatch.setattr(client_process, '_make_clients', make)

    async def scenario():
        reporter, signaled = Failures(asyncio.get_running_loop()), asyncio.Event()
        signaled.set()
        assert await _drive([], [], Ros(), signaled, reporter) == 0
        assert reporter.happened.is_set() == failed

    try:
        asyncio.run(scenario())
    finally:
        gc.unfreeze()
    assert ('stopping an arm failed' in caplog.text) == failed


@pytest.mark.parametrize('error', [RuntimeError, ValueError])
def test_invalid_ros_parameter_is_reported(monkeypatch, capfd, error):
    def fails(*_, **__):
        raise error('use_sim_time: must be a bool')

    monkeypatch.setattr(client_process, 'Node', fails)
    nodes = []
    assert not client_process._make_nodes(['left'], nodes, 'epson_driver')
    assert nodes == []
    assert 'use_sim_time: must be a bool' in capfd.readouterr().err
