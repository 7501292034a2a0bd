# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
import pytest

from epson_driver.sim_controller.condition.errors import (
    ERRORS,
    TEXTS,
    ErrorNumber,
    Rejection,
    corrupt,
)

FROM_MEMORY = {2900, 2901, 2904, 2907, 2909, 2910, 2911, 2912, 2913, 2914}
FROM_MEMORY |= {4001, 4002, 4007, 4241, 5042, 5043, 5054, 9001, 9002}


@pytest.mark.parametrize('number', ErrorNumber)
def test_every_error_that_is_shown_has_a_text(number):
    assert TEXTS[number] == ERRORS[number].meaning != ''


@pytest.mark.parametrize('number', set(ErrorNumber) - {0, 2998, 2999})
def test_every_error_that_stops_the_motion_says_what_to_do(number):
    assert ERRORS[number].remedy


def test_what_no_document_confirms_is_marked():
    assert {number for number, text in ERRORS.items() if not text.confirmed} == FROM_MEMORY


def test_a_rejection_keeps_its_number_when_it_is_said_what_it_is_about():
    assert corrupt('wrong').about('point 3') == Rejection(
        ErrorNumber.CORRUPT_MESSAGE, 'point 3: wrong'
    )
