# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The planner in its process: answers, deaths, and what is left then."""

import asyncio
import os
import signal
import sys
from contextlib import asynccontextmanager
from dataclasses import replace

import numpy as np
import pytest

from epson_driver.motion.smoother import Smoother, plan
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.arm import planner_process
from epson_driver.sim_controller.arm.planner_process import PlannerError, PlannerProcess
from epson_driver.sim_controller.arm.planner_worker import framed

LIMITS = load_robot_model('c3_a601s').limits
PATIENCE = 300.0
SLOW = replace(LIMITS, velocity=0.02 * LIMITS.velocity)


def a_request():
    smoother = Smoother(LIMITS, np.zeros(6), planner=None)
    smoother.append(np.full(6, 0.2), 0.5)
    smoother.append(np.full(6, 0.3), 0.5)
    smoother.finish()
    return smoother.request()


class Told:
    """What a planner has answered, and the failures it has told of."""

    def __init__(self):
        self.answers = []
        self.failures = []

    async def until(self, condition):
        while not condition():  # noqa: ASYNC110  a poll is simple
            await asyncio.sleep(0.01)


@asynccontextmanager
async def planning():
    planner, told = PlannerProcess(LIMITS), Told()
    assert not planner.ready
    async with asyncio.timeout(PATIENCE):
        await planner.start()
        assert planner.ready
        running = asyncio.create_task(planner.run(told.failures.append))
        try:
            yield planner, told
        finally:
            running.cancel()
            await planner.close()


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Have it start again at once, and give it the time that a busy machine needs."""
    monkeypatch.setattr(planner_process, 'PAUSE', 0.0)
    monkeypatch.setattr(planner_process, 'START_TIMEOUT', PATIENCE)
    monkeypatch.setattr(planner_process, 'HUNG', PATIENCE)


def test_its_plans_are_those_of_the_function():
    async def main():
        async with planning() as (planner, told):
            for count in (1, 2, 3):
                planner.ask(a_request(), LIMITS, told.answers.append)
                with pytest.raises(RuntimeError, match='has a request already'):
                    planner.ask(a_request(), LIMITS, told.answers.append)
                await told.until(lambda count=count: len(told.answers) == count)
            expected = plan(a_request(), LIMITS)
            for answer in told.answers:
                np.testing.assert_allclose(answer.knots.position, expected.knots.position)
                assert answer.timing.duration == pytest.approx(expected.timing.duration)
            assert not told.failures
            pid = planner.pid
        assert planner.pid is None
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)

    asyncio.run(main())


def test_its_plans_keep_to_the_limits_they_were_asked_with():
    async def main():
        sizes = []
        async with planning() as (planner, told):
            send = planner._child.send
            planner._child.send = lambda value: (sizes.append(len(framed(value))), send(value))
            order = (LIMITS, SLOW, SLOW, LIMITS, LIMITS)
            for count, limits in enumerate(order, start=1):
                planner.ask(a_request(), limits, told.answers.append)
                await told.until(lambda count=count: len(told.answers) == count)
        for answer, limits in zip(told.answers, order, strict=True):
            expected = plan(a_request(), limits)
            assert answer.timing.duration == pytest.approx(expected.timing.duration)
        assert told.answers[1].timing.duration > 1.2 * told.answers[0].timing.duration
        # limits are sent when they change, and only then
        assert sizes[0] == sizes[2] == sizes[4] < sizes[1] == sizes[3]

    asyncio.run(main())


def test_one_that_was_started_again_knows_the_limits():
    async def main():
        async with planning() as (planner, told):
            planner.ask(a_request(), SLOW, told.answers.append)
            await told.until(lambda: told.answers)
            os.kill(planner.pid, signal.SIGKILL)
            await told.until(lambda: told.failures)
            await told.until(lambda: planner.ready)
            planner.ask(a_request(), SLOW, told.answers.append)
            await told.until(lambda: len(told.answers) == 2)
            first, second = (answer.timing.duration for answer in told.answers)
            assert first == pytest.approx(second)
            assert first == pytest.approx(plan(a_request(), SLOW).timing.duration)

    asyncio.run(main())


def test_a_killed_planner_answers_none_tells_why_and_is_started_again():
    async def main():
        async with planning() as (planner, told):
            os.kill(planner.pid, signal.SIGSTOP)
            planner.ask(a_request(), LIMITS, told.answers.append)
            os.kill(planner.pid, signal.SIGKILL)
            await told.until(lambda: told.failures)
            assert told.answers == [None]
            assert told.failures == ['was ended by SIGKILL']
            await told.until(lambda: planner.ready)
            planner.ask(a_request(), LIMITS, told.answers.append)
            await told.until(lambda: len(told.answers) == 2)
            assert told.answers[1] is not None

    asyncio.run(main())


def test_one_that_does_not_answer_is_killed(monkeypatch):
    monkeypatch.setattr(planner_process, 'HUNG', 0.2)

    async def main():
        async with planning() as (planner, told):
            os.kill(planner.pid, signal.SIGSTOP)
            planner.ask(a_request(), LIMITS, told.answers.append)
            await told.until(lambda: told.failures)
            assert told.answers == [None]
            assert told.failures == ['did not answer for 0.2 s']
            await told.until(lambda: planner.ready)

    asyncio.run(main())


def test_an_error_in_it_is_logged_with_its_words(caplog):
    async def main():
        async with planning() as (planner, told):
            planner.ask('no request', LIMITS, told.answers.append)
            await told.until(lambda: told.failures)
            assert told.failures == ['ended with exit code 1']
            with pytest.raises(RuntimeError, match='not ready'):
                planner.ask(a_request(), LIMITS, told.answers.append)
            await told.until(lambda: planner.ready)

    asyncio.run(main())
    assert "AttributeError: 'str' object has no attribute" in caplog.text


@pytest.mark.parametrize(
    ('interpreter', 'text'),
    [
        ('/nowhere/python', 'cannot be started: .*No such file'),
        ('/bin/false', 'the motion planner ended with exit code 1'),
    ],
)
def test_one_that_cannot_be_started_says_why(monkeypatch, interpreter, text):
    monkeypatch.setattr(sys, 'executable', interpreter)
    with pytest.raises(PlannerError, match=text):
        asyncio.run(PlannerProcess(LIMITS).start())
