# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fast DDS uses UDP unless the user has configured a transport."""

import os
from pathlib import Path

import pytest

from epson_driver.node import ros_process
from epson_driver.node.ros_process import PROFILES, RANGE, TRANSPORTS, udp_by_default

NAMES = (*PROFILES, TRANSPORTS, RANGE, 'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS')


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)


def changed(monkeypatch: pytest.MonkeyPatch, **variables: str) -> tuple[dict[str, str], str]:
    """Return the variables set in the block, and the profile. Others must not change."""
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    before = dict(os.environ)
    with udp_by_default():
        changes = {
            name: os.environ[name] for name in NAMES if os.environ.get(name) != before.get(name)
        }
        file = changes.get(PROFILES[0])
        profile = '' if file is None else Path(file).read_text('utf-8')
    assert dict(os.environ) == before
    return changes, profile


@pytest.mark.parametrize('discovery_range', ['SUBNET', 'SYSTEM_DEFAULT', 'OFF', ''])
def test_only_the_transport_variable_is_set_outside_localhost(
    discovery_range: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert changed(monkeypatch, **{RANGE: discovery_range}) == ({TRANSPORTS: 'UDPv4'}, '')


@pytest.mark.parametrize('name', [*PROFILES, TRANSPORTS])
def test_empty_transport_variable_counts_as_unset(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert changed(monkeypatch, **{RANGE: 'SUBNET', name: ''}) == ({TRANSPORTS: 'UDPv4'}, '')


@pytest.mark.parametrize('name', [RANGE, 'ROS_LOCALHOST_ONLY'])
def test_localhost_uses_a_profile_with_the_same_peers(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    value = 'LOCALHOST' if name == RANGE else '1'
    changes, profile = changed(monkeypatch, **{name: value, 'ROS_STATIC_PEERS': '127.0.0.2'})
    assert changes[RANGE] == 'SYSTEM_DEFAULT'
    assert ('127.0.0.2' in profile) == (name == RANGE)
    assert '>127.0.0.1<' in profile
    assert '<useBuiltinTransports>false<' in profile
    assert 'SHM' not in profile


def test_unresolvable_peer_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast DDS would drop the whole profile, and ask by multicast."""
    with pytest.raises(ValueError, match=r'ROS_STATIC_PEERS: no\.such\.invalid: '):
        changed(monkeypatch, **{RANGE: 'LOCALHOST', 'ROS_STATIC_PEERS': 'no.such.invalid'})


@pytest.mark.parametrize('name', [*PROFILES, TRANSPORTS, 'a profile here', 'another middleware'])
def test_user_s_fast_dds_configuration_takes_precedence(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(RANGE, 'LOCALHOST')
    monkeypatch.chdir(tmp_path)
    variables = {}
    if name == 'a profile here':
        (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').touch()
    elif name == 'another middleware':
        cyclone = 'rmw_cyclonedds_cpp'
        monkeypatch.setattr(ros_process, 'get_rmw_implementation_identifier', lambda: cyclone)
    else:
        variables = {name: 'LARGE_DATA'}
    assert changed(monkeypatch, **variables) == ({}, '')
