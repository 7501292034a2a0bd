# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A remote client of a controller on a manual clock, without sockets."""

from support.controller_harness import Harness, Peer


class Remote:
    """Lines in, answers out; `harness` has the controller."""

    def __init__(self, harness=None, login='Login'):
        self.harness = harness or Harness(motors=False)
        self.peer = Peer()
        self.connection = self.harness.controller.connect('remote', self.peer)
        if login:
            assert self(login) == '#Login,0'

    @property
    def controller(self):
        return self.harness.controller

    def __call__(self, command):
        """Return the one answer to a command, which is written without its `$`."""
        (answer,) = self.answers(f'${command}\r\n'.encode())
        return answer

    def answers(self, data):
        """Return the answers to bytes."""
        self.connection.receive(data)
        text = self.peer.take().decode()
        assert not text or text.endswith('\r\n')
        return text.split('\r\n')[:-1]
