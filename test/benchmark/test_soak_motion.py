# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The short form of `make soak-motion`: every kind of episode."""

from pathlib import Path

import pytest

from benchmark.soak_motion import soak


@pytest.mark.slow
@pytest.mark.invariant(3, 4, 5, 7)
def test_soak_of_a_minute_has_no_problems(tmp_path: Path) -> None:
    figures = soak(minutes=1.0, seed=1, folder=tmp_path, warm_up=20.0)
    leaks = ('memory', 'controller_memory')  # not distinguishable from the warm-up within a minute
    assert [figure for figure in figures['problems'] if not figure.startswith(leaks)] == []
    assert figures['goals'] > 0
