# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Why a connection or a port could not be opened, in the system's words."""

import os
import socket


def reason(error: Exception) -> str:
    """Return the system's reason without the address, which the caller names.

    asyncio and `socket.create_server` repeat the address in their texts. The numbers of errors of
    name resolution are not those of the system, so their own text counts. Empty if the error says
    nothing, as a time-out does.
    """
    if not isinstance(error, OSError) or error.errno is None:
        return str(error)
    if isinstance(error, socket.gaierror):
        return error.strerror or str(error)
    return os.strerror(error.errno)
