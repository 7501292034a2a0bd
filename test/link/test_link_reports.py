# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the log says of links: once, and why a second client gets none."""

import asyncio
import logging

from support.event_loop import run, until

from epson_driver.link import Link, link_reports
from epson_driver.link.link_reports import MAX_SHORT, LinkReports


def test_a_second_client_is_told_once_and_then_of_the_change(caplog, monkeypatch):
    """Of a port that serves one client, every other connection is closed at once."""
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(link_reports, 'SHORT_S', 2.0)  # however slow this machine is

    async def check():
        accepted = 0
        served = False
        end = asyncio.Event()

        async def serve(_reader, writer):
            nonlocal accepted
            accepted += 1
            if served:
                await end.wait()
            writer.close()

        server = await asyncio.start_server(serve, '127.0.0.1', 0)
        port = server.sockets[0].getsockname()[1]
        link = Link(
            'motion',
            '127.0.0.1',
            port,
            on_packet=lambda _: None,
            on_state=lambda _, why: reports.tell(why),
        )
        reports = LinkReports(link, 'rc620, c3_a601s')
        task = asyncio.create_task(link.run())
        await until(lambda: accepted >= MAX_SHORT + 2)
        told = [line for line in caplog.messages if 'serves one client' in line]
        assert len(told) == 1
        count = len(caplog.messages)
        await until(lambda: accepted >= MAX_SHORT + 3)
        assert len(caplog.messages) == count
        served = True
        await until(lambda: len(caplog.messages) > count)
        assert caplog.messages[-1] == (
            f'motion link connected: 127.0.0.1:{port}, configured as rc620, c3_a601s'
        )
        end.set()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        server.close()

    run(check())
