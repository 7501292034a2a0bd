# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Defects of the past are put back one by one: a seed finds each."""

import pytest
from support.old_defects import DEFECTS, finds


@pytest.mark.parametrize('name', DEFECTS)
def test_an_old_defect_is_found(name: str) -> None:
    seed, _ = DEFECTS[name]
    assert finds(seed, name), f'look for another seed: see {finds.__module__}'
