# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Identifies a controller: the ports that answer, the profile that fits, and the robot model.

Only the remote port and the state ports are opened. A client that leaves a motion or I/O port may
stop the arm or change outputs. A closed port is tried once more after REOPENED_S, because the
program may be opening it again. If no program sends joint states, Real-time Motion Control is
searched for by DDS discovery.
"""

import asyncio
from dataclasses import dataclass, field

from epson_driver.doctor.findings import Findings
from epson_driver.doctor.learning import differences
from epson_driver.doctor.listening import (
    REOPENED_S,
    NoConnectionError,
    ReceivedTraffic,
    Refusal,
    conversation,
    refusal_of,
)
from epson_driver.doctor.port_checks import OPTION_UNKNOWN, REAL_TIME, has_joints
from epson_driver.doctor.state_facts import state_facts
from epson_driver.inputs import InputError
from epson_driver.profiles import load_controller_profile
from epson_driver.remote_ethernet.answers import ask_identity
from epson_driver.remote_ethernet.client import HungUpError, RemoteError, logged_in
from epson_driver.robots.catalogue import model_name
from epson_driver.rtmc.transport import CONTROLLER_PORT, TransportError, is_there

REMOTE_PORT = 5000
STATE_PORTS = {
    11002: ('spel', 'simulated', 'generic', 'abb', 'fanuc'),
    50241: ('motoman',),
}
"""Usual state port → profiles of controllers that have no Remote Ethernet."""

TIMEOUT_S = 3.0
ENOUGH_PACKETS = 60

NOTHING_LISTENS = (
    'in RC+ set the control device to Remote Ethernet, port 5000, or start the program on the '
    'controller'
)


@dataclass
class Look:
    """The services that answer at an address, and the profile and the model that fit them.

    `profile` or `model` is '' if no profile or model fits.
    """

    host: str
    remote_port: int
    state_port: int = 0
    profile: str = ''
    model: str = ''
    why: str = ''  # the reason for the profile
    simulated: bool = False
    answers: dict[int, str] = field(default_factory=dict)  # a clause on the service at each port
    refusals: list[Refusal] = field(default_factory=list)
    trouble: tuple[str, str] = ('', '')  # error text of the remote port, and its remedy
    doubt: tuple[str, str] = ('', '')  # what is unknown of Real-time Motion Control, and a remedy


async def look_at(
    host: str,
    password: str = '',
    remote_port: int | None = None,
    state_port: int | None = None,
    real_time_port: int | None = None,
) -> Look:
    """Identify a controller from its ports.

    A port of None means the default port, and 0 means that the port is not used.
    """
    look = Look(host, REMOTE_PORT if remote_port is None else remote_port)
    states = STATE_PORTS if state_port is None else {state_port: STATE_PORTS[11002]}
    listeners = asyncio.gather(*(_listen(look, port) for port in states if port))
    controller, received = await asyncio.gather(_ask_remote(look, password), listeners)
    remote = controller is not None
    for (port, profiles), traffic in zip(states.items(), received, strict=False):
        if traffic is not None and not look.state_port:
            look.state_port = port
            look.profile = 'spel' if remote else _nearest(traffic, profiles)
            look.why = f'joint states arrive at port {port}'
    if remote and not look.state_port:
        look.profile = 'remote'
        look.why = 'Remote Ethernet answers, and no program sends joint states'
    if not (look.state_port or controller):
        await _discover(look, CONTROLLER_PORT if real_time_port is None else real_time_port)
    if controller:
        look.simulated, look.profile = True, controller
        look.why = 'the simulated controller reports it'
    return look


async def _ask_remote(look: Look, password: str) -> str | None:
    """Return the profile that a simulated controller reports over Remote Ethernet.

    Return '' for a real controller, and None without an answer.
    """
    port = look.remote_port
    if not port:
        return None
    try:
        async with logged_in(look.host, port, TIMEOUT_S, password) as ask:
            controller, robot, simulated = await ask_identity(ask)
    except RemoteError as error:
        look.answers[port] = f'Remote Ethernet: {error.meaning}'
        look.trouble = (
            look.answers[port],
            'name a variable with the password of RC+: --password-variable',
        )
        return None
    except HungUpError as error:
        look.answers[port] = f'{error}, so another client may be connected'
        look.trouble = look.answers[port], 'stop the other client, which may be the driver'
        return None
    except (TimeoutError, ConnectionError) as error:
        cause = error if isinstance(error, TimeoutError) else error.__cause__
        look.answers[port] = refusal_of(cause).value[0] if cause else str(error)
        look.refusals.append(refusal_of(cause))
        return None
    look.answers[port] = f'Remote Ethernet: {", ".join(filter(None, (controller, robot)))}'
    try:
        look.model = model_name(robot) if robot else ''
    except InputError:
        look.answers[port] += ', a model that is not known'
    return controller if simulated else ''


async def _discover(look: Look, port: int) -> None:
    try:
        if port and await is_there(look.host, port):
            look.profile, look.why = 'rtmc', f'{REAL_TIME} is discovered at UDP port {port}'
            look.doubt = OPTION_UNKNOWN
        elif port:
            look.answers[port] = f'no {REAL_TIME}'
    except TransportError as error:
        look.doubt = 'not looked for', str(error)


async def _listen(look: Look, port: int) -> ReceivedTraffic | None:
    try:
        async with conversation(look.host, port, sends=True, pause=REOPENED_S) as state:
            await state.wait_for_traffic(lambda it: len(it.packets) >= ENOUGH_PACKETS, TIMEOUT_S)
    except NoConnectionError as error:
        look.answers[port] = error.refusal.value[0]
        look.refusals.append(error.refusal)
        return None
    if has_joints(state.traffic):
        look.answers[port] = 'joint states'
        return state.traffic
    closed = state.traffic.ended and not state.traffic.first_bytes
    look.answers[port] = (
        'closes each connection' if closed else 'something else than a robot controller'
    )
    return None


def _nearest(traffic: ReceivedTraffic, names: tuple[str, ...]) -> str:
    facts = state_facts(traffic)
    return min(names, key=lambda name: len(differences(facts, load_controller_profile(name))))


def report_look(look: Look, findings: Findings) -> bool:
    if look.doubt[0]:
        findings.note(REAL_TIME, *look.doubt)
    ports = ', '.join(f'port {port}: {answer}' for port, answer in sorted(look.answers.items()))
    if not look.profile:
        if look.trouble[0]:
            findings.wrong('remote port', *look.trouble)
        else:
            text, remedy = f'no controller answers ({ports})', NOTHING_LISTENS
            if look.refusals and Refusal.REFUSED not in look.refusals:
                _, text, remedy = look.refusals[0].value
            findings.wrong('controller', f'{look.host}: {text}', remedy)
        return False
    findings.ok('controller', f'profile {look.profile}, because {look.why} ({ports})')
    if look.trouble[0]:
        findings.note('remote port', *look.trouble)
    if not look.model:
        findings.note('model', 'the controller does not report it', 'give it: --robot MODEL')
    return True
