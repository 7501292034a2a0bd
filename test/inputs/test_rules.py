# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The rules for input values, alone and in YAML files."""

import os
from pathlib import Path
from typing import Any

import pytest

from epson_driver.inputs import (
    HOST,
    JOINT_NAMES,
    InputError,
    Rule,
    choice,
    count,
    list_of,
    number,
    printable,
    read_file,
    read_yaml,
    shown,
)
from epson_driver.link.link import Link
from epson_driver.simple_message import JointPosition


@pytest.mark.parametrize(
    'host',
    [
        '127.0.0.1',
        '::1',
        'fe80::1%eth0',
        'localhost',
        'robot-1.cell.example',
        'robot_1',
        'x' * 63,
        'roboter-ä',
        'a.',
    ],
)
def test_valid_host_is_accepted(host: str) -> None:
    assert HOST.checked(host, 'x') == host


@pytest.mark.parametrize(
    'host',
    [
        '',
        '.',
        'a..b',
        '.a',
        'x' * 64,
        'x.' * 127 + 'x',
        'a b',
        'a\n',
        'a\0',
        '\udc80',
        '-a',
        'a-',
        '999.1.1.1',
        '1.2.3.4.5',
        '127.1',
        '192.168.000.1',
        'fe80::xyz',
        7,
        None,
    ],
)
def test_invalid_host_is_refused(host: Any) -> None:
    with pytest.raises(InputError, match=r'^robot_ip = .*: must be an IP address without'):
        HOST.checked(host, 'robot_ip')


@pytest.mark.parametrize('host', ['1.2.3.4:80', 'http://1.2.3.4', 'https://1.2.3.4:80/x'])
def test_address_with_a_scheme_or_port_is_refused_with_the_address_alone(host: str) -> None:
    with pytest.raises(InputError, match=r': must be the address alone: 1\.2\.3\.4 \(ports are'):
        HOST.checked(host, 'robot_ip')


def test_link_to_an_invalid_host_is_refused() -> None:
    """Otherwise the resolver raises UnicodeError when the driver connects."""
    with pytest.raises(InputError, match=r"^state link: host = 'a\.\.b': must be an IP address"):
        Link('state', 'a..b', 1, on_packet=print, on_state=print)


@pytest.mark.parametrize(
    'names',
    [[], 'ab', [''], ['a', 'a'], ['a.b'], ['a b'], ['1'], ['a\n'], ['ä'], ['x' * 101], [1], None],
)
def test_invalid_joint_names_are_refused(names: Any) -> None:
    with pytest.raises(InputError, match=r'^x = .*: must be a list of unique names'):
        JOINT_NAMES.checked(names, 'x')


def test_valid_joint_names_are_accepted() -> None:
    assert JOINT_NAMES.checked(['left/joint_1', 'J2', 'a-b'], 'x') == ('left/joint_1', 'J2', 'a-b')


@pytest.mark.parametrize(
    ('rule', 'value'),
    [
        (number(0.0, 1.0), value)
        for value in (True, '0', None, [], float('nan'), float('inf'), 10**5000, -1e-320, 1.1)
    ]
    + [(count(0, 5), value) for value in (True, 1.0, '1', -1, 6, 10**5000)]
    + [(choice('a', 'b'), value) for value in ('c', 1, None, ['a'], {})]
    + [(list_of(count(0, 5)), value) for value in ([], [6], 1, 'ab', None)],
    ids=lambda _: 'x',
)
def test_value_that_breaks_the_rule_is_refused(rule: Rule, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        rule.checked(value, 'f.yaml: key')
    assert str(caught.value) == f'f.yaml: key = {shown(value)}: {rule.text}'


def test_long_values_in_error_texts_are_abbreviated() -> None:
    endless: list[Any] = []
    endless.append(endless)
    for value in ('x' * 10**6, 10**5000, 10**400, [[1] * 1000] * 1000, {'a' * 999: 1}, endless):
        assert len(shown(value)) <= 200
    assert shown({'b': 1, 'a': [1.5, 'x']}) == "{'b': 1, 'a': [1.5, 'x']}"
    assert shown(10**5000) == 'a number of 5001 digits'
    assert printable('a\n\ud800ä\0') == 'a\\n\\ud800ä\\x00'


def test_deeply_nested_value_is_abbreviated() -> None:
    nested: dict[str, Any] = {'a': 1}
    for _ in range(20):
        nested = {'a': nested}
    assert shown(nested).count('{') < 15
    assert '{...}' in shown(nested)
    assert shown({'a': {}}) == "{'a': {}}"


def test_unconnected_link_refuses_to_send() -> None:
    link = Link('state', '127.0.0.1', 11002, on_packet=print, on_state=print)
    with pytest.raises(ConnectionError, match='state link is disconnected'):
        link.send_topic(JointPosition(0, (0.0,) * 10))


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
def test_yaml_value_is_read(text: str, value: Any, tmp_path: Path) -> None:
    read = read_yaml(written(tmp_path, text))
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        ('a: 1\nb: 2\na: 3', "line 3: 'a' occurs twice"),
        ('a: &x 1\nb: *x', 'line 2: *x: aliases are not supported'),
        ('a: !!python/object:os.system x', "line 1: 'tag:yaml.org,2002:python/object:os.system'"),
        ('a:\n  !!timestamp 2026-99-99', "line 2: 'tag:yaml.org,2002:timestamp': tags are not"),
        ('[' * 100_000, 'line 1: nested more than 20 levels deep'),
        ('{a: ' * 100_000, 'line 1: nested more than 20 levels deep'),
        ('- ' * 100_000, 'line 1: nested more than 20 levels deep'),
        ('? [1]\n: 2', 'line 1: a mapping or a list cannot be a key'),
        ('a: ' + '9' * 5000, 'has too many digits for a number'),
        ('a: 1\n--- 2', 'line 2: it must contain one document'),
        ('a: [1', 'not YAML: line 2, column 1: did not find'),
        ('a:\n\t- x', 'not YAML: line 2, column 1: found character that cannot start'),
        ('"\0"', 'not YAML: unacceptable character #x0000'),
        (b'a: 1\nb: \xff', 'not YAML: line 2 is not UTF-8 text'),
        (b'\xff\xfea\0', 'not YAML: line 1 is not UTF-8 text'),
        (os.urandom(10) + b'\xff' + bytes(1000), 'not YAML: '),
        ('x' * 1_000_001, 'is larger than 1 MB'),
    ],
)
def test_yaml_without_plain_data_is_refused_with_file_and_line(
    content: str | bytes, sentence: str, tmp_path: Path
) -> None:
    path = written(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_yaml(path)
    assert str(caught.value).startswith(f'{path}: ')
    assert sentence in str(caught.value)
    assert len(str(caught.value)) < 500


def test_yaml_alias_bomb_is_refused(tmp_path: Path) -> None:
    lines = ['a0: &a0 [x]'] + [
        f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, 10)
    ]
    with pytest.raises(InputError, match=r'line 2: \*a0: aliases are not supported'):
        read_yaml(written(tmp_path, '\n'.join(lines)))


def test_first_of_several_documents_is_read(tmp_path: Path) -> None:
    assert read_yaml(written(tmp_path, 'a: 1\n---\na: 2\n'), several=True) == {'a': 1}


def test_folders_pipes_devices_and_invalid_paths_are_refused(tmp_path: Path) -> None:
    """Opening the pipe would block, and reading the device would not end."""
    os.mkfifo(tmp_path / 'pipe')
    before = len(os.listdir('/proc/self/fd'))  # noqa: PTH208
    for path, sentence in (
        (tmp_path, 'is a folder, not a file'),
        (tmp_path / 'pipe', 'is a pipe or a device, not a file'),
        (Path('/dev/zero'), 'is a pipe or a device, not a file'),
        (
            tmp_path / 'none.yaml',
            f'directory; correct the name or the folder, {tmp_path}',
        ),
        (tmp_path / 'pip', f'No such file or directory; did you mean {tmp_path / "pipe"}?'),
        (tmp_path / 'no' / 'x', f'create the folder {tmp_path / "no"}, or correct the path'),
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
