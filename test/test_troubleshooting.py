# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""docs/troubleshooting.md: its error numbers are the table's, its sentences are the driver's."""

import ast
import re
import runpy
from pathlib import Path

import pytest

from epson_driver.error_texts import load_error_texts

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / 'docs' / 'troubleshooting.md').read_text(encoding='utf-8')
SAID = re.findall(r'^\| "(.+?)" \|', PAGE, re.MULTILINE)
ROW = re.compile(r'^\| (\d+) \| (.*?) \| (.*?) \| (yes|\*\*no\*\*) \|$', re.MULTILINE)


def without_docstrings(path):
    tree = ast.parse(path.read_text(encoding='utf-8'))
    for node in ast.walk(tree):
        body = getattr(node, 'body', None)
        if isinstance(body, list):
            node.body = [line for line in body if not is_text(line)]
    return tree


def is_text(line):
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant)


def sentences():
    """Return all texts in the driver's code, each f-string's parts joined by …."""
    for package in ('driver', 'node', 'link', 'simple_message'):
        for path in (ROOT / 'epson_driver' / package).rglob('*.py'):
            for node in ast.walk(without_docstrings(path)):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value
                elif isinstance(node, ast.JoinedStr):
                    parts = (getattr(part, 'value', None) for part in node.values)
                    yield ''.join(part if isinstance(part, str) else '…' for part in parts)


TEXTS = '\n'.join(sentences())


@pytest.mark.parametrize('said', SAID)
def test_the_driver_can_say_it(said):
    assert said in TEXTS


def test_there_are_symptoms():
    assert len(SAID) > 20


@pytest.mark.parametrize('number', [number for number in load_error_texts() if number])
def test_every_error_number_stands_there_with_its_remedy(number):
    rows = {int(row[0]): row[1:] for row in ROW.findall(PAGE)}
    text = load_error_texts()[number]
    confirmed = 'yes' if text.confirmed else '**no**'
    assert rows[number] == (text.meaning, text.remedy, confirmed)


def test_no_other_number_stands_there_and_the_table_is_generated():
    assert {int(row[0]) for row in ROW.findall(PAGE)} | {0} == set(load_error_texts())
    make = runpy.run_path(str(ROOT / 'docs' / 'make_tables.py'))
    assert make['page']('troubleshooting.md') == PAGE, 'run `python docs/make_tables.py`'
