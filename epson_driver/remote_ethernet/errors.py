# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The error numbers of EPSON's Remote Ethernet, shared by both ends of the protocol.

Source: EPSON RC+ 5.0 and 8.0 user's guides, Remote Ethernet.
"""

from enum import IntEnum


class RemoteErrorNumber(IntEnum):
    """Error numbers of Remote Ethernet."""

    NO_DOLLAR = 10
    BAD_COMMAND = 11
    FORMAT = 12
    PASSWORD = 13
    COUNT = 14
    PARAMETER = 15
    TIMEOUT = 19
    NOT_READY = 20
    EXECUTING = 21
    PASSWORD_NEEDED = 98
    SYSTEM = 99


MEANINGS: dict[int, str] = {
    RemoteErrorNumber.NO_DOLLAR: 'the command does not begin with $',
    RemoteErrorNumber.BAD_COMMAND: 'the command is unknown, or nobody is logged in',
    RemoteErrorNumber.FORMAT: 'the format of the command is wrong',
    RemoteErrorNumber.PASSWORD: 'the password is wrong',
    RemoteErrorNumber.COUNT: 'the number of values asked for is wrong',
    RemoteErrorNumber.PARAMETER: 'a parameter is wrong',
    RemoteErrorNumber.TIMEOUT: 'the controller took too long',
    RemoteErrorNumber.NOT_READY: 'the controller does not accept it in its present condition',
    RemoteErrorNumber.EXECUTING: 'another command is being executed',
    RemoteErrorNumber.PASSWORD_NEEDED: 'a password is needed',
    RemoteErrorNumber.SYSTEM: 'system error or communication error',
}
