# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`~/stop` works without Fast DDS' shared memory, in each discovery range."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support import lost_shared_memory

NAMESPACES = ('unshare', '--mount', '--net')
ALONE = 'mount -t tmpfs none /dev/shm && ip link set lo up multicast on && exec "$@"'


@pytest.mark.invariant(3)
@pytest.mark.parametrize(
    ('how', 'discovery'), [('removed', 'LOCALHOST'), ('second user', 'SUBNET')]
)
def test_inv3_stop_works_without_shared_memory(how: str, discovery: str, tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    probe = subprocess.run([*NAMESPACES, 'sh', '-c', ALONE, 'sh', 'true'], capture_output=True)
    if probe.returncode:
        pytest.skip(f'private namespaces are not permitted: {probe.stderr.decode()}')
    program = [sys.executable, lost_shared_memory.__file__, str(tmp_path), how]
    user = subprocess.run(
        [*NAMESPACES, 'sh', '-c', ALONE, 'sh', *program],
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': discovery},
        capture_output=True,
        text=True,
        check=False,
    )
    assert user.returncode == 0, user.stderr
    lines = user.stdout.splitlines()
    assert lines[0].startswith('stop True the running motion ended: stopped on request')
    assert lines[1].startswith('ended')
