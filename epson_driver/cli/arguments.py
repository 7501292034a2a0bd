# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Types of command-line arguments, for argparse, which names the argument and exits with 2."""

import argparse
import errno
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from epson_driver.inputs import HOST, Rule, count, printable, shown

PORT = Rule(count(1, 65_535).read, 'must be a port from 1 to 65535')
FREE_PORT = Rule(count(0, 65_535).read, 'must be a port from 0 to 65535')
"""0 selects any free port."""

LOGIN_HELP = 'Remote Ethernet password (default: none)'
PORT_HELP = '{} port (default: from the profile'


class _Formatter(argparse.HelpFormatter):
    """Wraps the description and keeps the lines of the epilog."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if '\n' in text else super()._fill_text(text, width, indent)


def help_texts(description: str, examples: Sequence[str], codes: str, more: str = '') -> Any:
    """Return the keywords of a parser for its description, examples and exit codes."""
    lines = ['examples:', *(f'  epson_driver {example}' for example in examples)]
    epilog = '\n'.join([*lines, '', f'exit codes: {codes}', more]).strip()
    return {'description': description, 'epilog': epilog, 'formatter_class': _Formatter}


def argument(rule: Rule, parse: Callable[[str], object] | None = None) -> Callable[[str], Any]:
    """Return a `type` for argparse: the number, or what `parse` returns, checked by a rule."""

    def read(text: str) -> Any:
        try:
            return rule.read((parse or _number)(text))
        except (TypeError, ValueError, KeyError, OverflowError):
            message = text if text and len(text) < 100 else shown(text)
            raise argparse.ArgumentTypeError(f'{printable(message)}: {rule.text}') from None

    return read


host = argument(HOST, str)


def define(text: str) -> tuple[str, str]:
    """Return name and value of NAME=VALUE, which replaces a #define value of a SPEL+ project."""
    name, equals, value = text.partition('=')
    if not equals or not name.strip():
        rule = 'must be NAME=VALUE, or NAME= to turn it off'
        raise argparse.ArgumentTypeError(f'{printable(shown(text))}: {rule}')
    return name.strip(), value


PICTURES = ('.png', '.pdf', '.svg', '.jpg')


def picture(text: str) -> Path:
    """Return the path of a picture, checked for a supported suffix."""
    path = Path(text)
    if path.suffix not in PICTURES:
        rule = f'must end in {" or ".join(PICTURES)}'
        raise argparse.ArgumentTypeError(f'{printable(shown(text))}: {rule}')
    return path


def page(text: str) -> Path:
    """Return the path of a report page, which must end in .html."""
    path = Path(text)
    if path.suffix != '.html':
        raise argparse.ArgumentTypeError(f'{printable(shown(text))}: must end in .html')
    return path


def if_in_use(cause: BaseException | None) -> str:
    """Return advice if another process has the port open."""
    if not isinstance(cause, OSError) or cause.errno != errno.EADDRINUSE:
        return ''
    return (
        '; end the process that uses it, or choose other ports with --motion-port, --state-port … '
        '(0: any free port) and set them in the client too (motion_port, state_port …)'
    )


def _number(text: str) -> int | float:
    if not text.isascii() or '_' in text:  # int() accepts other digits and underscores
        raise ValueError
    try:
        return int(text)
    except ValueError:
        number = float(text)
    if math.isinf(number) and 'inf' not in text.lower():  # more digits than a number can have
        raise OverflowError
    return number


def with_start_joined(arguments: Sequence[str]) -> list[str]:
    """Make `--start -1.0,0.2` one word, because argparse would read an option."""
    joined: list[str] = []
    for word in arguments:
        if joined and joined[-1] == '--start':
            joined[-1] = f'--start={word}'
        else:
            joined.append(word)
    return joined
