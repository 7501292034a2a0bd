# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How many examples hypothesis tries, and which: one profile for each kind of run.

`make test` and `make test-all` try the same examples each time, so that they fail only for what
was changed; `make soak` looks for new ones, and prints how to see a failure again.
"""

from collections.abc import Collection, Iterable
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

FULL = 100
"""`max_examples` of the profile in which a test gets the number that it names."""

LEAST = 5
"""So many are tried in any run."""

_ANY_MACHINE = settings(
    deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
PROFILES = {
    'quick': settings(_ANY_MACHINE, max_examples=FULL // 5, derandomize=True),
    'thorough': settings(_ANY_MACHINE, max_examples=FULL, derandomize=True),
    'soak': settings(_ANY_MACHINE, max_examples=10 * FULL, derandomize=False),
}


def profile_for(marks: str) -> str:
    """Return the profile's name for what `pytest -m` says."""
    chosen = set(marks.replace('not ', 'not-').replace('(', ' ').replace(')', ' ').split())
    if 'soak' in chosen:
        return 'soak'
    return 'quick' if 'not-slow' in chosen else 'thorough'


def load_profile(name: str) -> None:
    """Make it that of all tests whose modules are imported from now on."""
    for each, profile in PROFILES.items():
        settings.register_profile(each, profile)
    settings.load_profile(name)


def examples(count: int) -> int:
    """Return how many of so many examples are tried in this run."""
    assert settings.default is not None
    return max(count * settings.default.max_examples // FULL, min(count, LEAST))


def one_in(every: int, values: Iterable[Any], *, several: bool = False) -> list[Any]:
    """Return parameters: `make test` tries the first of every so many, `make test-all` all.

    `several`: each value is a tuple with the values of several parameters.
    """
    found = list(values)
    return quickly(found[::every], found, several=several)


def quickly(some: Collection[Any], values: Iterable[Any], *, several: bool = True) -> list[Any]:
    """Return parameters: `make test` tries some of the values, `make test-all` all."""
    return [
        pytest.param(
            *(value if several else (value,)), marks=() if value in some else pytest.mark.slow
        )
        for value in values
    ]
