# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests of the executables."""

import pytest
from support.sim_process import started


@pytest.fixture
def start():
    """Start `sim_controller` on free ports. It ends with the test."""
    processes = []

    def start_process(*arguments, **options):
        process, ports = started(*arguments, **options)
        processes.append(process)
        return process, ports

    yield start_process
    for process in processes:
        process.kill()
        process.communicate()
