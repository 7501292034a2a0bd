# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Which transport Fast DDS is asked for: UDP, unless the user has chosen."""

import os
from pathlib import Path

import pytest

from epson_driver.node import ros_transport
from epson_driver.node.ros_transport import PROFILES, RANGE, TRANSPORTS, udp_by_default

NAMES = (*PROFILES, TRANSPORTS, RANGE, 'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS')


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)


def changed(monkeypatch: pytest.MonkeyPatch, **given: str) -> tuple[dict[str, str], str]:
    """Return what is set in the block, and the profile; the rest must be as before."""
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    before = dict(os.environ)
    with udp_by_default():
        found = {
            name: os.environ[name] for name in NAMES if os.environ.get(name) != before.get(name)
        }
        file = found.get(PROFILES[0])
        profile = '' if file is None else Path(file).read_text('utf-8')
    assert dict(os.environ) == before
    return found, profile


@pytest.mark.parametrize('given', ['SUBNET', 'SYSTEM_DEFAULT', 'OFF', ''])
def test_the_variable_is_enough_where_fast_dds_obeys_it(
    given: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert changed(monkeypatch, **{RANGE: given}) == ({TRANSPORTS: 'UDPv4'}, '')


@pytest.mark.parametrize('name', [*PROFILES, TRANSPORTS])
def test_an_empty_variable_is_not_set(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert changed(monkeypatch, **{RANGE: 'SUBNET', name: ''}) == ({TRANSPORTS: 'UDPv4'}, '')


@pytest.mark.parametrize('name', [RANGE, 'ROS_LOCALHOST_ONLY'])
def test_localhost_is_a_profile_with_the_same_peers(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    value = 'LOCALHOST' if name == RANGE else '1'
    found, profile = changed(monkeypatch, **{name: value, 'ROS_STATIC_PEERS': '127.0.0.2'})
    assert found[RANGE] == 'SYSTEM_DEFAULT'
    assert ('127.0.0.2' in profile) == (name == RANGE)
    assert '>127.0.0.1<' in profile
    assert '<useBuiltinTransports>false<' in profile
    assert 'SHM' not in profile


def test_a_peer_without_an_address_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast DDS would drop the whole profile, and ask by multicast."""
    with pytest.raises(ValueError, match=r'ROS_STATIC_PEERS: no\.such\.invalid: '):
        changed(monkeypatch, **{RANGE: 'LOCALHOST', 'ROS_STATIC_PEERS': 'no.such.invalid'})


@pytest.mark.parametrize('name', [*PROFILES, TRANSPORTS, 'a profile here', 'another middleware'])
def test_what_the_user_has_set_wins(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(RANGE, 'LOCALHOST')
    monkeypatch.chdir(tmp_path)
    given = {}
    if name == 'a profile here':
        (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').touch()
    elif name == 'another middleware':
        cyclone = 'rmw_cyclonedds_cpp'
        monkeypatch.setattr(ros_transport, 'get_rmw_implementation_identifier', lambda: cyclone)
    else:
        given = {name: 'LARGE_DATA'}
    assert changed(monkeypatch, **given) == ({}, '')
