# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Log lines caused by peers: rate limit and escaping, and texts of socket errors."""

import errno
import logging
import os
import socket

import pytest
from support.event_loop import PATIENCE, run

from epson_driver.inputs import printable
from epson_driver.log_lines import PERIOD_S, LogThrottle, PrintableFormatter
from epson_driver.remote_ethernet.client import execute
from epson_driver.socket_errors import reason


def test_one_line_per_period_passes_with_a_count():
    pace = LogThrottle()
    assert pace.line('first', 100.0) == 'first'
    assert pace.line('second', 100.1) is None
    assert pace.line('third', 100.0 + 0.9 * PERIOD_S) is None
    assert pace.line('fourth', 100.0 + PERIOD_S) == 'fourth (and 2 like it before)'
    assert pace.line('fifth', 100.0 + 3 * PERIOD_S) == 'fifth'


def test_burst_passes_and_is_restored_later():
    pace = LogThrottle(burst=5)
    passed = [pace.passes(100.0) for _ in range(1000)]
    assert passed == [0] * 5 + [None] * 995
    assert pace.passes(100.0 + PERIOD_S) == 995
    assert pace.passes(100.0 + PERIOD_S) is None
    assert [pace.passes(1000.0) for _ in range(6)] == [1, 0, 0, 0, 0, None]


def test_burst_and_one_line_per_period_pass_at_any_rate():
    pace = LogThrottle(burst=5)
    passed = [pace.passes(0.001 * tick) for tick in range(10_001)]
    assert sum(held is not None for held in passed) == 5 + 10
    assert sum(held for held in passed if held is not None) >= 10_001 - 15 - 1000


@pytest.mark.parametrize(
    ('text', 'shown'),
    [
        ('plain, µ and °', 'plain, µ and °'),
        ('\x1b[2J\x07', r'\x1b[2J\x07'),
        ('one\r\ntwo\tthree\0', r'one\r\ntwo\tthree\x00'),
        ('\x9b31m', r'\x9b31m'),
        ('\u202egnp.exe', r'\u202egnp.exe'),
        ('\udcff', r'\udcff'),
        ('\u2028', r'\u2028'),
    ],
)
def test_unprintable_characters_are_escaped(text, shown):
    assert printable(text) == shown
    assert printable(printable(text)) == shown


def test_log_record_is_one_printable_line():
    formatter = PrintableFormatter('%(levelname)s %(message)s')
    try:
        raise ValueError('\x1b]0;title\x07')
    except ValueError as error:
        wrong = (type(error), error, error.__traceback__)
    arguments = ('x', logging.ERROR, __file__, 1, 'it said %s', ('\x1b[2J\nINFO forged',))
    assert formatter.format(logging.LogRecord(*arguments, None)) == (
        r'ERROR it said \x1b[2J\nINFO forged'
    )
    lines = formatter.format(logging.LogRecord(*arguments, wrong)).split('\n')
    assert lines[1] == 'Traceback (most recent call last):'
    assert lines[-1] == r'ValueError: \x1b]0;title\x07'
    assert all(line.isprintable() for line in lines)


def test_reason_has_no_address() -> None:
    with socket.create_server(('127.0.0.1', 0)) as taken:
        address = taken.getsockname()
        with pytest.raises(OSError, match='address') as caught:
            socket.create_server(address)
    assert str(address[1]) in str(caught.value)
    assert reason(caught.value) == os.strerror(errno.EADDRINUSE)


@pytest.mark.parametrize(
    ('error', 'text'),
    [
        (ConnectionRefusedError(errno.ECONNREFUSED, 'Connect call failed'), 'Connection refused'),
        (
            socket.gaierror(socket.EAI_NONAME, 'Name or service not known'),
            'Name or service not known',
        ),
        (OSError('Multiple exceptions: …'), 'Multiple exceptions: …'),
        (OverflowError('bind(): port must be 0-65535.'), 'bind(): port must be 0-65535.'),
        (TimeoutError(), ''),
    ],
)
def test_socket_error_is_logged_with_its_text(error: Exception, text: str) -> None:
    assert reason(error) == text


def test_unknown_host_error_has_no_errno() -> None:
    with pytest.raises(ConnectionError) as caught:
        run(execute('no such host', 5000, [], PATIENCE))
    text = str(caught.value)
    assert text.startswith('no such host:5000: ')
    assert 'Errno' not in text
