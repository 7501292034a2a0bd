# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The built-in and the SPEL+ program get the same bytes. The page lists the differences.

`byte_scripts.py` contains the scripts. Replies, connection and final position are compared.
"""

import re
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from support.byte_scripts import SCRIPTS, Script
from support.controller_harness import SIMULATED, Harness, InlinePlanner, split
from support.examples import one_in
from support.spel_program_harness import OurProgramHarness

from epson_driver.simple_message import FrameError

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
