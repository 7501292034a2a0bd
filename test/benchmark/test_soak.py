# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The short form of `make soak`: memory does not grow with every request (invariant 7, 9)."""

from pathlib import Path

import pytest

from benchmark import soak as long_run
from benchmark.soak import growth, soak

pytestmark = [pytest.mark.invariant(7, 9), pytest.mark.slow]

CALLS = 2_400
WARM_UP = 1_000
MOST_PER_CALL = 400
"""Bytes of resident memory. It was 1,050 when each turn of the executor left a callback behind."""


def test_a_service_call_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(long_run, 'PATIENCE_S', 300.0)  # a busy machine is no leak
    _, of_calls = soak(goals=5, calls=CALLS, folder=tmp_path)
    grown = growth(of_calls, after=WARM_UP)
    assert grown < MOST_PER_CALL * (CALLS - WARM_UP), f'{grown} bytes more after {WARM_UP} calls'
