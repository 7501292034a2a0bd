# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Exit code and output formats of `spel check`: text, and the formats of CI tools."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

from epson_driver.inputs import printable
from epson_driver.spel import Problem
from epson_driver.spel.lint import RULES

FOUND = 1
"""Exit code for a program with problems or failed tests."""


def path_from_here(folder: Path, name: str) -> str:
    """Return the path of a file in `folder`, relative to the current folder if it is inside."""
    path = folder / name
    here = Path.cwd()
    if path.is_absolute() and path.is_relative_to(here):
        path = path.relative_to(here)
    return path.as_posix()


def placed(problems: Sequence[Problem], folder: Path) -> list[Problem]:
    """Return the problems of a program in `folder`, with the file paths of `path_from_here`."""
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
    """Return GitHub workflow commands, which make GitHub show each problem at its line."""
    return ''.join(
        f'::{_level(problem)} file={_escaped(problem.position.file)},line={problem.position.line},'
        f'col={problem.position.column},title={problem.rule}::{_escaped(problem.text, "%")}\n'
        for problem in problems
    )


def _sarif(problems: Sequence[Problem]) -> str:
    """Return SARIF 2.1.0, the input of code scanning tools."""
    used = sorted({problem.rule for problem in problems})
    results = [
        {
            'ruleId': problem.rule,
            'level': _level(problem),
            'message': {'text': problem.text},
            'locations': [
                {
                    'physicalLocation': {
                        'artifactLocation': {'uri': quote(problem.position.file)},
                        'region': {
                            'startLine': problem.position.line,
                            'startColumn': problem.position.column,
                        },
                    }
                }
            ],
        }
        for problem in problems
    ]
    rules = [{'id': rule, 'shortDescription': {'text': RULES.get(rule, rule)}} for rule in used]
    tool = {'driver': {'name': 'epson_driver spel check', 'rules': rules}}
    return (
        json.dumps(
            {
                '$schema': 'https://json.schemastore.org/sarif-2.1.0.json',
                'version': '2.1.0',
                'runs': [{'tool': tool, 'results': results}],
            },
            indent=2,
        )
        + '\n'
    )


FORMATS: dict[str, Callable[[Sequence[Problem]], str]] = {
    'text': _text,
    'json': _json,
    'github': _github,
    'sarif': _sarif,
}
"""The functions that format problems, by the values of --format."""
