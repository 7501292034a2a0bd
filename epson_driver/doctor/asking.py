# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Requests to a controller whose motors are off. None of them can move anything.

They still have side effects. They occupy the only place of a motion client. A rejected point may
leave an error. A program that serves only one client, and only once, must be restarted afterwards.
They are therefore sent only with the user's permission.
"""

import asyncio
from contextlib import AsyncExitStack

from epson_driver.doctor.findings import Findings
from epson_driver.doctor.listening import Conversation, NoConnectionError, conversation
from epson_driver.doctor.state_facts import Facts, latest_joints, latest_status
from epson_driver.driver.inhibit import MAIN_ENDED, Inhibit, device_inhibit, flags_inhibit
from epson_driver.error_texts import ErrorTexts
from epson_driver.remote_ethernet.answers import ask_control_device, ask_flags
from epson_driver.remote_ethernet.client import HungUpError, RemoteError, logged_in
from epson_driver.simple_message import (
    IoType,
    JointPosition,
    JointTrajPt,
    MotionReply,
    Packet,
    SpecialSequence,
    TriState,
    joint_data,
)
from epson_driver.simple_message.io_messages import IoInfo, IoInfoReply

REPLY_TIMEOUT_S = 5.0
SILENCE_S = 2.0
"""Maximum wait for a reply that the controller may never send, s."""

ADMISSION_TIMEOUT_S = 3.0
MAX_CLIENTS = 20

SLOW_VELOCITY = 0.01
SLOW_DURATION_S = 5.0

RESTART = 'start the program on the controller again'

IO_KEYS = {
    IoType.DIGITAL_INPUT: 'digital_inputs',
    IoType.DIGITAL_OUTPUT: 'digital_outputs',
    IoType.ANALOG_INPUT: 'analog_inputs',
    IoType.ANALOG_OUTPUT: 'analog_outputs',
    IoType.FLAG: 'flags',
}


def why_not_to_ask(state: Conversation) -> str:
    """Return why the motion port must not be used now, or '' if its use is safe."""
    status = latest_status(state.traffic)
    if status is None:
        return 'no STATUS received, so it is unknown whether the motors are off'
    if status.in_motion == TriState.TRUE:
        return 'the arm is moving'
    if status.drives_powered != TriState.FALSE:
        return 'the motors are on or unknown, and a disconnecting client could stop the arm'
    return ''


async def ask_motion_port(host: str, port: int, state: Conversation, findings: Findings) -> Facts:
    """Send a STOP and a point at the arm's current position. Return the facts from the replies."""
    facts: Facts = {}
    try:
        async with conversation(host, port) as motion:
            motion.link.dialect = state.traffic.packets[0][1].dialect
            clock = asyncio.get_running_loop().time
            sent = clock()
            reply = await motion.ask(JointTrajPt(SpecialSequence.STOP_TRAJECTORY), REPLY_TIMEOUT_S)
            took = f'{(clock() - sent) * 1e3:.1f} ms'
            if reply is None:
                _report_silence(motion, findings)
                return facts
            facts |= _reply_facts(reply)
            text = f'replied to STOP after {took} with {_described(reply)}'
            findings.ok('motion port', text)
            facts['ports.motion'] = port
            if facts['program.kind'] == 'points':
                facts |= await _ask_points(motion, state)
    except NoConnectionError as error:
        remedy = 'start the motion program, check motion_port and the firewall'
        findings.wrong('motion port', f'{host}:{port}: {error}', remedy)
        return facts
    if await _serves_again(host, port, motion):
        findings.ok('motion port', 'accepts a new client after the last one disconnects')
    else:
        text = 'does not accept a new client after the last one disconnects'
        findings.wrong('motion port', text, f'{RESTART} after each stop of the driver')
    return facts


def _report_silence(motion: Conversation, findings: Findings) -> None:
    if motion.traffic.ended:
        text = f'{motion.traffic.ended} immediately: another client is connected'
        findings.doubt = 'another client is connected to the motion port'
        remedy = f'if it is not the driver, stop it (such as the ROS 1 node), or {RESTART}'
        findings.note('motion port', text, remedy)
        return
    text = f'no reply to a STOP within {REPLY_TIMEOUT_S:g} s'
    findings.wrong('motion port', text, f'its motion task may have ended: {RESTART}')


def _reply_facts(reply: Packet) -> Facts:
    message = reply.message
    if isinstance(message, MotionReply):
        return {'program.kind': 'motoman', 'program.motors': 'motoman'}
    form = 'sequence' if isinstance(message, JointPosition) else 'header'
    return {'program.kind': 'points', 'program.reply': form}


def _described(reply: Packet) -> str:
    if isinstance(reply.message, MotionReply):
        return 'a MOTION_REPLY: Motoman'
    return f'message type {reply.msg_type}, {reply.reply_code.name}'


async def _ask_points(motion: Conversation, state: Conversation) -> Facts:
    """Return which special sequence numbers the controller's program supports.

    The motors must be off.
    """
    start = JointTrajPt(SpecialSequence.START_TRAJECTORY_STREAMING)
    answered = await motion.ask(start, SILENCE_S)
    facts: Facts = {} if answered is None else {'program.special_sequences': 'all'}
    here = latest_joints(state.traffic)
    if here is None or why_not_to_ask(state):
        return facts
    point = JointTrajPt(0, joint_data(here), SLOW_VELOCITY, SLOW_DURATION_S)
    reply = await motion.ask(point, REPLY_TIMEOUT_S)
    if reply is not None:  # without a reply its tasks may be paused, which proves nothing
        facts.setdefault('program.special_sequences', 'stop')
    await motion.ask(JointTrajPt(SpecialSequence.STOP_TRAJECTORY), REPLY_TIMEOUT_S)
    return facts


async def _serves_again(host: str, port: int, before: Conversation) -> bool:
    await asyncio.sleep(0.5)  # a server notices the end of its client a moment later
    try:
        async with conversation(host, port) as motion:
            motion.link.dialect = before.link.dialect
            stop = JointTrajPt(SpecialSequence.STOP_TRAJECTORY)
            return await motion.ask(stop, REPLY_TIMEOUT_S) is not None
    except NoConnectionError:
        return False


async def count_state_clients(host: str, port: int) -> Facts:
    served = 1
    async with AsyncExitStack() as connected:
        while served < MAX_CLIENTS:
            try:
                one = await connected.enter_async_context(conversation(host, port))
            except NoConnectionError:
                break
            if not await one.another_packet(ADMISSION_TIMEOUT_S):
                break
            served += 1
        else:
            return {}
    return {'server.state_clients': served}


async def ask_io_port(host: str, port: int, state: Conversation, findings: Findings) -> Facts:
    """Count the I/O points.

    The outputs may take their safe values when the connection closes.
    """
    try:
        async with conversation(host, port) as io:
            io.link.dialect = state.traffic.packets[0][1].dialect
            reply = await io.ask(IoInfo(1), REPLY_TIMEOUT_S)
    except NoConnectionError as error:
        remedy = 'start the I/O program, or set io_port to 0'
        findings.wrong('I/O port', f'{host}:{port}: {error}', remedy)
        return {}
    if reply is None or not isinstance(reply.message, IoInfoReply):
        silent = io.traffic.ended or f'no answer within {REPLY_TIMEOUT_S:g} s'
        how = silent if reply is None else 'refused: its task is not running, or is stopped'
        remedy = f'stop the other client, or {RESTART}, or set io_port to 0 (no I/O)'
        findings.wrong('I/O port', f'IO_INFO: {how}', remedy)
        return {}
    counts = dict.fromkeys(IO_KEYS.values(), 0)
    for item in reply.message.items:
        if item.io_type in IO_KEYS:
            counts[IO_KEYS[IoType(item.io_type)]] += item.count
    text = ', '.join(f'{count} {name.replace("_", " ")}' for name, count in counts.items())
    findings.ok('I/O port', text)
    return {'ports.io': port, 'io': counts}


async def ask_remote_port(
    host: str,
    port: int,
    password: str,
    findings: Findings,
    texts: ErrorTexts,
    needs_main: bool,
) -> tuple[Facts, list[Inhibit]]:
    """Return facts learned over Remote Ethernet, and the reasons why the arm cannot move.

    `texts`: the controller's error texts. `needs_main`: whether the arm moves only while the SPEL+
    function main runs.
    """
    try:
        async with logged_in(host, port, REPLY_TIMEOUT_S, password) as ask:
            flags, number = await ask_flags(ask)
            device = await ask_control_device(ask)
    except RemoteError as error:
        findings.wrong(
            'remote port',
            str(error),
            'name a variable with the password of RC+: --password-variable',
        )
        return {}, []
    except (TimeoutError, ConnectionError) as error:
        text = str(error) or f'no answer within {REPLY_TIMEOUT_S:g} s'
        remedy = 'enable Remote Ethernet in RC+ (an RC620 has none: remote_port 0)'
        if isinstance(error, HungUpError):
            remedy = 'it accepts one client: stop the other one, which may be the driver'
        findings.wrong('remote port', text, remedy)
        return {}, []
    text = f'Remote Ethernet replies: {", ".join(flags) or "no flag set"}'
    findings.ok('remote port', f'{text}, error {texts.phrase(number)}' if number else text)
    runs = 'Running' in flags
    if runs and not needs_main:
        text = 'a program is running: until it stops, motor commands and resets are refused'
        findings.note('remote port', text, 'program.motors: restart in the profile')
    result = [flags_inhibit(flags, number, texts), device_inhibit(device)]
    if needs_main and not runs and 'Paused' not in flags:
        result.append(MAIN_ENDED)
    motors = 'restart' if runs else 'remote_ethernet'
    facts = {'ports.remote': port, 'program.motors': motors}
    return facts, [item for item in result if item is not None]
