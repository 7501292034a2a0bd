# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""I/O of an RC800 by Real-time Motion Control."""

import asyncio

import pytest
from support.driver_harness import cell, options_of, pose
from support.event_loop import until

from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.driver.outcome import End
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.condition.states import Event
from epson_driver.simple_message import IoAddress, IoSetting, IoType

PROFILE = load_controller_profile('rtmc')
OPTIONS = options_of(PROFILE) | {'state_period': PROFILE.state.period, 'io': PROFILE.io}
DI, DO = IoType.DIGITAL_INPUT, IoType.DIGITAL_OUTPUT
GI, GO = IoType.GROUP_INPUT, IoType.GROUP_OUTPUT


def states(harness):
    return {(item.io_type, item.start): item.values for item in harness.driver.io.states}


async def test_points_and_groups_are_read_written_and_polled():
    async with cell(profile=PROFILE, **OPTIONS) as (harness, controller):
        io = harness.driver.io
        settings = [IoSetting(DO, 3, 1), IoSetting(GO, 1, 0xA5), IoSetting(DO, 16, 1)]
        good, group, beyond = await io.write(settings)
        assert not good.text
        assert not group.text
        assert 'the controller has 0 to 15' in beyond.text
        values = (controller.io.read_port(DO, 0, 16), 0xA508)
        assert values[0] == values[1]
        controller.io.set_input_port(1, 8, 0x41)
        answers = await io.read([IoAddress(DO, 3), IoAddress(GO, 1000), IoAddress(GI, 1)])
        assert [answer.value for answer in answers] == [1, 0xA508, 0x41]
        await until(lambda: states(harness).get((GI, 0), ())[:2] == (0, 0x41))
        assert states(harness)[DO, 0][3] == 1


async def test_requests_during_a_motion_are_refused_with_the_reason():
    async with cell(profile=PROFILE, **OPTIONS) as (harness, controller):
        io = harness.driver.io
        goal = harness.submit(pose(0.3))
        await harness.until_moving()
        (answer,) = await io.write([IoSetting(DO, 3, 1)])
        assert 'the arm moves' in answer.text
        await until(lambda: 'the arm moves' in io.reason)
        assert controller.io.read_port(DO, 0, 16) == 0
        assert (await goal.end()).end is End.SUCCEEDED
        await until(lambda: io.states)


async def test_refusal_of_the_controller_and_lost_link_are_reported():
    async with cell(profile=PROFILE, **OPTIONS) as (harness, controller):
        controller.apply(Event.ESTOP_PRESS)
        (answer,) = await harness.driver.io.write([IoSetting(DO, 3, 1)])
        assert 'E-stop' in answer.text
        harness.driver.motion_link.reconnect('a test')
        await asyncio.sleep(0.01)
        with pytest.raises(IoUnavailableError, match='real-time motion: rtmc link is'):
            await harness.driver.io.read([IoAddress(DI, 0)])
