# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What was looked at, how it is, and what to do about it: a line each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """How something is. Only WRONG makes the exit code 1."""

    OK = 'ok'
    NOTE = 'note'
    WRONG = 'wrong'
    SKIPPED = 'skipped'


@dataclass(frozen=True, slots=True)
class Finding:
    """One line: what it is about, what was found, and what to do."""

    level: Level
    about: str
    found: str
    remedy: str = ''


class Findings:
    """Collects findings, and tells each at once: what comes next may take its time."""

    def __init__(self, tell: Callable[[Finding], None]) -> None:
        self.all: list[Finding] = []
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

    def skipped(self, about: str, why: str, remedy: str = '') -> None:
        """Say what was not looked at, and why."""
        self.add(Finding(Level.SKIPPED, about, why, remedy))

    @property
    def exit_code(self) -> int:
        """0 if nothing is wrong, else 1."""
        return int(any(each.level is Level.WRONG for each in self.all))


def as_text(findings: Sequence[Finding], head: Sequence[str]) -> str:
    """Return the findings as a text file for a bug report."""
    lines = [*head, '']
    for each in findings:
        lines.append(f'{each.level.value:8}{each.about}: {each.found}')
        if each.remedy:
            lines.append(f'{"":8}-> {each.remedy}')
    wrong = sum(each.level is Level.WRONG for each in findings)
    lines += ['', 'nothing is wrong' if not wrong else f'{wrong} wrong']
    return '\n'.join(lines) + '\n'
