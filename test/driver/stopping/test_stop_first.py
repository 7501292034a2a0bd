# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A controller that may resume old points on connection receives STOP first."""

import asyncio
import struct

import pytest
from support.driver_harness import Harness, ScriptedController, frame, pose, scripted_cell
from support.event_loop import until
from support.fault_play import cell_of, make_ready, standing, where

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.delivery.delivery import DeliveryRules
from epson_driver.driver.stopping import stopper
from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.faults.fault_kinds import parse
from epson_driver.simple_message import ByteOrder
from epson_driver.simple_message.motoman import Command, Result

MOTOMAN = DeliveryRules(point_message='joint_traj_pt_full', motoman=True)
POINTS = DeliveryRules()
MOTION_CTRL, MOTION_REPLY = 2001, 2002


class Motoman(ScriptedController):
    """Answers MOTION_CTRL like MotoROS, and STOP_MOTION with `result`.

    `connections` has a list of received commands for each connection.
    """

    def __init__(self):
        super().__init__()
        self.connections = []
        self.result = Result.SUCCESS

    async def _motion(self, reader, writer):
        self.motion = writer
        commands = []
        self.connections.append(commands)
        while True:
            (length,) = struct.unpack('<i', await reader.readexactly(4))
            body = await reader.readexactly(length)
            msg_type = struct.unpack_from('<i', body)[0]
            assert msg_type == MOTION_CTRL, msg_type
            group, sequence, command = struct.unpack_from('<3i', body, 12)
            commands.append(command)
            stop = command == Command.STOP_MOTION
            result = self.result if stop else Result.SUCCESS
            if command == Command.START_SERVOS:
                self.status = self.STATUS
            values = (group, sequence, command, result, 0)
            writer.write(frame(MOTION_REPLY, 3, 1, struct.pack('<5i40x', *values)))


@pytest.mark.invariant(4)
async def test_inv4_motoman_receives_stop_motion_first_on_every_connection():
    """MotoROS keeps its queue without a client and resumes it on the next connection."""
    async with (
        Motoman() as controller,
        Harness(controller.ports, delivery=MOTOMAN, motors='motoman') as harness,
    ):
        for count in (1, 2, 3):
            await until(
                lambda count=count: (
                    len(controller.connections) == count and controller.connections[-1]
                )
            )
            await harness.ready()
            assert controller.connections[-1][0] == Command.STOP_MOTION
            await harness.commands.enable()
            controller.motion.close()
            await until(lambda: harness.gate is not None)


@pytest.mark.invariant(4)
@pytest.mark.parametrize('status', [False, True], ids=['no state', 'STATUS alone'])
async def test_inv4_motion_link_to_motoman_waits_until_stop_motion_can_be_encoded(status):
    async with Motoman() as controller:
        controller.shows_joints, controller.shows_status = False, status
        async with Harness(
            controller.ports,
            delivery=MOTOMAN,
            motors='motoman',
            usual_byte_order=ByteOrder.BIG,
        ) as harness:
            await until(lambda: harness.driver.state_link.connected)
            await until(lambda: harness.driver.state_link.statistics.frames_received or not status)
            why = r'sends no STATUS|waiting for joints, which show the byte order'
            with pytest.raises(CommandError, match=why):
                await harness.commands.enable()
            assert controller.connections == []
            controller.shows_joints = controller.shows_status = True
            await until(lambda: controller.connections and controller.connections[0])
            assert controller.connections[0][0] == Command.STOP_MOTION


@pytest.mark.invariant(4)
async def test_inv4_motoman_stays_at_rest_if_its_state_link_returns_last():
    async with cell_of(load_controller_profile('motoman')) as (harness, controller, _):
        await make_ready(harness, controller)
        await harness.commands.enable()
        goal = harness.submit(*(pose(angle / 10.0) for angle in range(1, 11)), step=0.3)
        await until(lambda: where(controller)[0] > 0.3)
        for fault in ('cut for=0.5 port=motion', 'cut for=0.9 port=state'):
            controller.faults.start(parse(fault))
        assert 'link was lost' in (await goal.end()).text
        await standing(controller)
        rest = where(controller)
        await until(lambda: harness.driver.motion_link.connected)
        await asyncio.sleep(0.5)
        assert abs(where(controller) - rest).max() < 1e-9


class WrongByteOrder(Motoman):
    """Sends its state in the wrong byte order while `wrong`, and its replies in the right one."""

    wrong = True

    async def _state(self, _reader, writer):
        self.state = writer
        order = '>' if self.wrong else '<'
        joints = struct.pack(f'{order}4i', 56, 10, 1, 0) + bytes(44)
        status = struct.pack(f'{order}11i', 40, 13, 1, 0, *self.STATUS)
        while not writer.is_closing():
            writer.write(joints + status)
            await writer.drain()
            await asyncio.sleep(0.005)


@pytest.mark.invariant(4)
async def test_inv4_stop_in_a_wrong_byte_order_is_repeated_on_a_new_connection(monkeypatch):
    """A Motoman that did not understand STOP_MOTION still has its queue."""
    # an unanswered STOP must not be the reason for the new connection
    for name in ('ANSWER_TIMEOUT_S', 'UNCONFIRMED_REST_TIME_S'):
        monkeypatch.setattr(stopper, name, 1e9)

    async with (
        WrongByteOrder() as controller,
        Harness(controller.ports, delivery=MOTOMAN, motors='motoman') as harness,
    ):
        link = harness.driver.motion_link
        await until(lambda: link.statistics.frames_sent)
        assert controller.connections == [[]]  # it waits for the rest of a long message
        controller.wrong = False
        controller.state.close()
        await until(lambda: len(controller.connections) == 2 and controller.connections[1])
        assert controller.connections[1][0] == Command.STOP_MOTION
        await until(lambda: link.connected)
        await harness.ready()
        await harness.commands.enable()
        assert len(controller.connections) == 2


@pytest.mark.invariant(4)
async def test_inv4_servos_stay_off_until_stop_motion_succeeds():
    """With servos on, Motoman would execute a queue that STOP_MOTION has not cleared."""
    async with Motoman() as controller:
        controller.status = (0, *Motoman.STATUS[1:])  # drives_powered
        controller.result = Result.MP_FAILURE
        async with Harness(controller.ports, delivery=MOTOMAN, motors='motoman') as harness:
            await harness.ready()
            with pytest.raises(CommandError, match=r'refused STOP.*MP_FAILURE'):
                await harness.commands.enable()
            assert set(controller.connections[0]) == {Command.STOP_MOTION}
            controller.result = Result.SUCCESS
            await harness.commands.enable()
            assert controller.connections[0][-1] == Command.START_SERVOS


@pytest.mark.invariant(4)
async def test_inv4_old_points_are_stopped_when_the_link_returns():
    """FANUC's and ABB's programs execute the points they have unless STOP arrives."""
    async with scripted_cell(lambda _: b'', delivery=POINTS) as (harness, controller):
        goal = harness.submit(harness.at + 0.1)
        await until(lambda: controller.received == [0])
        controller.motion.close()
        await goal.end()
        await until(lambda: len(controller.received) > 1)
        assert controller.received[1] == -4
        assert harness.gate is not None


async def test_controller_without_old_points_receives_no_stop_on_connection():
    async with scripted_cell(delivery=POINTS) as (_, controller):
        assert controller.received == []
