# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel COMMAND`: SPEL+ programs without a robot and without RC+."""

import argparse
import gc
import sys
from codecs import BOM_UTF8
from collections.abc import Iterator
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any

from epson_driver.cli.arguments import FREE_PORT, Parser, argument, help_texts, parsed
from epson_driver.cli.problem_formats import FORMATS, FOUND, placed
from epson_driver.cli.spel_options import add_program_options, add_set
from epson_driver.inputs import InputError, Rule, count, number, printable, read_file, write_file
from epson_driver.spel import Problem, ProgramError, read_project, read_settings
from epson_driver.spel.commands import CONTROLLERS, VERSIONS
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.formatting import formatted
from epson_driver.spel.lint import check
from epson_driver.spel.project_data import INCLUDE, LARGEST_FILE, PROGRAM, PROJECT, decoded

ADDRESS = Rule(lambda text: str(IPv4Address(text)), 'must be an IPv4 address')
VERSION = Rule(count(VERSIONS[0], VERSIONS[-1]).read, 'must be 6, 7 or 8')
_FILES = (
    'project folder or its .sprj, .prg files (with .inc files in the same folder), or -: stdin'
)
STDIN = 'stdin.prg'


def main() -> int:
    parser = _parser()
    arguments = parsed(parser)
    try:
        return int(arguments.run(arguments))
    except BrokenPipeError:
        sys.stderr.close()
        return FOUND
    except ProgramError as error:
        print(error)
        return FOUND
    except (OSError, InputError) as error:
        parser.error(str(error))


def _parser() -> argparse.ArgumentParser:
    codes = '0 no problem, 1 problems found, 2 invalid arguments, 130 Ctrl-C'
    parser = Parser(
        'spel',
        'Check, run, test, edit and export SPEL+ programs without a robot and without RC+.',
        ('spel check my_project', 'spel test my_project'),
        codes,
    )
    commands = parser.add_subparsers(required=True, metavar='COMMAND')
    text = 'Find errors and probable mistakes in a program.'
    examples = ('spel check my_project --strict', 'spel check main.prg --version 7 --format json')
    checking = commands.add_parser('check', help=text, **help_texts(text, examples, codes))
    checking.add_argument('files', nargs='+', type=Path, metavar='FILE', help=_FILES)
    checking.add_argument(
        '--version',
        type=argument(VERSION),
        metavar='|'.join(map(str, VERSIONS)),
        help='RC+ version to check against: 6 (RC620), 7 (RC700, RC90, T, VT) or 8 (RC800) '
        "(default: that of spel.yaml's controller, else 8)",
    )
    checking.add_argument(
        '--format',
        choices=FORMATS,
        default='text',
        help='lines of text, GitHub annotations, or a JSON list (default: %(default)s)',
    )
    checking.option('--strict', 'exit code 1 for warnings too')
    add_set(checking)
    checking.set_defaults(run=_check)
    text = 'Run the functions named Test… of a program on a simulated controller.'
    examples = ('spel test my_project -k gripper', 'spel test my_project --junit results.xml')
    testing = commands.add_parser('test', help=text, **help_texts(text, examples, codes))
    testing.add_argument('files', nargs='+', type=Path, metavar='FILE', help=_FILES)
    testing.add_argument(
        '-k', metavar='TEXT', default='', help='only tests with this text in the name'
    )
    testing.option('--coverage FILE', 'Cobertura XML file for the line coverage', Path)
    testing.option('--junit FILE', 'JUnit XML file for the results', Path)
    add_program_options(testing)
    testing.set_defaults(run=_test)
    text = 'Run a program on a simulated controller.'
    examples = ('spel run main.prg', 'spel run my_project --fast --seconds 60')
    ends = '0 the program ended, 1 an error ended it, 2 invalid arguments, '
    ends += '3 --seconds ended it, 130 Ctrl-C'
    running = commands.add_parser('run', help=text, **help_texts(text, examples, ends))
    running.add_argument(
        'program', type=Path, metavar='FILE', help='project folder, its .sprj or a .prg file'
    )
    running.option(
        '--remote-port PORT',
        'port for `pendant` (default: any free port, printed on stderr)',
        FREE_PORT,
        0,
    )
    running.option(
        '--seconds S',
        "time limit by the controller's clock, s (default: none)",
        number(0.001, 1e6, 's'),
    )
    running.option(
        '--fast', "run the controller's clock as fast as possible, without network (at most 600 s)"
    )
    add_program_options(running)
    running.set_defaults(run=_run)
    text = 'Write an RC+ project with our controller program.'
    example = 'spel export my_cell --robot c4_a601s --controller rc700a --address 192.168.0.1'
    example_8 = 'spel export new_cell --robot c8_a701s --controller rc800 --address 192.168.0.2'
    texts = help_texts(text, (example, example_8), '0 done, 2 invalid arguments, 130 Ctrl-C')
    exporting = commands.add_parser('export', help=text, **texts)
    exporting.add_argument('folder', type=Path, metavar='FOLDER', help='new or empty folder')
    exporting.option('--robot MODEL', 'robot model', required=True)
    exporting.option(
        '--controller PROFILE',
        f'controller profile: {", ".join(CONTROLLERS)}',
        required=True,
        choices=CONTROLLERS,
    )
    exporting.option(
        '--address ADDRESS', "the controller's IPv4 address", argument(ADDRESS, str), required=True
    )
    exporting.set_defaults(run=_export)
    add_editing(commands, codes)
    return parser


def _export(arguments: argparse.Namespace) -> int:
    from epson_driver.cli import spel_commands  # here, because it imports numpy and the simulation

    return spel_commands.export(arguments)


def _run(arguments: argparse.Namespace) -> int:
    from epson_driver.cli import spel_commands

    return spel_commands.run(arguments, *_projects([arguments.program]))


def _test(arguments: argparse.Namespace) -> int:
    from epson_driver.cli import spel_commands

    return spel_commands.test(arguments, _projects(arguments.files))


def _check(arguments: argparse.Namespace) -> int:
    problems: list[Problem] = []
    version = arguments.version
    for folder, files in _projects(arguments.files):
        settings = read_settings(folder, arguments.set)
        version = arguments.version or CONTROLLERS.get(settings.controller or '', VERSIONS[-1])
        problems += placed(check(files, version, settings), folder)
    errors = sum(not problem.warning for problem in problems)
    print(FORMATS[arguments.format](problems), end='')
    if arguments.format == 'text':
        warnings = len(problems) - errors
        print(f'{errors} errors, {warnings} warnings (version {version})')
    return FOUND if errors or (arguments.strict and problems) else 0


def _projects(paths: list[Path]) -> Iterator[tuple[Path, dict[str, str]]]:
    """Yield each project: its folder and its files.

    Each folder in `paths` is a project. Files in `paths` that share a folder form a project, too.
    """
    single: dict[Path, dict[str, str]] = {}
    for path in paths:
        if str(path) == '-':
            yield Path(), {STDIN: decoded(sys.stdin.buffer.read())}
        elif path.is_dir():
            files = read_project(path)
            if not any(name.lower().endswith(PROJECT) for name in files):
                print(f'{path} has no .sprj file: all its .prg files are built', file=sys.stderr)
            yield path, files
        else:
            single.setdefault(path.parent, {}).update(read_project(path))
    yield from single.items()


def add_editing(commands: Any, codes: str) -> None:
    text = "Set the case of words as RC+'s editor does, and the indentation of blocks."
    examples = ('spel fmt my_project', 'spel fmt --check main.prg')
    formatting = commands.add_parser('fmt', help=text, **help_texts(text, examples, codes))
    about = '.prg and .inc files, or a folder: all that are in it'
    formatting.add_argument('files', nargs='+', type=Path, metavar='FILE', help=about)
    formatting.option('--check', 'print what would change, and write nothing')
    formatting.set_defaults(run=_format)
    text = 'Show points as a table, or convert them.'
    examples = ('spel points robot1.pts', 'spel points robot1.pts --to points.csv')
    points = commands.add_parser('points', help=text, **help_texts(text, examples, codes))
    points.add_argument('file', type=Path, metavar='FILE', help='.pts, .csv or .yaml file')
    points.option('--to FILE', '.pts, .csv or .yaml file', Path)
    points.set_defaults(run=_points)
    text = 'Serve an editor by the Language Server Protocol, on stdin and stdout.'
    more = 'docs/spel_editor.md has the settings of editors.'
    texts = help_texts(text, ('spel server',), '0 ended by the editor, 1 cannot start', more)
    commands.add_parser('server', help=text, **texts).set_defaults(run=_serve)


def _sources(paths: list[Path]) -> Iterator[Path]:
    for path in paths:
        for item in sorted(path.iterdir()) if path.is_dir() else [path]:
            if item == path or item.suffix.lower() in (PROGRAM, INCLUDE):
                yield item


def _format(arguments: argparse.Namespace) -> int:
    """Format source files in place. Line ends and encodings are preserved."""
    changed = 0
    for path in _sources(arguments.files):
        content = read_file(path, LARGEST_FILE)
        mark = BOM_UTF8 if content.startswith(BOM_UTF8) else b''
        # Words are ASCII, and no code page has the bytes of quotes in its other characters.
        text = content.removeprefix(mark).decode('latin-1')
        result = mark + formatted(text).encode('latin-1')
        if result != content:
            changed += 1
            print(f'{"would format" if arguments.check else "formatted"} {printable(path)}')
            if not arguments.check:
                write_file(path, result)
    return FOUND if changed and arguments.check else 0


def _points(arguments: argparse.Namespace) -> int:
    from epson_driver.taught_points import TaughtPoints  # here, because it imports numpy

    points = TaughtPoints()
    points.load(arguments.file)
    if arguments.to is not None:
        if arguments.to.suffix.lower() in ('.yaml', '.yml'):
            usable = points.places
            omitted = [name for name in points if is_point_literal(name) or name not in usable]
            for name in omitted:
                points.remove(name)
            if omitted:
                print(f'{len(omitted)} points without label or position omitted', file=sys.stderr)
        points.save(arguments.to)
        return 0
    rows = [('', 'label', *'XYZUVW', 'flags', 'description'), *points.table()]
    rows = [tuple(decoded(text.encode('latin-1')) for text in row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (
            text.rjust(width) if 2 <= place < 8 else text.ljust(width)
            for place, (text, width) in enumerate(zip(row, widths, strict=True))
        )
        print('  '.join(map(printable, cells)).rstrip())
    return 0


def _serve(_arguments: argparse.Namespace) -> int:
    from epson_driver.editor.server import server  # here, because it needs the extra

    gc.set_threshold(50_000)  # syntax trees have no cycles to collect
    server.start_io()
    return 0
