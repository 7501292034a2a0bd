# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Labels of points and I/O that are used without the RC+ files that define them.

Programs are often shared alone, without their .pts file and IOLabels.dat. A name that can only be
the label of a point or of I/O is then treated as one, with a warning.
"""

from collections.abc import Iterable, Mapping

from epson_driver.spel.commands import COMMANDS, TYPES
from epson_driver.spel.errors import Problem
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.lexer import END, NAME, Token
from epson_driver.spel.preprocess import Line
from epson_driver.spel.project_data import IO_LABELS, LAST_POINT, POINTS, PROJECT, ProjectData
from epson_driver.spel.words import reserved

_MOTIONS = frozenset(name for name, rule in COMMANDS.items() if rule.form == '@motion')
_PLACES = frozenset({'here', 'xy', 'ja', 'pulse', 'agltopls', 'curpos', 'realpos', 'pallet'})
_OF_POINTS = frozenset({'pallet', 'local'})
"""Statements with points and numbers as arguments."""
_SIDES = frozenset({'x', 'y', 'l', 'r', 'baseu', 'outside'})
_SWITCHED = frozenset({'on', 'off', 'out', 'outw', 'opbcd'})
_READ = frozenset({'sw', 'in', 'inw', 'oport', 'out', 'outw'})


def add_missing(
    data: ProjectData,
    files: Mapping[str, str],
    lines: Mapping[str, list[Line]],
    functions: set[str],
    notes: list[Problem],
) -> None:
    """Add the labels that a project without .sprj, .pts or IOLabels.dat leaves undefined.

    Points get the numbers 999, 998, … and no place. I/O labels are added to `data.unlabelled`.
    """
    there = {name.lower() for name in files}
    if any(name.endswith(PROJECT) for name in there):
        return
    known = functions | data.labels.keys() | data.point_labels.keys()
    every = [line for found in lines.values() for line in found]
    known |= _declared(every)
    points = {} if any(name.endswith(POINTS) for name in there) else _points(every, known)
    bits = {} if IO_LABELS in there else _bits(every, known | points.keys())
    for number, (name, token) in enumerate(points.items()):
        data.point_labels[name] = LAST_POINT - number
        _note(notes, token, 'a point', 'there is no .pts file')
    for name, token in bits.items():
        data.unlabelled.add(name)
        _note(notes, token, 'an I/O bit', 'there is no IOLabels.dat')


def _note(notes: list[Problem], token: Token, kind: str, why: str) -> None:
    text = f'{token.text} is taken for the label of {kind}: {why}'
    notes.append(Problem(token.position, 'project-file', text, warning=True))


def _declared(lines: Iterable[Line]) -> set[str]:
    """Return the names in all lines that contain a type."""
    found: set[str] = set()
    for line in lines:
        if any(token.lower in TYPES for token in line.tokens):
            found |= {token.lower for token in line.tokens if token.kind == NAME}
    return found


def _is_free(token: Token, known: set[str]) -> bool:
    name = token.lower
    return (
        token.kind == NAME
        and not reserved(name)
        and not is_point_literal(name)
        and name not in known
        and (name[:1] != 'p' or name[1:] not in known)  # Pctr: P(ctr), p345
    )


def _points(lines: Iterable[Line], known: set[str]) -> dict[str, Token]:
    found: dict[str, Token] = {}
    for line in lines:
        for first, second, third in _threes(line):
            word = first.lower
            moved = word in _MOTIONS and third.text != '('
            placed = second.text == '=' and third.lower in _PLACES
            for token in ([second] if moved else []) + ([first] if placed else []):
                if _is_free(token, known):
                    found.setdefault(token.lower, token)
        if line.tokens and line.tokens[0].lower in _OF_POINTS:
            for token in line.tokens[1:]:
                if token.lower not in _SIDES and _is_free(token, known):
                    found.setdefault(token.lower, token)
    return found


def _bits(lines: Iterable[Line], known: set[str]) -> dict[str, Token]:
    found: dict[str, Token] = {}
    for line in lines:
        for first, second, third in _threes(line):
            if first.lower in _READ and second.text == '(':
                token = third
            elif first.lower in _SWITCHED and third.text in ('', ',', ';', '!'):
                token = second
            else:
                continue
            if _is_free(token, known):
                found.setdefault(token.lower, token)
    return found


def _threes(line: Line) -> Iterable[tuple[Token, Token, Token]]:
    if not line.tokens:
        return ()
    end = Token(END, '', line.tokens[-1].position)
    padded = (*line.tokens, end, end)
    return zip(padded, padded[1:], padded[2:], strict=False)
