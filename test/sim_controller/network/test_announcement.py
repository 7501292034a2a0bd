# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Simulated controllers are announced on this machine while they run."""

import logging

import pytest
from support.controller_harness import MODEL, PROFILE
from support.event_loop import run

from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.network.announcement import announce, is_announced
from epson_driver.sim_controller.network.servers import ControllerServers, Ports

HOST = '127.0.0.1'


@pytest.mark.invariant(1)
def test_port_is_announced_while_the_controller_is_open() -> None:
    async def scenario() -> None:
        servers = ControllerServers(new_controller(MODEL, PROFILE))
        ports = await servers.open(HOST, Ports(0, 0, 0, 0))
        assert is_announced(ports.remote)
        assert not is_announced(ports.motion)
        await servers.close()
        assert not is_announced(ports.remote)

    run(scenario())


def test_second_controller_with_the_same_remote_port_works_unannounced(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scenario() -> None:
        first = ControllerServers(new_controller(MODEL, PROFILE))
        ports = await first.open(HOST, Ports(0, 0, 0, 0))
        second = ControllerServers(new_controller(MODEL, PROFILE))
        with caplog.at_level(logging.WARNING):
            await second.open('127.0.0.2', Ports(0, 0, 0, ports.remote))
        assert 'the panel treats this controller as real' in caplog.text
        await second.close()
        assert is_announced(ports.remote)
        await first.close()

    run(scenario())


def test_port_can_be_announced_once() -> None:
    with announce(1):
        with pytest.raises(OSError, match='in use'):
            announce(1)
        assert is_announced(1)
    assert not is_announced(1)
