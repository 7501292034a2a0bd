# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Builds a program from files: read, parse, compile. All problems are reported together.

Programs are often shared without their .pts file and IOLabels.dat. A name that can only be a label
of a point or of I/O is then treated as such a label, with a warning.
"""

import re
from collections.abc import Container, Iterable, Iterator, Mapping
from itertools import chain

from epson_driver.inputs import InputError, shown
from epson_driver.spel.code import FunctionCode, Program, Variable
from epson_driver.spel.commands import COMMANDS, NOT_SIMULATED
from epson_driver.spel.compiler import Compiler
from epson_driver.spel.errors import Position, Problem, ProgramError, SyntaxProblem
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.files import without_answer
from epson_driver.spel.lexer import END, NAME, Token, tokens
from epson_driver.spel.parser import Parser, function_names, statements_of
from epson_driver.spel.preprocess import Line, Preprocessor
from epson_driver.spel.project_data import (
    IO_LABELS,
    LAST_POINT,
    POINTS,
    PROJECT,
    ProjectData,
    project_data,
)
from epson_driver.spel.scope import Scope
from epson_driver.spel.syntax import (
    Declaration,
    Declare,
    File,
    Function,
    Label,
    Parameter,
    walk,
)
from epson_driver.spel.syntax import Variable as VariableName
from epson_driver.spel.values import TYPES, size
from epson_driver.spel.words import FIRST, WORDS, reserved

_MOTIONS = frozenset(name for name, rule in COMMANDS.items() if rule.form == '@motion')
_PLACES = frozenset({'here', 'xy', 'ja', 'pulse', 'agltopls', 'curpos', 'realpos', 'pallet'})
_OF_POINTS = frozenset({'pallet', 'local'})
"""Statements whose arguments are points and numbers."""
_SIDES = frozenset({'x', 'y', 'l', 'r', 'baseu', 'outside'})
_SWITCHED = frozenset({'on', 'off', 'out', 'outw'})
_READ = frozenset({'sw', 'in', 'inw', 'oport', 'out', 'outw'})


def add_missing(
    data: ProjectData,
    files: Mapping[str, str],
    lines: Mapping[str, list[Line]],
    functions: set[str],
    notes: list[Problem],
) -> None:
    """Add labels that are undefined because the .sprj, .pts or IOLabels.dat file is missing.

    Points get the numbers 999, 998, … and no position. I/O labels are added to `data.unlabelled`.
    For each added label, `notes` gets a warning.
    """
    there = {name.lower() for name in files}
    if any(name.endswith(PROJECT) for name in there):
        return
    known = functions | data.labels.keys() | data.point_labels.keys()
    every = [line for result in lines.values() for line in result]
    known |= _declared(every)
    points = {} if any(name.endswith(POINTS) for name in there) else _points(every, known)
    bits = {} if IO_LABELS in there else _bits(every, known | points.keys())
    for number, (name, token) in enumerate(points.items()):
        data.point_labels[name], data.spelling[name] = LAST_POINT - number, token.text
        _note(notes, token, 'a point', 'there is no .pts file')
    for name, token in bits.items():
        data.unlabelled.add(name)
        _note(notes, token, 'an I/O bit', 'there is no IOLabels.dat')


def _note(notes: list[Problem], token: Token, kind: str, why: str) -> None:
    text = f'{token.text} is treated as the label of {kind}: {why}'
    notes.append(Problem(token.position, 'project-file', text, warning=True))


def _declared(lines: Iterable[Line]) -> set[str]:
    """Return the names in all lines that contain a type. Such a line may be a declaration."""
    result: set[str] = set()
    for line in lines:
        if any(token.lower in TYPES for token in line.tokens):
            result |= {token.lower for token in line.tokens if token.kind == NAME}
    return result


def _is_free(token: Token, known: set[str]) -> bool:
    name = token.lower
    return (
        token.kind == NAME
        and not reserved(name)
        and not is_point_literal(name)
        and name not in known
        and (name[:1] != 'p' or name[1:] not in known)  # Pctr: P(ctr), p345
    )


def _points(lines: Iterable[Line], known: set[str]) -> dict[str, Token]:
    result: dict[str, Token] = {}
    for line in lines:
        for first, second, third in _threes(line):
            word = first.lower
            moved = word in _MOTIONS and third.text != '('
            placed = second.text == '=' and third.lower in _PLACES
            for token in ([second] if moved else []) + ([first] if placed else []):
                if _is_free(token, known):
                    result.setdefault(token.lower, token)
        if line.tokens and line.tokens[0].lower in _OF_POINTS:
            for token in line.tokens[1:]:
                if token.lower not in _SIDES and _is_free(token, known):
                    result.setdefault(token.lower, token)
    return result


def _bits(lines: Iterable[Line], known: set[str]) -> dict[str, Token]:
    result: dict[str, Token] = {}
    for line in lines:
        for first, second, third in _threes(line):
            if first.lower in _READ and second.text == '(':
                token = third
            elif first.lower in _SWITCHED and third.text in ('', ',', ';', '!'):
                token = second
            else:
                continue
            if _is_free(token, known):
                result.setdefault(token.lower, token)
    return result


def _threes(line: Line) -> Iterable[tuple[Token, Token, Token]]:
    if not line.tokens:
        return ()
    end = Token(END, '', '', line.tokens[-1].position)
    padded = (*line.tokens, end, end)
    return zip(padded, padded[1:], padded[2:], strict=False)


MAX_ELEMENTS = 2_000_000
"""Maximum number of elements in all shared arrays together."""

MAX_TEXT = 50_000
"""Maximum number of characters of Python text in one compilation. Each character needs about 150
bytes of memory."""

OFF = "'"
"""Prefix that turns a #define line into a comment."""

COMMAND = '$Execute'
"""Name of the file, and of the function, that contain a command of the command window."""

_DEFINE = re.compile(r"\s*'?#define\s+([A-Za-z]\w*)(?:\s+(.*))?$")


def with_defines(files: Mapping[str, str], values: Mapping[str, str]) -> dict[str, str]:
    """Return the files with other values in their #define lines.

    The value '' disables a line by a leading '. Any other value enables a line that is disabled in
    this way. Raises InputError if no file defines a name, or if a value is not printable.
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


TESTS = r'test\w*'
"""Pattern of the names of test functions."""


def with_setup(files: Mapping[str, str], statements: str, functions: str) -> dict[str, str]:
    """Return the files with statements added at the start of functions without parameters.

    `functions`: the pattern of the names of these functions, such as main, or `TESTS`.
    """
    start = rf'(?im)^[ \t]*function[ \t]+(?:{functions})\b(?:[ \t]*\([ \t]*\)|(?![ \t]*\())'
    return {
        name: re.sub(start, lambda found: f'{found[0]}; {statements}', text)
        if name.lower().endswith('.prg')
        else text
        for name, text in files.items()
    }


Parsed = dict[str, tuple[object, File, list[Problem]]]
"""The files that the last check parsed: name → what the result depends on, result, problems."""


def _parse(
    files: Mapping[str, str],
    problems: list[Problem],
    notes: list[Problem],
    data: ProjectData,
    parsed: Parsed,
) -> list[File]:
    lines: dict[str, list[Line]] = {}
    for name in files:
        if name.lower().endswith('.prg'):
            lines[name] = list(Preprocessor(files, problems).lines(name))
    names = {item for result in lines.values() for item in function_names(result)}
    add_missing(data, files, lines, names, notes)
    notes += _joined_types(lines.values())
    labels = data.point_labels
    for name, result in lines.items():
        key = result, names, labels
        if name not in parsed or parsed[name][0] != key:
            own: list[Problem] = []
            parsed[name] = key, Parser(name, result, names, own, labels).file(), own
        problems += parsed[name][2]
    return [parsed[name][1] for name in lines]


def _joined_types(files: Iterable[list[Line]]) -> Iterator[Problem]:
    """Yield a warning for each `AsInteger`, which RC+ accepts, but the manual does not list."""
    for line in (item for result in files for item in result):
        if line.tokens and line.tokens[0].lower == 'function':
            for token in line.tokens[2:]:
                if token.lower[:2] == 'as' and token.lower[2:] in TYPES:
                    message = f'{token.text}: write As {token.text[2:]}'
                    yield Problem(token.position, 'syntax', message, warning=True)


def build(files: Mapping[str, str]) -> Program:
    problems: list[Problem] = []
    program = build_with(files, problems)
    if problems:
        raise ProgramError(sorted(set(problems), key=lambda each: each.position))
    return program


def build_with(
    files: Mapping[str, str],
    problems: list[Problem],
    notes: list[Problem] | None = None,
    cache: Parsed | None = None,
) -> Program:
    """Build a program as far as possible.

    Errors are added to `problems`, and warnings to `notes`. `cache`: see `Parsed`.
    """
    notes = [] if notes is None else notes
    data = project_data(files, problems)
    parsed = _parse(files, problems, notes, data, {} if cache is None else cache)
    problems.extend(problem for file in parsed for problem in reserved_names(file, FIRST))
    functions: dict[str, Function] = {}
    libraries: dict[str, tuple[int, Declare]] = {}
    declared: list[Declare] = []
    for file in parsed:
        for function in file.functions:
            key = function.name.lower()
            if key in functions:
                first = functions[key].at
                text = f'function {function.name} is also defined in {first.file}:{first.line}'
                problems.append(Problem(function.at, 'declaration', text))
                continue
            functions[key] = function
        for item in file.declared:
            libraries.setdefault(item.name.lower(), (len(declared), item))
            declared.append(item)
    codes = {
        key: FunctionCode(
            function.name, index, function.parameters, function.result, function.at, function.end
        )
        for index, (key, function) in enumerate(functions.items())
    }
    shared: dict[str, Variable] = {}
    variables: list[Variable] = []
    outer = Scope(shared, functions, libraries, data)
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
    if total > MAX_ELEMENTS:
        text = f'the shared arrays have {total} elements, at most {MAX_ELEMENTS} are simulated'
        problems.append(Problem(variables[-1].at, 'array-size', text))
        variables.clear()
    for file, scope in scopes:
        for function in file.functions:
            if functions[function.name.lower()] is function:
                Compiler(function, scope.for_function(), codes, problems, notes).compile()
    portions = ['']
    for text in (text for code in codes.values() for text in code.source):
        if len(portions[-1]) > MAX_TEXT:
            portions.append('')
        portions[-1] += text
    source = tuple(portions)
    return Program(list(codes.values()), codes, variables, declared, parsed, source, data, shared)


def command(program: Program, text: str, answered: Container[str] = ()) -> FunctionCode:
    """Compile statements of the command window. Raises ProgramError if they are invalid.

    The statements may use the Global variables of the program. An unterminated string ends with
    `text`. A word that is not simulated is refused, unless it is in `answered`.
    """
    at = Position(COMMAND, 1)
    problems: list[Problem] = []
    try:
        match = tokens(text + '"' * (text.count('"') % 2), COMMAND, 1)
        for token in match:
            if token.lower in NOT_SIMULATED and token.lower not in answered:
                text = without_answer(token.text)
                raise SyntaxProblem(token.position, text, 'not-simulated')
        line = Line(at, tuple(match))
        for part in statements_of(line):
            word = WORDS.get(part[0].lower) if part else None
            if word is not None and not word.window:
                message = f'{word.name} is for programs only: the command window does not take it'
                problems.append(Problem(part[0].position, 'syntax', message))
    except SyntaxProblem as problem:
        raise ProgramError([problem.problem]) from problem
    before, name, after = (
        Token(NAME, word, word.lower(), at) for word in ('Function', COMMAND, 'Fend')
    )
    lines = [Line(at, (before, name)), line, Line(at, (after,))]
    file = Parser(COMMAND, lines, set(program.by_name), problems, program.data.point_labels).file()
    if problems:
        raise ProgramError(problems)
    (function,) = file.functions
    functions = {item.name.lower(): item for of in program.files for item in of.functions}
    libraries = {item.name.lower(): (at, item) for at, item in enumerate(program.libraries)}
    scope = Scope(program.shared, functions, libraries, program.data)
    code = FunctionCode(COMMAND, len(program.functions), (), function.result, at, at)
    codes = {**program.by_name, COMMAND.lower(): code}
    Compiler(function, scope.for_function(), codes, problems, []).compile()
    if problems:
        raise ProgramError(problems)
    return code


def reserved_names(file: File, version: tuple[int, ...]) -> Iterator[Problem]:
    inner = [(of, *of.parameters, *of.of(VariableName, Label)) for of in file.functions]
    for node in chain(*inner, walk(file.declarations)):
        if not isinstance(node, Function | Parameter | VariableName | Label):
            continue
        if reserved(node.name, version):
            what = type(node).__name__.lower()
            text = f'{node.name} is a reserved word of SPEL+: it cannot name a {what}'
            yield Problem(node.at, 'reserved', text)


def _declare(
    declaration: Declaration,
    scope: Scope,
    shared: dict[str, Variable],
    module: dict[str, Variable],
    variables: list[Variable],
) -> None:
    within = module if declaration.scope == 'module' else shared
    for number, item in enumerate(declaration.variables):
        bounds = scope.bounds(declaration, number)
        key = item.name.lower()
        variable = Variable(
            item.name,
            declaration.type,
            'g',
            len(variables),
            bounds,
            bool(bounds),
            preserved=declaration.scope == 'preserve',
            at=item.at,
        )
        known = within.get(key)
        if known is not None:
            same = TYPES[known.type] == TYPES[variable.type] and known.bounds == bounds
            if within is module or not same or known.preserved != variable.preserved:
                first = known.at
                text = f'{item.name} is declared in {first.file}:{first.line} already'
                text += '' if within is module else ', differently'
                raise SyntaxProblem(item.at, text, 'declaration')
            continue
        within[key] = variable
        variables.append(variable)
