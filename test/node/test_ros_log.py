# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Drivers that share a process log under the name of their own node."""

import asyncio
import logging
import threading

import pytest

from epson_driver.node.ros_log import RosLogHandler, context_of


class Logger:
    def __init__(self):
        self.lines = []

    def __getattr__(self, severity):
        return lambda text: self.lines.append((severity, text))


@pytest.fixture
def made():
    """Return a Python logger, and the ROS logger that has what belongs to nobody."""
    log, nobody = logging.getLogger('test_ros_log'), Logger()
    handler = RosLogHandler(nobody)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    yield log, nobody
    log.removeHandler(handler)


@pytest.mark.parametrize('severity', ['debug', 'info', 'warning', 'error'])
def test_severities_stay(made, severity):
    log, nobody = made
    getattr(log, severity)('text %d', 1)
    assert nobody.lines == [(severity, 'text 1')]


def test_what_a_controller_sent_does_nothing_to_the_terminal(made):
    log, nobody = made
    log.warning('it said %s', '\x1b[2J\x07\n[INFO] forged')
    assert nobody.lines == [('warning', r'it said \x1b[2J\x07\n[INFO] forged')]


def test_tasks_and_callbacks_of_two_nodes_in_one_loop(made):
    log, nobody = made
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
        log.info('nobody')

    asyncio.run(scenario())
    assert loggers[0].lines == [('info', '0'), ('info', 'child of 0')]
    assert loggers[1].lines == [('info', '1'), ('info', 'child of 1'), ('info', 'called')]
    assert nobody.lines == [('info', 'nobody')]


def test_a_record_that_cannot_be_written_goes_to_stderr_with_the_reason(made, capsys):
    log, nobody = made
    nobody.warning = None  # as after the context was shut down
    log.warning('the link is lost')
    said = capsys.readouterr().err
    assert 'TypeError' in said
    assert 'the link is lost' in said
