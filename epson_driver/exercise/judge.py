# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Evaluates a program's reaction to a fault, and describes it in a word and a sentence."""

from dataclasses import dataclass
from enum import StrEnum
from xml.etree import ElementTree

import numpy as np

from epson_driver.motion import Array

THERE = 0.01  # maximum distance from the end position of the run without a fault, rad or m


class Verdict(StrEnum):
    FINISHED = 'finished'
    GAVE_UP = 'gave up'
    GAVE_UP_SILENTLY = 'gave up silently'
    CLAIMED = 'claimed success'
    REPEATED = 'repeated'
    HUNG = 'hung'
    MOVED_AFTER_ESTOP = 'moved after E-stop'
    NO_MOTION = 'no motion'
    REFUSED = 'fault refused'


GOOD = (Verdict.FINISHED, Verdict.GAVE_UP)


@dataclass(frozen=True, eq=False)
class Observed:
    """Observations of one run of the program.

    * code: the program's exit code, or None if it had to be killed after `seconds`.
    * end: the arm's final position, shape (n,), rad or m.
    * refused: why the controller did not accept the fault, or ''.
    * aborted: why the driver last aborted a goal, or ''.
    """

    case: str
    code: int | None
    seconds: float
    last_line: str
    trajectories: int
    end: Array | None
    moved: bool = True
    moved_after_stop: bool = False
    refused: str = ''
    aborted: str = ''


@dataclass(frozen=True, slots=True)
class Result:
    case: str
    verdict: Verdict
    why: str
    seconds: float

    @property
    def good(self) -> bool:
        return self.verdict in GOOD


def judge(seen: Observed, usual: Observed) -> Result:
    verdict, why = _verdict(seen, usual)
    return Result(seen.case, verdict, why, seen.seconds)


def _verdict(seen: Observed, usual: Observed) -> tuple[Verdict, str]:
    if seen.moved_after_stop:
        return Verdict.MOVED_AFTER_ESTOP, 'the arm moved again after it had stopped for the E-stop'
    if seen.refused:
        return Verdict.REFUSED, f'the controller refused the fault: {seen.refused}'
    if seen.code is None:
        text = f'killed after {seen.seconds:.0f} s, last line: {seen.last_line or "-"}'
        return Verdict.HUNG, text
    if not seen.moved:
        return Verdict.NO_MOTION, f'the arm did not move, last line: {seen.last_line or "-"}'
    if seen.trajectories > usual.trajectories:
        text = f'{seen.trajectories} trajectories, but {usual.trajectories} without the fault'
        return Verdict.REPEATED, text
    if seen.code == 0:
        if seen.end is not None and usual.end is not None:
            off = float(np.abs(seen.end - usual.end).max())
            if off > THERE:
                text = f'exit code 0, but the arm is {off:.3f} rad or m away from the end'
                return Verdict.CLAIMED, text
        return Verdict.FINISHED, seen.last_line
    if not seen.last_line:
        return Verdict.GAVE_UP_SILENTLY, f'exit code {seen.code}, without any output'
    return Verdict.GAVE_UP, seen.last_line


def junit(results: list[Result], command: str) -> str:
    failures = sum(not result.good for result in results)
    suite = ElementTree.Element(
        'testsuite',
        name='epson_driver exercise',
        tests=str(len(results)),
        failures=str(failures),
        time=f'{sum(result.seconds for result in results):.3f}',
    )
    for item in results:
        case = ElementTree.SubElement(
            suite,
            'testcase',
            classname='epson_driver.exercise',
            name=item.case,
            time=f'{item.seconds:.3f}',
        )
        if not item.good:
            failure = ElementTree.SubElement(case, 'failure', message=item.verdict.value)
            failure.text = _xml_text(item.why)
        ElementTree.SubElement(case, 'system-out').text = _xml_text(
            f'{command}: {item.verdict.value}: {item.why}'
        )
    ElementTree.indent(suite)
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return head + ElementTree.tostring(suite, encoding='unicode') + '\n'


def _xml_text(text: str) -> str:
    return ''.join(c if c.isprintable() or c in '\n\t' else '\ufffd' for c in text)
