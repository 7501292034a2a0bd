# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes the TextMate grammar of SPEL+ for VS Code from the word table.

python -m generate.grammar
"""

import json
import re
from collections.abc import Iterable
from pathlib import Path

from epson_driver.spel.commands import TYPES
from epson_driver.spel.words import CONSTANTS, WORDS

TARGET = Path(__file__).parents[1] / 'editors' / 'vscode' / 'spel.tmLanguage.json'
_CONTROL = {
    *('call', 'case', 'default', 'do', 'else', 'elseif', 'endif', 'eresume', 'exit', 'fend'),
    *('for', 'function', 'gosub', 'goto', 'if', 'loop', 'next', 'onerr', 'return', 'select'),
    *('send', 'step', 'then', 'to', 'until', 'while', 'xqt'),
}


def _words(scope: str, names: Iterable[str]) -> dict[str, str]:
    alternatives = '|'.join(map(re.escape, sorted(names, key=lambda name: (-len(name), name))))
    # $ is no word character: Chr$ ends before a letter only
    return {'match': rf'(?i)(?<![\w.])(?:{alternatives})(?![\w$.])', 'name': f'{scope}.spel'}


def grammar() -> str:
    """Return the grammar as JSON."""
    rest = {name: word for name, word in WORDS.items() if name not in _CONTROL | TYPES.keys()}
    statements = {name for name, word in rest.items() if word.uses - {'function'}}
    patterns = [
        {'match': "'.*$", 'name': 'comment.line.apostrophe.spel'},
        {'match': '"[^"]*("|$)', 'name': 'string.quoted.double.spel'},
        {
            'match': r'(?i)^\s*#\s*(define|undef|ifdef|ifndef|else|endif|include)\b',
            'name': 'keyword.control.directive.spel',
        },
        {
            'match': r'(?i)\b(function)\s+(\w+\$?)',
            'captures': {
                '1': {'name': 'keyword.control.spel'},
                '2': {'name': 'entity.name.function.spel'},
            },
        },
        {'match': r'^\s*[A-Za-z]\w*\s*:(?!\w+\()', 'name': 'entity.name.label.spel'},
        {
            'match': r'(?i)&h[0-9a-f]+|&b[01]+|(?<!\w)(\d+\.?\d*|\.\d+)(e[+-]?\d+)?\b',
            'name': 'constant.numeric.spel',
        },
        _words('keyword.control', _CONTROL),
        _words('storage.type', TYPES.keys() | {'global', 'preserve', 'static', 'byref', 'byval'}),
        _words('keyword.other', statements - {'global', 'preserve', 'byref', 'byval'}),
        _words('support.function', rest.keys() - statements),
        _words('constant.language', CONSTANTS),
    ]
    return json.dumps({'scopeName': 'source.spel', 'patterns': patterns}, indent=1) + '\n'


if __name__ == '__main__':
    TARGET.write_text(grammar(), encoding='utf-8')
