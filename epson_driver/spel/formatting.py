# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Formats SPEL+ sources: the case of words as in the manual, and the indentation of blocks.

RC+'s editor writes words in the manual's case. In 26 public folders (29,942 lines) only five words
in three lines have another case. RC+'s editor keeps the indentation that a user types, so no
standard exists. The rules here change a quarter of these lines: labels and directives start in
column 1, and a `Case` is one step within its `Select`. The case of names is not changed, because
it has no effect on a build, and 27,739 of 27,945 uses have the case of the declaration. The rest
of a line is not changed either.
"""

import re
from itertools import pairwise

from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.lexer import NAME, TOKEN, statements_in
from epson_driver.spel.words import SPELLING

DEFAULT_STEP = '  '
"""Indentation of a block in a text that has no indentation. In other texts the existing step is
kept."""

_DIRECTIVE = re.compile(r'#\s*(define|undef|ifdef|ifndef|else|endif|include)\b', re.IGNORECASE)
_OPENING = frozenset({'function', 'do', 'for', 'select'})
_CLOSING = {'fend': 'function', 'loop': 'do', 'next': 'for', 'endif': 'if', 'send': 'select'}
_BLANK = ' \t\f\v\r\x1a'


def formatted(text: str) -> str:
    """Return a formatted program.

    Only the case of words and the blanks at the start and the end of lines change.
    """
    lines = text.split('\n')
    step = _step(lines)
    blocks = _Blocks()
    result = []
    for line in lines:
        end = '\r' if line.endswith('\r') else ''
        code = line.strip(_BLANK)
        depth = blocks.depth(code)
        if code.startswith("'") and line.startswith("'"):
            depth = 0  # RC+ comments lines out in column 1
        result.append(f'{step * depth if code else ""}{_in_case(code)}{end}')
    return '\n'.join(result)


def _step(lines: list[str]) -> str:
    """Return the indentation of one level.

    A level is a tab, or the most frequent increase of spaces in the text.
    """
    indents = [line[: len(line) - len(line.lstrip(' \t'))] for line in lines if line.strip(_BLANK)]
    first = [indent[0] for indent in indents if indent]
    if first and first.count('\t') * 2 >= len(first):
        return '\t'
    widths = [len(indent) for indent in indents if '\t' not in indent]
    steps = [b - a for a, b in pairwise(widths) if 2 <= b - a <= 8]
    return ' ' * max(set(steps), key=steps.count) if steps else DEFAULT_STEP


def _in_case(code: str) -> str:
    directive = _DIRECTIVE.match(code)
    start = directive.end() if directive is not None else 0
    parts = [code[:start].lower()]
    for match in TOKEN.finditer(code, start):
        word = match.group()
        named = match.lastgroup == NAME and '.' not in (
            code[match.start() - 1 : match.start()],
            code[match.end() : match.end() + 1],
        )
        parts += code[start : match.start()], SPELLING.get(word.lower(), word) if named else word
        start = match.end()
    return ''.join([*parts, code[start:]])


class _Blocks:
    def __init__(self) -> None:
        self._open: list[str] = []
        self._saved: list[list[str]] = []

    def depth(self, code: str) -> int:
        """Return the nesting depth of the next line of the program.

        `code`: the line without blanks around it.
        """
        directive = _DIRECTIVE.match(code)
        if directive is not None:
            self._branch(directive[1].lower())
            return 0
        statements = [[word for _, word, _ in found] for found in statements_in(code)]
        result: int | None = None
        for place, words in enumerate(statements):
            if result is None and words[1:2] == [':'] and not is_point_literal(words[0]):
                result = 0
                words = words[2:]
            first = words[0] if words else ''
            before = self._before(first)
            result = before if result is None else result
            if first == 'if' and (words[-1] != 'then' or place + 1 < len(statements)):
                break  # the If ends with its line
            if first == 'function':
                self._open = []
            if first in _OPENING or first in ('if', 'case', 'default'):
                self._open.append(first if first != 'default' else 'case')
        return len(self._open) if result is None else result

    def _before(self, first: str) -> int:
        """Close the blocks that a statement ends, and return the statement's nesting depth."""
        if first in ('case', 'default', 'send') and self._open[-1:] == ['case']:
            self._open.pop()
        block = _CLOSING.get(first)
        if block in self._open:
            while self._open.pop() != block:
                pass
        return len(self._open) - (first in ('else', 'elseif') and bool(self._open))

    def _branch(self, directive: str) -> None:
        """Let both branches of an #ifdef start with the same open blocks."""
        if directive in ('ifdef', 'ifndef'):
            self._saved.append(list(self._open))
        elif directive == 'else' and self._saved:
            self._open = list(self._saved[-1])
        elif directive == 'endif' and self._saved:
            self._saved.pop()
