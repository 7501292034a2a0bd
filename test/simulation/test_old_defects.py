# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Defects of earlier versions are reintroduced one by one, and the simulation finds each."""

import pytest
from support.examples import one_in
from support.old_defects import DEFECTS, finds


@pytest.mark.parametrize('name', one_in(7, DEFECTS))
def test_simulation_finds_a_reintroduced_old_defect(name: str) -> None:
    seed, _ = DEFECTS[name]
    assert finds(seed, name), f'search for another seed with {finds.__module__}'
