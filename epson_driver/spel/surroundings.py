# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The environment of a program besides its host: stub answers, ports, files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from epson_driver.inputs import InputError, near_name, read_yaml
from epson_driver.spel.errors import ErrorNumber, SpelError
from epson_driver.spel.files import Files
from epson_driver.spel.host import NetSettings
from epson_driver.spel.words import WORDS

Answer = int | float | str | None | list[int | float | str]
"""Values for the variables of a statement, the value of a function, or nothing."""


class Stubs:
    """Stub answers by word, or by word and first argument (`VGet find.Geom01.RobotXYU`).

    The answers of a word are used in turn, and the last one repeats.
    """

    def __init__(self, answers: Mapping[str, Sequence[Answer]]) -> None:
        self._answers = {' '.join(key.lower().split()): each for key, each in answers.items()}
        self._given: dict[str, int] = {}

    def answer(self, name: str, arguments: Sequence[object]) -> Answer:
        """Return the next answer. Raises SpelError if none exists."""
        keys = [name.lower()]
        if arguments:
            keys.insert(0, f'{keys[0]} {arguments[0]}'.lower())
        for key in keys:
            if answers := self._answers.get(key):
                turn = self._given.get(key, 0)
                self._given[key] = turn + 1
                return answers[min(turn, len(answers) - 1)]
        text = f'{name} is not simulated: give an answer to it with --stub'
        raise SpelError(ErrorNumber.NOT_SIMULATED, text)


@dataclass
class Surroundings:
    """Answers, port settings and files.

    `ports`: settings of ports 201 to 216 in RC+'s system configuration, valid until SetNet.
    """

    answers: Mapping[str, Sequence[Answer]] = field(default_factory=dict)
    ports: Mapping[int, NetSettings] = field(default_factory=dict)
    files: Files = field(default_factory=Files)

    def fresh(self) -> 'Surroundings':
        """Return a copy with unmodified files."""
        return replace(self, files=self.files.fresh())

    def new_stubs(self) -> Stubs:
        """Return the answers, starting with the first."""
        return Stubs(self.answers)


def read_answers(path: Path) -> dict[str, list[Answer]]:
    """Return the answers of a file of --stub: `word: answer`, or a list of answers.

    Raises InputError.
    """
    found: dict[str, list[Answer]] = {}
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InputError(f'{path}: must have lines WORD: ANSWERS')
    for key, given in content.items():
        word = str(key).split()[0].lower() if str(key).split() else ''
        if word not in WORDS:
            near = near_name(word, [each.name for each in WORDS.values()])
            meant = f': did you mean {near}?' if near else ''
            raise InputError(f'{path}: {key} is no word of SPEL+{meant}')
        answers = given if isinstance(given, list) else [given]
        for each in answers:
            values = each if isinstance(each, list) else [each]
            if not all(value is None or isinstance(value, int | float | str) for value in values):
                raise InputError(f'{path}: {key}: an answer is a value, or a list of values')
        found[str(key)] = answers
    return found
