# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Defects of the past are put back one by one: seeds find each."""

import pytest
from support.examples import one_in
from support.old_defects import DEFECTS, found, noted

SEEDS = 40
"""How many worlds are tried besides the one that found it when all were looked for."""


def test_what_was_found_is_a_defect_that_can_be_put_back():
    assert noted().keys() <= DEFECTS.keys()


@pytest.mark.parametrize('defect', one_in(20, list(noted())))
def test_an_old_defect_is_found(defect):
    seeds = [noted()[defect].seed, *map(str, range(1, SEEDS))]
    assert found(defect, seeds), f'look again: test/support/old_defects.py {defect}'
