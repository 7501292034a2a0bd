# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The number and choice of hypothesis examples: one profile for each kind of run.

`make test` and `make test-all` try the same examples each time, so that they fail only because of
a change. `make soak` searches for new ones, and prints how to reproduce a failure.
"""

import math
from collections.abc import Collection, Iterable
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

FULL = 100
"""`max_examples` with which each test gets the number that it requests."""

MIN_EXAMPLES = 3
"""Minimum number of examples in any run."""

_ANY_MACHINE = settings(
    deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
PROFILES = {
    'quick': settings(_ANY_MACHINE, max_examples=FULL // 5, derandomize=True),
    'thorough': settings(_ANY_MACHINE, max_examples=FULL // 2, derandomize=True),
    'soak': settings(_ANY_MACHINE, max_examples=10 * FULL, derandomize=False),
}


def profile_for(marks: str) -> str:
    """Return the profile's name for the argument of `pytest -m`."""
    chosen = set(marks.replace('not ', 'not-').replace('(', ' ').replace(')', ' ').split())
    if 'soak' in chosen:
        return 'soak'
    return 'quick' if 'not-slow' in chosen else 'thorough'


def load_profile(name: str) -> None:
    """Load a profile for all tests whose modules are imported later."""
    for registered, profile in PROFILES.items():
        settings.register_profile(registered, profile)
    settings.load_profile(name)


def examples(count: int) -> int:
    """Return the number of examples in this run, of `count` in the full one."""
    assert settings.default is not None
    return max(count * settings.default.max_examples // FULL, min(count, MIN_EXAMPLES))


MAX_SLOW = 4
"""Maximum number of parameters that `make test-all` adds: of 125 arms, for example, 4."""


def one_in(every: int, values: Iterable[Any], *, several: bool = False) -> list[Any]:
    """Return parameters: `make test` tries one in `every`, and `quickly` marks the others.

    `several`: each value is a tuple for several parameters.
    """
    all_values = list(values)
    return quickly(all_values[::every], all_values, several=several)


def quickly(some: Collection[Any], values: Iterable[Any], *, several: bool = True) -> list[Any]:
    """Return parameters: `make test` tries some of the values, `make test-all` MAX_SLOW more.

    `make soak-tests` tries all.
    """
    all_values = list(values)
    others = [index for index, value in enumerate(all_values) if value not in some]
    slow = others[:: math.ceil(len(others) / MAX_SLOW)] if others else []

    def marks(index: int) -> Any:
        if index not in others:
            return ()
        return pytest.mark.slow if index in slow else pytest.mark.soak

    return [
        pytest.param(*(value if several else (value,)), marks=marks(index))
        for index, value in enumerate(all_values)
    ]
