# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/spel.md names every statement, function, rule and error number there is."""

import re
from pathlib import Path

from epson_driver.spel import ErrorNumber
from epson_driver.spel.commands import COMMANDS
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.lint import RULES

PAGE = (Path(__file__).parents[2] / 'docs' / 'spel.md').read_text(encoding='utf-8')


def names_below(sentence: str) -> set[str]:
    """Return the names in backquotes of the list that follows a sentence."""
    items = PAGE.split(f'{sentence}\n\n', 1)[1].split('\n\n', 1)[0]
    return set(re.findall(r'`([^`]+)`', items))


def test_the_tables_of_the_page_are_those_of_the_code() -> None:
    assert names_below('expressions, and these statements:') == {
        rule.name for rule in COMMANDS.values()
    }
    assert names_below('and these functions:') == {rule.name for rule in FUNCTIONS.values()}
    rules = re.findall(r'(?m)^\| `([a-z-]+)` \| (.*) \|$', PAGE)
    assert dict(rules) == RULES
    numbers = PAGE.split('| number | meaning |\n', 1)[1]
    assert [int(row) for row in re.findall(r'(?m)^\| (\d+) \|', numbers)] == list(ErrorNumber)
