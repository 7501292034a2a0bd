# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fixture of the Python API's tests."""

import signal

import pytest
from support import sim_process


@pytest.fixture
def ports():
    """Yield the ports of a simulated controller that runs in a separate process."""
    process, numbers = sim_process.started()
    yield numbers
    process.send_signal(signal.SIGINT)
    process.wait(sim_process.PATIENCE_S)
    process.stdout.close()
