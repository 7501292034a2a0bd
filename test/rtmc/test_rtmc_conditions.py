# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conditions of requests, and refusals, of Real-time Motion Control."""

from dataclasses import replace

import pytest

from epson_driver.rtmc.conditions import (
    CONDITIONS,
    DETAILS,
    REMEDIES,
    Detail,
    Needs,
    Refusal,
    refusal,
    required,
    sentence,
)
from epson_driver.rtmc.messages import OperationMode, Request, RtmcStatus

GOOD = RtmcStatus(False, False, OperationMode.AUTO)
NOTICES = {Request.STATUS_NOTICE, Request.JOINTS_NOTICE}
EVERYTHING = Needs.AUTO | Needs.CHECKED | Needs.SAFE | Needs.MODE


def test_every_request_has_conditions():
    assert set(CONDITIONS) == set(Request) - NOTICES
    assert required(999, 0) is None
    assert required(Request.STATUS_NOTICE, 0) is None


@pytest.mark.parametrize(
    ('status', 'checked', 'mode', 'expected'),
    [
        (replace(GOOD, mode=OperationMode.TEACH), False, False, Refusal.NOT_AUTO),
        (GOOD, False, False, Refusal.MODEL_NOT_CHECKED),
        (replace(GOOD, safeguard_open=True), True, False, Refusal.SAFEGUARD),
        (replace(GOOD, estop=True), True, False, Refusal.ESTOP),
        (GOOD, True, False, Refusal.MOTION_MODE),
        (replace(GOOD, safeguard_open=True, estop=True, error=1), True, True, Refusal.SAFEGUARD),
        (replace(GOOD, estop=True, error=1), True, True, Refusal.ESTOP),
        (replace(GOOD, error=1), True, True, Refusal.ERROR),
        (replace(GOOD, warning=1), True, True, None),
    ],
)
def test_order_of_refusals_is_that_of_the_manual(status, checked, mode, expected):
    assert refusal(EVERYTHING, status, checked=checked, mode=mode) is expected


@pytest.mark.parametrize('request_', sorted(set(Request) - NOTICES))
def test_only_targets_modes_and_texts_are_accepted_in_the_motion_mode(request_):
    accepted = (Request.SET_MODE, Request.MODE, Request.MOVE)
    of_status = (Request.STATUS, Request.FORMATS, Request.MESSAGES)
    why = refusal(required(request_, 0), GOOD, checked=True, mode=True)
    assert why is (None if request_ in accepted + of_status else Refusal.MOTION_MODE)


@pytest.mark.invariant(1)
@pytest.mark.parametrize('bad', [{'safeguard_open': True}, {'estop': True}, {'error': 5042}])
@pytest.mark.parametrize('request_', [Request.SET_MOTORS, Request.SET_MODE, Request.MOVE])
def test_motion_needs_closed_safeguard_no_estop_and_no_error(request_, bad):
    status = replace(GOOD, **bad)
    mode = request_ is Request.MOVE
    assert refusal(required(request_, 1), status, checked=True, mode=mode) is not None
    assert refusal(required(request_, 1), GOOD, checked=True, mode=mode) is None


def test_the_motion_mode_can_be_disabled_after_an_estop():
    status = replace(GOOD, estop=True, error=1)
    assert refusal(required(Request.SET_MODE, 0), status, checked=True, mode=True) is None


def test_each_refusal_has_a_remedy():
    assert set(REMEDIES) == set(Refusal) - {Refusal.EXECUTION}
    assert 'release it' in sentence(Request.MOVE, Refusal.ESTOP)
    for (request, detail), text in DETAILS.items():
        assert sentence(request, detail << 8) == text
    assert sentence(Request.CONNECT, Detail.PASSWORD << 8).startswith('the password')
    assert 'see the error' in sentence(Request.RESET, 0)
    assert sentence(Request.RESET, 0x0109) == 'unknown reason 0x0109'
