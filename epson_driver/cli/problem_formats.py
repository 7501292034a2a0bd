# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Exit code and output formats of `spel check`: plain text, and the formats of CI tools."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from epson_driver.inputs import printable
from epson_driver.spel import Problem
from epson_driver.spel.lint import RULES

FOUND = 1
"""Exit code if a program has problems, or if tests have failed."""


def path_from_here(folder: Path, name: str) -> str:
    """Return the path of a file in `folder`, for messages.

    A path inside the current folder is relative.
    """
    path = folder / name
    here = Path.cwd()
    if path.is_absolute() and path.is_relative_to(here):
        path = path.relative_to(here)
    return path.as_posix()


def placed(problems: Sequence[Problem], folder: Path) -> list[Problem]:
    return [
        replace(problem, position=position._replace(file=path_from_here(folder, position.file)))
        for problem in problems
        for position in [problem.position]
    ]


def _level(problem: Problem) -> str:
    return 'warning' if problem.warning else 'error'


def _text(problems: Sequence[Problem]) -> str:
    return ''.join(f'{problem}\n' for problem in problems)


def _json(problems: Sequence[Problem]) -> str:
    result = [
        {
            'file': problem.position.file,
            'line': problem.position.line,
            'column': problem.position.column,
            'rule': problem.rule,
            'about': RULES.get(problem.rule, ''),
            'severity': _level(problem),
            'text': problem.text,
        }
        for problem in problems
    ]
    return json.dumps(result, indent=2) + '\n'


def _escaped(text: str, signs: str = '%:,') -> str:
    for sign in signs:
        text = text.replace(sign, f'%{ord(sign):02X}')
    return printable(text)


def _github(problems: Sequence[Problem]) -> str:
    return ''.join(
        f'::{_level(problem)} file={_escaped(problem.position.file)},line={problem.position.line},'
        f'col={problem.position.column},title={problem.rule}::{_escaped(problem.text, "%")}\n'
        for problem in problems
    )


FORMATS: dict[str, Callable[[Sequence[Problem]], str]] = {
    'text': _text,
    'json': _json,
    'github': _github,
}
