# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A remote client of a controller on a manual clock, without sockets."""

from controller_bench import Bench, Peer


class Remote:
    """Lines in, answers out; `bench` has the controller."""

    def __init__(self, bench=None, login='Login'):
        self.bench = bench or Bench(motors=False)
        self.peer = Peer()
        self.line = self.bench.controller.connect('remote', self.peer)
        if login:
            assert self(login) == '#Login,0'

    @property
    def controller(self):
        return self.bench.controller

    def __call__(self, command):
        """Return the one answer to a command, which is written without its `$`."""
        (answer,) = self.answers(f'${command}\r\n'.encode())
        return answer

    def answers(self, data):
        """Return the answers to bytes."""
        self.line.receive(data)
        text = self.peer.take().decode()
        assert not text or text.endswith('\r\n')
        return text.split('\r\n')[:-1]
