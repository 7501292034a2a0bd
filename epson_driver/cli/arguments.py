# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arguments that several commands share, and types for argparse.

argparse exits with code 2 and names the argument if a type rejects its value.
"""

import argparse
import errno
import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from epson_driver.inputs import HOST, VARIABLE, InputError, Rule, count, meant, printable, shown
from epson_driver.setup.robot_file import is_robot_file, robot_settings

PORT = Rule(count(1, 65_535).read, 'must be a port from 1 to 65535')
FREE_PORT = Rule(count(0, 65_535).read, 'must be a port from 0 to 65535')

DEFAULT_MODEL = 'c3_a601s'

FOR_FILES = {'--robot': 'robot_model', '--host': 'robot_ip', '--address': 'robot_ip'}
"""Options that accept a robot's file, and the setting that they take from it."""


class Parser(argparse.ArgumentParser):
    """A parser that reports an error in one sentence and suggests the nearest option or choice.

    Options cannot be abbreviated. `texts`: the arguments of `help_texts`, except for a subcommand.
    """

    def __init__(self, name: str = '', *texts: Any, **options: Any) -> None:
        if texts:
            options |= {'prog': f'epson_driver {name}'} | help_texts(*texts)
        super().__init__(allow_abbrev=False, **options)

    def option(
        self,
        form: str,
        text: str,
        rule: Rule | Callable[[str], Any] | None = None,
        default: Any = None,
        **more: Any,
    ) -> None:
        """Add an option, such as `--seed N`, or a switch, such as `--list`.

        `rule` checks a number, or converts the text. The help text is `text` and the default,
        unless `text` contains it.
        """
        name, _, metavar = form.partition(' ')
        if metavar:
            kind = argument(rule) if isinstance(rule, Rule) else rule
            more |= {'type': kind, 'default': default, 'metavar': metavar}
            if default not in (None, []) and 'default:' not in text:
                text += ' (default: %(default)s)'
        else:
            more['action'] = 'store_true'
        self.add_argument(name, help=text, **more)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        words = sys.argv[1:] if args is None else list(args)
        end = words.index('--') if '--' in words else len(words)
        options = [name for name in self._option_string_actions if name.startswith('--')]
        for word in [] if self._subparsers else words[:end]:
            name = word.partition('=')[0]
            if name.startswith('--') and name not in options:
                self.error(f'no option {printable(name)}: {meant(name, options)}')
        result, unknown = super().parse_known_args(words, namespace)
        if unknown:
            self.error(f'unexpected argument {printable(unknown[0])}')
        return result, unknown

    def error(self, message: str) -> NoReturn:
        if re.match('unexpected|the following|argument .*: expected ', message):  # has no remedy
            message += f': see `{self.prog} --help`'
        self.exit(2, f'{self.prog}: error: {message}\n')

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            remedy = meant(str(value), map(str, action.choices))
            raise argparse.ArgumentError(action, f'{printable(shown(value))}: {remedy}')


def add_robot(parser: Parser) -> None:
    parser.option('--robot MODEL', 'robot model, or a .yaml file', default=DEFAULT_MODEL)


def add_controller(parser: Parser, about: str = 'controller profile') -> None:
    parser.option('--controller PROFILE', f'{about}, or a .yaml file', default='simulated')


def add_password(parser: Parser) -> None:
    text = 'environment variable that contains the Remote Ethernet password (default: no password)'
    parser.option('--password-variable NAME', text, argument(VARIABLE, str), '')


def add_ports(parser: Parser, unused: str) -> None:
    """Add an option for each port of a controller. `unused` explains port 0."""
    for name in ('state', 'motion', 'io', 'remote'):
        text = f'{"I/O" if name == "io" else name} port (default: from the profile'
        text += ')' if name == 'state' else f', 0: {unused})'
        parser.option(f'--{name}-port PORT', text, FREE_PORT)


class _Formatter(argparse.HelpFormatter):
    """A help formatter that wraps the description, and keeps the lines of the epilog."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if '\n' in text else super()._fill_text(text, width, indent)


def help_texts(description: str, examples: Sequence[str], codes: str, more: str = '') -> Any:
    """Return keyword arguments for ArgumentParser that show a help text.

    `codes` describes the exit codes, and `more` is the text after them.
    """
    lines = ['examples:', *(f'  epson_driver {example}' for example in examples)]
    epilog = '\n'.join([*lines, '', f'exit codes: {codes}', more]).strip()
    return {'description': description, 'epilog': epilog, 'formatter_class': _Formatter}


def argument(rule: Rule, parse: Callable[[str], object] | None = None) -> Callable[[str], Any]:
    """Return a `type` for argparse that parses an argument and checks `rule`.

    `parse` converts the text (default: to a number).
    """

    def read(text: str) -> Any:
        try:
            return rule.read((parse or _number)(text))
        except (TypeError, ValueError, KeyError, OverflowError):
            message = text if text and len(text) < 100 else shown(text)
            raise argparse.ArgumentTypeError(
                f'{printable(message)}: {rule.text_for(text)}'
            ) from None

    return read


def host(text: str) -> str:
    if text.endswith(('.yaml', '.yml')):
        raise argparse.ArgumentTypeError(
            f'{printable(text)}: must be a file written by `epson_driver connect`'
        )
    return str(argument(HOST, str)(text))


def parsed(
    parser: argparse.ArgumentParser,
    words: Sequence[str] | None = None,
    *,
    positional: str = '',
    refused: str = '',
) -> argparse.Namespace:
    """Parse a command line that may contain a robot's file (robot.yaml) instead of a value.

    After --robot, the file stands for its robot model, and after --host or --address for its
    address. A file without an option stands for its setting `positional`, or is an error if
    `positional` is ''. The other settings of the file replace the parser's defaults. `refused` is
    the reason why the command accepts no such file, or ''.
    """
    words = list(sys.argv[1:] if words is None else words)
    end = words.index('--') if '--' in words else len(words)
    for index, word in enumerate(words[:end]):
        option, _, name = word.rpartition('=')
        option = option or (words[index - 1] if index else '')
        action = parser._option_string_actions.get(option)  # noqa: SLF001 - not public otherwise
        other = action is not None and action.nargs != 0 and option not in FOR_FILES
        if other or not is_robot_file(name):
            continue
        if refused:
            parser.error(f'{printable(name)}: {refused}')
        try:
            settings = robot_settings(name)
        except InputError as error:
            parser.error(str(error))
        key = FOR_FILES.get(option, positional)
        if not key:
            parser.error(
                f'{printable(name)}: a robot file must follow {", ".join(FOR_FILES)}; only '
                'client, connect, doctor, first_run and panel take it alone'
            )
        words[index] = f'{word[: -len(name)]}{settings.get(key, DEFAULT_MODEL)}'
        defaults = settings | {'robot': settings.get('robot_model')}
        if option == '--host' and settings.get('remote_port'):
            defaults['port'] = settings['remote_port']
        parser.set_defaults(
            **{name: value for name, value in defaults.items() if value is not None}
        )
    return parser.parse_args(words)


def define(text: str) -> tuple[str, str]:
    name, equals, value = text.partition('=')
    if not equals or not name.strip():
        rule = 'must be NAME=VALUE, or NAME= to turn it off'
        raise argparse.ArgumentTypeError(f'{printable(shown(text))}: {rule}')
    return name.strip(), value


def path_with(*suffixes: str) -> Callable[[str], Path]:
    """Return a `type` for argparse that accepts paths with one of these suffixes."""

    def read(text: str) -> Path:
        path = Path(text)
        if path.suffix not in suffixes:
            rule = f'must end in {" or ".join(suffixes)}'
            raise argparse.ArgumentTypeError(f'{printable(shown(text))}: {rule}')
        return path

    return read


page = path_with('.html')
picture = path_with('.png', '.pdf', '.svg', '.jpg')


def if_in_use(cause: BaseException | None) -> str:
    """Return advice if `cause` means that another process uses the port, else ''."""
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
    if math.isinf(number) and 'inf' not in text.lower():  # such as 1e999
        raise OverflowError
    return number


def with_start_joined(arguments: Sequence[str]) -> list[str]:
    """Join an option and its value, as in `--start=-1.0,0.2`.

    argparse would otherwise treat a value that starts with - as an option.
    """
    joined: list[str] = []
    for word in arguments:
        if joined and joined[-1] == '--start':
            joined[-1] = f'--start={word}'
        else:
            joined.append(word)
    return joined
