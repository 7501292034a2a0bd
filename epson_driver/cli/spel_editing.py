# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel fmt|points|server`: format sources, convert points, and serve an editor."""

import argparse
from codecs import BOM_UTF8
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from epson_driver.cli.arguments import help_texts
from epson_driver.cli.problem_formats import FOUND
from epson_driver.inputs import printable, read_file, write_file
from epson_driver.spel.formatting import formatted
from epson_driver.spel.project_data import INCLUDE, LARGEST_FILE, PROGRAM, decoded


def add_editing(commands: Any, codes: str) -> None:
    text = "Set the case of words as RC+'s editor does, and the indentation of blocks."
    examples = ('spel fmt my_project', 'spel fmt --check main.prg')
    formatting = commands.add_parser('fmt', help=text, **help_texts(text, examples, codes))
    about = '.prg and .inc files, or a folder: all that are in it'
    formatting.add_argument('files', nargs='+', type=Path, metavar='FILE', help=about)
    formatting.add_argument(
        '--check', action='store_true', help='print what would change, and write nothing'
    )
    formatting.set_defaults(run=_format)
    text = 'Show points as a table, or convert them.'
    examples = ('spel points robot1.pts', 'spel points robot1.pts --to points.csv')
    points = commands.add_parser('points', help=text, **help_texts(text, examples, codes))
    points.add_argument('file', type=Path, metavar='FILE', help='.pts, .csv or .yaml file')
    points.add_argument('--to', type=Path, metavar='FILE', help='.pts, .csv or .yaml file')
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

    server.start_io()
    return 0
