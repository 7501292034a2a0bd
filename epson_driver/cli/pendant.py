# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`pendant`: what a person does at the controller, over its remote port."""

import argparse
import asyncio
import sys
from contextlib import suppress

from epson_driver.controller.errors import TEXTS
from epson_driver.link.remote_ethernet import RemoteError, execute
from epson_driver.remote_errors import RemoteErrorNumber

_TIMEOUT = 5.0  # s
_FLAGS = (
    'Test',
    'Teach',
    'Auto',
    'Warning',
    'SError',
    'Safeguard',
    'EStop',
    'Error',
    'Paused',
    'Running',
    'Ready',
)

ACTIONS: dict[str, tuple[str, str]] = {
    'motors on': ('SetMotorsOn,1', 'motors on'),
    'motors off': ('SetMotorsOff,1', 'motors off'),
    'estop press': ('Sim,estop,press', 'E-stop pressed'),
    'estop release': (
        'Sim,estop,release',
        'E-stop released; it stays latched until the reset',
    ),
    'reset': ('Reset', 'reset; the motors are switched on separately'),
}
"""What is said on the command line: the remote command, and the answer when it is done."""

_WORDS = ('status', *ACTIONS)


def main() -> int:
    """Do one action. Return 0 if it is done, 1 if it is refused or nobody answers."""
    parser = _parser()
    args = parser.parse_args()
    action = ' '.join(args.action)
    if action not in _WORDS:
        parser.error(f'{action}: must be one of {", ".join(_WORDS)}')
    try:
        print(asyncio.run(_do(action, args.host, args.port)))
    except RemoteError as error:
        reason = _advice(error, args.host, args.port)
        print(f'refused: {reason}', file=sys.stderr)
        return 1
    except TimeoutError:
        print(f'no answer from {args.host}:{args.port} in {_TIMEOUT:g} s', file=sys.stderr)
        return 1
    except ConnectionError as error:
        print(f'no controller: {error}', file=sys.stderr)
        return 1
    return 0


async def _do(action: str, host: str, port: int) -> str:
    if action == 'status':
        return await _status(host, port)
    command, done = ACTIONS[action]
    await execute(host, port, [command], _TIMEOUT)
    return done


async def _status(host: str, port: int) -> str:
    flags, number = await _flags(host, port)
    try:
        values = await execute(host, port, ['GetMotor,0'], _TIMEOUT)
        motors = 'on' if values[0].split(',')[1:2] == ['1'] else 'off'
    except RemoteError:  # an older firmware
        motors = 'unknown'
    mode = 'AUTO' if 'Auto' in flags else 'TEACH' if 'Teach' in flags else 'unknown'
    error = f'{number:04d} ({TEXTS.get(number, "see the manual")})' if number else 'none'
    rows = {
        'motors': motors,
        'E-stop': 'active (release, then reset)' if 'EStop' in flags else 'not active',
        'arm': 'moves' if 'Running' in flags else 'stands',
        'error': error,
        'mode': mode,
        'flags': ' '.join(flags) or 'none',
    }
    with suppress(RemoteError):  # a real controller
        rows['late'] = _late(*await execute(host, port, ['Sim,timing'], _TIMEOUT))
    return '\n'.join(f'{name + ":":8}{text}' for name, text in rows.items())


def _late(value: str) -> str:
    """Return what the simulated controller says of its timing since it was started."""
    cycles, plans, failures = value.split(',')
    return f'{cycles} cycles, {plans} plans; {failures} plans failed'


async def _flags(host: str, port: int) -> tuple[tuple[str, ...], int]:
    """Return the names of the flags that are set, and the error number.

    RC+ 5 sends ten flags, without Test; so they are counted from the end.
    """
    (value,) = await execute(host, port, ['GetStatus'], _TIMEOUT)
    bits, _, number = value.partition(',')
    if not number.isdecimal() or not 0 < len(bits) <= len(_FLAGS) or set(bits) - {'0', '1'}:
        raise ConnectionError(f'{host}:{port}: {value!r} is no status')
    named = zip(_FLAGS[-len(bits) :], bits, strict=True)
    return tuple(name for name, bit in named if bit == '1'), int(number)


def _advice(error: RemoteError, host: str, port: int) -> str:
    if error.number != RemoteErrorNumber.NOT_READY:
        return str(error)
    try:
        flags, _ = asyncio.run(_flags(host, port))
    except (RemoteError, OSError):
        return str(error)
    if 'EStop' in flags:
        return f'the E-stop is active: release the E-stop, then reset (error {error.number})'
    if 'Running' in flags:
        return f'the arm still moves: try again when it stands (error {error.number})'
    return str(error)


def _port(text: str) -> int:
    port = int(text) if text.isdecimal() else 0
    if not 1 <= port <= 65_535:
        raise argparse.ArgumentTypeError(f'{text}: must be a port from 1 to 65535')
    return port


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='pendant',
        description='What a person does at the controller.',
        usage='%(prog)s [-h] [--host HOST] [--port PORT] ' + '|'.join(_WORDS),
    )
    parser.add_argument('--host', default='127.0.0.1', help='the controller (%(default)s)')
    parser.add_argument('--port', type=_port, default=5000, help='its remote port (%(default)s)')
    parser.add_argument('action', nargs='+', help=', '.join(_WORDS))
    return parser
