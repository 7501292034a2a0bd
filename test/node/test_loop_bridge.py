# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every service call gets a reply, also after errors and after the driver's end."""

import asyncio

import pytest
from std_srvs.srv import Trigger
from support.request_harness import Made, done

from epson_driver.node.loop_bridge import DriverEndedError


@pytest.fixture
def made():
    made = Made()
    yield made
    made.loop.close()


@pytest.mark.invariant(9)
def test_failing_service_reports_the_error_and_stops_the_arm(made):
    async def serve(_request, _response):
        raise ZeroDivisionError('made for this test')

    made.bridge.create_service(Trigger, '~/enable', serve)
    answer = done(made.node.served['~/enable'](Trigger.Request(), Trigger.Response()))
    why = '~/enable failed: ZeroDivisionError: made for this test'
    assert not answer.success
    assert answer.message == f'{why}, the arm is stopped and disabled, see the log'
    made.turn()
    assert made.faults == [why]
    ((severity, text),) = made.node.log.lines
    assert severity == 'error'
    assert 'Traceback' in text


@pytest.mark.invariant(9)
def test_replies_report_that_the_driver_has_ended(made):
    async def late(_request, _response):
        return await made.bridge.in_loop(lambda: asyncio.sleep(0))

    async def failing(_request, _response):
        raise ZeroDivisionError

    made.bridge.create_service(Trigger, 'late', late)
    made.bridge.create_service(Trigger, 'failing', failing)
    made.end()
    answers = {
        name: done(serve(Trigger.Request(), Trigger.Response()))
        for name, serve in made.node.served.items()
    }
    assert not any(answer.success for answer in answers.values())
    assert answers['late'].message == 'the driver has ended'
    assert answers['failing'].message.endswith(', the driver has ended')
    with pytest.raises(DriverEndedError):
        made.bridge.to_loop(print)
    with pytest.raises(DriverEndedError):
        made.bridge.create_future()


@pytest.mark.invariant(9)
def test_request_dropped_with_its_executor_is_no_failure(made):
    async def serve(_request, _response):
        return await made.bridge.wait_for(made.bridge.create_future())

    made.bridge.create_service(Trigger, '~/stop', serve)
    waiting = made.node.served['~/stop'](Trigger.Request(), Trigger.Response())
    waiting.send(None)
    waiting.close()
    made.turn()
    assert made.faults == []


@pytest.mark.invariant(5)
def test_future_resolves_once_and_at_the_driver_s_end_at_the_latest(made):
    first, second = made.bridge.create_future(), made.bridge.create_future()
    made.bridge.resolve(first, 'an answer')
    made.bridge.resolve(first, 'another')
    assert first.result() == 'an answer'
    made.end()
    assert isinstance(second.result(), DriverEndedError)
    with pytest.raises(DriverEndedError):
        done(made.bridge.wait_for(second))
