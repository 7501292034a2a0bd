# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Selects UDP instead of Fast DDS' shared memory, for all ROS processes of this package.

Shared memory fails silently when /dev/shm is emptied, and between users. Nodes still discover each
other, but no message arrives, including calls of `~/stop`.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from socket import gethostbyname
from tempfile import NamedTemporaryFile

from rclpy.utilities import get_rmw_implementation_identifier

PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_RANGES = ('', 'SUBNET', 'SYSTEM_DEFAULT', 'OFF')
"""Values for which Fast DDS obeys TRANSPORTS. rcl treats any other value as LOCALHOST, for which
rmw_fastrtps adds shared memory to every profile."""

_LOCALHOST = """<dds xmlns="http://www.eprosima.com"><profiles>
<transport_descriptors><transport_descriptor><transport_id>udp</transport_id><type>UDPv4</type>
<maxInitialPeersRange>32</maxInitialPeersRange></transport_descriptor></transport_descriptors>
<participant profile_name="localhost" is_default_profile="true"><rtps>
<builtin><initialPeersList>{}</initialPeersList>
<metatrafficUnicastLocatorList><locator><udpv4/></locator></metatrafficUnicastLocatorList></builtin>
<userTransports><transport_id>udp</transport_id></userTransports>
<useBuiltinTransports>false</useBuiltinTransports></rtps></participant></profiles></dds>"""
"""Profile that rmw_fastrtps uses for LOCALHOST, without shared memory: no multicast, 32
participants."""


@contextmanager
def udp_by_default() -> Iterator[None]:
    """Use UDP for the context and the first node created in the block.

    User-defined Fast DDS profiles and transports take precedence. Other middlewares are
    unaffected. Raises OSError if the disk is full, ValueError for a peer without an address.
    """
    before = dict(os.environ)
    own = any(map(before.get, PROFILES)) or Path('DEFAULT_FASTRTPS_PROFILES.xml').exists()
    shared = (before.get(TRANSPORTS) or 'UDPv4') != 'UDPv4'
    if own or shared or not get_rmw_implementation_identifier().startswith('rmw_fastrtps'):
        yield
        return
    with NamedTemporaryFile('w', suffix='.xml') as file:
        changes = {TRANSPORTS: 'UDPv4'}
        alone = before.get('ROS_LOCALHOST_ONLY') == '1'
        if alone or before.get(RANGE, '') not in _RANGES:
            names = '' if alone else before.get('ROS_STATIC_PEERS', '')
            peers = ''.join(map(_peer, filter(None, ('127.0.0.1', *names.split(';')))))
            file.write(_LOCALHOST.format(peers))
            file.flush()
            changes = {PROFILES[0]: file.name, RANGE: 'SYSTEM_DEFAULT', 'ROS_LOCALHOST_ONLY': ''}
        os.environ.update(changes)
        try:
            yield
        finally:
            for name in changes:
                del os.environ[name]
            os.environ.update({name: before[name] for name in changes if name in before})


def _peer(name: str) -> str:
    """Return the locator of a host. Fast DDS drops a profile with an unknown one."""
    try:
        return f'<locator><udpv4><address>{gethostbyname(name)}</address></udpv4></locator>'
    except (OSError, UnicodeError) as error:
        raise ValueError(f'ROS_STATIC_PEERS: {name}: {error}') from error
