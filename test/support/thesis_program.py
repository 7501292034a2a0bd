# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The thesis' SPEL+ program, extracted from its text and repaired, with a replacement of its DLL.

The text is not part of this repository. It is read from ../shared/seed or EPSON_DRIVER_SEED.
Rules repair errors of the printed form. Each rule counts its uses, so that a test notices a
change of the text or of a rule.
"""

import os
import re
import struct
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SEED = Path(os.environ.get('EPSON_DRIVER_SEED', Path(__file__).parents[3] / 'shared' / 'seed'))
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
