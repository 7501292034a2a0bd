# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The operating system's text for a network error."""

import os
import socket


def reason(error: Exception) -> str:
    """Return the system's text for an error, such as "Connection refused".

    The texts of asyncio and `socket.create_server` also contain the address, which callers of this
    function add themselves. The result is '' for an error without a text, such as a timeout.
    """
    if not isinstance(error, OSError) or error.errno is None:
        return str(error)
    if isinstance(error, socket.gaierror):  # name resolution has separate error numbers
        return error.strerror or str(error)
    return os.strerror(error.errno)
