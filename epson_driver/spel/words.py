# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The words of SPEL+, from config/spel/words.yaml. Parser, linter and docs use this table."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from epson_driver.inputs import read_yaml
from epson_driver.share import share_path

FIRST = (6, 0, 0)


@dataclass(frozen=True, slots=True)
class Word:
    """One word: its uses, and where it is allowed.

    * uses: where it can be used: 'window' (the command window and $Execute), 'statement',
      'function', 'keyword'.
    * background: whether it is allowed in NoEmgAbort and background tasks.
    * since: the first version of SPEL+ that has the word.
    * page: its page in the SPEL+ manual, if it has one.
    """

    name: str
    uses: frozenset[str]
    background: bool
    since: tuple[int, ...]
    page: int | None

    @property
    def window(self) -> bool:
        """Whether a line of the command window may start with the word.

        Functions are only allowed inside of a statement.
        """
        return 'window' in self.uses or self.uses == {'function'}


_TABLE: dict[str, Any] = read_yaml(share_path('config', 'spel', 'words.yaml'))
_USES = ('window', 'statement', 'function', 'keyword')


def _words() -> Iterator[Word]:
    since = {
        name: tuple(map(int, version.split('.')))
        for version, names in _TABLE['since'].items()
        for name in names.split()
    }
    parts = _TABLE['page'].split()
    pages = dict(zip(parts[::2], map(int, parts[1::2]), strict=True))
    elsewhere = frozenset(_TABLE['not in background'].split())
    for key, names in _TABLE.items():
        uses = frozenset(key.split())
        if uses <= frozenset(_USES):
            for name in names.split():
                version = since.get(name, FIRST)
                yield Word(name, uses, name not in elsewhere, version, pages.get(name))


def _constants() -> Iterator[tuple[str, int | str]]:
    for prefix, text in _TABLE['constant'].items():
        parts = text.split()
        for name, value in zip(parts[::2], parts[1::2], strict=True):
            yield f'{prefix}_{name}' if prefix else name, int(value)
    yield from _TABLE['text constant'].items()


WORDS: dict[str, Word] = {word.name.lower(): word for word in _words()}
"""Statements, functions and keywords by name in lower case."""

CONSTANTS: dict[str, int | str] = {name.lower(): value for name, value in _constants()}
"""Predefined constants by name in lower case."""

SPELLING = {name.lower(): name for name, _ in _constants()} | {
    key: word.name for key, word in WORDS.items()
}
"""All words and constants in the manual's case, by name in lower case."""

SYNTAX: dict[str, str] = {name.lower(): text for name, text in _TABLE['syntax'].items()}
"""Syntax in the manual by name in lower case, of statements whose form starts with `@`."""

EXCEPTIONS: dict[str, str] = _TABLE['background exceptions']
"""Word → the tasks that can execute it, although the manual lists it as not in background."""

EVERY_VERSION = (99, 0, 0)


def reserved(name: str, version: tuple[int, ...] = EVERY_VERSION) -> bool:
    word = WORDS.get(name.lower())
    return name.lower() in CONSTANTS or (word is not None and word.since <= version)


def not_simulated(name: str) -> str:
    """Return the text for a word that is not simulated, with its manual page."""
    word = WORDS.get(name.lower())
    page = f' (SPEL+ manual p{word.page})' if word is not None and word.page else ''
    return f'{name} is not simulated{page}'


def is_a(use: str, name: str) -> bool:
    word = WORDS.get(name.lower())
    return word is not None and use in word.uses
