# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A gripper with two outputs and two inputs at the simulated controller's I/O."""

import asyncio
import contextlib
from dataclasses import replace

import pytest
from support.driver_harness import Harness, simulated
from support.event_loop import now, until
from support.two_jaws import TwoJaws

from epson_driver.driver.io.gripper import Gripper
from epson_driver.driver.io.gripper_wiring import GripperError, GripperState, GripperWiring
from epson_driver.sim_controller.condition.states import Event

WIRING = GripperWiring(
    open_output=2, close_output=3, opened_input=4, closed_input=5, stroke=0.08, time=2.0
)
OPENED, CLOSED = GripperState(True, False), GripperState(False, True)
HOLDS = GripperState(False, False)


@contextlib.asynccontextmanager
async def cell(**options):
    """Yield a gripper, its jaws and the simulated controller."""
    async with (
        simulated() as (controller, ports),
        Harness(ports, io_port=ports.io) as harness,
    ):
        jaws = TwoJaws(controller, WIRING, **options)
        await until(lambda: harness.driver.io.states)
        yield Gripper(harness.driver.io, WIRING), jaws, controller


async def test_gripper_opens_and_closes_and_reports_its_state():
    async with cell() as (gripper, jaws, _):
        assert await gripper.state() == CLOSED
        start = now()
        assert await gripper.move(opened=True) == OPENED
        assert jaws.travel <= now() - start < jaws.travel + 0.2
        assert await gripper.move(opened=True) == OPENED
        assert await gripper.move(opened=False) == CLOSED
        assert [state.position(0.08) for state in (OPENED, CLOSED, HOLDS)] == [0.08, 0, 0.04]


async def test_gripper_reports_a_held_object_after_the_timeout():
    async with cell() as (gripper, jaws, _):
        await gripper.move(opened=True)
        jaws.part = True
        start = now()
        assert await gripper.move(opened=False) == HOLDS
        assert now() - start == pytest.approx(WIRING.time, abs=0.2)


@pytest.mark.invariant(9)
async def test_inv9_stuck_jaws_are_an_error_with_the_missing_input():
    async with cell() as (gripper, jaws, _):
        jaws.stuck = True
        with pytest.raises(GripperError, match=r'DI 4 \(opened\) did not come on within 2 s'):
            await gripper.move(opened=True)
        jaws.stuck = False
        await gripper.move(opened=False)
        await gripper.move(opened=True)
        jaws.stuck = True
        with pytest.raises(GripperError, match=r'DI 5 \(closed\) did not .* it is open'):
            await gripper.move(opened=False)


async def test_newer_gripper_command_replaces_a_waiting_one():
    async with cell() as (gripper, _, _):
        opening = asyncio.create_task(gripper.move(opened=True))
        await asyncio.sleep(0.1)
        assert await gripper.move(opened=False) == CLOSED
        with pytest.raises(GripperError, match='replaced by a newer command'):
            await opening


@pytest.mark.invariant(9)
async def test_inv9_lost_io_is_an_error_of_move_and_state():
    async with cell() as (gripper, _, controller):
        controller.apply(Event.ESTOP_PRESS)
        with pytest.raises(GripperError, match='outputs of the gripper were not set: '):
            await gripper.move(opened=True)
        with pytest.raises(GripperError, match='inputs of the gripper are not known: '):
            await gripper.state()


async def test_gripper_with_both_inputs_on_is_a_wiring_error():
    async with cell() as (gripper, jaws, controller):
        jaws.stuck = True
        for index in (4, 5):
            controller.io.set_input(1, index, 1)
        with pytest.raises(GripperError, match='both on: check the wiring'):
            await gripper.move(opened=True)


async def test_gripper_outputs_are_never_both_on():
    async with cell() as (gripper, jaws, _):
        for opened in (True, False, True):
            await gripper.move(opened=opened)
        assert (True, True) not in jaws.seen
        assert {(True, False), (False, True)} <= set(jaws.seen)


@pytest.mark.parametrize(
    ('wrong', 'expected'),
    [
        ({'open_output': -1}, 'open_output = -1: must be a whole number from 0'),
        ({'close_output': 2}, 'open_output = close_output = 2: must be different'),
        ({'closed_input': 4}, 'opened_input = closed_input = 4: must be different'),
        ({'stroke': 0.0}, 'stroke = 0.0: must be a number from 0.0001 to 2 m'),
        ({'time': float('nan')}, 'time = nan: must be a number'),
    ],
)
def test_invalid_wiring_is_refused(wrong, expected):
    valid = {name: getattr(WIRING, name) for name in WIRING.__dataclass_fields__}
    with pytest.raises(ValueError, match=expected):
        GripperWiring(**valid | wrong)


@pytest.mark.invariant(9)
@pytest.mark.parametrize(
    ('wiring', 'reason'),
    [
        (replace(WIRING, opened_input=999), 'the inputs of the gripper are not known: '),
        (replace(WIRING, open_output=999), 'the outputs of the gripper were not set: '),
    ],
)
async def test_inv9_points_missing_at_the_controller_are_an_error(wiring, reason):
    async with cell() as (gripper, _, _):
        miswired = Gripper(gripper._io, wiring)
        with pytest.raises(GripperError, match=f'{reason}.*999'):
            await miswired.move(opened=True)
