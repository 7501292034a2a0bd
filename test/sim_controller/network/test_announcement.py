# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated controllers are announced on this machine while they run."""

import logging

import pytest
from support.controller_harness import MODEL, PROFILE

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.network.announcement import announce, is_announced
from epson_driver.sim_controller.network.servers import ControllerServers, Ports

HOST = '127.0.0.1'


@pytest.mark.invariant(1)
async def test_port_is_announced_while_the_controller_is_open() -> None:
    servers = ControllerServers(new_controller(MODEL, PROFILE))
    ports = await servers.open(HOST, Ports(0, 0, 0, 0))
    assert is_announced(HOST, ports.remote)
    assert not is_announced(HOST, ports.motion)
    await servers.close()
    assert not is_announced(HOST, ports.remote)


async def test_controllers_at_two_addresses_are_announced_apart(
    caplog: pytest.LogCaptureFixture,
) -> None:
    first = ControllerServers(new_controller(MODEL, PROFILE))
    ports = await first.open(HOST, Ports(0, 0, 0, 0))
    second = ControllerServers(new_controller(MODEL, PROFILE))
    with caplog.at_level(logging.WARNING):
        await second.open('127.0.0.2', Ports(0, 0, 0, ports.remote))
    assert 'as real' not in caplog.text
    assert is_announced('127.0.0.2', ports.remote)
    await second.close()
    assert not is_announced('127.0.0.2', ports.remote)
    assert is_announced(HOST, ports.remote)
    await first.close()


@pytest.mark.invariant(1)
def test_controller_at_all_addresses_is_announced_at_local_ones_only() -> None:
    with announce('0.0.0.0', 1):
        assert is_announced('127.0.0.3', 1)
        assert not is_announced('192.0.2.1', 1)  # TEST-NET-1: a real controller elsewhere
