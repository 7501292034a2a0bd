# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Converts text lines to token lines: #define, #undef, #ifdef, #ifndef, #else, #endif, #include.

A definition is valid from its line to the end of the program file, also in files included there.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from epson_driver.inputs import printable
from epson_driver.spel.errors import Position, Problem, SyntaxProblem
from epson_driver.spel.lexer import NAME, SYMBOL, Token, tokens
from epson_driver.spel.values import TYPES

DEEPEST_INCLUDE = 16
MAX_PARAMETERS = 8
MAX_TOKENS = 20_000
"""Maximum number of tokens in one line during macro expansion."""
DEEPEST_DEFINITION = 50
MAX_LINES = 200_000
"""Maximum number of lines in one file, including its included files."""

_SCOPES = frozenset({'global', 'preserve', 'static'})
_DECLARES = _SCOPES | TYPES.keys()

line_tokens = lru_cache(maxsize=50_000)(tokens)
"""Returns the tokens of a program's line. They are stored, because many programs include the same
file, and an editor changes one line. Lines of other origin would fill the memory."""

_DIRECTIVE = re.compile(r'\s*#\s*([A-Za-z]+)')
_DIRECTIVES = ('define', 'undef', 'ifdef', 'ifndef', 'else', 'endif', 'include')


@dataclass(frozen=True)
class Definition:
    """A `#define`: the tokens that replace the name, and the parameters, if any."""

    parameters: tuple[str, ...] | None
    body: tuple[Token, ...]


@dataclass(frozen=True)
class Line:
    position: Position
    tokens: tuple[Token, ...]


@dataclass
class _Condition:
    position: Position
    active: bool
    outer: bool
    turned: bool = False


class Preprocessor:
    def __init__(self, files: Mapping[str, str], problems: list[Problem]) -> None:
        self._files = {name.lower(): (name, text) for name, text in files.items()}
        self._problems = problems
        self.definitions: dict[str, Definition] = {}
        self._count = 0
        self._steps = 0

    def lines(self, name: str) -> Iterator[Line]:
        yield from self._lines(name.lower(), 0)

    def _lines(self, key: str, depth: int) -> Iterator[Line]:
        name, text = self._files[key]
        conditions: list[_Condition] = []
        for number, line in enumerate(text.split('\n'), 1):
            self._count += 1
            if self._count > MAX_LINES:
                where = Position(name, number)
                self._problems.append(
                    Problem(where, 'include', f'the program has more than {MAX_LINES} lines')
                )
                return
            try:
                yield from self._line(name, number, line, conditions, depth)
            except SyntaxProblem as problem:
                self._problems.append(problem.problem)
        for condition in conditions:
            text = 'the #ifdef or #ifndef has no #endif'
            self._problems.append(Problem(condition.position, 'preprocessor', text))

    def _line(
        self, name: str, number: int, line: str, conditions: list[_Condition], depth: int
    ) -> Iterator[Line]:
        active = not conditions or conditions[-1].active
        directive = _DIRECTIVE.match(line)
        if directive is not None:
            position = Position(name, number, directive.start(1))
            word = directive[1].lower()
            if word not in _DIRECTIVES:
                if not active:
                    return
                raise SyntaxProblem(position, f'unknown directive #{directive[1]}', 'preprocessor')
            if word in ('ifdef', 'ifndef', 'else', 'endif'):
                self._conditional(word, position, line[directive.end() :], conditions)
            elif active and word == 'include':
                yield from self._include(position, line[directive.end() :], depth)
            elif active:
                rest = line_tokens(line[directive.end() :], name, number, directive.end() + 1)
                self._define(word, position, rest)
            return
        if not active:
            return
        result = line_tokens(line, name, number)
        self._refuse_declarations(result)
        if result:
            yield Line(result[0].position, tuple(self._expanded(result)))

    def _refuse_declarations(self, found: Sequence[Token]) -> None:
        """Raise SyntaxProblem if a macro is used as a label, or expands to a declaration."""
        start = True
        for place, token in enumerate(found):
            definition = self.definitions.get(token.lower) if start else None
            if definition is not None and definition.body:
                label = [item.text for item in found[place + 1 : place + 2]] == [':']
                if label or definition.body[0].lower in _DECLARES:
                    what = 'label' if label else 'declaration'
                    text = f'{token.text} is a #define: it cannot make a {what} (p58)'
                    raise SyntaxProblem(token.position, text, 'preprocessor')
            start = token.text == ';' or (start and token.lower in _SCOPES)

    def _conditional(
        self, word: str, position: Position, rest: str, conditions: list[_Condition]
    ) -> None:
        if word in ('ifdef', 'ifndef'):
            named = line_tokens(rest, position.file, position.line)
            if not named or named[0].kind != NAME:
                raise SyntaxProblem(position, f'#{word} needs a name', 'preprocessor')
            outer = not conditions or conditions[-1].active
            holds = (named[0].lower in self.definitions) == (word == 'ifdef')
            conditions.append(_Condition(position, outer and holds, outer))
            return
        if not conditions:
            raise SyntaxProblem(position, f'#{word} without #ifdef', 'preprocessor')
        if word == 'endif':
            conditions.pop()
            return
        condition = conditions[-1]
        if condition.turned:
            raise SyntaxProblem(position, 'a second #else', 'preprocessor')
        condition.turned = True
        condition.active = condition.outer and not condition.active

    def _include(self, position: Position, rest: str, depth: int) -> Iterator[Line]:
        named = re.match(r'\s*"([^"]*)"\s*(\'.*)?\s*\Z', rest)
        if named is None:
            raise SyntaxProblem(position, '#include needs a file name in quotes', 'include')
        if named[1].lower() not in self._files:
            text = f'#include: no file {printable(named[1])} in the project'
            raise SyntaxProblem(position, text, 'include')
        if depth >= DEEPEST_INCLUDE:
            raise SyntaxProblem(position, 'files include each other endlessly', 'include')
        yield from self._lines(named[1].lower(), depth + 1)

    def _define(self, word: str, position: Position, rest: Sequence[Token]) -> None:
        if not rest or rest[0].kind != NAME:
            raise SyntaxProblem(position, f'#{word} needs a name', 'preprocessor')
        name, rest = rest[0], rest[1:]
        if word == 'undef':
            self.definitions.pop(name.lower, None)
            return
        parameters: tuple[str, ...] | None = None
        end = name.position.column + len(name.text)
        if rest and rest[0].text == '(' and rest[0].position.column == end:
            closing = next((i for i, element in enumerate(rest) if element.text == ')'), None)
            if closing is None:
                raise SyntaxProblem(position, '#define: the parameters lack a )', 'preprocessor')
            inner, rest = rest[1:closing], rest[closing + 1 :]
            names, commas = inner[::2], inner[1::2]
            wrong = any(item.kind != NAME for item in names)
            wrong = wrong or any(comma.text != ',' for comma in commas)
            if wrong or (inner and len(inner) % 2 == 0) or len(names) > MAX_PARAMETERS:
                text = f'#define takes at most {MAX_PARAMETERS} names as parameters'
                raise SyntaxProblem(position, text, 'preprocessor')
            parameters = tuple(item.lower for item in names)
        self.definitions[name.lower] = Definition(parameters, tuple(rest))

    def _expanded(self, found: Sequence[Token]) -> Sequence[Token]:
        if not any(token.lower in self.definitions for token in found):
            return found
        result: list[Token] = []
        self._steps = 0
        self._expand(found, result, frozenset())
        return result

    def _expand(self, found: Sequence[Token], into: list[Token], hidden: frozenset[str]) -> None:
        at = 0
        while at < len(found):
            token = found[at]
            at += 1
            self._steps += 1
            if self._steps > MAX_TOKENS or len(hidden) > DEEPEST_DEFINITION:
                text = 'the #defines make the line too long'
                raise SyntaxProblem(token.position, text, 'preprocessor')
            definition = self.definitions.get(token.lower) if token.kind == NAME else None
            if definition is None or token.lower in hidden:
                into.append(token)
                continue
            body = [t._replace(position=token.position) for t in definition.body]
            if definition.parameters is not None:
                arguments, at = _arguments(found, at, token, len(definition.parameters))
                named = dict(zip(definition.parameters, arguments, strict=True))
                body = [item for t in body for item in named.get(t.lower, [t])]
            self._expand(body, into, hidden | {token.lower})


def _arguments(
    found: Sequence[Token], at: int, name: Token, count: int
) -> tuple[list[list[Token]], int]:
    """Return a macro call's arguments, and the index of the token that follows them."""
    problem = SyntaxProblem(name.position, f'{name.text} needs {count} arguments in ( )')
    if at >= len(found) or found[at].text != '(':
        raise problem
    arguments: list[list[Token]] = [[]]
    depth = 1
    at += 1
    while at < len(found):
        token = found[at]
        at += 1
        if token.kind == SYMBOL and token.text in '()':
            depth += 1 if token.text == '(' else -1
            if depth == 0:
                if count == 0 and arguments == [[]]:
                    return [], at
                if len(arguments) != count:
                    raise problem
                return arguments, at
        if token.text == ',' and depth == 1:
            arguments.append([])
        else:
            arguments[-1].append(token)
    raise problem
