# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Identification of a port that is not a state port, from its protocol."""

import asyncio
from collections import Counter
from contextlib import suppress

from epson_driver.doctor.findings import Findings
from epson_driver.doctor.listening import (
    Conversation,
    NoConnectionError,
    ReceivedTraffic,
    Refusal,
    conversation,
)
from epson_driver.doctor.state_facts import is_joints
from epson_driver.simple_message import Status

ABOUT = 'state port'

OTHER_PORT_S = 1.5
"""Time to listen to the motion port when the state port is silent, s."""

FELL_SILENT_S = 1.0
"""Silence after which a port that had sent data counts as silent, s."""

HTTP_QUESTION = b'HEAD / HTTP/1.0\r\n\r\n'
"""As a message it would be 1 GB long in either byte order, so it cannot be mistaken for a
point."""

HTTP_ANSWER_S = 2.0

ROBOT_PORTS = frozenset({5000, *range(11000, 11004), *range(50240, 50243)})
"""Usual ports of robots. Only their own protocol is spoken there unless the user allows more."""

REFUSALS = {
    Refusal.UNKNOWN_NAME: (
        'no machine with this name',
        "check the spelling and the name server, or give the controller's IP address",
    ),
    Refusal.REFUSED: (
        'the machine replies, but nothing listens at this port',
        'start the program on the controller, check state_port',
    ),
    Refusal.DROPPED: (
        'no reply from this address',
        'check the address, the network mask, the cable, and that the controller is on; a '
        'firewall may drop the packets',
    ),
    Refusal.UNREACHABLE: (
        'no route to this address',
        "check the address, the cable, and this machine's network settings",
    ),
}
"""Reasons for a failed connection, with remedies."""


def tell_refusal(where: str, error: NoConnectionError, findings: Findings) -> None:
    """Report why the state port could not be opened."""
    text, remedy = REFUSALS[error.refusal]
    findings.wrong(ABOUT, f'{where}: {text} ({error})', remedy)


async def tell_of_no_state(
    state: Conversation,
    listened: float,
    motion: tuple[str, int],
    findings: Findings,
    may_ask: bool,
) -> bool:
    """Return whether a port is not a state port, and report the service found there.

    `motion`: host and port of the motion port, which is checked if this port is silent.
    """
    received = state.heard
    if received.unreadable:
        start = received.first_bytes[:24].hex()
        text = f'another program replies there: {received.unreadable} ({start})'
        remedy = 'check address and port: 11002 is usual, 50241 Motoman'
    elif received.vanished:
        text = f'half-open: the connection is up, but the machine is gone ({received.ended})'
        remedy = 'check whether a cable is unplugged, and whether the controller is on'
    elif received.ended and not received.packets:
        text = f'{received.ended} after {listened:.1f} s, without a message'
        remedy = (
            'check whether the controller is off, its program has ended, or a cable is unplugged'
        )
    elif not received.packets:
        text, remedy = await _why_silent(state, listened, motion, may_ask)
    elif not any(
        is_joints(item) or isinstance(item.message, Status) for _, item in received.packets
    ):
        kinds = Counter(item.msg_type for _, item in received.packets)
        types = ', '.join(f'{count} of type {int(kind)}' for kind, count in kinds.most_common(3))
        text = f'simple message, but neither joint states nor STATUS: {types}'
        remedy = 'it is another port of a controller: 11002 is the usual state port, 50241 Motoman'
    else:
        return False
    findings.wrong(ABOUT, text, remedy)
    return True


async def _why_silent(
    state: Conversation, listened: float, motion: tuple[str, int], may_ask: bool
) -> tuple[str, str]:
    host, port = motion
    own = state.port
    if port and port != own and await _sends_state(host, port):
        text = f'silent, but joint states come from port {port}: state and motion are swapped'
        return text, f'swap them: state_port {port}, motion_port {own}'
    if may_ask or own not in ROBOT_PORTS:
        started = await _answer_to_http(state)
        if started.startswith(b'HTTP/'):
            line = started.partition(b'\r\n')[0].decode('ascii', 'replace')
            text = f'this is a web server (HTTP), not a state port: {line[:60]!r}'
            return text, 'check address and port: 11002 is usual, 50241 Motoman'
    text = f'accepts, but sent nothing in {listened:.1f} s'
    remedy = (
        'start the state task on the controller. If it is running, it is stuck, or this is the '
        'port of another program'
    )
    return text, remedy


async def _sends_state(host: str, port: int) -> bool:
    """Return whether a port sends joint states without a request."""
    try:
        async with conversation(host, port) as other:
            return await other.wait_for_traffic(has_joints, OTHER_PORT_S)
    except NoConnectionError:
        return False


async def _answer_to_http(state: Conversation) -> bytes:
    with suppress(OSError):
        state.send_bytes(HTTP_QUESTION)
        await state.wait_for_traffic(lambda heard: heard.first_bytes, HTTP_ANSWER_S)
    return state.heard.first_bytes


def has_joints(heard: ReceivedTraffic) -> bool:
    """Return whether a joint state was received."""
    return any(is_joints(item) for _, item in heard.packets)


def silence(heard: ReceivedTraffic) -> float:
    """Return the time since the last message, s."""
    return asyncio.get_running_loop().time() - heard.packets[-1][0]
