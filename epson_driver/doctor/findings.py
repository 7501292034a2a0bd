# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What was looked at, how it is, and what to do about it: a line each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """How something is. WRONG and HELD make the exit code 1.

    HELD: nothing is broken, but this keeps the arm from moving.
    """

    OK = 'ok'
    NOTE = 'note'
    WRONG = 'wrong'
    HELD = 'held'
    SKIPPED = 'skipped'


@dataclass(frozen=True, slots=True)
class Finding:
    """One line: what it is about, what was found, and what to do."""

    level: Level
    about: str
    found: str
    remedy: str = ''


class Findings:
    """Collects findings, and tells each at once: what comes next may take its time.

    `busy` is told what takes its time now. `doubt`: a
    sentence on what keeps anybody from knowing whether the arm could move.
    """

    def __init__(
        self, tell: Callable[[Finding], None], busy: Callable[[str], None] = lambda text: None
    ) -> None:
        self.all: list[Finding] = []
        self.busy = busy
        self.doubt = ''
        self._tell = tell

    def add(self, finding: Finding) -> None:
        """Take a finding."""
        self.all.append(finding)
        self._tell(finding)

    def ok(self, about: str, found: str) -> None:
        """Say that something is as it should be."""
        self.add(Finding(Level.OK, about, found))

    def note(self, about: str, found: str, remedy: str = '') -> None:
        """Say something worth knowing that is not wrong."""
        self.add(Finding(Level.NOTE, about, found, remedy))

    def wrong(self, about: str, found: str, remedy: str) -> None:
        """Say what is wrong, and what to do."""
        self.add(Finding(Level.WRONG, about, found, remedy))

    def held(self, about: str, found: str, remedy: str) -> None:
        """Say what keeps the arm from moving, and what helps."""
        self.add(Finding(Level.HELD, about, found, remedy))

    def skipped(self, about: str, why: str, remedy: str = '') -> None:
        """Say what was not looked at, and why."""
        self.add(Finding(Level.SKIPPED, about, why, remedy))

    @property
    def exit_code(self) -> int:
        """0 if nothing is wrong and nothing keeps the arm from moving, else 1."""
        return int(any(each.level in (Level.WRONG, Level.HELD) for each in self.all))

    @property
    def verdict(self) -> str:
        """All of it in one sentence."""
        wrong = sum(each.level is Level.WRONG for each in self.all)
        held = next((each for each in self.all if each.level is Level.HELD), None)
        said = [f'{wrong} wrong'] if wrong else []
        if held is not None:
            said.append(f'the arm cannot move: {held.found}')
        elif self.doubt:
            said.append(self.doubt)
        return '; '.join(said) or 'nothing is wrong'


def as_text(findings: Findings, head: Sequence[str]) -> str:
    """Return the findings as a text file for a bug report."""
    lines = [*head, '']
    for each in findings.all:
        lines.append(f'{each.level.value:8}{each.about}: {each.found}')
        if each.remedy:
            lines.append(f'{"":8}-> {each.remedy}')
    return '\n'.join([*lines, '', findings.verdict]) + '\n'
