# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the tests of the executables share."""

import pytest
from support.sim_process import started


@pytest.fixture
def start():
    """Start `sim_controller` with arguments, on free ports; it ends with the test."""
    processes = []

    def start_process(*arguments, **options):
        process, ports = started(*arguments, **options)
        processes.append(process)
        return process, ports

    yield start_process
    for process in processes:
        process.kill()
        process.communicate()
