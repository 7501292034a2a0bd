# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What tests of the Python API share."""

import signal

import pytest
from support import sim_process


@pytest.fixture
def ports():
    """Yield the ports of a simulated controller in a process of its own."""
    process, numbers = sim_process.started()
    yield numbers
    process.send_signal(signal.SIGINT)
    process.wait(sim_process.PATIENCE_S)
    process.stdout.close()
