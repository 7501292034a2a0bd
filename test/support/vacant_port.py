# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A port on which nobody listens, and which no other process can take meanwhile."""

import functools
import socket


@functools.cache
def _held() -> socket.socket:
    held = socket.socket()
    # A server of the same test may still listen there later; ports that the kernel chooses for
    # others are never this one.
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    held.bind(('127.0.0.1', 0))
    return held


def vacant_port() -> int:
    """Return a TCP port of 127.0.0.1 that refuses connections: one for each process.

    A port that was merely free a moment ago may be somebody's server a moment later. This one is
    bound for as long as the process lives, and nobody listens.
    """
    return int(_held().getsockname()[1])
