# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a controller, from what its state port sends; and what it may be asked."""

import asyncio
import time
from dataclasses import dataclass

import numpy as np

from epson_driver.doctor.asking import (
    ask_io_port,
    ask_motion_port,
    ask_remote_port,
    count_state_clients,
    why_not_to_ask,
)
from epson_driver.doctor.findings import Findings
from epson_driver.doctor.learning import differences
from epson_driver.doctor.listening import Conversation, NoConnectionError, conversation
from epson_driver.doctor.pose_checks import Ask, check_joints, check_tool
from epson_driver.doctor.state_facts import (
    Facts,
    is_joints,
    latest_joints,
    latest_status,
    state_facts,
)
from epson_driver.error_texts import load_error_texts
from epson_driver.profiles import ControllerProfile
from epson_driver.robots import RobotModel
from epson_driver.simple_message import TriState

MIN_LISTENING_S = 1.0
AT_ONCE_S = 0.5
"""A connection that the controller closes so soon was not wanted."""

LONGEST_GAP_S = 0.3
CLOCK_JUMP_S = 0.1
OUTSIDE_RAD = 0.05
"""How far beyond a limit a joint may be reported, rad or m: noise, and a rest at the very end."""


@dataclass(frozen=True)
class Question:
    """Whom to look at, and what is allowed. A port of 0 is left alone."""

    host: str
    profile: ControllerProfile
    model: RobotModel
    state_port: int
    motion_port: int
    io_port: int
    remote_port: int
    password: str
    seconds: float
    may_ask: bool
    may_use_io: bool
    once: bool
    """Whether to connect although the profile says that servers serve one client once."""


async def check_controller(
    question: Question, findings: Findings, ask: Ask | None = None
) -> Facts:
    """Look at a controller; return what was found out, by the keys of a profile.

    `ask` talks to a person at the pendant; None: there is none.
    """
    if not question.profile.server.reconnect and not question.once:
        text = (
            f'not opened: a {question.profile.name} serves one client, once, and has to be '
            'started again afterwards'
        )
        findings.skipped('controller', text, 'allow it with --once')
        return {}
    where = f'{question.host}:{question.state_port}'
    try:
        async with conversation(question.host, question.state_port) as state:
            findings.ok(
                'state port', f'{where} accepts; handshake {state.heard.handshake * 1e3:.1f} ms'
            )
            facts = await _check_state(question, state, findings)
            if facts:
                facts |= await _ask(question, state, findings)
                if ask is not None:
                    await check_joints(state, question.model, ask, findings)
                    await check_tool(state, question.model, ask, findings)
    except NoConnectionError as error:
        remedy = 'start the program on the controller; check address, state_port, cable, firewall'
        findings.wrong('state port', f'{where}: {error}', remedy)
        return {}
    _compare(question.profile, facts, findings)
    return facts


async def _check_state(question: Question, state: Conversation, findings: Findings) -> Facts:
    """Listen to the state port; return nothing if that tells nothing."""
    heard = state.heard
    wall, monotonic = time.time(), time.monotonic()
    loop = asyncio.get_running_loop()
    began = loop.time()
    if await state.ended_within(AT_ONCE_S) and not heard.packets:
        text = f'{heard.ended} at once: it has a client already, or its program has ended'
        remedy = (
            'stop the other client, which may be the driver or the ROS 1 node; else start the '
            'program again'
        )
        findings.wrong('state port', text, remedy)
        return {}
    await state.ended_within(max(question.seconds - AT_ONCE_S, 0.0))
    listened = loop.time() - began
    drift = (time.time() - wall) - (time.monotonic() - monotonic)
    if heard.unreadable:
        text = f'something else answers there: {heard.unreadable} ({heard.first_bytes[:24].hex()})'
        findings.wrong('state port', text, 'check address and port: 11002 is usual, 50241 Motoman')
        return {}
    if heard.ended:
        text = f'{heard.ended} after {listened:.1f} s'
        remedy = 'was the controller switched off, has its program ended, is a cable out?'
        findings.wrong('state port', text, remedy)
    if not heard.packets:
        text = f'nothing came in {listened:.1f} s'
        remedy = 'the state task on the controller does not run, or sends nothing: start it'
        findings.wrong('state port', text, remedy)
        return {}
    _tell_messages(state, listened, findings)
    _tell_condition(question, state, findings)
    if abs(drift) > CLOCK_JUMP_S:
        text = f"this machine's clock was set by {drift:.2f} s while it was listened"
        findings.note('clock', text, 'stamps of ROS jump with it: keep it with chrony or NTP')
    else:
        findings.ok('clock', "this machine's clock was not set while it was listened")
    return {} if heard.ended else state_facts(heard) | {'ports.state': question.state_port}


def _tell_messages(state: Conversation, listened: float, findings: Findings) -> None:
    heard = state.heard
    joints = [at for at, packet in heard.packets if is_joints(packet)]
    others = len(heard.packets) - len(joints)
    dialect = heard.packets[0][1].dialect
    findings.ok('byte order', f'{dialect.byte_order.name.lower()}-endian, {dialect.real.name}')
    if len(joints) < 2 or joints[0] == joints[-1]:
        at_once = ', all at once' if len(joints) > 1 else ''
        text = f'{len(joints)} in {listened:.1f} s{at_once}'
        remedy = 'the state task must send JOINT_POSITION again and again'
        findings.wrong('joint states', text, remedy)
        return
    gap = float(np.diff(joints).max())
    text = f'{(len(joints) - 1) / (joints[-1] - joints[0]):.1f} Hz, longest gap {gap * 1e3:.0f} ms'
    if gap > LONGEST_GAP_S:
        findings.wrong('joint states', text, 'look at the state task and at the network')
    else:
        findings.ok('joint states', text)
    if not others:
        remedy = 'the program must send STATUS: without it nothing says whether the arm may move'
        findings.wrong('STATUS', 'none came', remedy)
    else:
        findings.ok(
            'STATUS',
            f'{others / listened:.1f} Hz, one for {len(joints) / others:.1f} joint states',
        )


def _tell_condition(question: Question, state: Conversation, findings: Findings) -> None:
    joints, status = latest_joints(state.heard), latest_status(state.heard)
    model = question.model
    if joints is not None:
        _check_positions(joints, model, findings)
    if status is None:
        return
    unknown = [
        name
        for name in ('drives_powered', 'e_stopped', 'in_error', 'in_motion', 'motion_possible')
        if getattr(status, name) == TriState.UNKNOWN
    ]
    if unknown:
        text = f'{", ".join(unknown)} UNKNOWN'
        findings.note('STATUS fields', text, 'the driver then goes by positions and replies')
    else:
        findings.ok('STATUS fields', 'all are filled')
    if status.e_stopped == TriState.TRUE:
        remedy = 'release it, reset, then ~/enable'
        findings.note('E-stop', 'pressed, or not reset', remedy)
    if status.in_error == TriState.TRUE or status.error_code:
        texts = load_error_texts(question.profile.error_texts)
        advice = texts.advice(status.error_code, "look it up in the controller's manual; reset")
        findings.note('error', texts.phrase(status.error_code), advice)


def _check_positions(joints: tuple[float, ...], model: RobotModel, findings: Findings) -> None:
    limits, count = model.limits, len(model.joint_names)
    beyond = [number + 1 for number in range(count, len(joints)) if joints[number] != 0.0]
    if not np.all(np.isfinite(joints)):
        findings.wrong('joints', f'{joints} are not all numbers', 'look at the state task')
        return
    for name, value, low, high in zip(
        limits.names, joints, limits.position_min, limits.position_max, strict=False
    ):
        if not low - OUTSIDE_RAD <= value <= high + OUTSIDE_RAD:
            text = f'{name} = {value:.4f} is outside {low:.4f} … {high:.4f}'
            remedy = 'check --robot (robot_model), units (rad, not degrees), joint_offsets'
            findings.wrong('joints', text, remedy)
            return
    if beyond:
        text = f'joint {beyond[0]} is not 0, but a {model.name} has {count}'
        findings.note('joints', text, 'check --robot (robot_model)')
    else:
        shown = ', '.join(f'{value:.4f}' for value in joints[:count])
        findings.ok('joints', f'within the limits of a {model.name}: {shown}')


async def _ask(question: Question, state: Conversation, findings: Findings) -> Facts:
    facts: Facts = {}
    if not question.may_ask and not question.may_use_io:
        findings.skipped('motion, I/O, remote port', 'not opened', 'allow it: --ask, --io')
        return facts
    reason = why_not_to_ask(state)
    if reason:
        findings.skipped('motion, I/O, remote port', reason, 'switch the motors off, then again')
        return facts
    if question.may_ask:
        if question.remote_port:
            facts |= await ask_remote_port(
                question.host, question.remote_port, question.password, findings
            )
        facts |= await count_state_clients(question.host, question.state_port)
    if question.may_use_io and question.io_port:
        facts |= await ask_io_port(question.host, question.io_port, state, findings)
    if question.may_ask:  # last: a program that serves one client once is over after it
        facts |= await ask_motion_port(question.host, question.motion_port, state, findings)
    return facts


def _compare(profile: ControllerProfile, facts: Facts, findings: Findings) -> None:
    if not facts:
        return
    found = differences(facts, profile)
    for key, value, held in found:
        shown = f'{value:.4g}' if isinstance(value, float) else value
        text = f'{key} is {shown}, the profile {profile.name} says {held}'
        remedy = 'choose another profile, or make one: epson_driver doctor --learn FILE'
        findings.wrong('profile', text, remedy)
    if not found:
        findings.ok('profile', f'{profile.name} fits in {len(facts)} keys')
