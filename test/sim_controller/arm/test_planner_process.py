# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner process: answers, failures, restart and the latency estimate."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
from contextlib import asynccontextmanager
from dataclasses import replace

import numpy as np
import pytest

from epson_driver.motion.smoother import Smoother, plan
from epson_driver.processes.command import module_command
from epson_driver.processes.worker import packed
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm import planner_process
from epson_driver.sim_controller.arm.planner_process import PlannerError, PlannerProcess
from epson_driver.sim_controller.arm.streaming import (
    INITIAL_LATENCY_S,
    MAX_LATENCY_S,
    MAX_RECENT_PLANS,
    MIN_LATENCY_S,
    PlanningLatency,
)

LIMITS = load_robot_model('c3_a601s').limits
TIMEOUT_S = 300.0
SLOW = replace(LIMITS, velocity=0.02 * LIMITS.velocity)


def new_request():
    smoother = Smoother(LIMITS, np.zeros(6), planner=None)
    smoother.append(np.full(6, 0.2), 0.5)
    smoother.append(np.full(6, 0.3), 0.5)
    smoother.finish()
    return smoother.request()


class Recorder:
    """The answers of a planner and its reported failures."""

    def __init__(self):
        self.answers = []
        self.failures = []

    async def until(self, condition):
        while not condition():  # noqa: ASYNC110  a poll is simple
            await asyncio.sleep(0.01)


@asynccontextmanager
async def planning():
    planner, recorder = PlannerProcess(LIMITS), Recorder()
    assert not planner.ready
    async with asyncio.timeout(TIMEOUT_S):
        await planner.start()
        assert planner.ready
        running = asyncio.create_task(planner.run(recorder.failures.append))
        try:
            yield planner, recorder
        finally:
            running.cancel()
            await planner.close()


@pytest.fixture(autouse=True)
def no_delays(monkeypatch):
    """Restart without delay, with timeouts for a busy machine."""
    monkeypatch.setattr(planner_process, 'RESTART_DELAY_S', 0.0)
    monkeypatch.setattr(planner_process, 'START_TIMEOUT_S', TIMEOUT_S)
    monkeypatch.setattr(planner_process, 'PLAN_TIMEOUT_S', TIMEOUT_S)
    monkeypatch.setattr(planner_process, 'EXIT_TIMEOUT_S', TIMEOUT_S)


def test_process_returns_the_same_plan_as_the_function():
    async def main():
        async with planning() as (planner, recorder):
            for count in (1, 2, 3):
                planner.ask(new_request(), LIMITS, recorder.answers.append)
                with pytest.raises(RuntimeError, match='already has a request'):
                    planner.ask(new_request(), LIMITS, recorder.answers.append)
                await recorder.until(lambda count=count: len(recorder.answers) == count)
            expected = plan(new_request(), LIMITS)
            for answer in recorder.answers:
                np.testing.assert_allclose(answer.knots.position, expected.knots.position)
                assert answer.timing.duration == pytest.approx(expected.timing.duration)
            assert not recorder.failures
            pid = planner.pid
        assert planner.pid is None
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)

    asyncio.run(main())


def test_plan_respects_the_limits_of_its_request(monkeypatch):
    async def main():
        sizes = []

        def recorded(value):
            data = packed(value)
            sizes.append(len(data))
            return data

        async with planning() as (planner, recorder):
            monkeypatch.setattr(planner_process, 'packed', recorded)
            order = (LIMITS, SLOW, SLOW, LIMITS, LIMITS)
            for count, limits in enumerate(order, start=1):
                planner.ask(new_request(), limits, recorder.answers.append)
                await recorder.until(lambda count=count: len(recorder.answers) == count)
        for answer, limits in zip(recorder.answers, order, strict=True):
            expected = plan(new_request(), limits)
            assert answer.timing.duration == pytest.approx(expected.timing.duration)
        assert recorder.answers[1].timing.duration > 1.2 * recorder.answers[0].timing.duration
        # limits are sent only when they change
        assert sizes[0] == sizes[2] == sizes[4] < sizes[1] == sizes[3]

    asyncio.run(main())


def test_restarted_planner_receives_the_limits():
    async def main():
        async with planning() as (planner, recorder):
            planner.ask(new_request(), SLOW, recorder.answers.append)
            await recorder.until(lambda: recorder.answers)
            os.kill(planner.pid, signal.SIGKILL)
            await recorder.until(lambda: recorder.failures)
            await recorder.until(lambda: planner.ready)
            planner.ask(new_request(), SLOW, recorder.answers.append)
            await recorder.until(lambda: len(recorder.answers) == 2)
            first, second = (answer.timing.duration for answer in recorder.answers)
            assert first == pytest.approx(second)
            assert first == pytest.approx(plan(new_request(), SLOW).timing.duration)

    asyncio.run(main())


def test_killed_planner_answers_none_and_restarts():
    async def main():
        async with planning() as (planner, recorder):
            os.kill(planner.pid, signal.SIGSTOP)
            planner.ask(new_request(), LIMITS, recorder.answers.append)
            os.kill(planner.pid, signal.SIGKILL)
            await recorder.until(lambda: recorder.failures)
            assert recorder.answers == [None]
            assert recorder.failures == ['was ended by SIGKILL']
            await recorder.until(lambda: planner.ready)
            planner.ask(new_request(), LIMITS, recorder.answers.append)
            await recorder.until(lambda: len(recorder.answers) == 2)
            assert recorder.answers[1] is not None

    asyncio.run(main())


def test_unresponsive_planner_is_killed(monkeypatch):
    monkeypatch.setattr(planner_process, 'PLAN_TIMEOUT_S', 0.2)

    async def main():
        async with planning() as (planner, recorder):
            os.kill(planner.pid, signal.SIGSTOP)
            planner.ask(new_request(), LIMITS, recorder.answers.append)
            await recorder.until(lambda: recorder.failures)
            assert recorder.answers == [None]
            assert recorder.failures == ['did not reply within 0.2 s']
            await recorder.until(lambda: planner.ready)

    asyncio.run(main())


def test_exception_in_the_planner_is_logged(caplog):
    async def main():
        async with planning() as (planner, recorder):
            planner.ask('no request', LIMITS, recorder.answers.append)
            await recorder.until(lambda: recorder.failures)
            assert recorder.failures == ['ended with exit code 1']
            with pytest.raises(RuntimeError, match='not ready'):
                planner.ask(new_request(), LIMITS, recorder.answers.append)
            await recorder.until(lambda: planner.ready)

    asyncio.run(main())
    assert "AttributeError: 'str' object has no attribute" in caplog.text


@pytest.mark.parametrize(
    ('interpreter', 'text'),
    [
        ('/nowhere/python', 'cannot be started: .*No such file'),
        ('/bin/false', 'the motion planner ended with exit code 1'),
    ],
)
def test_failed_start_raises_an_error_with_the_reason(monkeypatch, interpreter, text):
    monkeypatch.setattr(sys, 'executable', interpreter)
    with pytest.raises(PlannerError, match=text):
        asyncio.run(PlannerProcess(LIMITS).start())


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('script', 'text'),
    [
        ('exec sleep 60', 'the motion planner did not start within 0.2 s'),
        ('exec >&-; exec sleep 60', 'the motion planner closed its pipe'),
        ('exit 4', 'the motion planner ended with exit code 4'),
        (
            'printf %016d 0; exec sleep 60',
            'the motion planner sent a value of 3472328297036144736',
        ),
        (
            r"printf '\1\0\0\0\2\0\0\0\0\0\0\0\0\0\0\0{}'; exec sleep 60",
            'the motion planner sent 18 bytes without a value',
        ),
    ],
)
def test_inv9_planner_that_never_reports_ready_is_reported_and_ended(
    monkeypatch, tmp_path, caplog, script, text
):
    """The first start raises an error. A later failure is logged and retried."""
    python = tmp_path / 'python'
    python.write_text(f'#!/bin/sh\necho $$ > {tmp_path}/pid\n{script}\n')
    python.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(python))
    if script == 'exec sleep 60':
        monkeypatch.setattr(planner_process, 'START_TIMEOUT_S', 0.2)
    if not script.startswith('exit'):
        monkeypatch.setattr(planner_process, 'EXIT_TIMEOUT_S', 0.1)

    async def check():
        planner = PlannerProcess(LIMITS)
        with pytest.raises(PlannerError, match=text):
            await planner.start()
        assert not planner.ready
        assert text not in caplog.text
        running = asyncio.create_task(planner.run(lambda _: None))
        async with asyncio.timeout(TIMEOUT_S):
            while text not in caplog.text:  # noqa: ASYNC110  a poll is simple
                await asyncio.sleep(0.01)
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running
        await planner.close()

    asyncio.run(check())


@pytest.mark.slow
def test_planner_without_a_controller_exits_silently():
    worker = module_command(planner_process.WORKER)
    ended = subprocess.run(worker, stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, b'', b'')


def test_latency_follows_the_recent_plans():
    latency = PlanningLatency()
    assert latency.value == INITIAL_LATENCY_S
    for _ in range(MAX_RECENT_PLANS):
        latency.took(0.02)
    assert latency.value == pytest.approx(0.026)
    for _ in range(MAX_RECENT_PLANS // 4):
        latency.took(0.05)
    assert latency.value == pytest.approx(0.065)


def test_one_slow_plan_in_25_does_not_raise_the_latency():
    latency = PlanningLatency()
    for number in range(4 * MAX_RECENT_PLANS):
        latency.took(0.08 if number % 25 == 24 else 0.01)
    assert latency.value == pytest.approx(0.013)


def test_late_plan_raises_the_latency():
    latency = PlanningLatency()
    latency.took(0.041, late=True)
    assert latency.value == pytest.approx(0.06)
    latency.took(0.041, late=True)
    assert latency.value == pytest.approx(0.09)


@pytest.mark.parametrize(('seconds', 'value'), [(0.0, MIN_LATENCY_S), (5.0, MAX_LATENCY_S)])
def test_latency_stays_within_bounds(seconds, value):
    latency = PlanningLatency()
    for _ in range(MAX_RECENT_PLANS):
        latency.took(seconds, late=seconds > 0.0)
    assert latency.value == value
