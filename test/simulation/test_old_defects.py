# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Defects of earlier versions are reintroduced one by one, and the simulation finds each."""

import pytest
from support.examples import quickly
from support.old_defects import DEFECTS, finds

QUICK = ('a_held_stream_is_followed_at_once', 'an_arm_outlives_its_client')


@pytest.mark.parametrize('name', quickly(QUICK, DEFECTS, several=False))
def test_simulation_finds_a_reintroduced_old_defect(name: str) -> None:
    seed, _ = DEFECTS[name]
    assert finds(seed, name), f'search for another seed with {finds.__module__}'
