# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Drivers that share a process log under their node's name."""

import asyncio
import logging
import threading

import pytest

from epson_driver.node.ros_process import RosLogHandler, context_of


class Logger:
    def __init__(self):
        self.lines = []

    def __getattr__(self, severity):
        return lambda text: self.lines.append((severity, text))


@pytest.fixture
def made():
    """Return a Python logger, and the ROS logger for records without a node."""
    log, default = logging.getLogger('test_ros_log'), Logger()
    handler = RosLogHandler(default)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    yield log, default
    log.removeHandler(handler)


@pytest.mark.parametrize('severity', ['debug', 'info', 'warning', 'error'])
def test_ros_log_preserves_the_severity(made, severity):
    log, default = made
    getattr(log, severity)('text %d', 1)
    assert default.lines == [(severity, 'text 1')]


def test_ros_log_escapes_control_characters(made):
    log, default = made
    log.warning('it errors %s', '\x1b[2J\x07\n[INFO] forged')
    assert default.lines == [('warning', r'it errors \x1b[2J\x07\n[INFO] forged')]


def test_tasks_and_callbacks_log_under_their_node(made):
    log, default = made
    loggers = [Logger(), Logger()]

    async def work(text):
        log.info(text)
        await asyncio.sleep(0)
        await asyncio.create_task(child(text))

    async def child(text):
        log.info('child of %s', text)

    async def scenario():
        loop = asyncio.get_running_loop()
        contexts = [context_of(logger) for logger in loggers]
        tasks = [
            loop.create_task(work(str(number)), context=context)
            for number, context in enumerate(contexts)
        ]
        await asyncio.gather(*tasks)
        from_outside = threading.Thread(
            target=lambda: loop.call_soon_threadsafe(log.info, 'called', context=contexts[1])
        )
        from_outside.start()
        await asyncio.to_thread(from_outside.join)
        await asyncio.sleep(0)
        log.info('default')

    asyncio.run(scenario())
    assert loggers[0].lines == [('info', '0'), ('info', 'child of 0')]
    assert loggers[1].lines == [('info', '1'), ('info', 'child of 1'), ('info', 'called')]
    assert default.lines == [('info', 'default')]


def test_failed_record_goes_to_stderr_with_the_reason(made, capsys):
    log, default = made
    default.warning = None  # like after the context's shutdown
    log.warning('the link is lost')
    errors = capsys.readouterr().err
    assert 'TypeError' in errors
    assert 'the link is lost' in errors
