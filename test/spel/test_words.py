# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The table of SPEL+ words, its use by the parser, and the tables of docs/spel.md."""

import importlib
import re
from pathlib import Path

import pytest

from epson_driver.spel import ErrorNumber
from epson_driver.spel.commands import COMMANDS
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.lint import RULES, check
from epson_driver.spel.words import CONSTANTS, WORDS, is_a, reserved


def problems(text: str, version: int = 8) -> list[tuple[str, str]]:
    return [(p.rule, p.text) for p in check({'main.prg': text}, version)]


def test_word_table_is_complete() -> None:
    """Sources: appendix A (p929-950), the summary (p27-50), and appendix D (p995-1009).

    p647 has one more. Two more words are from an EPSON library for a later version. Two words and
    eight constants are from the force option of RC+ 5 to 7. p891 and p1003 have WindowsStatus,
    p949 misprints it.
    """
    assert len(WORDS) == 613 + 1 + 2 + 2
    assert len(CONSTANTS) == 475 + 8
    assert is_a('function', 'WindowsStatus')
    assert not is_a('function', 'WindowStatus')
    assert CONSTANTS['above'] == 1
    assert CONSTANTS['crlf'] == '\r\n'
    assert CONSTANTS['vision_imagesize_2560x1920'] == 8
    assert CONSTANTS['slp_c_zl_pos'] == 76
    assert not WORDS['move'].background  # p915
    assert WORDS['hand_on'].since == (7, 5, 1)  # p987
    assert WORDS['print'].window  # p942
    assert not WORDS['xqt'].window  # p950


@pytest.mark.parametrize(
    'text',
    [
        'Function Flush\nFend',
        'Function f(Home As Integer)\nFend',
        'Function f\n  Integer a, below\nFend',
        'Global Real Speed\nFunction f\nFend',
        'Function f\nLefty:\nFend',
    ],
)
def test_reserved_word_is_refused_as_a_name(text: str) -> None:
    assert {rule for rule, _ in problems(text)} - {'unused'} == {'reserved'}


def test_word_of_a_later_version_is_a_valid_name() -> None:
    text = 'Function Hand_On\nFend\nFunction main\n  Hand_On\nFend'
    assert problems(text, 6) == []
    assert [rule for rule, _ in problems(text, 7)] == ['reserved']


def test_every_word_is_accepted_or_refused_by_its_name() -> None:
    """Each word, as a statement and as a value, is accepted or refused by its name."""
    forms = ('{} 1', 'x = {}(1)', 'x = {}')
    for text in (form.format(word.name) for word in WORDS.values() for form in forms):
        result = problems(f'Function main\n  Real x\n  {text}\nFend')
        assert 'unknown' not in [rule for rule, _ in result], (text, result)


def test_reserved_words_depend_on_the_version() -> None:
    assert reserved('DOCKFILL')
    assert reserved('encTemper')
    assert not reserved('EncTemper', (7, 99))
    assert not reserved('place')
    assert all(is_a('function', name) for name in FUNCTIONS if name != 'p')


DOCS = Path(__file__).parents[2] / 'docs'
PAGE = (DOCS / 'spel.md').read_text(encoding='utf-8')


def test_generated_tables_of_the_page_are_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DOCS))
    make = importlib.import_module('make_tables')
    for name in ('spel_words', 'spel_rules', 'spel_errors'):
        assert f'<!-- made: {name} -->' in PAGE
    assert any(f'{len(COMMANDS)} statements' in line for line in make.spel_words())
    rules = re.findall(r'(?m)^\* `([a-z-]+)`: ', ''.join(make.spel_rules()))
    assert rules == list(RULES)
    numbers = re.findall(r'(?m)^\* `(\d+)`: ', ''.join(make.spel_errors()))
    assert [int(number) for number in numbers] == list(ErrorNumber)
