# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Lamps and advice from the reported state. Lamps of outdated values are grey."""

from dataclasses import replace

import numpy as np
import pytest

from epson_driver.driver.inhibit import Cause, Inhibit
from epson_driver.driver.remedy import Remedy
from epson_driver.panel.robot_state import (
    MAX_AGES_S,
    Event,
    RobotState,
    Simulation,
    Status,
    Tri,
)
from epson_driver.panel.status_lamps import BAD, CALM, GOOD, UNKNOWN, WARN, WORDS, advice, lamps

NOW = 100.0

FINE = Status(
    e_stopped=Tri.NO,
    motors_on=Tri.YES,
    motion_possible=Tri.YES,
    in_motion=Tri.NO,
    in_error=Tri.NO,
    mode='AUTO',
)


ESTOP = Inhibit(Cause.ESTOP, Remedy.RELEASE_ESTOP, 'so it is')
NO_LINK = Inhibit(Cause.NO_STATE_LINK, Remedy.CONNECT, 'no link to the controller')


def state(status: Status = FINE, **changes: object) -> RobotState:
    result = RobotState(
        joint_names=('a', 'b'),
        positions=np.zeros(2),
        status=status,
        link='connected',
        gate_open=True,
        simulation=Simulation({'door': 'closed', 'tasks': 'running'}),
        times=dict.fromkeys(MAX_AGES_S, NOW),
    )
    for name, value in changes.items():
        setattr(result, name, value)
    return result


def colours(found: RobotState, now: float = NOW) -> dict[str, str]:
    return {lamp.name: lamp.colour for lamp in lamps(found, now)}


def test_ready_robot_has_no_bad_lamp() -> None:
    shown = colours(state())
    assert set(shown) == {
        'Link', 'Motors', 'E-stop', 'Door', 'Error', 'Mode', 'Motion', 'Enabled',
    }  # fmt: skip
    assert set(shown.values()) <= {GOOD, 'off'}
    assert advice(state(), NOW).colour == GOOD


@pytest.mark.invariant(6)
def test_unreported_state_gives_unknown_lamps() -> None:
    assert set(colours(RobotState()).values()) == {UNKNOWN}
    assert colours(state(Status()))['E-stop'] == UNKNOWN  # not shown as released


@pytest.mark.invariant(6)
@pytest.mark.parametrize(
    ('name', 'grey'),
    [
        ('status', {'Motors', 'E-stop', 'Error', 'Mode', 'Motion'}),
        ('diagnostics', {'Link', 'Enabled'}),
        ('simulation', {'Door'}),
    ],
)
def test_lamp_is_grey_when_its_source_is_silent(name: str, grey: set[str]) -> None:
    result = state()
    result.times[name] = NOW - MAX_AGES_S[name] - 0.01
    assert {lamp for lamp, colour in colours(result).items() if colour == UNKNOWN} == grey
    result.times[name] = NOW - MAX_AGES_S[name] + 0.01
    assert UNKNOWN not in colours(result).values()


@pytest.mark.invariant(6)
def test_link_lamp_is_bad_without_joint_states() -> None:
    result = state()
    result.times['joints'] = NOW - MAX_AGES_S['joints'] - 0.01
    assert colours(result)['Link'] == BAD
    assert advice(result, NOW).colour == BAD


def test_released_estop_of_a_simulated_controller_only_needs_a_reset() -> None:
    status = replace(FINE, e_stopped=Tri.YES)
    result = state(status, inhibit=ESTOP, simulation=Simulation({'estop': 'released, not reset'}))
    shown = advice(result, NOW)
    assert (shown.reason, shown.remedy) == ('the E-stop was pressed', 'Reset error, then Enable')
    (lamp,) = (lamp for lamp in lamps(result, NOW) if lamp.name == 'E-stop')
    assert (lamp.text, lamp.colour) == ('not reset', BAD)


@pytest.mark.parametrize(
    ('inhibit', 'armed'),
    [
        (Inhibit(Cause.NOT_ENABLED, Remedy.ENABLE, 'not enabled'), True),
        (ESTOP, True),
        (NO_LINK, False),
        (None, False),
    ],
)
def test_advice_names_remedies_that_need_an_armed_window(
    inhibit: Inhibit | None, armed: bool
) -> None:
    assert advice(state(inhibit=inhibit), NOW).armed == armed


@pytest.mark.parametrize(
    ('changes', 'lamp', 'colour', 'reason', 'remedy'),
    [
        (
            {'status': replace(FINE, e_stopped=Tri.YES), 'inhibit': ESTOP},
            'E-stop',
            BAD,
            'so it is',
            'Reset error',
        ),
        ({'link': 'backing_off', 'inhibit': NO_LINK}, 'Link', BAD, 'no link', 'robot_ip'),
        (
            {
                'status': replace(FINE, in_error=Tri.YES, error_codes=(4031,)),
                'inhibit': Inhibit(Cause.ERROR, Remedy.RESET, 'error 4031', 'fix it'),
            },
            'Error',
            BAD,
            'error 4031',
            'fix it; Reset error, then Enable',
        ),
        (
            {'gate_open': False, 'inhibit': Inhibit(Cause.NOT_ENABLED, Remedy.ENABLE, 'so it is')},
            'Enabled',
            WARN,
            'so it is',
            'press Enable',
        ),
        (
            {
                'status': replace(FINE, mode='MANUAL', motion_possible=Tri.NO),
                'inhibit': Inhibit(Cause.MANUAL_MODE, Remedy.TURN_TO_AUTO, 'it is at MANUAL'),
            },
            'Mode',
            WARN,
            'at MANUAL',
            'turn it to AUTO',
        ),
        (
            {'simulation': Simulation({'door': 'open'})},
            'Door',
            BAD,
            'door is open',
            'close the door',
        ),
    ],
)
def test_each_simulated_condition_has_a_lamp_a_reason_and_a_remedy(
    changes: dict[str, object], lamp: str, colour: str, reason: str, remedy: str
) -> None:
    result = state(**changes)  # type: ignore[arg-type]
    assert colours(result)[lamp] == colour
    shown_advice = advice(result, NOW)
    assert reason in shown_advice.reason
    assert remedy in shown_advice.remedy


@pytest.mark.parametrize('cause', Cause)
def test_inhibit_takes_precedence_over_simulated_condition(cause: Cause) -> None:
    simulation = Simulation({'door': 'open', 'tasks': 'stopped'})
    shown_advice = advice(
        state(inhibit=Inhibit(cause, Remedy.KEEP_AWAY, 'mine'), simulation=simulation), NOW
    )
    assert (shown_advice.reason == 'mine') == (cause not in CALM)
    assert shown_advice.colour == BAD


def test_remedies_name_the_buttons_of_the_page() -> None:
    pressed = {Remedy.RELEASE_ESTOP, Remedy.RESET, Remedy.ENABLE, Remedy.TURN_TO_AUTO}
    assert pressed <= set(WORDS)


@pytest.mark.parametrize(
    ('condition', 'reason', 'remedy'),
    [
        ({'estop': 'pressed', 'tasks': 'aborted'}, 'E-stop is pressed', 'release the E-stop'),
        ({'estop': 'released, not reset', 'tasks': 'aborted'}, 'was pressed', 'Reset error, then'),
        ({'estop': 'not active', 'tasks': 'stopped'}, 'program is stopped', 'start'),
        ({'estop': 'not active', 'tasks': 'running'}, 'no link', 'robot_ip'),
        ({'estop': 'not active', 'tasks': 'paused'}, 'no link', 'robot_ip'),
    ],
)
def test_stopped_simulated_program_explains_the_lost_link(
    condition: dict[str, str], reason: str, remedy: str
) -> None:
    result = state(link='backing_off', inhibit=NO_LINK, simulation=Simulation(condition))
    shown_advice = advice(result, NOW)
    assert reason in shown_advice.reason
    assert remedy in shown_advice.remedy
    result.times['simulation'] = NOW - MAX_AGES_S['simulation'] - 0.1
    assert 'no link' in advice(result, NOW).reason


def test_ended_simulated_program_leaves_the_remedy_to_a_connected_driver() -> None:
    inhibit = Inhibit(Cause.NOT_ENABLED, Remedy.ENABLE, 'the E-stop was pressed')
    result = state(inhibit=inhibit, simulation=Simulation({'tasks': 'stopped'}))
    shown_advice = advice(result, NOW)
    assert shown_advice[:2] == ('the E-stop was pressed', 'press Enable')
    assert shown_advice.armed


def test_line_logged_by_driver_and_panel_is_shown_once() -> None:
    result = RobotState()
    result.add_event(Event(10.0, 20, '~/enable: the arm is enabled'))
    result.add_event(Event(10.5, 20, 'enable: the arm is enabled'))
    result.add_event(Event(14.0, 20, '~/enable: the arm is enabled'))
    assert [event.time for event in result.events] == [10.0, 14.0]


def test_paused_simulated_controller_has_a_remedy() -> None:
    result = state(simulation=Simulation({'door': 'closed', 'tasks': 'paused'}))
    shown_advice = advice(result, NOW)
    assert (shown_advice.colour, shown_advice.reason) == (WARN, 'the controller is paused')
    assert 'Continue' in shown_advice.remedy
