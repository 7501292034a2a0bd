# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm gate, and the status values that inhibit motion (docs/invariants.md, 4)."""

from itertools import product

import pytest
from support.driver_harness import open_gate

from epson_driver.driver.inhibit import Cause, status_inhibit
from epson_driver.driver.stopping.arm_gate import ArmGate, GateError
from epson_driver.error_texts import load_error_texts
from epson_driver.simple_message import Mode, Status, TriState

pytestmark = pytest.mark.invariant(4)


def test_inv4_gate_is_closed_at_start():
    gate = ArmGate()
    assert not gate.close('anything')
    assert gate.reason == 'not enabled since the driver started'


def test_closed_gate_keeps_its_first_closing_reason():
    gate = ArmGate()
    open_gate(gate)
    assert gate.reason is None
    assert gate.close('the E-stop is pressed')
    assert not gate.close('the motors are off')
    assert gate.reason == 'the E-stop is pressed'
    open_gate(gate)
    assert gate.reason is None
    assert gate.close('the motors are off')
    assert gate.reason == 'the motors are off'


def test_gate_reason_without_a_cause_is_completed_by_the_next_reason():
    """A STATUS that arrives late still explains a refused goal."""
    gate = ArmGate()
    open_gate(gate)
    assert gate.close('the controller refused point 1', unexplained=True)
    assert not gate.close('no status yet', unexplained=True)
    assert not gate.close('the motors are off')
    assert not gate.close('the E-stop is pressed')
    assert gate.reason == 'the controller refused point 1; then: the motors are off'
    open_gate(gate)
    assert gate.close('the motors are off')
    assert not gate.close('the E-stop is pressed')
    assert gate.reason == 'the motors are off'


ERRORS = load_error_texts()
FINE = {'drives_powered': 1, 'e_stopped': 0, 'in_error': 0, 'error_code': 0}


@pytest.mark.parametrize(
    ('fields', 'words'),
    [
        ({}, None),
        ({'e_stopped': 1}, ['E-stop']),
        ({'e_stopped': 1, 'error_code': 2261}, ['E-stop', '2261']),
        ({'in_error': 1, 'error_code': 4001}, ['in error 4001 (the arm', 'not confirmed)']),
        ({'in_error': 1, 'error_code': 4030}, ['in error 4030 (too much torque for too long)']),
        ({'drives_powered': 0}, ['motors are off']),
        ({'drives_powered': 0, 'error_code': 4031}, ['motors are off', '4031']),
        ({'e_stopped': 1, 'in_error': 1, 'drives_powered': 0}, ['E-stop']),
        ({'in_error': 1, 'error_code': 7, 'drives_powered': 0}, ['in error 7']),
        ({'e_stopped': -1}, None),
        ({'in_error': -1}, None),
        ({'drives_powered': -1}, None),
        ({'in_motion': -1, 'motion_possible': -1, 'mode': -1}, None),
        ({'error_code': 5}, None),  # a code without in_error is information
    ],
)
def test_reason_that_inhibits_motion_is_read_from_the_status(fields, words):
    inhibit = status_inhibit(Status(**{**FINE, **fields}), ERRORS)
    if words is None:
        assert inhibit is None
    else:
        assert all(word in inhibit.text for word in words)


@pytest.mark.parametrize('fields', [{'in_error': 1}, {'drives_powered': 0}])
def test_reason_with_an_error_has_its_advice(fields):
    status = Status(**{**FINE, 'error_code': 4242, **fields})
    assert status_inhibit(status, ERRORS).advice == 'less acceleration'


def test_status_inhibits_motion_by_estop_error_or_motors_off():
    values = list(TriState)
    for e_stopped, in_error, drives, mode in product(values, values, values, Mode):
        status = Status(drives, e_stopped, 0, in_error, TriState.UNKNOWN, mode, TriState.UNKNOWN)
        forbidden = e_stopped == 1 or in_error == 1 or drives == 0
        assert (status_inhibit(status, ERRORS) is not None) == forbidden


# --- enable requests ----------------------------------------------------------------------


@pytest.mark.parametrize('opened', [False, True], ids=['closed', 'open'])
def test_inv4_closing_reason_cancels_pending_enable_requests(opened):
    gate = ArmGate()
    if opened:
        open_gate(gate)
    canceled = []
    with gate.enabling() as first, gate.enabling() as second:
        first.on_cancel = lambda: canceled.append('first')
        gate.close('the E-stop is pressed')
        gate.close('the motors are off')
        for enabling in (first, second):
            assert enabling.canceled == 'the E-stop is pressed'
            with pytest.raises(GateError, match='the E-stop is pressed'):
                gate.open(enabling)
    assert canceled == ['first']
    assert gate.reason is not None
    open_gate(gate)
    assert gate.reason is None


def test_inv4_motors_off_cancels_only_a_request_that_saw_motors_on():
    gate = ArmGate()
    with gate.enabling() as enabling:
        gate.close('the motors are off', motors_off=True)
        assert enabling.canceled is None
        gate.see_motors_on()
        gate.close('the motors are off', motors_off=True)
        assert enabling.canceled == 'the motors are off'


def test_inv4_ended_enable_request_does_not_open_the_gate():
    gate = ArmGate()
    with gate.enabling() as enabling:
        pass
    with pytest.raises(GateError, match='has ended'):
        gate.open(enabling)
    assert gate.reason is not None


@pytest.mark.parametrize(
    ('fields', 'cause'),
    [
        ({'drives_powered': 0}, Cause.MOTORS_OFF),
        ({'drives_powered': 0, 'error_code': 4031}, Cause.MOTORS_OFF),
        ({'drives_powered': 0, 'e_stopped': 1}, Cause.ESTOP),
        ({'drives_powered': 0, 'in_error': 1}, Cause.ERROR),
    ],
)
def test_motors_off_is_the_cause_only_without_estop_and_error(fields, cause):
    assert status_inhibit(Status(**{**FINE, **fields}), ERRORS).cause is cause
