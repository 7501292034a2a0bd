# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The docs: links, troubleshooting, tables of errors."""

import ast
import importlib
import re
from functools import cache
from pathlib import Path

import pytest
from catkin_pkg import changelog
from catkin_pkg.package_version import get_forthcoming_label
from support.pages import items

from epson_driver.error_texts import ErrorText, ErrorTexts, load_error_texts, read_error_texts
from epson_driver.inputs import InputError
from epson_driver.share import share_path
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.remote.status_words import FLAGS

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/*.md')])


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_link_targets_and_their_anchors_exist(page):
    links = re.findall(r'\]\((?!https?:)([^)#:]*)#?([^)]*)\)', page.read_text(encoding='utf-8'))
    for target, anchor in links:
        there = page.parent / target if target else page
        assert there.exists(), f'{page.name} links to {target}'
        if anchor:
            headings = re.findall(r'(?m)^#+ (.*)$', there.read_text(encoding='utf-8').lower())
            anchors = {re.sub(r'[^\w\- ]', '', item).replace(' ', '-') for item in headings}
            assert anchor in anchors, f'{page.name} links to {target}#{anchor}'


def test_files_named_in_the_docs_exist():
    for page in PAGES:
        for name in re.findall(r'`((?:\w+/)+\w*\.py|test/[\w/]+)`', page.read_text('utf-8')):
            result = (ROOT / name).exists() or (ROOT / 'epson_driver' / name).exists()
            assert result, f'{page.name} names {name}'


def test_release_tools_find_the_forthcoming_changes():
    """catkin_prepare_release replaces this heading by a version and a date."""
    read = changelog.get_changelog_from_path(ROOT / 'CHANGELOG.rst', 'epson_driver')
    assert get_forthcoming_label(read.rst) == 'Forthcoming'


def test_generated_tables_are_up_to_date(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / 'docs'))
    make_tables = importlib.import_module('make_tables')
    for page in ROOT.glob('docs/*.md'):
        text = page.read_text(encoding='utf-8')
        assert make_tables.with_tables(text) == text, f'{page.name}: make tables'


def test_index_lists_every_page():
    index = (ROOT / 'docs' / 'README.md').read_text(encoding='utf-8')
    for page in ROOT.glob('docs/*.md'):
        assert page.name == 'README.md' or f']({page.name})' in index, page.name


def test_every_documented_invariant_has_tests():
    page = (ROOT / 'docs' / 'invariants.md').read_text(encoding='utf-8')
    described = re.findall(r'(?m)^(\d+)\. [A-Z]', page)
    tests = ''.join(path.read_text(encoding='utf-8') for path in ROOT.glob('test/**/test_*.py'))
    marks = ','.join(re.findall(r'mark\.invariant\(([\d, ]+)\)', tests))
    assert set(re.findall(r'\d+', marks)) == set(described)


PAGE = (ROOT / 'docs' / 'troubleshooting.md').read_text(encoding='utf-8')

MESSAGES = re.findall(r'^\* \*\*"(.+?)"\*\*', PAGE, re.MULTILINE)


def without_docstrings(path):
    tree = ast.parse(path.read_text(encoding='utf-8'))
    for node in ast.walk(tree):
        body = getattr(node, 'body', None)
        if isinstance(body, list):
            node.body = [line for line in body if not is_text(line)]
    return tree


def is_text(line):
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant)


@cache
def sentences():
    """Return all texts in the driver's code, with … for the values of f-strings."""
    texts = []
    for package in ('driver', 'node', 'link', 'simple_message'):
        for path in (ROOT / 'epson_driver' / package).rglob('*.py'):
            for node in ast.walk(without_docstrings(path)):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    texts.append(node.value)
                elif isinstance(node, ast.JoinedStr):
                    parts = (getattr(part, 'value', None) for part in node.values)
                    texts.append(''.join(part if isinstance(part, str) else '…' for part in parts))
    return '\n'.join(texts)


@pytest.mark.parametrize('message', MESSAGES)
def test_documented_message_exists_in_the_driver(message):
    assert message in sentences()


def test_documented_flags_equal_the_code():
    page = (ROOT / 'docs' / 'remote.md').read_text(encoding='utf-8')
    section = page.split('## Flags of GetStatus\n')[1].split('\n## ')[0]
    flags = [item.split(': ')[0] for item, _ in items(section)]
    assert flags == [f'`{name}`' for name in FLAGS]


EPSON = load_error_texts('epson')


def test_error_numbers_have_meanings_remedies_and_sources():
    file = share_path('config', 'errors', 'epson.yaml').read_text('utf-8')
    sources = set(re.findall(r'^#   ([\w-]+)  ', file, re.MULTILINE))
    assert set(ErrorNumber) <= set(EPSON)
    for number, text in EPSON.items():
        assert 0 <= number <= 9999
        assert text.meaning
        assert text.source in sources, number
        assert text.confirmed == (text.source != 'memory'), number
        assert text.remedy or number in (0, 2998, 2999), number


def test_error_phrase_has_number_and_meaning_and_marks_unconfirmed_ones():
    texts = ErrorTexts({1: ErrorText('it broke', 'fix it'), 2: ErrorText('it sank', '', False)})
    assert texts.phrase(1) == '1 (it broke)'
    assert texts.phrase(2) == '2 (it sank, not confirmed)'
    assert texts.phrase(3) == '3'
    assert EPSON.phrase(0) == '0'  # 0 means no error
    assert texts.advice(1, 'look') == 'fix it'
    assert texts.advice(2, 'look') == texts.advice(3, 'look') == 'look'


def test_missing_table_is_an_error():
    with pytest.raises(InputError, match=r'must be .*epson'):
        load_error_texts('../robots/c3_a601s')


GOOD = 'number: 1, meaning: m, remedy: r, confirmed: true, source: s'


@pytest.mark.parametrize(
    ('content', 'wrong'),
    [
        ('errors: {}', 'errors must be a list'),
        ('errors: [{number: 1}]', r'errors\[0\] = .*: must have number, meaning'),
        (f'errors: [{{{GOOD}}}, {{{GOOD}}}]', 'number 1 occurs twice'),
        (f'errors: [{{{GOOD.replace("true", "1")}}}]', r'errors\[0\].confirmed = 1: must be bool'),
    ],
)
def test_invalid_error_file_is_reported(tmp_path, content, wrong):
    path = tmp_path / 'x.yaml'
    path.write_text(content, encoding='utf-8')
    with pytest.raises(InputError, match=f'{path}: {wrong}'):
        read_error_texts(path)
