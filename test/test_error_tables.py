# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""config/errors: every number has its text, and says how far it can be trusted."""

import re

import pytest

from epson_driver.error_texts import ErrorText, ErrorTexts, load_error_texts, read_error_texts
from epson_driver.share import share_file

EPSON = load_error_texts('epson')
FILE = share_file('config', 'errors', 'epson.yaml')
SOURCES = set(re.findall(r'^#   ([\w-]+)  ', FILE.read_text('utf-8'), re.MULTILINE))
GOOD = 'number: 1, meaning: m, remedy: r, confirmed: true, source: s'


@pytest.mark.parametrize('number', EPSON)
def test_every_number_has_a_meaning_and_a_source(number):
    text = EPSON[number]
    assert 0 <= number <= 9999
    assert text.meaning
    assert text.source in SOURCES
    assert text.confirmed == (text.source != 'memory')
    assert text.remedy or number in (0, 2998, 2999)


def test_numbers_are_in_order():
    assert list(EPSON) == sorted(EPSON)


def test_a_phrase_says_number_meaning_and_doubt():
    texts = ErrorTexts({1: ErrorText('it broke', 'mend it'), 2: ErrorText('it sank', '', False)})
    assert texts.phrase(1) == '1 (it broke)'
    assert texts.phrase(2) == '2 (it sank; not confirmed)'
    assert texts.phrase(3) == '3'
    assert EPSON.phrase(0) == '0'  # in error, and the number does not say which
    assert texts.advice(1, 'look') == 'mend it'
    assert texts.advice(2, 'look') == texts.advice(3, 'look') == 'look'
    assert len(texts) == 2


def test_the_table_without_texts():
    assert dict(load_error_texts('none')) == {}
    assert load_error_texts('none').phrase(4031) == '4031'


@pytest.mark.parametrize('name', ['nonsense', '../robots/c3_a601s', ''])
def test_a_table_that_is_not_there(name):
    with pytest.raises(FileNotFoundError):
        load_error_texts(name)


@pytest.mark.parametrize(
    ('content', 'wrong'),
    [
        ('[', 'not YAML'),
        ('- 1', 'errors must be a list'),
        ('errors: {}', 'errors must be a list'),
        ('errors: [1]', r'errors\[0\] = 1: must have number, meaning'),
        ('errors: [{number: 1}]', r'errors\[0\]'),
        (f'errors: [{{{GOOD}}}, {{{GOOD}}}]', 'number 1 is there twice'),
        (f'errors: [{{{GOOD.replace("1", "x")}}}]', r"errors\[0\].number = 'x': must be int"),
        (f'errors: [{{{GOOD.replace("true", "1")}}}]', r'errors\[0\].confirmed = 1: must be bool'),
    ],
)
def test_a_bad_file_is_named_with_what_is_wrong(tmp_path, content, wrong):
    path = tmp_path / 'x.yaml'
    path.write_text(content, encoding='utf-8')
    with pytest.raises(ValueError, match=wrong) as caught:
        read_error_texts(path)
    assert str(path) in str(caught.value)


def test_a_good_file_is_read(tmp_path):
    path = tmp_path / 'x.yaml'
    path.write_text(f'errors: [{{{GOOD}}}]', encoding='utf-8')
    assert dict(read_error_texts(path)) == {1: ErrorText('m', 'r', True, 's')}
