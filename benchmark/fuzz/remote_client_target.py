# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The client of Remote Ethernet against answers of any kind, in memory."""

import asyncio

from benchmark.fuzz import messages
from benchmark.fuzz.cases import Case, Step
from benchmark.fuzz.memory_server import ServedEnd, listen, new_loop
from benchmark.fuzz.messages import Chance
from epson_driver.remote_ethernet.client import RemoteError, execute

COMMANDS = ('GetStatus', 'SetMotorsOn,1', 'Reset', 'SetIO,1,1')
INPUTS_PER_CASE = 60
PORT = 4
TIMEOUT_S = 5.0


class RemoteClientTarget:
    """Commands to a server that answers, truncates its answers, or disconnects."""

    name = 'client of Remote Ethernet'

    def case(self, chance: Chance, corpus: list[bytes]) -> Case:
        """Return the sequence of answers."""
        steps: list[Step] = []
        for _ in range(INPUTS_PER_CASE):
            draw = chance.random()
            if draw < 0.05:
                steps.append(('do', 'hang up'))
                continue
            data = messages.answer(chance, chance.choice((b'Login,', *map(str.encode, COMMANDS))))
            if draw < 0.5:
                data = b''  # the right answer
            elif draw < 0.8:
                data = messages.mutated(chance, data)
            steps.append(('send', 'remote', data))
        return Case(self.name, tuple(steps))

    def run(self, case: Case) -> None:
        """Send commands until all answers are used. Raises exceptions that no caller expects."""
        loop = new_loop()
        answers = list(reversed(case.steps))

        def accept(end: ServedEnd) -> None:
            def on_bytes(data: bytes) -> None:
                step = answers.pop() if answers else ('do', 'hang up')
                if step[0] != 'send':
                    end.hang_up()
                    return
                right = b'#' + data.removeprefix(b'$').split(b',')[0].strip() + b',0\r\n'
                end.feed(step[2] or right)

            end.on_bytes = on_bytes

        listen(loop, PORT, accept)

        async def give() -> None:
            while answers:
                left = len(answers)
                try:
                    await execute('127.0.0.1', PORT, COMMANDS, TIMEOUT_S)
                except (RemoteError, TimeoutError, ConnectionError):
                    if left == len(answers):
                        return

        try:
            loop.run_until_complete(asyncio.wait_for(give(), 1e6))
        finally:
            loop.bury()
