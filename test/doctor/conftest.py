# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for tests of the doctor."""

import pytest

from epson_driver.link import Link


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the list of the ports that links open from now on."""
    ports: list[int] = []
    connect = Link.run

    async def seen(link: Link) -> None:
        ports.append(link.port)
        await connect(link)

    monkeypatch.setattr(Link, 'run', seen)
    return ports
