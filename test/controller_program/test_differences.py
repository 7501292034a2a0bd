# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The built-in and the SPEL+ program get the same bytes. The page lists the differences.

A script is a list of bytes to send, times to wait, s, and words for events at the controller.
Replies, connection and final position are compared.
"""

import re
import struct
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from support.controller_harness import (
    SIMULATED,
    STOP,
    Harness,
    InlinePlanner,
    frame,
    point,
    point_body,
    split,
)
from support.examples import one_in
from support.spel_program_harness import OurProgramHarness

from epson_driver.simple_message import FrameError

NAN, INF = float('nan'), float('inf')
TOPIC, REQUEST, REPLY = 1, 2, 3
START_DOWNLOAD, START_STREAMING, END = -1, -2, -3
WAIT = 0.3
Script = list[bytes | float | str]


def at(*degrees):
    """Return joint angles, rad."""
    values = [value * 0.017453292519943295 for value in degrees]
    return [*values, *[0.0] * (6 - len(values))]


def line(count, first=0, step=2.0, comm_type=REQUEST, seconds=0.3):
    """Return points that move joint 1 by `step` degrees each, with consecutive sequences."""
    return [
        point(first + number, at(step * (number + 1)), 0.0, seconds, comm_type)
        for number in range(count)
    ]


def ten(*values):
    """Return a point with ten joints, four more than the robot has."""
    return frame(11, REQUEST, 0, struct.pack('<i12f', 0, *at(1.0), *values, 0.0, 0.5))


SCRIPTS: dict[str, Script] = {
    'a stream': [*line(5)],
    'a stream that begins with -2': [point(START_STREAMING, at(1.0), 0.0, 0.3), *line(3, first=1)],
    'a stream after another': [*line(3), 3.0, *line(3)],
    'a sequence that leaves one out': [*line(2), WAIT, point(3, at(8.0), 0.0, 0.3)],
    'a sequence twice': [*line(2), WAIT, point(1, at(8.0), 0.0, 0.3)],
    'a first sequence that is not 0': [point(4, at(2.0), 0.0, 0.3)],
    'a stream after a failure': [point(4, at(2.0), 0.0, 0.3), WAIT, *line(2)],
    'the next point after a failure': [*line(2), 2.0, point(9, at(6.0)), WAIT, point(2, at(6.0))],
    'a sequence below -4': [point(-7, at(2.0), 0.0, 0.3)],
    'a joint that is not a number': [point(0, [NAN, *at()[1:]], 0.0, 0.3)],
    'a joint that is infinite': [point(0, [*at()[:5], INF], 0.0, 0.3)],
    'a joint that the robot lacks is not a number': [ten(0.0, NAN, 0.0, 0.0)],
    'a joint that the robot lacks has a value': [ten(0.0, 1.0, 0.0, 0.0)],
    'a joint out of range': [point(0, at(171.0), 0.0, 0.3)],
    'a joint out of range in a stream': [*line(2), point(2, at(0.0, 70.0)), *line(2, first=3)],
    'a velocity above 1': [point(0, at(2.0), 1.5, 0.3)],
    'a negative velocity': [point(0, at(2.0), -0.5, 0.3)],
    'a negative duration': [point(0, at(2.0), 0.0, -1.0)],
    'a duration that is not a number': [point(0, at(2.0), 0.0, NAN)],
    'a duration of two days': [point(0, at(2.0), 0.0, 172_800.0)],
    'a STOP at rest': [point(STOP)],
    'a STOP with the motors off': ['motors off', WAIT, point(STOP)],
    'a STOP with the E-stop pressed': ['E-stop press', WAIT, point(STOP)],
    'a STOP while paused': ['pause', WAIT, point(STOP)],
    'a STOP that is a topic': [point(STOP, comm_type=TOPIC)],
    'a point with the motors off': ['motors off', WAIT, point(0, at(2.0), 0.0, 0.3)],
    'a point with the E-stop pressed': ['E-stop press', WAIT, point(0, at(2.0), 0.0, 0.3)],
    'a point in MANUAL': ['mode manual', 1.0, point(0, at(2.0), 0.0, 0.3)],
    'a point after stop': ['stop', WAIT, point(0, at(2.0), 0.0, 0.3)],
    'a point that is a topic': [point(0, at(2.0), 0.0, 0.3, comm_type=TOPIC)],
    'a point that is a reply': [point(0, at(2.0), 0.0, 0.3, comm_type=REPLY, reply_code=1)],
    'a point with a reply code': [point(0, at(2.0), 0.0, 0.3, reply_code=1)],
    'a point of an unknown kind': [point(0, at(2.0), 0.0, 0.3, comm_type=9)],
    'a point that is too short': [frame(11, REQUEST, 0, point_body(0)[:-4])],
    'a point that is too long': [frame(11, REQUEST, 0, point_body(0) + bytes(4))],
    'a download of topics': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3, TOPIC),
        *line(3, first=1, comm_type=TOPIC),
        point(END, at(9.0), 0.0, 0.3, TOPIC),
    ],
    'a download of requests': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3),
        *line(3, first=1),
        point(END, at(9.0), 0.0, 0.3),
    ],
    'a download with a point out of range': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3),
        point(1, at(175.0), 0.0, 0.3),
        point(2, at(2.0), 0.0, 0.3),
        point(END, at(9.0), 0.0, 0.3),
    ],
    'a download that a STOP ends': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3),
        point(1, at(2.0), 0.0, 0.3),
        point(STOP),
        point(END, at(9.0), 0.0, 0.3),
    ],
    'a PING': [frame(1, REQUEST, 0, bytes(40))],
    'an empty PING': [frame(1, REQUEST, 0)],
    'a PING that is a topic': [frame(1, TOPIC, 0, bytes(40))],
    'GET_VERSION': [frame(2, REQUEST, 0)],
    'an unknown request': [frame(999, REQUEST, 0, bytes(20))],
    'an unknown topic': [frame(999, TOPIC, 0, bytes(20))],
    'a message of type 0': [frame(0, REQUEST, 0)],
    'a message of a negative type': [frame(-5, REQUEST, 0, bytes(4))],
    'a PING in pieces': [
        frame(1, REQUEST, 0, bytes(40))[:7],
        0.1,
        frame(1, REQUEST, 0, bytes(40))[7:],
    ],
    'a length below 12': [struct.pack('<5i', 8, 1, 2, 0, 0)],
    'a length of 2 MB': [struct.pack('<i', 2_000_000) + bytes(100)],
    'a message of 2,000 bytes': [frame(999, TOPIC, 0, bytes(2000)), frame(1, REQUEST, 0)],
    'a message that does not end': [frame(1, REQUEST, 0, bytes(40))[:30], 3.0],
}


PAGE = Path(__file__).parents[2] / 'docs' / 'controller_program.md'
SECTION = '### What differs from the built-in program'
CODES = {0: 'INVALID', 1: 'SUCCESS', 2: 'FAILURE'}
POINT_REPLY = 10
QUIET_S = 4.0
BETWEEN_S = 0.02


def differences() -> dict[str, tuple[str, str]]:
    """Return the table of the page: script to the behaviour of both programs."""
    section = PAGE.read_text(encoding='utf-8').split(SECTION)[1].split('\n#')[0]
    rows = re.findall(r'^\| (.+?) \| (.+?) \| (.+?) \| .+? \|$', section, re.MULTILINE)
    return {name: (one, other) for name, one, other in rows[1:] if set(name) != {'-'}}


def play_script(script: Script, send, step, do) -> None:
    for item in script:
        if isinstance(item, bytes):
            send(item)
            step(BETWEEN_S)
        elif isinstance(item, str):
            do(item)
        else:
            step(item)
    step(QUIET_S)


def outcome(script: Script, data: bytes, cut: bool, position) -> tuple[str, str, str]:
    """Return the replies, the state of the connection and the result of the motion, as text."""
    replies = []
    for code, group in groupby(split(data), lambda each: each[2]):
        numbers = ' '.join(_number(kind, body) for kind, _, _, body in group)
        replies.append(f'{CODES[code]} {numbers}')
    targets = [
        np.frombuffer(item[20:44], '<f4')
        for item in script
        if type(item) is bytes and len(item) == 68
    ]
    rests = 'stops on its way'
    if not np.any(position):
        rests = 'stays'
    elif any(np.abs(position - target).max() < 1e-6 for target in targets):
        rests = 'arrives'
    return ', '.join(replies) or 'no answer', 'cut off' if cut else 'stays connected', rests


def _number(kind: int, body: bytes) -> str:
    """Return the sequence of a reply to a point, or the type of another reply."""
    if kind != POINT_REPLY:
        return f'type {kind}'
    return str(int.from_bytes(body[:4], 'little', signed=True))


def by_spel(script: Script) -> tuple[str, str, str]:
    harness = OurProgramHarness()
    client = harness.ready()
    play_script(script, client.send_bytes, harness.step, harness.do)
    return outcome(script, client.raw(), not client.open, harness.position)


def by_built_in(script: Script) -> tuple[str, str, str]:
    harness = Harness(planner=InlinePlanner(), profile=SIMULATED)
    cut = []

    def send(data: bytes) -> None:
        try:
            harness.connection.receive(data)
        except FrameError:  # the server of the port closes the connection
            cut.append(True)

    play_script(script, send, harness.step, harness.do)
    ended = bool(cut) or harness.peer.ended is not None
    return outcome(script, harness.peer.take(), ended, harness.controller.arm.commanded)


@pytest.mark.invariant(7)
@pytest.mark.parametrize('name', one_in(6, SCRIPTS))
def test_programs_differ_only_as_the_page_describes(name: str) -> None:
    script = SCRIPTS[name]
    one, other = by_built_in(script), by_spel(script)
    unlike = [pair for pair in zip(one, other, strict=True) if pair[0] != pair[1]]
    rows = tuple(', '.join(item) for item in zip(*unlike, strict=True))
    assert rows == differences().get(name, ())


def test_page_names_existing_scripts() -> None:
    assert differences().keys() <= SCRIPTS.keys()
    assert differences()
