# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of a controller through its ports. They send only requests that the user permits."""

import asyncio
import time
from dataclasses import dataclass

import numpy as np

from epson_driver.doctor.asking import (
    REPLY_TIMEOUT_S,
    ask_io_port,
    ask_motion_port,
    ask_remote_port,
    count_state_clients,
    why_not_to_ask,
)
from epson_driver.doctor.findings import ARM, Findings, Level, report_inhibit
from epson_driver.doctor.learning import differences, tolerance
from epson_driver.doctor.listening import (
    Conversation,
    NoConnectionError,
    ReceivedTraffic,
    conversation,
)
from epson_driver.doctor.port_checks import (
    CHECK_CABLE,
    FELL_SILENT_S,
    OPTION_UNKNOWN,
    REAL_TIME,
    report_no_state,
    silence,
)
from epson_driver.doctor.pose_checks import Ask, check_joints, check_tool
from epson_driver.doctor.state_facts import (
    Facts,
    is_joints,
    latest_joints,
    latest_status,
    rhythm,
    state_facts,
)
from epson_driver.driver.inhibit import MAIN_ENDED, Cause, seen_inhibit, status_inhibit
from epson_driver.error_texts import load_error_texts
from epson_driver.profiles import ControllerProfile
from epson_driver.remote_ethernet.answers import ask_positions
from epson_driver.remote_ethernet.client import RemoteError, logged_in
from epson_driver.robots import RobotModel
from epson_driver.rtmc.transport import TransportError, is_there
from epson_driver.simple_message import Status, TriState

MIN_LISTENING_S = 1.0
AT_ONCE_S = 0.5

CONDITION_S = 3.0
"""Maximum wait for the first STATUS before the other checks start, s."""

LATE_S = 0.05

BUSY_S = 0.25
"""Timer delay on this machine above which silence does not count against the controller, s."""

LONGEST_GAP_S = 0.3
CLOCK_JUMP_S = 0.1
NEEDED = ('drives_powered', 'e_stopped', 'in_error')
"""Fields of STATUS that are needed to decide whether the arm can move."""

SERVERS = {
    'state port': 'StateServer (67)',
    'motion port': 'MotionServer (66)',
    'I/O port': 'IoServer (68)',
}

OUTSIDE_RAD = 0.05
"""Maximum distance of a reported joint position beyond its limit, rad or m. It allows for noise of
the measurement."""


@dataclass(frozen=True)
class Question:
    """The controller to check, and the permitted checks. A port of 0 is not used."""

    host: str
    profile: ControllerProfile
    model: RobotModel
    state_port: int
    motion_port: int
    io_port: int
    remote_port: int
    password: str
    seconds: float  # listening time
    may_ask: bool  # permits requests to the motion and remote ports
    may_use_io: bool  # permits requests to the I/O port


async def check_controller(
    question: Question, findings: Findings, ask: Ask | None = None
) -> Facts:
    """Check a controller, and return measured values by the keys of a controller profile.

    `ask` shows a question to a person at the pendant, and returns the answer.
    """
    facts = await _check(question, findings, ask)
    if question.profile.spel.project:
        _name_tasks(findings)
    return facts


def _name_tasks(findings: Findings) -> None:
    well = {item.about for item in findings.all if item.level is Level.OK}
    looked_at = {item.about for item in findings.all if item.level in (Level.WRONG, Level.NOTE)}
    missing = [task for port, task in SERVERS.items() if port in looked_at - well]
    if missing:
        text = f'RC+ must show {" and ".join(missing)} in its Task Manager'
        remedy = 'if not: BgMain (65) starts them (Preferences, background tasks)'
        findings.note('SPEL+ program', text, remedy)


async def _check(question: Question, findings: Findings, ask: Ask | None) -> Facts:
    if question.profile.program.interface == 'statements':
        return await _check_remote(question, findings)
    if question.profile.program.interface == 'rtmc':
        return await _check_real_time(question, findings)
    where = f'{question.host}:{question.state_port}'
    try:
        findings.busy(f'connecting to {where}')
        async with conversation(question.host, question.state_port, sends=True) as state:
            facts = await _check_state(question, state, findings)
            if facts:
                facts |= await _ask(question, state, findings)
                if ask is not None:
                    await check_joints(state, question.model, ask, findings)
                    await check_tool(state, question.model, ask, findings)
    except NoConnectionError as error:
        _, text, remedy = error.refusal.value
        findings.wrong('state port', f'{where}: {text} ({error})', remedy)
        return {}
    _compare(question.profile, facts, findings)
    return facts


async def _check_real_time(question: Question, findings: Findings) -> Facts:
    where = f'{question.host}, UDP port {question.motion_port}'
    if not question.may_ask:
        why = 'not looked for, because a client that leaves may stop the arm'
        findings.skipped(REAL_TIME, why, 'stop the driver, then permit it with --ask')
        return {}
    findings.busy('looking for the controller')
    try:
        if await is_there(question.host, question.motion_port):
            findings.ok(REAL_TIME, f'{where}: the controller is discovered')
            findings.note('option', *OPTION_UNKNOWN)
        else:
            remedy = 'check its address and option, and the firewall for UDP'
            findings.wrong(REAL_TIME, f'{where}: no controller is discovered', remedy)
    except TransportError as error:
        findings.wrong(REAL_TIME, 'not looked for', str(error))
    return {}


async def _check_remote(question: Question, findings: Findings) -> Facts:
    findings.busy('querying the remote port')
    texts = load_error_texts(question.profile.error_texts)
    units = question.model.limits.units
    facts, inhibits = await ask_remote_port(
        question.host, question.remote_port, question.password, findings, texts, False
    )
    for item in inhibits:
        report_inhibit(item, findings)
    if not facts or inhibits:
        return {}
    try:
        async with logged_in(
            question.host, question.remote_port, REPLY_TIMEOUT_S, question.password
        ) as ask:
            joints, motors = await ask_positions(ask, units)
    except (RemoteError, TimeoutError, ConnectionError) as error:
        text = str(error) or 'no answer'
        findings.wrong('joints', text, 'stop the running program: the controller must be Ready')
        return {}
    _check_positions(joints, question.model, findings)
    findings.ok(ARM, f'the motors are {"on" if motors else "off: the driver switches them on"}')
    findings.note(
        'Remote Ethernet alone',
        'joint moves, lines and arcs, one at a time; a trajectory of several points only along a '
        'straight line of tool0; no streams, and no joint states during a motion',
        'load the controller program for more',
    )
    return {'ports.remote': question.remote_port}


async def _check_state(question: Question, state: Conversation, findings: Findings) -> Facts:
    received = state.traffic
    wall, monotonic = time.time(), time.monotonic()
    loop = asyncio.get_running_loop()
    began = loop.time()
    if await state.ended_within(AT_ONCE_S) and not received.first_bytes:
        text = (
            f'{received.ended} immediately: another client is connected, or the program has ended'
        )
        remedy = 'stop the other client, such as the driver, or restart the program'
        findings.wrong('state port', text, remedy)
        return {}
    facts: Facts = {}
    findings.busy(f'listening to the state port for {question.seconds:g} s')
    if await state.wait_for_traffic(latest_status, min(question.seconds - AT_ONCE_S, CONDITION_S)):
        facts = await _report_inhibits(question, state, findings)
    deadline = began + question.seconds
    while (left := deadline - loop.time()) > 0.0 and not await state.ended_within(min(left, 1.0)):
        rest = max(deadline - loop.time(), 0.0)
        findings.busy(f'listening to the state port, {rest:.0f} s more')
    listened = loop.time() - began
    drift = (time.time() - wall) - (time.monotonic() - monotonic)
    findings.busy('evaluating the messages')
    motion = (question.host, question.motion_port)
    if await report_no_state(state, listened, motion, findings):
        return {}
    handshake = f'handshake {received.handshake * 1e3:.1f} ms'
    findings.ok('state port', f'{question.host}:{question.state_port} accepts, {handshake}')
    if received.ended:
        findings.wrong('state port', f'{received.ended} after {listened:.1f} s', CHECK_CABLE)
    elif (silent := silence(received)) > FELL_SILENT_S + received.lateness:
        text = (
            f'{len(received.packets)} messages received, then none for {silent:.1f} s: half-open'
        )
        _wrong_unless_busy(received, findings, 'state port', text, CHECK_CABLE)
    if received.lateness > LATE_S:
        text = f'busy: a timer was up to {received.lateness * 1e3:.0f} ms late'
        findings.note('this machine', text, 'times below may be wrong by this amount')
    _report_messages(state, listened, findings)
    _report_condition(question, state, findings)
    if abs(drift) > CLOCK_JUMP_S:
        text = f"this machine's clock was set by {drift:.2f} s during the check"
        findings.note('clock', text, 'ROS time stamps jump too: synchronise it with chrony or NTP')
    else:
        findings.ok('clock', "this machine's clock was not set during the check")
    if received.ended:
        return {}
    return facts | state_facts(received) | {'ports.state': question.state_port}


async def _report_inhibits(question: Question, state: Conversation, findings: Findings) -> Facts:
    """Report all reasons why the arm cannot move.

    Return the facts learned over Remote Ethernet, which is only used if permitted.
    """
    status = latest_status(state.traffic) or Status()
    texts = load_error_texts(question.profile.error_texts)
    facts: Facts = {}
    seen = seen_inhibit(status, texts)
    inhibits = [] if seen is None else [seen]
    if question.may_ask and question.remote_port:
        findings.busy('querying the remote port')
        needs_main = question.profile.program.motors == 'restart'
        facts, report = await ask_remote_port(
            question.host, question.remote_port, question.password, findings, texts, needs_main
        )
        unclear = seen is not None and seen.cause is Cause.NOT_POSSIBLE
        no_program = facts.get('program.motors') == 'remote_ethernet'
        if unclear and (report or no_program):
            inhibits, report = [], report or [MAIN_ENDED]
        # STATUS covers E-stop, key and error as well: one line for each cause
        causes = {item.cause for item in inhibits}
        inhibits += [item for item in report if item.cause not in causes]
    order = list(Cause)  # an E-stop also ends main
    inhibits.sort(key=lambda item: order.index(item.cause))
    for item in inhibits:
        report_inhibit(item, findings)
    unknown = [name for name in NEEDED if getattr(status, name) == TriState.UNKNOWN]
    if not inhibits and unknown:
        text = f'unknown whether it can move: {", ".join(unknown)} UNKNOWN in STATUS'
        findings.doubt = text
        findings.note(ARM, text, 'check at the controller')
    elif not inhibits:
        findings.ok(ARM, 'can move: motors on, no E-stop, no error, not at MANUAL')
    return facts


def _wrong_unless_busy(
    traffic: ReceivedTraffic, findings: Findings, about: str, text: str, remedy: str
) -> None:
    """Report a timing problem. If this machine was busy, report a note instead."""
    if traffic.lateness <= BUSY_S:
        findings.wrong(about, text, remedy)
        return
    findings.doubt = 'this machine was too busy to judge the timing'
    findings.note(about, text, f'repeat it with a lower load on this machine, then: {remedy}')


def _report_messages(state: Conversation, listened: float, findings: Findings) -> None:
    received = state.traffic
    joints = [time for time, packet in received.packets if is_joints(packet)]
    others = len(received.packets) - len(joints)
    dialect = received.packets[0][1].dialect
    findings.ok('byte order', f'{dialect.byte_order.name.lower()}-endian, {dialect.real.name}')
    if len(joints) < 2 or joints[0] == joints[-1]:
        at_once = ', all simultaneously' if len(joints) > 1 else ''
        text = f'{len(joints)} in {listened:.1f} s{at_once}'
        remedy = 'the state task must send JOINT_POSITION periodically'
        _wrong_unless_busy(received, findings, 'joint states', text, remedy)
        return
    gap = float(np.diff(joints).max())
    result = rhythm(joints, state.traffic.lateness)
    period = result or (joints[-1] - joints[0]) / (len(joints) - 1)
    text = f'{1.0 / period:.1f} Hz, longest gap {gap * 1e3:.0f} ms'
    if gap > LONGEST_GAP_S + state.traffic.lateness:
        remedy = 'check the state task and the network'
        _wrong_unless_busy(received, findings, 'joint states', text, remedy)
    else:
        findings.ok('joint states', text)
    if not others:
        remedy = 'the program must send STATUS, which shows whether the arm may move'
        findings.wrong('STATUS', 'none received', remedy)
    else:
        findings.ok(
            'STATUS',
            f'{others / listened:.1f} Hz, one for {len(joints) / others:.1f} joint states',
        )


def _report_condition(question: Question, state: Conversation, findings: Findings) -> None:
    joints, status = latest_joints(state.traffic), latest_status(state.traffic)
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
        findings.note('STATUS fields', text, 'the driver uses positions and replies instead')
    else:
        findings.ok('STATUS fields', 'all are filled')
    errors = load_error_texts(question.profile.error_texts)
    if status.error_code and status_inhibit(status, errors) is None:  # else it is named there
        number = status.error_code
        text = f'the last error was {errors.phrase(number)}'
        findings.note('error', text, errors.advice(number, 'see the manual of the controller'))


def _check_positions(joints: tuple[float, ...], model: RobotModel, findings: Findings) -> None:
    limits, count = model.limits, len(model.joint_names)
    beyond = [number + 1 for number in range(count, len(joints)) if joints[number] != 0.0]
    if not np.all(np.isfinite(joints)):
        findings.wrong('joints', f'{joints} must be finite numbers', 'check the state task')
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
        text = f'joint {beyond[0]} is not 0, but a {model.name} has {count} joints'
        findings.note('joints', text, 'check --robot (robot_model)')
    else:
        shown = ', '.join(f'{value:.4f}' for value in joints[:count])
        findings.ok('joints', f'within the limits of a {model.name}: {shown}')


async def _ask(question: Question, state: Conversation, findings: Findings) -> Facts:
    if not question.may_ask and not question.may_use_io:
        findings.skipped('motion, I/O, remote port', 'not queried', 'permit it with --ask, --io')
        return {}
    reason = why_not_to_ask(state)
    if reason:
        findings.skipped('motion, I/O port', reason, 'switch the motors off, then repeat')
        return {}
    facts: Facts = {}
    if question.may_ask:
        findings.busy('counting the clients that the state port accepts')
        facts |= await count_state_clients(question.host, question.state_port)
    findings.busy('querying the motion and the I/O port')
    if question.may_use_io and question.io_port:
        facts |= await ask_io_port(question.host, question.io_port, state, findings)
    if question.may_ask:  # last, because a program that serves one client once ends after it
        facts |= await ask_motion_port(question.host, question.motion_port, state, findings)
    return facts


def _compare(profile: ControllerProfile, facts: Facts, findings: Findings) -> None:
    if not facts:
        return
    result = differences(facts, profile)
    for key, value, expected in result:
        shown = value
        if isinstance(value, float) and isinstance(expected, float):
            shown = f'{value:.4g} (tolerance {tolerance(value, expected):.2g})'
        text = f'{key} is {shown}, but {expected} in the profile {profile.name}'
        remedy = 'select another profile, or create one: epson_driver doctor --learn FILE'
        findings.wrong('profile', text, remedy)
    if not result:
        text = f'{profile.name} ({profile.description}) matches in {len(facts)} keys'
        findings.ok('profile', text)
