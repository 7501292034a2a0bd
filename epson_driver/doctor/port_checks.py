# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Identifies the protocol of a port that sends no robot states."""

import asyncio
from collections import Counter

from epson_driver.doctor.findings import Findings
from epson_driver.doctor.listening import (
    Conversation,
    NoConnectionError,
    ReceivedTraffic,
    conversation,
)
from epson_driver.doctor.state_facts import is_joints
from epson_driver.simple_message import Status

CHECK_CABLE = (
    'check whether the controller is off, its program has ended or is stuck, or a cable is '
    'unplugged'
)

REAL_TIME = 'Real-time Motion Control'
OPTION_UNKNOWN = (
    'nothing was sent, so whether the option is enabled is unknown',
    'enable it in RC+, or use --controller remote',
)

OTHER_PORT_S = 1.5

FELL_SILENT_S = 1.0


async def report_no_state(
    state: Conversation,
    listened: float,
    motion: tuple[str, int],
    findings: Findings,
) -> bool:
    """Report why a port sends no robot state. Return False if it does send robot states.

    `listened`: duration of listening, s. `motion`: host and port of the motion port.
    """
    received = state.traffic
    if received.unreadable:
        start = received.first_bytes[:24].hex()
        text = f'another program replies there: {received.unreadable} ({start})'
        remedy = 'check address and port: 11002 is usual, 50241 Motoman'
    elif received.vanished:
        text = f'half-open: the connection is up, but the machine is gone ({received.ended})'
        remedy = CHECK_CABLE
    elif received.ended and not received.packets:
        text = f'{received.ended} after {listened:.1f} s, without a message'
        remedy = CHECK_CABLE
    elif not received.packets:
        text, remedy = await _why_silent(state, listened, motion)
    elif not any(
        is_joints(item) or isinstance(item.message, Status) for _, item in received.packets
    ):
        kinds = Counter(item.msg_type for _, item in received.packets)
        types = ', '.join(f'{count} of type {int(kind)}' for kind, count in kinds.most_common(3))
        text = f'simple message, but neither joint states nor STATUS: {types}'
        remedy = 'it is another port of a controller: 11002 is the usual state port, 50241 Motoman'
    else:
        return False
    findings.wrong('state port', text, remedy)
    return True


async def _why_silent(
    state: Conversation, listened: float, motion: tuple[str, int]
) -> tuple[str, str]:
    host, port = motion
    own = state.port
    if port and port != own and await _sends_state(host, port):
        text = f'silent, but joint states come from port {port}: state and motion are swapped'
        return text, f'swap them: state_port {port}, motion_port {own}'
    text = f'accepts, but sent nothing in {listened:.1f} s'
    remedy = (
        'start the state task on the controller. If it is running, it is stuck, or this is the '
        'port of another program'
    )
    return text, remedy


async def _sends_state(host: str, port: int) -> bool:
    try:
        async with conversation(host, port) as other:
            return await other.wait_for_traffic(has_joints, OTHER_PORT_S)
    except NoConnectionError:
        return False


def has_joints(traffic: ReceivedTraffic) -> bool:
    return any(is_joints(item) for _, item in traffic.packets)


def silence(traffic: ReceivedTraffic) -> float:
    return asyncio.get_running_loop().time() - traffic.packets[-1][0]
