# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reason for a failed connection or port, as a system message."""

import os
import socket


def reason(error: Exception) -> str:
    """Return the system's reason without the address, which the caller adds.

    asyncio and `socket.create_server` repeat the address in their texts. Name resolution has
    separate error numbers, so its text is used. Empty if the error has no text, for example for a
    timeout.
    """
    if not isinstance(error, OSError) or error.errno is None:
        return str(error)
    if isinstance(error, socket.gaierror):
        return error.strerror or str(error)
    return os.strerror(error.errno)
