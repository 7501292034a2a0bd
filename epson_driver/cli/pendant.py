# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`pendant`: what a person does at the controller, over its remote port."""

import argparse
import asyncio
import sys

from epson_driver.cli.arguments import PORT, argument, host
from epson_driver.inputs import number
from epson_driver.pendant.commands import TEXTS, UsageError, completion, request
from epson_driver.pendant.session import RejectedError, ask_controller
from epson_driver.remote_ethernet.client import RemoteError
from epson_driver.sim_controller.faults.fault_text import describe

ANSWER_TIMEOUT_S = 5.0
TIMEOUT = number(0.1, 3600.0, 's')

_LOCAL = {'fault kinds': describe, 'completion': completion}
"""What needs no controller to be answered."""


def main() -> int:
    """Do one action. Return 0 if it was done, 1 if it was refused or nobody answered."""
    parser = _parser()
    args = parser.parse_args()
    said = ' '.join(args.action)
    if said in _LOCAL:
        print(_LOCAL[said]())
        return 0
    try:
        asked = None if said == 'status' else request(args.action)
    except UsageError as error:
        parser.error(str(error))
    try:
        said = asyncio.run(
            ask_controller(asked, args.host, args.port, args.password, args.timeout)
        )
    except RejectedError as error:
        print(f'refused: {error}', file=sys.stderr)
        return 1
    except RemoteError as error:
        print(f'refused: {error} [{args.host}:{args.port}]', file=sys.stderr)
        return 1
    except TimeoutError:
        print(f'no answer from {args.host}:{args.port} in {args.timeout:g} s', file=sys.stderr)
        return 1
    except ConnectionError as error:
        print(f'no controller: {error}', file=sys.stderr)
        return 1
    print(said)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='epson_driver pendant',
        description='What a person does at the controller.',
        usage='%(prog)s [-h] [--host HOST] [--port PORT]\n'
        '                            [--password PASSWORD] [--timeout S] WORD …',
        epilog='\n'.join(['words:', *(f'  {said:26}{text}' for said, text in TEXTS.items())]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        '--host', type=host, default='127.0.0.1', help='the controller (%(default)s)'
    )
    parser.add_argument(
        '--port', type=argument(PORT), default=5000, help='its remote port (%(default)s)'
    )
    parser.add_argument('--password', default='', help='password of the remote port (none)')
    parser.add_argument(
        '--timeout',
        type=argument(TIMEOUT),
        default=ANSWER_TIMEOUT_S,
        metavar='S',
        help='how long to try, s (%(default)g)',
    )
    parser.add_argument('action', nargs='+', metavar='WORD', help='the action, as listed below')
    return parser
