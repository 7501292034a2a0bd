# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Findings of the doctor, one line each: the subject, its state and the remedy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from epson_driver.driver.inhibit import Cause, Inhibit
from epson_driver.driver.remedy import Remedy


class Level(StrEnum):
    """Severity of a finding. WRONG and INHIBIT make the exit code 1."""

    OK = 'ok'
    NOTE = 'note'
    WRONG = 'wrong'
    INHIBIT = 'inhibit'  # nothing is broken, but this keeps the arm from moving
    SKIPPED = 'skipped'


@dataclass(frozen=True, slots=True)
class Finding:
    level: Level
    about: str
    text: str
    remedy: str = ''


class Findings:
    """Collects findings and reports each immediately, because the next check may be slow.

    * report: called with each finding.
    * busy: called with a description of the current step.
    * doubt: reason why the arm cannot move yet, or may be unable to move. '' if there is none.
    """

    def __init__(
        self, report: Callable[[Finding], None], busy: Callable[[str], None] = lambda text: None
    ) -> None:
        self.all: list[Finding] = []
        self.busy = busy
        self.doubt = ''
        self._report = report

    def add(self, finding: Finding) -> None:
        self.all.append(finding)
        self._report(finding)

    def ok(self, about: str, text: str) -> None:
        self.add(Finding(Level.OK, about, text))

    def note(self, about: str, text: str, remedy: str = '') -> None:
        self.add(Finding(Level.NOTE, about, text, remedy))

    def wrong(self, about: str, text: str, remedy: str) -> None:
        self.add(Finding(Level.WRONG, about, text, remedy))

    def inhibit(self, about: str, text: str, remedy: str) -> None:
        self.add(Finding(Level.INHIBIT, about, text, remedy))

    def skipped(self, about: str, why: str, remedy: str = '') -> None:
        self.add(Finding(Level.SKIPPED, about, why, remedy))

    @property
    def exit_code(self) -> int:
        return int(any(item.level in (Level.WRONG, Level.INHIBIT) for item in self.all))

    @property
    def verdict(self) -> str:
        wrong = sum(item.level is Level.WRONG for item in self.all)
        inhibit = next((item for item in self.all if item.level is Level.INHIBIT), None)
        message = [f'{wrong} wrong'] if wrong else []
        if inhibit is not None:
            message.append(f'the arm cannot move: {inhibit.text}')
        elif self.doubt:
            message.append(self.doubt)
        return ', '.join(message) or 'nothing is wrong'


def as_text(findings: Findings, head: Sequence[str]) -> str:
    lines = [*head, '']
    for item in findings.all:
        lines.append(f'{item.level.value:8}{item.about}: {item.text}')
        if item.remedy:
            lines.append(f'{"":8}-> {item.remedy}')
    return '\n'.join([*lines, '', findings.verdict]) + '\n'


ARM = 'the arm'

ABOUT = {
    Cause.SECOND_DRIVER: 'second driver',
    Cause.ESTOP: 'E-stop',
    Cause.ERROR: 'error',
    Cause.SAFEGUARD: 'safeguard',
    Cause.MANUAL_MODE: 'key switch',
    Cause.CONTROL_DEVICE: 'control device',
    Cause.MOTORS_OFF: 'motors',
    Cause.MAIN_ENDED: 'main',
    Cause.PAUSED: 'pause',
}
"""Cause → subject of a finding about it. The subject of all other causes is the arm."""

ENABLE = 'enable the arm (ROS: ~/enable, Python: enable(), panel: Enable)'
RESET = 'reset (ROS: ~/reset_error, Python: reset(), panel: Reset error), then enable the arm'
WORDS = {
    Remedy.RELEASE_ESTOP: f'release it, {RESET}',
    Remedy.RESET: RESET,
    Remedy.ENABLE: f'{ENABLE}. If the motors stay off, close the safeguard',
    Remedy.START_MAIN: f'start main at the controller, or {ENABLE}',
    Remedy.LOOK_AT_CONTROLLER: 'close the safeguard, continue or start main there (with --ask, a '
    'remote port shows which)',
}


def report_inhibit(inhibit: Inhibit, findings: Findings, driver: str = '') -> None:
    """Report a reason why the arm cannot move. If enabling is enough, this is only a note.

    `driver`: the driver that reports the reason, if any.
    """
    remedy = WORDS.get(inhibit.remedy, inhibit.remedy.value)
    advice = ', '.join(filter(None, (inhibit.advice, remedy)))
    about = driver or ABOUT.get(inhibit.cause, ARM)
    if inhibit.remedy is Remedy.ENABLE:
        findings.doubt = f'the arm cannot move yet: {inhibit.text}'
        findings.note(about, inhibit.text, advice)
    else:
        findings.inhibit(about, inhibit.text, advice)


def report_drivers(drivers: Sequence[Mapping[str, str]], findings: Findings) -> None:
    """Report the /diagnostics of the drivers running in this ROS domain.

    Each mapping contains `name`, `host`, `text`, and the other diagnostic values that a driver
    publishes for its arm.
    """
    for driver in drivers:
        who = f'driver {driver["name"]} ({driver["host"]})'
        if (cause := driver.get('cause', 'NONE')) == 'NONE':
            findings.ok(who, driver['text'])
            continue
        result = Inhibit(
            Cause.__members__.get(cause, Cause.NOT_ENABLED),
            Remedy.__members__.get(driver.get('remedy', ''), Remedy.NONE),
            driver['text'],
            driver.get('advice', ''),
        )
        report_inhibit(result, findings, who)
    if not drivers:
        findings.skipped('driver', 'not running in this ROS domain, so its arm gate is unknown')
