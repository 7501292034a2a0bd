# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Files to a program: read, parse, compile. All that is wrong with it is said at once."""

import re
from collections.abc import Mapping
from pathlib import Path

from epson_driver.inputs import InputError, printable, read_file, shown
from epson_driver.spel.code import FunctionCode, Program, Variable
from epson_driver.spel.compiler import Compiler
from epson_driver.spel.errors import Position, Problem, ProgramError, SyntaxProblem
from epson_driver.spel.parser import Parser, function_names
from epson_driver.spel.preprocess import Line, Preprocessor
from epson_driver.spel.scope import Scope
from epson_driver.spel.syntax import Declaration, Declare, File, Function
from epson_driver.spel.values import TYPES, size

LARGEST_FILE = 5_000_000
"""Bytes."""

MOST_ELEMENTS = 2_000_000
"""Of all shared arrays together."""

OFF = "'"
"""In front of a #define line: it is a comment."""

_DEFINE = re.compile(r"\s*'?#define\s+([A-Za-z]\w*)(?:\s+(.*))?$")
_ENDINGS = ('.prg', '.inc')
_USER_ERRORS = 'UserErrors.dat'


def read_project(path: Path) -> dict[str, str]:
    """Return the texts of a project by file name: a folder, or one .prg with its includes.

    Raises InputError for what cannot be read.
    """
    folder = path if path.is_dir() else path.parent
    files: dict[str, str] = {}
    for each in sorted(folder.iterdir() if folder.is_dir() else []):
        wanted = each.suffix.lower() in _ENDINGS or each.name.lower() == _USER_ERRORS.lower()
        wanted = wanted and (path.is_dir() or each.suffix.lower() != '.prg')
        if wanted and each.is_file():
            files[each.name] = decoded(read_file(each, LARGEST_FILE))
    if not path.is_dir():
        files[path.name] = decoded(read_file(path, LARGEST_FILE))
    if not any(name.lower().endswith('.prg') for name in files):
        raise InputError(f'{printable(path)}: has no .prg file')
    return files


def decoded(content: bytes) -> str:
    """Return a text: UTF-8, or byte by byte where it is not."""
    try:
        text = content.decode('utf-8-sig')
    except UnicodeDecodeError:
        text = content.decode('latin-1')
    return text.replace('\r\n', '\n').replace('\r', '\n')


def with_defines(files: Mapping[str, str], values: Mapping[str, str]) -> dict[str, str]:
    """Return the files with other values in their #define lines; an empty value turns one off.

    A line that is turned off by a ' in front is turned on. Raises InputError for a name that no
    file has such a line for, and a value that is more than one line.
    """
    left = dict(values)
    changed = {}
    for name, text in files.items():
        lines = text.split('\n')
        for number, line in enumerate(lines):
            match = _DEFINE.match(line)
            if match is None or match[1] not in values:
                continue
            value = values[match[1]].strip()
            if not value.isprintable():
                raise InputError(f'#define {match[1]} = {shown(value)}: must be printable')
            left.pop(match[1], None)
            lines[number] = f'{"" if value else OFF}#define {match[1]} {value or match[2]}'
        changed[name] = '\n'.join(lines)
    if left:
        named = ', '.join(shown(name) for name in left)
        raise InputError(f'no file of the project has a line #define {named}')
    return changed


def parse(files: Mapping[str, str], problems: list[Problem]) -> list[File]:
    """Return the .prg files as they are written; what cannot be read goes to the list."""
    lines: dict[str, list[Line]] = {}
    for name in files:
        if name.lower().endswith('.prg'):
            lines[name] = list(Preprocessor(files, problems).lines(name))
    names = {each for found in lines.values() for each in function_names(found)}
    return [Parser(name, found, names, problems).file() for name, found in lines.items()]


def build(files: Mapping[str, str]) -> Program:
    """Return the program of a project's files. Raises ProgramError with all that is wrong."""
    problems: list[Problem] = []
    program = build_with(files, problems)
    if problems:
        raise ProgramError(sorted(set(problems), key=lambda each: each.position))
    return program


def build_with(
    files: Mapping[str, str], problems: list[Problem], notes: list[Problem] | None = None
) -> Program:
    """Return the program as far as it can be made; what is wrong goes to the lists."""
    notes = [] if notes is None else notes
    parsed = parse(files, problems)
    functions: dict[str, Function] = {}
    libraries: dict[str, tuple[int, Declare]] = {}
    declared: list[Declare] = []
    for file in parsed:
        for function in file.functions:
            key = function.name.lower()
            if key in functions:
                first = functions[key].at
                text = f'function {function.name} stands in {first.file}:{first.line} too'
                problems.append(Problem(function.at, 'declaration', text))
                continue
            functions[key] = function
        for each in file.declared:
            libraries.setdefault(each.name.lower(), (len(declared), each))
            declared.append(each)
    codes = {
        key: FunctionCode(
            function.name, index, function.parameters, function.result, function.at, function.end
        )
        for index, (key, function) in enumerate(functions.items())
    }
    labels, texts = _user_errors(files, problems)
    shared: dict[str, Variable] = {}
    variables: list[Variable] = []
    outer = Scope(shared, functions, libraries, labels)
    scopes = []
    for file in parsed:
        module: dict[str, Variable] = {}
        scope = outer.for_file(module)
        scopes.append((file, scope))
        for declaration in file.declarations:
            try:
                _declare(declaration, scope, shared, module, variables)
            except SyntaxProblem as problem:
                problems.append(problem.problem)
    total = sum(size(variable.bounds) for variable in variables)
    if total > MOST_ELEMENTS:
        text = f'the shared arrays have {total} elements, at most {MOST_ELEMENTS} are simulated'
        problems.append(Problem(variables[-1].at, 'array-size', text))
        variables.clear()
    for file, scope in scopes:
        for function in file.functions:
            if functions[function.name.lower()] is function:
                Compiler(function, scope.for_function(), codes, problems, notes).compile()
    source = ''.join(text for code in codes.values() for text in code.source)
    return Program(list(codes.values()), codes, variables, declared, parsed, source, texts)


def _declare(
    declaration: Declaration,
    scope: Scope,
    shared: dict[str, Variable],
    module: dict[str, Variable],
    variables: list[Variable],
) -> None:
    within = module if declaration.scope == 'module' else shared
    for number, each in enumerate(declaration.variables):
        bounds = scope.bounds(declaration, number)
        key = each.name.lower()
        variable = Variable(
            each.name,
            declaration.type,
            'g',
            len(variables),
            bounds,
            bool(bounds),
            preserved=declaration.scope == 'preserve',
            at=each.at,
        )
        known = within.get(key)
        if known is not None:
            same = TYPES[known.type] == TYPES[variable.type] and known.bounds == bounds
            if within is module or not same or known.preserved != variable.preserved:
                first = known.at
                text = f'{each.name} is declared in {first.file}:{first.line} already'
                text += '' if within is module else ', differently'
                raise SyntaxProblem(each.at, text, 'declaration')
            continue
        within[key] = variable
        variables.append(variable)


def _user_errors(
    files: Mapping[str, str], problems: list[Problem]
) -> tuple[dict[str, int], dict[int, str]]:
    """Return labels and messages of UserErrors.dat: nError, sLabel and sMessage lines."""
    labels: dict[str, int] = {}
    texts: dict[int, str] = {}
    found = [name for name in files if name.lower() == _USER_ERRORS.lower()]
    number = 0
    for line_number, line in enumerate(files[found[0]].split('\n') if found else [], 1):
        match = re.match(r'\s*(nError|sLabel|sMessage)\w*\s*=\s*"?([^"]*)"?', line, re.IGNORECASE)
        if match is None:
            continue
        word, value = match[1].lower(), match[2].strip()
        if word == 'nerror':
            if not re.fullmatch('[0-9]{1,5}', value):
                text = f'{value[:40]!r} is not an error number'
                problems.append(Problem(Position(found[0], line_number), 'user-errors', text))
                continue
            number = int(value)
        elif word == 'slabel' and value:
            labels[value.lower()] = number
        elif value:
            texts[number] = value
    return labels, texts
