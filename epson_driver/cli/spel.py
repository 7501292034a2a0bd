# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel check|run|test FILE…`: SPEL+ programs without a robot and without RC+."""

import argparse
import json
import logging
import sys
from pathlib import Path
from xml.sax.saxutils import quoteattr

from epson_driver.cli.arguments import FREE_PORT, argument, define
from epson_driver.inputs import InputError, Rule, count, number, printable
from epson_driver.spel import Problem, ProgramError, build, read_project
from epson_driver.spel.commands import VERSIONS
from epson_driver.spel.lint import RULES, check
from epson_driver.spel.testing import TestResult, run_tests

FOUND = 1
"""Exit code: something is wrong with the program."""

VERSION = Rule(count(VERSIONS[0], VERSIONS[-1]).read, 'must be 6, 7 or 8')
_FILES = 'a project folder, or .prg files (with the .inc files beside them)'


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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='epson_driver spel', description=__doc__)
    commands = parser.add_subparsers(required=True, metavar='check|run|test')
    checking = commands.add_parser('check', help='a linter: what is wrong, and what will be')
    checking.add_argument('files', nargs='+', type=Path, metavar='FILE', help=_FILES)
    checking.add_argument(
        '--version',
        type=argument(VERSION),
        metavar='|'.join(map(str, VERSIONS)),
        default=VERSIONS[-1],
        help='of RC+: 6 is RC620, 7 RC700 RC90 T VT, 8 RC800 (default: %(default)s)',
    )
    checking.add_argument('--json', action='store_true', help='a list of objects on stdout')
    checking.add_argument('--strict', action='store_true', help='warnings fail as well')
    checking.set_defaults(run=_check)
    testing = commands.add_parser('test', help='run the functions named Test…')
    testing.add_argument('files', nargs='+', type=Path, metavar='FILE', help=_FILES)
    testing.add_argument('-k', metavar='TEXT', default='', help='only tests with this in the name')
    testing.add_argument('--junit', type=Path, metavar='FILE', help='write JUnit XML as well')
    testing.set_defaults(run=_test)
    running = commands.add_parser('run', help='run a program on a simulated controller')
    running.add_argument('program', type=Path, metavar='FILE', help='a project folder, or a .prg')
    running.add_argument('--robot', default='c3_a601s', help='robot model (%(default)s)')
    running.add_argument('--controller', default='rc620', help='controller profile (%(default)s)')
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
    running.set_defaults(run=_run)
    return parser


def _run(arguments: argparse.Namespace) -> int:
    from epson_driver.cli import spel_run  # imports numpy and the whole controller

    logging.basicConfig(level=logging.WARNING, format='%(message)s')
    return spel_run.run(arguments)


def _projects(paths: list[Path]) -> list[dict[str, str]]:
    """Return the projects that are meant: each folder one, all single files together one."""
    projects = [read_project(path) for path in paths if path.is_dir()]
    single: dict[str, str] = {}
    for path in paths:
        if not path.is_dir():
            single.update(read_project(path))
    return [*projects, single] if single else projects


def _check(arguments: argparse.Namespace) -> int:
    problems: list[Problem] = []
    for files in _projects(arguments.files):
        problems += check(files, arguments.version)
    errors = sum(not problem.warning for problem in problems)
    if arguments.json:
        print(json.dumps([_as_json(problem) for problem in problems], indent=2))
    else:
        for problem in problems:
            print(problem)
        warnings = len(problems) - errors
        print(f'{errors} errors, {warnings} warnings (version {arguments.version})')
    return FOUND if errors or (arguments.strict and problems) else 0


def _as_json(problem: Problem) -> dict[str, object]:
    at = problem.position
    return {
        'file': at.file,
        'line': at.line,
        'column': at.column,
        'rule': problem.rule,
        'about': RULES.get(problem.rule, ''),
        'severity': 'warning' if problem.warning else 'error',
        'text': problem.text,
    }


def _test(arguments: argparse.Namespace) -> int:
    results: list[TestResult] = []
    for files in _projects(arguments.files):
        try:
            program = build(files)
        except ProgramError as error:
            print(error)
            return FOUND
        for result in run_tests(program, lambda name: arguments.k.lower() in name.lower()):
            results.append(result)
            _report(result)
    failed = sum(bool(result.error) for result in results)
    if arguments.junit is not None:
        arguments.junit.write_text(_junit(results), encoding='utf-8')
    if not results:
        print('no function is named Test…')
        return FOUND
    print(f'{len(results) - failed} passed, {failed} failed')
    return FOUND if failed else 0


def _report(result: TestResult) -> None:
    if not result.error:
        print(f'passed {result.name} ({result.seconds:.3f} s)')
        return
    at = result.position
    text = printable(result.error)
    print(f'FAILED {result.name}: {printable(at.file)}:{at.line}: {text}')
    for line in result.printed.splitlines():
        print(f'  {printable(line)}')


def _junit(results: list[TestResult]) -> str:
    failed = sum(bool(result.error) for result in results)
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<testsuite name="spel" tests="{len(results)}" failures="{failed}">',
    ]
    for result in results:
        at = result.position
        named = f'name={quoteattr(result.name)} file={quoteattr(printable(at.file))}'
        begun = f'  <testcase {named} line="{at.line}" time="{result.seconds:.3f}"'
        if result.error:
            message = quoteattr(printable(result.error))
            lines.append(f'{begun}><failure message={message}/></testcase>')
        else:
            lines.append(f'{begun}/>')
    return '\n'.join([*lines, '</testsuite>', ''])


if __name__ == '__main__':
    sys.exit(main())
