# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A Remote Ethernet port with scripted answers."""

import asyncio
import contextlib

READY = '#GetStatus,00100000001,0000'
HOME = '#Execute,"0 0 0 0 0 0 1"'


class RemotePeer:
    """Answers each line, by its whole command or by its name.

    An answer is a text, None for none, ConnectionError to disconnect, a list of them, one for each
    time, or a function of the line. `default`: the answer to other commands, `%s` for their name.
    `delay`: time before each answer, s. `blank`: time between empty lines, s, 0 for none. `lines`:
    received lines of all connections.
    """

    def __init__(self, delay=0.0, default=None, **answers):
        usual = {'Login': '#Login,0', 'GetStatus': READY, 'Execute': HOME, 'Abort': '#Abort,0'}
        self.answers = usual | answers
        self.delay = delay
        self.default = default
        self.blank = 0.0
        self.lines = []
        self.connections = 0
        self._tasks = set()

    async def __aenter__(self):
        self._server = await asyncio.start_server(self._serve, '127.0.0.1', 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_):
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def given(self, name):
        """Return the lines with a command."""
        return [line for line in self.lines if line.startswith(f'${name}')]

    async def _serve(self, reader, writer):
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        self.connections += 1
        if self.blank:
            blanks = asyncio.create_task(self._send_blanks(writer))
            task.add_done_callback(lambda _: blanks.cancel())
        with contextlib.suppress(ConnectionError, asyncio.CancelledError):
            while line := (await reader.readline()).decode().strip():
                self.lines.append(line)
                answer = await self.answer(line)
                if answer is not None and not writer.is_closing():
                    writer.write(f'{answer}\r\n'.encode())
        writer.close()

    async def _send_blanks(self, writer):
        while not writer.is_closing():
            writer.write(b'\r\n')
            await asyncio.sleep(self.blank)

    async def answer(self, line):
        """Return the answer to a line, without its end, or None."""
        command = line[1:]
        name = command.partition(',')[0]
        default = self.default and self.default.replace('%s', name)
        answer = self.answers.get(command, self.answers.get(name, default))
        if isinstance(answer, list):
            answer = answer.pop(0)
        if answer is ConnectionError:
            raise answer
        if callable(answer):
            answer = answer(line)
        if answer is not None:
            await asyncio.sleep(self.delay)
        return answer
