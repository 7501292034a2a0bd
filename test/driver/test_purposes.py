# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The inhibits of each purpose, in their order: all apply at first and are removed one by one."""

from types import SimpleNamespace as Fake
from typing import Any

import pytest

from epson_driver.driver.inhibit import MAIN_ENDED, MANUAL, Cause, Purpose, second_driver
from epson_driver.driver.remedy import Remedy
from epson_driver.driver.why_not import InhibitTable
from epson_driver.error_texts import load_error_texts
from epson_driver.link import LinkState
from epson_driver.simple_message import Mode, Status

NOW = 100.0

CLOSED = (
    'NO_STATE_LINK NO_JOINTS NO_STATUS STOP_FAILED NO_MOTION_LINK SECOND_DRIVER ESTOP '
    'MANUAL_MODE NOT_ENABLED'
)
"""Inhibits of every purpose while the arm gate is closed."""

ORDER = {
    Purpose.REPORT: f'{CLOSED} MOTORS_OFF MAIN_ENDED PAUSED',
    Purpose.COMMAND: 'NO_STATE_LINK NO_MOTION_LINK',
    Purpose.ENABLE: 'SECOND_DRIVER ESTOP',
    Purpose.OPEN: 'NO_STATE_LINK NO_STATUS NO_MOTION_LINK SECOND_DRIVER ESTOP MOTORS_OFF NO_POSE',
    Purpose.RUN: 'SECOND_DRIVER ESTOP MOTORS_OFF MAIN_ENDED',
    Purpose.GOAL: f'{CLOSED} STOPPING STREAM',
    Purpose.READY: f'{CLOSED} STOPPING STREAM NO_POSE MAIN_ENDED PAUSED',
    Purpose.ALONE: 'GOAL_RUNS',
    Purpose.START: f'{CLOSED} STOPPING STREAM NO_POSE MAIN_ENDED PAUSED MOVES',
    Purpose.STREAM: f'NO_STREAMS GOAL_RUNS {CLOSED} STOPPING STREAM NO_POSE MAIN_ENDED PAUSED '
    'MOVES',
    Purpose.FOLLOW: f'{CLOSED} STOPPING MAIN_ENDED PAUSED',
    Purpose.LET_GO: f'{CLOSED} MAIN_ENDED PAUSED',
    Purpose.RESUME: 'STOPPING MAIN_ENDED PAUSED',
}


def table(wrong: set[Cause], *, resumes: bool = False, busy: bool = True) -> InhibitTable:
    """Return the table of a driver to which these causes apply."""

    def link(name: str, cause: Cause) -> Fake:
        connected = cause not in wrong
        state = LinkState.BACKING_OFF
        attempts = {'failure': None, 'turned_away': 0}
        return Fake(
            name=name, host='arm', port=1, connected=connected, state=state, flags=(), **attempts
        )

    status = Status(
        e_stopped=int(Cause.ESTOP in wrong),
        drives_powered=int(Cause.MOTORS_OFF not in wrong),
        mode=Mode.MANUAL if Cause.MANUAL_MODE in wrong else Mode.AUTO,
        motion_possible=0,
    )
    robot = Fake(
        errors=load_error_texts(),
        joints_unavailable=False,
        sample=Fake(measured=NOW - 5.0 * (Cause.NO_JOINTS in wrong)),
        status=status,
        status_time=NOW - 5.0 * (Cause.NO_STATUS in wrong),
        main_ended=Cause.MAIN_ENDED in wrong,
        paused=Cause.PAUSED in wrong,
        why_not_ready=lambda now: 'unknown' if Cause.NO_POSE in wrong else None,
        why_not_at_rest=lambda velocity: 'fast' if Cause.MOVES in wrong else None,
    )
    stopper = Fake(
        delivery=Fake(no_streams='never' if Cause.NO_STREAMS in wrong else '', resumes=resumes),
        over=Cause.STOPPING not in wrong,
        alarm='no reply' if Cause.STOP_FAILED in wrong else None,
        arm_state='the arm is moving',
        stopped_velocity=0.01,
    )
    result: Any = InhibitTable(
        Fake(
            state_link=link('state', Cause.NO_STATE_LINK),
            motion_link=link('motion', Cause.NO_MOTION_LINK),
        ),
        robot,
        Fake(reason='for the test' if Cause.NOT_ENABLED in wrong else None, refusal=None),
        stopper,
        1.0,
        lambda: False,
        second_driver('another') if Cause.SECOND_DRIVER in wrong else None,
    )
    result.goals = Fake(
        idle=Cause.GOAL_RUNS not in wrong,
        busy=busy,
        why_no_stream='',
        stops=['stopped'] * (Cause.STOPPING in wrong),
    )
    result.servo = Fake(
        active=False, active_user=lambda: 'a stream' if Cause.STREAM in wrong else None
    )
    return result


def test_key_turned_to_auto_no_longer_explains_a_refused_enable() -> None:
    driver = table({Cause.NOT_ENABLED})
    for refusal, remedy in ((MANUAL, Remedy.ENABLE), (MAIN_ENDED, Remedy.START_MAIN)):
        driver.gate.refusal = refusal
        assert driver(Purpose.REPORT, NOW).remedy is remedy


def inhibits(purpose: Purpose, **options: bool) -> list[str]:
    """Return the inhibits of a purpose in the order in which removal reveals them."""
    wrong, causes = set(Cause), []
    while (inhibit := table(wrong, **options)(purpose, NOW)) is not None:
        causes.append(inhibit.cause.name)
        wrong.remove(inhibit.cause)
    return causes


@pytest.mark.invariant(4)
@pytest.mark.parametrize('purpose', Purpose)
def test_inv4_causes_inhibit_each_purpose_in_a_fixed_order(purpose: Purpose) -> None:
    assert inhibits(purpose) == ORDER[purpose].split()


def test_idle_arm_stays_enabled_when_main_has_ended() -> None:
    assert 'MAIN_ENDED' not in inhibits(Purpose.RUN, busy=False)


def test_controller_that_resumes_accepts_a_goal_while_paused() -> None:
    assert 'PAUSED' not in inhibits(Purpose.START, resumes=True)
    assert 'PAUSED' in inhibits(Purpose.REPORT, resumes=True)
