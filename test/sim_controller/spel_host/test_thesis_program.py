# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The thesis' own program, unmodified, on the simulated controller.

It has the profile that docs/controllers.md gives as an example, and the defects that the page
lists. Its text is not part of this repository: without it these tests are skipped. Rules repair
errors of the printed form. Each counts its uses, so that a change of the text is noticed.
"""

import logging
import os
import re
import struct
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.controller_harness import MODEL, STOP, frame, point, split
from support.spel_program_harness import STEP_S, SpelProgramHarness

from epson_driver.profiles.profile import load_controller_profile
from epson_driver.sim_controller.assembly import new_controller, program_network
from epson_driver.sim_controller.spel_host.spel_program import SpelProgram, SpelSource
from epson_driver.spel import ErrorNumber, SpelError, build

SEED = Path(os.environ.get('EPSON_DRIVER_SEED', Path(__file__).parents[4] / 'shared' / 'seed'))
HEADING = re.compile(r'^Bijlage ([A-G]): ')
NAMES = {
    'A': 'trajectory.prg',
    'B': 'state.prg',
    'C': 'main.prg',
    'D': 'simple_message.inc',
    'E': 'robotinfo.inc',
}
USER_ERRORS = 'Label1 {\nnError=8000\nsLabel="CORRUPT_MSG"\n}\n'
"""The text gives the label and the number, but not the file."""

FENCE = '```'
INVENTED_ENDS = {'endwhile': (), 'endfunction': ('endif', 'next i')}
"""Block ends that SPEL+ does not have, with the real ends before them. The conversion of the pages
to text added them where a block was open at the end of a page."""
INCOMPLETE = re.compile(r'(\bAs|\bOr|\bAnd|[,(+*=<>-])$', re.IGNORECASE)
CONTINUES = re.compile(r'[*+<>]')
BARE_COMMENT = re.compile(r'(TODO:|\*+$)')


def listings() -> dict[str, list[str]] | None:
    """Return the lines of appendices A to F by letter, None without the text."""
    texts = sorted(SEED.glob('*.txt')) if SEED.is_dir() else []
    for path in texts:
        lines = path.read_text(encoding='utf-8').split('\n')
        starts = {}
        for number, line in enumerate(lines):
            if (match := HEADING.match(line)) is not None:
                starts[match[1]] = number  # the last one: the table of contents comes first
        if set('ABCDEFG') <= starts.keys():
            following = dict(zip('ABCDEF', 'BCDEFG', strict=True))
            return {
                letter: lines[starts[letter] + 1 : starts[following[letter]]]
                for letter in following
            }
    return None


def repaired(lines: Sequence[str], repairs: Counter[str]) -> str:
    """Return a listing as a program. `repairs` counts the repairs."""
    result: list[str] = []
    for line in lines:
        text = line.strip()
        if text.startswith(FENCE) or not text:
            continue
        if text.lower() in INVENTED_ENDS:
            repairs['ends of blocks at the end of a page'] += 1
            for expected in reversed(INVENTED_ENDS[text.lower()]):
                end = result.pop()
                assert end.lower() == expected, end
        elif BARE_COMMENT.match(text):
            repairs['comments without their mark'] += 1
        elif result and _is_continued(result[-1], text):
            repairs['lines that were wrapped'] += 1
            result[-1] += ' ' + text
        else:
            result.append(text)
    return '\n'.join(result) + '\n'


def _is_continued(before: str, text: str) -> bool:
    """Return whether a line continues the previous line."""
    if before.startswith(("'", '#')):
        return False
    code, quotes = _code(before)
    if quotes % 2:
        return True
    depth = code.count('(') - code.count(')')
    return (
        depth > 0
        or INCOMPLETE.search(code.rstrip()) is not None
        or CONTINUES.match(text) is not None
    )


def _code(line: str) -> tuple[str, int]:
    """Return a line without strings and comment, and how many quotes it has."""
    code, quotes = '', 0
    for letter in line:
        if letter == '"':
            quotes += 1
            code += letter
        elif quotes % 2 == 0:
            if letter == "'":
                break
            code += letter
    return code, quotes


def program_files(found: dict[str, list[str]], repairs: Counter[str]) -> dict[str, str]:
    """Return the project's files."""
    files = {name: repaired(found[letter], repairs) for letter, name in NAMES.items()}
    return {**files, 'UserErrors.dat': USER_ERRORS}


def call_library(_host: object, _library: str, name: str, arguments: Sequence[object]) -> int:
    """Emulate the functions of the thesis' DLL (its appendix F).

    ConvertToFloatingpoint takes velocity and duration by value in C, so they stay unchanged.
    """
    given: list[Any] = [getattr(argument, 'd', argument) for argument in arguments]
    if name.lower() == 'jointpositionsmtoints':
        *numbers, out = given
        data = struct.pack('<5i10f', *numbers)
    elif name.lower() == 'robotstatussmtoints':
        *head, body, out = given
        data = struct.pack('<11i', *head, *body)
    else:
        integers, out, _, _ = given
        out[:] = struct.unpack_from('<10f', bytes(integers))
        return 1
    out[: len(data)] = list(data)
    return 1


FOUND = listings()
pytestmark = pytest.mark.skipif(
    FOUND is None,
    reason=f'the thesis is not in {SEED}: set EPSON_DRIVER_SEED to where its text is',
)
PAGE = (Path(__file__).parents[3] / 'docs' / 'controllers.md').read_text(encoding='utf-8')
EXAMPLE = PAGE.split('```yaml\n', 1)[1].split('```', 1)[0]
REPLY = struct.pack('<4i', 56, 10, 3, 1) + bytes(44)
"""Its only reply: SUCCESS and zeros."""
UNKNOWN = -1


class ThesisHarness(SpelProgramHarness):
    """The program with a substitute for its DLL, motors on and both servers started."""

    program = None

    def __init__(self, caplog, folder, motors=True):
        if ThesisHarness.program is None:
            ThesisHarness.program = build(program_files(FOUND, Counter()))
        path = folder / 'thesis.yaml'
        path.write_text(EXAMPLE, encoding='utf-8')
        self.profile = load_controller_profile(str(path))
        source = SpelSource(self.program, program_network(self.profile))
        self.controller = new_controller(MODEL, self.profile, spel=source)
        self.caplog = caplog
        self.positions = [self.position]
        if motors:
            self.do('motors on')
        self.step(0.2)

    def send(self, motion, peer, *frames):
        """Send points, each after the previous reply, and return the replies."""
        got = []
        for data in frames:
            peer.take()
            motion.receive(data)
            self.until(lambda: len(peer.got) >= len(REPLY), 30.0)
            got.append(peer.take())
        return got


@pytest.fixture
def new_harness(caplog, monkeypatch, tmp_path):
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(SpelProgram, 'call_library', call_library)
    return lambda **options: ThesisHarness(caplog, tmp_path, **options)


@pytest.fixture
def harness(new_harness):
    return new_harness()


def assert_no_server(harness):
    """All tasks have ended, and with them their ports."""
    assert list(harness.controller.tasks()) == []
    for port in ('motion', 'state'):
        with pytest.raises(ConnectionRefusedError):
            harness.client(port)


def at(*values):
    return [*values, *[0.0] * (6 - len(values))]


def test_listings_extracted_from_the_thesis_are_repaired():
    repairs = Counter()
    files = program_files(FOUND, repairs)
    assert sorted(files) == [
        'UserErrors.dat',
        'main.prg',
        'robotinfo.inc',
        'simple_message.inc',
        'state.prg',
        'trajectory.prg',
    ]
    assert repairs == {
        'lines that were wrapped': 16,
        'comments without their mark': 4,
        'ends of blocks at the end of a page': 3,
    }


def test_every_reply_to_a_point_is_success_with_zeros(harness):
    """Defect 5, the good case."""
    motion, peer = harness.client('motion')
    assert harness.send(motion, peer, point(0, at(0.05)), point(1, at(0.1, 0.1))) == [REPLY] * 2
    harness.until(lambda: not harness.controller.in_motion)
    assert np.abs(harness.position - at(0.1, 0.1)).max() < 1e-5


def test_status_has_unknown_in_motion(harness):
    """Defect 10. STATUS follows ten positions."""
    _, peer = harness.client('state')
    harness.step(1.0)
    messages = split(peer.take())
    kinds = [kind for kind, *_ in messages]
    first = kinds.index(13)
    assert kinds[first - 10 : first + 11] == [*[10] * 10, 13, *[10] * 10]
    powered, e_stopped, error, in_error, in_motion, mode, possible = struct.unpack(
        '<7i', messages[first][3]
    )
    assert (powered, e_stopped, error, in_error) == (1, 0, 0, 0)
    assert (in_motion, mode, possible) == (UNKNOWN, 2, UNKNOWN)


def test_lost_client_ends_both_servers(harness):
    """Defect 1."""
    for port in ('motion', 'state'):
        connection, _ = harness.client(port)
        harness.step(0.3)
        connection.closed()
        harness.step(3.0)
        with pytest.raises(ConnectionRefusedError):
            harness.client(port)


def test_servers_end_after_50_s_without_a_client(harness):
    """Defect 12."""
    harness.step(49.0)
    assert len(list(harness.controller.tasks())) == 2
    harness.step(3.0)
    assert_no_server(harness)


def test_stop_is_answered_after_the_motion_and_stops_nothing(harness):
    """Defect 2."""
    motion, peer = harness.client('motion')
    motion.receive(point(0, at(0.4)) + point(STOP))
    harness.until(lambda: harness.position[0] > 0.1)
    assert not peer.got
    harness.until(lambda: len(peer.got) >= 2 * len(REPLY), 30.0)
    assert peer.take() == 2 * REPLY
    assert abs(harness.position[0] - 0.4) < 1e-5


@pytest.mark.parametrize('sequence', [-1, -2, -3, -4])
def test_every_negative_sequence_is_a_stop(harness, sequence):
    """Defect 3."""
    motion, peer = harness.client('motion')
    assert harness.send(motion, peer, point(sequence, at(0.2))) == [REPLY]
    harness.step(2.0)
    assert not np.any(harness.positions)
    assert any('trajectory stop message' in line for line in harness.printed)


def test_point_out_of_range_or_sequence_gets_success(harness):
    """Defects 5 and 6."""
    motion, peer = harness.client('motion')
    points = (point(0, at(3.0)), point(7, at(0.1)), point(3, at(0.05)))
    assert harness.send(motion, peer, *points) == [REPLY] * 3
    harness.until(lambda: not harness.controller.in_motion)
    assert abs(harness.position[0] - 0.05) < 1e-5
    assert max(item[0] for item in harness.positions) < 0.11


def test_point_without_motors_gets_success_after_a_message_box(new_harness):
    """Defects 4 and 5: the error is handled, nothing moves, the reply is a SUCCESS."""
    harness = new_harness(motors=False)
    motion, peer = harness.client('motion')
    assert harness.send(motion, peer, point(0, at(0.2))) == [REPLY]
    assert any('answered with Cancel' in line for line in harness.printed)
    assert not np.any(harness.positions)


def test_error_handler_runs_after_each_point(new_harness):
    """Defect 4: no Exit before the label, so the handler runs after every point. The arm moves
    all the same, the replies are the same."""
    harness = new_harness(motors=False)
    motion, peer = harness.client('motion')
    assert harness.send(motion, peer, point(0, at(0.2))) == [REPLY]
    assert harness.printed.count('in ErrorHandler') == 1
    harness.do('motors on')
    assert harness.send(motion, peer, point(1, at(0.05)), point(2, at(0.1))) == [REPLY] * 2
    harness.until(lambda: not harness.controller.in_motion)
    assert abs(harness.position[0] - 0.1) < 1e-5
    assert harness.printed.count('in ErrorHandler') == 3


def test_error_of_the_state_server_ends_all_tasks(harness, monkeypatch):
    """Defect 4: Quit All after its label. Here the DLL is unavailable."""
    _, peer = harness.client('state')
    harness.step(0.5)
    assert peer.take()

    def gone(_host, _library, name, _arguments):
        raise SpelError(ErrorNumber.NO_LIBRARY, name)

    monkeypatch.setattr(SpelProgram, 'call_library', gone)
    harness.step(0.5)
    assert_no_server(harness)


def test_corrupt_message_ends_all_tasks(harness):
    """Defect 5."""
    motion, _ = harness.client('motion')
    motion.receive(frame(11, 2, 0, bytes(20)))
    harness.step(3.0)
    assert_no_server(harness)


def test_low_power_limits_speed_to_5_percent(harness):
    """Defects 6 and 8: `uses: nothing`, `power: low`."""
    motion, peer = harness.client('motion')
    harness.send(motion, peer, point(0, at(0.5), velocity=1.0, duration=0.1))
    velocity, _ = harness.within_limits()
    assert 0.02 < velocity < 0.0501


def test_arm_stops_at_every_point_in_spite_of_cp(harness):
    """Defect 9."""
    motion, peer = harness.client('motion')
    start = len(harness.positions)
    harness.send(motion, peer, *(point(n, at(0.05 * (n + 1))) for n in range(3)))
    harness.until(lambda: not harness.controller.in_motion)
    moves = np.diff(np.array(harness.positions[start:])[:, 0]) > 1e-9
    assert np.count_nonzero(np.diff(moves.astype(int)) == 1) == 3
    assert len(moves) * STEP_S > 2.0  # a second after each point


def test_estop_ends_the_motion_but_not_the_state_server(harness):
    """Xqt … NoEmgAbort."""
    _, state = harness.client('state')
    motion, peer = harness.client('motion')
    motion.receive(point(0, at(1.0)))
    harness.until(lambda: harness.position[0] > 0.1)
    harness.do('E-stop press')
    harness.step(1.0)
    state.take()
    peer.take()
    harness.step(1.0)
    assert len(split(state.take())) > 10
    motion.receive(point(1, at(0.0)))
    harness.step(2.0)
    assert not peer.got
