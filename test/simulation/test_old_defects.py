# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Old defects are reintroduced one by one, and a seed finds each."""

import pytest
from support.examples import one_in
from support.old_defects import DEFECTS, finds


@pytest.mark.parametrize('name', one_in(4, DEFECTS))
def test_old_defect_is_found(name: str) -> None:
    seed, _ = DEFECTS[name]
    assert finds(seed, name), f'search for another seed with {finds.__module__}'
