# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every invariant has tests that carry its number, and docs/invariants.md lists them."""

import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / 'docs'
MAKE = runpy.run_path(str(DOCS / 'make_tables.py'))
PAGE = (DOCS / 'invariants.md').read_text(encoding='utf-8')

MODULE = """
import pytest
pytestmark = [pytest.mark.invariant(3), pytest.mark.slow]

def no_test(): ...
def test_one(): ...
@pytest.mark.invariant(2, 5)
@pytest.mark.parametrize('x', [1, 2])
def test_two(x): ...
class TestThree:
    @pytest.mark.invariant(5)
    async def test_three(self): ...
TestFour = Machine.TestCase
"""


def test_the_page_lists_the_tests() -> None:
    assert MAKE['page']('invariants.md') == PAGE, 'run `python docs/make_tables.py`'


def test_every_invariant_of_the_page_has_tests() -> None:
    described = {int(number) for number in re.findall(r'(?m)^(\d+)\. [A-Z]', PAGE)}
    lines = ''.join(MAKE['invariants']())
    found = re.findall(r'(?m)^\* \*\*(\d+)\*\*: (\d+) tests$', lines)
    rows = {int(number): int(count) for number, count in found}
    assert described == set(rows) == set(MAKE['INVARIANTS'])
    assert all(rows.values())


def test_a_test_counts_for_the_numbers_of_its_markers_and_of_its_modules() -> None:
    assert sorted(MAKE['marked'](MODULE)) == [2, 3, 3, 3, 3, 5, 5]


@pytest.mark.parametrize('module', ['def test_one(): ...', '# pytest.mark.invariant(1)'])
def test_without_a_marker_nothing_counts(module: str) -> None:
    assert list(MAKE['marked'](module)) == []
