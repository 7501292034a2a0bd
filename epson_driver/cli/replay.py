# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver replay`: plays the controller's side of a recorded run, for bug reports."""

import argparse
import asyncio
import contextlib
import sys
from pathlib import Path

from epson_driver.cli.arguments import FREE_PORT, argument, host, if_in_use
from epson_driver.inputs import InputError, number, printable
from epson_driver.processes.interrupt import ended_by_signals
from epson_driver.trace.pcap import PcapError
from epson_driver.trace.playback import play
from epson_driver.trace.player import Player, Score
from epson_driver.trace.recording import read_recording
from epson_driver.trace.script import ROLES, Script, ScriptError, make_script


def main() -> int:
    """Play a file once. Returns 0 if the client did all that was recorded and nothing else."""
    parser = _parser()
    args = parser.parse_args()
    try:
        script = make_script(read_recording(args.file), args.controller)
    except (PcapError, ScriptError) as error:
        parser.error(printable(f'{args.file}: {error}'))
    except InputError as error:
        parser.error(str(error))
    player = Player(script, args.speed, _tell)
    asked = {role: getattr(args, f'{role}_port') for role in ROLES}
    ports = {
        role: port if asked[role] is None else asked[role] for role, port in script.ports.items()
    }
    try:
        asyncio.run(_run(player, script, args.host, ports))
    except OSError as error:
        print(f'epson_driver replay: {error}{if_in_use(error.__cause__)}', file=sys.stderr)
        return 2
    score = player.finish()
    print(_report(score))
    return 0 if score.unknown == score.missing == 0 else 1


async def _run(player: Player, script: Script, host: str, ports: dict[str, int]) -> None:
    stop = asyncio.Event()
    with ended_by_signals(asyncio.get_running_loop(), stop.set):
        await play(player, script, host, ports, stop, _tell)


def _report(score: Score) -> str:
    requests = score.same + score.alike
    return '\n'.join(
        (
            f'requests: {requests} as recorded ({score.same} to the byte), '
            f'{score.unknown} not recorded, {score.missing} missing',
            f'messages: {score.sent} sent, {score.repeated} repeated while waiting, '
            f'{score.left_out} left out',
        )
    )


def _tell(text: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        print(f'epson_driver replay: {text}', file=sys.stderr, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='epson_driver replay',
        description="Plays the controller's side of a recorded run once. Exit code 0: the client "
        'did exactly what was recorded; 1: it did not; 2: the file cannot be played.',
        allow_abbrev=False,
    )
    parser.add_argument('file', type=Path, metavar='FILE', help='a trace, or a pcap of tcpdump')
    parser.add_argument(
        '--host', type=host, default='127.0.0.1', help='address to listen on (%(default)s)'
    )
    for role in ROLES:
        text = f'{role} port, 0 for any free one (the recorded one)'
        parser.add_argument(f'--{role}-port', type=argument(FREE_PORT), metavar='PORT', help=text)
    parser.add_argument(
        '--speed',
        type=argument(number(0.01, 100.0)),
        default=1.0,
        metavar='FACTOR',
        help='how many times as fast as recorded (%(default)s)',
    )
    parser.add_argument(
        '--controller', metavar='ADDRESS', help='which controller to play, if the file has several'
    )
    return parser
