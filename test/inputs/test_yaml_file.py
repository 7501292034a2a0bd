# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""YAML files as plain data: what is read, and the sentence for what is not."""

import os
from pathlib import Path
from typing import Any

import pytest

from epson_driver.inputs import InputError, read_file, read_yaml


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / 'x.yaml'
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1e3', 1000.0),
        ('1e-3', 0.001),
        ('-.5', -0.5),
        ('010', 10),
        ('0x10', 16),
        ('0o10', 8),
        ('1:30', '1:30'),
        ('1_000', '1_000'),
        ('yes', 'yes'),
        ('true', True),
        ('~', None),
        ('', None),
        ("'1'", '1'),
        ('"~"', '~'),
        ('2026-99-99', '2026-99-99'),
        ('-.inf', float('-inf')),
        ('=', '='),
        ('{a: [1, {b: x}], 1: on}', {'a': [1, {'b': 'x'}], '1': 'on'}),
        ('\ufeffa: 1', {'a': 1}),
        ('a: |\n  12\n', {'a': '12\n'}),
    ],
)
def test_plain_values(text: str, value: Any, tmp_path: Path) -> None:
    read = read_yaml(written(tmp_path, text))
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        ('a: 1\nb: 2\na: 3', "line 3: 'a' is there twice"),
        ('a: &x 1\nb: *x', 'line 2: *x: aliases are not supported'),
        ('a: !!python/object:os.system x', "line 1: 'tag:yaml.org,2002:python/object:os.system'"),
        ('a:\n  !!timestamp 2026-99-99', "line 2: 'tag:yaml.org,2002:timestamp': tags are not"),
        ('[' * 100_000, 'line 1: nested more than 20 levels deep'),
        ('{a: ' * 100_000, 'line 1: nested more than 20 levels deep'),
        ('- ' * 100_000, 'line 1: nested more than 20 levels deep'),
        ('? [1]\n: 2', 'line 1: a mapping or a list cannot be a key'),
        ('a: ' + '9' * 5000, 'has too many digits for a number'),
        ('a: 1\n--- 2', 'line 2: a second document begins: there must be one'),
        ('a: [1', 'not YAML: line 2, column 1: did not find'),
        ('a:\n\t- x', 'not YAML: line 2, column 1: found character that cannot start'),
        ('"\0"', 'not YAML: unacceptable character #x0000'),
        (b'a: 1\nb: \xff', 'not YAML: line 2 is no UTF-8 text'),
        (b'\xff\xfea\0', 'not YAML: line 1 is no UTF-8 text'),
        (os.urandom(10) + b'\xff' + bytes(1000), 'not YAML: '),
        ('x' * 1_000_001, 'is larger than 1 MB'),
    ],
)
def test_what_is_no_data_is_refused_with_file_and_line(
    content: str | bytes, sentence: str, tmp_path: Path
) -> None:
    path = written(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(f'{path}: ')
    assert sentence in str(caught.value)
    assert len(str(caught.value)) < 500


def test_nine_lines_do_not_become_a_billion_values(tmp_path: Path) -> None:
    lines = ['a0: &a0 [x]'] + [
        f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, 10)
    ]
    with pytest.raises(InputError, match=r'line 2: \*a0: aliases are not supported'):
        read_yaml(written(tmp_path, '\n'.join(lines)))


def test_of_several_documents_the_first(tmp_path: Path) -> None:
    assert read_yaml(written(tmp_path, 'a: 1\n---\na: 2\n'), several=True) == {'a': 1}


def test_a_folder_a_pipe_a_device_and_what_is_no_path(tmp_path: Path) -> None:
    """Opening the pipe would wait for ever, reading the device would never end."""
    os.mkfifo(tmp_path / 'pipe')
    before = len(os.listdir('/proc/self/fd'))  # noqa: PTH208
    for path, sentence in (
        (tmp_path, 'is a folder, not a file'),
        (tmp_path / 'pipe', 'is a pipe or a device, not a file'),
        (Path('/dev/zero'), 'is a pipe or a device, not a file'),
        (tmp_path / 'none.yaml', 'No such file or directory'),
        (tmp_path / 'none.yaml' / 'x', 'No such file or directory'),
        (Path('/dev/null/x'), 'Not a directory'),
        (tmp_path / ('x' * 300), 'File name too long'),
        (Path('a\0b'), 'cannot be the path of a file'),
        (Path('\ud800'), 'cannot be the path of a file'),
    ):
        with pytest.raises(InputError) as caught:
            read_file(path, 10)
        assert str(caught.value).endswith(sentence)
        assert str(caught.value).isprintable()
    assert len(os.listdir('/proc/self/fd')) == before  # noqa: PTH208
    assert read_file(written(tmp_path, '1234567890'), 10) == b'1234567890'
