# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Rules of values: addresses, names of joints, numbers; and how a value is shown."""

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
    shown,
)
from epson_driver.link.link import Link
from epson_driver.simple_message import JointPosition


@pytest.mark.parametrize(
    'host',
    [
        '127.0.0.1',
        '127.1',
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
def test_hosts(host: str) -> None:
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
        'fe80::xyz',
        'http://a',
        '1.2.3.4:80',
        7,
        None,
    ],
)
def test_what_no_resolver_takes_is_no_host(host: Any) -> None:
    with pytest.raises(InputError, match=r'^robot_ip = .*: must be an IP address or the name of'):
        HOST.checked(host, 'robot_ip')


def test_a_link_to_no_host_is_refused_when_it_is_made() -> None:
    """UnicodeError of the resolver ended the driver when it connected."""
    with pytest.raises(InputError, match=r"^state link: host = 'a\.\.b': must be an IP address"):
        Link('state', 'a..b', 1, on_packet=print, on_state=print)


@pytest.mark.parametrize(
    'names',
    [[], 'ab', [''], ['a', 'a'], ['a.b'], ['a b'], ['1'], ['a\n'], ['ä'], ['x' * 101], [1], None],
)
def test_what_are_no_names_of_joints(names: Any) -> None:
    with pytest.raises(InputError, match=r'^x = .*: must be a list of names that differ'):
        JOINT_NAMES.checked(names, 'x')


def test_names_of_joints() -> None:
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
def test_what_is_not_in_the_rule(rule: Rule, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        rule.checked(value, 'f.yaml: key')
    assert str(caught.value) == f'f.yaml: key = {shown(value)}: {rule.text}'


def test_values_are_shown_short() -> None:
    endless: list[Any] = []
    endless.append(endless)
    for value in ('x' * 10**6, 10**5000, 10**400, [[1] * 1000] * 1000, {'a' * 999: 1}, endless):
        assert len(shown(value)) <= 200
    assert shown({'b': 1, 'a': [1.5, 'x']}) == "{'b': 1, 'a': [1.5, 'x']}"
    assert shown(10**5000) == 'a number of 5001 digits'
    assert printable('a\n\ud800ä\0') == 'a\\n\\ud800ä\\x00'


def test_what_is_nested_too_deeply_is_shown_shortened() -> None:
    nested: dict[str, Any] = {'a': 1}
    for _ in range(20):
        nested = {'a': nested}
    assert shown(nested).count('{') < 15
    assert '{...}' in shown(nested)
    assert shown({'a': {}}) == "{'a': {}}"


def test_a_link_that_is_not_connected_sends_nothing_and_says_so() -> None:
    link = Link('state', '127.0.0.1', 11002, on_packet=print, on_state=print)
    with pytest.raises(ConnectionError, match='state link is disconnected'):
        link.tell(JointPosition(0, (0.0,) * 10))
