# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel check|run|test|export …`: SPEL+ programs without a robot, without RC+."""

import argparse
import re
import sys
from collections.abc import Iterator
from ipaddress import IPv4Address
from pathlib import Path

from epson_driver.cli.arguments import FREE_PORT, argument, define
from epson_driver.cli.problem_formats import FORMATS, placed
from epson_driver.inputs import InputError, Rule, count, number, shown
from epson_driver.spel import (
    NetSettings,
    Problem,
    ProgramError,
    read_project,
)
from epson_driver.spel.commands import CONTROLLERS, VERSIONS
from epson_driver.spel.lint import check
from epson_driver.spel.project_data import PROJECT, decoded

FOUND = 1
"""Exit code: something is wrong with the program."""

ADDRESS = Rule(lambda text: str(IPv4Address(text)), 'must be an IPv4 address')
VERSION = Rule(count(VERSIONS[0], VERSIONS[-1]).read, 'must be 6, 7 or 8')
_FILES = (
    'a project folder or its .sprj, or .prg files (with the .inc files beside them), or -: stdin'
)
STDIN = 'stdin.prg'


def main() -> int:
    """Check, run or test. Returns 0 if all is well, 1 if not, 2 for unusable arguments."""
    parser = _parser()
    arguments = parser.parse_args()
    try:
        run: int = arguments.run(arguments)
    except BrokenPipeError:
        sys.stderr.close()
        return FOUND
    except ProgramError as error:
        print(error)
        return FOUND
    except (OSError, InputError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        return 130
    return run


def _net(text: str) -> tuple[int, NetSettings]:
    """Return a port and its settings from 201=192.168.0.1:2000[:CR|LF|CRLF]."""
    found = re.fullmatch(
        r'(2[01][0-9])=([^:=]*):([0-9]{1,5})(?::(CRLF|CR|LF))?', text, re.IGNORECASE
    )
    if found is None or not 201 <= int(found[1]) <= 216 or not 1 <= int(found[3]) <= 65_535:
        said = f'{shown(text)}: must be 201=ADDRESS:PORT, with :CR, :LF or :CRLF behind it'
        raise argparse.ArgumentTypeError(said)
    ends = {'CR': '\r', 'LF': '\n'}
    end = ends.get((found[4] or '').upper(), '\r\n')
    return int(found[1]), NetSettings(found[2], int(found[3]), end)


def _add_surroundings(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--robot', default='c3_a601s', help='robot model (%(default)s)')
    parser.add_argument(
        '--controller', default='simulated', help='controller profile (%(default)s)'
    )
    parser.add_argument(
        '--stub',
        type=Path,
        metavar='FILE',
        help='answers to what is not simulated (YAML: WORD: answers, in turn)',
    )
    parser.add_argument(
        '--net',
        type=_net,
        action='append',
        default=[],
        metavar='201=ADDRESS:PORT',
        help='a port as the system configuration of RC+ has it, without SetNet; may be repeated',
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='epson_driver spel', description=__doc__)
    commands = parser.add_subparsers(required=True, metavar='check|run|test|export')
    checking = commands.add_parser('check', help='a linter: what is wrong, and what will be')
    checking.add_argument('files', nargs='+', type=Path, metavar='FILE', help=_FILES)
    checking.add_argument(
        '--version',
        type=argument(VERSION),
        metavar='|'.join(map(str, VERSIONS)),
        default=VERSIONS[-1],
        help='of RC+: 6 is RC620, 7 RC700 RC90 T VT, 8 RC800 (default: %(default)s)',
    )
    checking.add_argument(
        '--format',
        choices=FORMATS,
        default='text',
        help='lines of text, annotations of GitHub, SARIF 2.1, or a list in JSON (%(default)s)',
    )
    checking.add_argument('--strict', action='store_true', help='warnings fail as well')
    checking.set_defaults(run=_check)
    testing = commands.add_parser('test', help='run the functions named Test…')
    testing.add_argument('files', nargs='+', type=Path, metavar='FILE', help=_FILES)
    testing.add_argument('-k', metavar='TEXT', default='', help='only tests with this in the name')
    testing.add_argument(
        '--coverage', type=Path, metavar='FILE', help='write which lines ran, as Cobertura XML'
    )
    testing.add_argument('--junit', type=Path, metavar='FILE', help='write JUnit XML as well')
    _add_surroundings(testing)
    testing.set_defaults(run=_test)
    running = commands.add_parser('run', help='run a program on a simulated controller')
    running.add_argument(
        'program', type=Path, metavar='FILE', help='a project folder, its .sprj or a .prg'
    )
    running.add_argument(
        '--define',
        type=define,
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='another value in a #define line; may be repeated',
    )
    running.add_argument(
        '--remote-port',
        type=argument(FREE_PORT),
        default=0,
        metavar='PORT',
        help='where `pendant` reaches it (any free one, said on stderr)',
    )
    running.add_argument(
        '--seconds',
        type=argument(number(0.001, 1e6, 's')),
        metavar='S',
        help="end after this long, by the controller's clock, with exit code 3",
    )
    running.add_argument(
        '--fast',
        action='store_true',
        help="let the controller's time pass as fast as possible, without network (600 s at most)",
    )
    running.add_argument(
        '--setup',
        default='',
        metavar='STATEMENTS',
        help='what the robot manager of RC+ keeps: "HomeSet 0, 0, 0, 0; TLSet 1, XY(0, 0, 50, 0)"',
    )
    _add_surroundings(running)
    running.set_defaults(run=_run)
    exporting = commands.add_parser('export', help='a project for RC+ with our program')
    exporting.add_argument('folder', type=Path, metavar='FOLDER', help='new, or empty')
    exporting.add_argument('--robot', required=True, help='robot model')
    exporting.add_argument('--controller', required=True, choices=CONTROLLERS)
    exporting.add_argument(
        '--address',
        required=True,
        type=argument(ADDRESS, str),
        metavar='A.B.C.D',
        help='of the controller',
    )
    exporting.set_defaults(run=_export)
    return parser


def _export(arguments: argparse.Namespace) -> int:
    from epson_driver.cli import spel_commands  # imports numpy and the whole controller

    return spel_commands.export(arguments)


def _run(arguments: argparse.Namespace) -> int:
    from epson_driver.cli import spel_commands

    return spel_commands.run(arguments, *_projects([arguments.program]))


def _test(arguments: argparse.Namespace) -> int:
    from epson_driver.cli import spel_commands

    return spel_commands.test(arguments, _projects(arguments.files))


def _check(arguments: argparse.Namespace) -> int:
    problems: list[Problem] = []
    for folder, files in _projects(arguments.files):
        problems += placed(check(files, arguments.version), folder)
    errors = sum(not problem.warning for problem in problems)
    print(FORMATS[arguments.format](problems), end='')
    if arguments.format == 'text':
        warnings = len(problems) - errors
        print(f'{errors} errors, {warnings} warnings (version {arguments.version})')
    return FOUND if errors or (arguments.strict and problems) else 0


def _projects(paths: list[Path]) -> Iterator[tuple[Path, dict[str, str]]]:
    """Yield projects with their folders: each folder one, the files of one folder together."""
    single: dict[Path, dict[str, str]] = {}
    for path in paths:
        if str(path) == '-':
            yield Path(), {STDIN: decoded(sys.stdin.buffer.read())}
        elif path.is_dir():
            files = read_project(path)
            if not any(name.lower().endswith(PROJECT) for name in files):
                print(f'{path} has no .sprj: all its .prg files are built', file=sys.stderr)
            yield path, files
        else:
            single.setdefault(path.parent, {}).update(read_project(path))
    yield from single.items()


if __name__ == '__main__':
    sys.exit(main())
