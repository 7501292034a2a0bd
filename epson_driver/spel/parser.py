# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parses lines of tokens to functions and declarations by recursive descent.

Each form of a statement has one method. An invalid statement is recorded as a problem, and parsing
continues with the next line, so one run reports all problems.
"""

from collections.abc import Container, Iterable, Iterator

from epson_driver.inputs import near_name
from epson_driver.spel.commands import (
    COMMANDS,
    DISPLAYING,
    DISPLAYING_ONE,
    KEYWORDS,
    SHOWN,
    SHOWN_IN_LOW_POWER,
    TASK_TYPE_WORDS,
    TYPES,
)
from epson_driver.spel.errors import Position, Problem, SyntaxProblem
from epson_driver.spel.expressions import SAME, Reader, is_point_literal
from epson_driver.spel.lexer import NAME, STRING, Token
from epson_driver.spel.preprocess import Line
from epson_driver.spel.statements import Statements, coordinates
from epson_driver.spel.syntax import (
    Apply,
    Argument,
    Assign,
    Binary,
    Block,
    Call,
    CaseItem,
    Declaration,
    Declare,
    Do,
    Exit,
    Expression,
    File,
    For,
    Function,
    If,
    Label,
    Name,
    Number,
    Parameter,
    Print,
    Select,
    Statement,
    Test,
    Text,
    Variable,
)
from epson_driver.spel.words import CONSTANTS, is_a

DEEPEST_BLOCK = 30
"""Maximum nesting of blocks. SPEL+ allows 10 nested For."""

_ENDS = {
    'else': 'If',
    'elseif': 'If',
    'endif': 'If',
    'case': 'Select',
    'default': 'Select',
    'send': 'Select',
    'loop': 'Do',
    'next': 'For',
}
_CLOSING = {'If': 'EndIf', 'Select': 'Send', 'Do': 'Loop', 'For': 'Next'}

_NAMES = [rule.name for rule in COMMANDS.values()]


def function_names(lines: Iterable[Line]) -> set[str]:
    names = set()
    for line in lines:
        if len(line.tokens) > 1 and line.tokens[0].lower in ('function', 'declare'):
            names.add(line.tokens[1].lower)
    return names


def statements_of(line: Line) -> Iterator[list[Token]]:
    """Yield the statements of a line. Parallel statements (`!…!`) stay with their motion."""
    part: list[Token] = []
    parallel = False
    for token in line.tokens:
        if token.text == '!':
            parallel = not parallel
        if token.text == ';' and not parallel:
            yield part
            part = []
        else:
            part.append(token)
    yield part


class Parser(Statements):
    """Parses one file. `points`: the labels of points, in lower case."""

    def __init__(
        self,
        name: str,
        lines: list[Line],
        functions: set[str],
        problems: list[Problem],
        points: Container[str] = frozenset(),
    ) -> None:
        super().__init__(functions, points)
        self._file = File(name, marks=self.marks)
        self._problems = problems
        self._lines = lines
        self._line = 0
        self._queue: list[list[Token]] = []
        self._depth = 0
        self._end = Position(name, 1)
        self._function: str | None = None

    def file(self) -> File:
        while (result := self._take()) is not None:
            try:
                self._outside(result)
            except SyntaxProblem as problem:
                self._refuse(problem)
                if result[0].lower == 'function':
                    self._skip_function()
        return self._file

    def _skip_function(self) -> None:
        while (result := self._peek()) is not None and result[0].lower != 'function':
            self._take()
            if result[0].lower == 'fend':
                return

    # Lines and statements

    def _reader(self, found: list[Token]) -> Reader:
        return Reader(found, found[0].position, self._points)

    def _peek(self) -> list[Token] | None:
        while not self._queue and self._line < len(self._lines):
            line = self._lines[self._line]
            self._line += 1
            self._queue = [part for part in statements_of(line) if part]
            self._end = line.position
        return self._queue[0] if self._queue else None

    def _take(self) -> list[Token] | None:
        result = self._peek()
        if result is not None:
            self._queue.pop(0)
        return result

    def _rest_of_line(self) -> list[list[Token]]:
        rest, self._queue = self._queue, []
        return rest

    def _refuse(self, problem: SyntaxProblem) -> None:
        self._problems.append(problem.problem)
        if not self._queue or self._queue[0][0].lower not in ('fend', 'function'):
            self._queue = []

    # Outside functions

    def _outside(self, found: list[Token]) -> None:
        reader = self._reader(found)
        word = found[0].lower
        if word == 'function':
            self._file.functions.append(self._read_function(reader))
        elif word == 'declare':
            self._file.declared.append(self._declare(reader))
        elif word in ('global', 'static') or word in TYPES:
            self._file.declarations.append(declaration(reader, 'module'))
        else:
            text = f'{found[0].text} outside a function: only declarations are allowed there'
            raise SyntaxProblem(found[0].position, text)

    def _declare(self, reader: Reader) -> Declare:
        at = reader.step().position
        name = reader.name('the name of the function')
        reader.need(',')
        texts = []
        while True:
            token = reader.step()
            if token.kind != STRING:
                raise SyntaxProblem(token.position, 'Declare needs the name of a DLL in quotes')
            texts.append(str(token.value))
            if not reader.takes(',') or reader.sees('(', 'as'):
                break
        parameters = _parameters(reader) if reader.takes('(') else ()
        result = 'long'
        if reader.takes('as'):
            result = _type(reader)
        else:
            self._mark('`Declare f, "a.dll"`', at)
        if result == 'string':
            raise SyntaxProblem(
                at, 'a function of a DLL cannot return a String: pass one ByRef', 'type'
            )
        reader.end()
        alias = texts[1] if len(texts) > 1 else name.text
        return Declare(name.text, texts[0], alias, parameters, result, at)

    def _read_function(self, reader: Reader) -> Function:
        at = reader.step().position
        name = reader.name('the name of the function')
        _check_name(name, 'function')
        parameters: tuple[Parameter, ...] = ()
        if reader.takes('('):
            parameters = _parameters(reader)
        result = 'string' if name.text.endswith('$') else ''
        if reader.takes('as'):
            result = _type(reader)
        reader.end()
        self._function = name.text
        body = self._block(())
        end = self._end
        closing = self._take()
        if closing is None or closing[0].lower != 'fend':
            where = at if closing is None else closing[0].position
            if closing is not None:
                self._queue.insert(0, closing)
            text = f'function {name.text} (line {at.line}) has no Fend'
            raise SyntaxProblem(where, text)
        return Function(name.text, parameters, result, body, at, end)

    # Blocks

    def _block(self, ends: tuple[str, ...]) -> Block:
        """Parse statements until a word in `ends`, or until the end of the function.

        The word itself is not read.
        """
        self._depth += 1
        read: list[Statement] = []
        while (result := self._peek()) is not None:
            word = result[0].lower
            if word in ends or word in ('fend', 'function'):
                break
            self._take()
            try:
                if self._depth > DEEPEST_BLOCK:
                    raise SyntaxProblem(result[0].position, 'blocks are nested too deeply')
                if word in _ENDS:
                    text = f'{result[0].text} without {_ENDS[word]}'
                    raise SyntaxProblem(result[0].position, text)
                read.extend(self._statement(result))
            except SyntaxProblem as problem:
                self._refuse(problem)
        self._depth -= 1
        return tuple(read)

    def _closing(self, kind: str, at: Position, *words: str) -> Reader:
        result = self._peek()
        if result is None or result[0].lower not in words:
            text = f'{kind} of line {at.line} has no {_CLOSING[kind]}'
            raise SyntaxProblem(at, text)
        self._take()
        return self._reader(result)

    def _statement(self, found: list[Token]) -> list[Statement]:
        first = found[0]
        if first.kind != NAME:
            raise SyntaxProblem(first.position, f'a statement cannot start with {first.text[:40]}')
        read: list[Statement] = []
        if self._is_label(found):
            read.append(Label(first.text, first.position))
            found = found[2:]
            if not found:
                return read
            first = found[0]
            if first.kind != NAME:
                raise SyntaxProblem(first.position, 'invalid start of a statement')
        reader = self._reader(found)
        return read + self._one(reader, first)

    def _is_label(self, found: list[Token]) -> bool:
        is_point = is_point_literal(found[0].text) or found[0].lower in self._points
        return len(found) > 1 and found[1].text == ':' and not is_point

    def _one(self, reader: Reader, first: Token) -> list[Statement]:
        word = first.lower
        assigned = _assignment(reader, word)
        if assigned is not None:
            return [assigned]
        if word in TYPES or word in ('global', 'static'):
            return [declaration(reader, 'local')]
        rule = COMMANDS.get(word)
        if rule is None or (word in self._functions and not rule.form.startswith('@')):
            if word in self._functions:
                reader.step()
                return [self._call_statement(reader, first)]
            if not is_a('statement', word):
                raise SyntaxProblem(first.position, *_unknown(first, reader))
            reader.step()
            return [self.read_stub(reader, first)]
        reader.step()
        if reader.at_end() and word in SHOWN:
            return _displayed(first)
        shows = word in DISPLAYING or (rule.robot and rule.needs_arguments)
        if (reader.at_end() and shows) or (word in DISPLAYING_ONE and not reader.has(',')):
            return [self.read_stub(reader, first)]
        if rule.form.startswith('@'):
            method = getattr(self, rule.form.replace('@', 'read_'))
            read: Statement | list[Statement] = method(reader, first)
        else:
            read = self.read_form(reader, first, rule.form)
        reader.end()
        return read if isinstance(read, list) else [read]

    def _inline(self, tokens: list[Token]) -> list[Statement]:
        if tokens[0].lower in _ENDS:
            raise SyntaxProblem(
                tokens[0].position, f'{tokens[0].text} is not allowed in this line'
            )
        return self._statement(tokens)

    # Blocks of statements

    def read_if(self, reader: Reader, first: Token) -> If:
        condition = reader.expression()
        reader.need('then')
        if not reader.at_end() or self._queue:  # `If c Then; a; b` is also one line
            return self._one_line_if(reader, first, condition)
        branches = [(condition, self._block(('elseif', 'else', 'endif')))]
        otherwise: Block = ()
        while True:
            closing = self._closing('If', first.position, 'elseif', 'else', 'endif')
            word = closing.step()
            if word.lower == 'elseif':
                condition = closing.expression()
                closing.need('then')
                self._rest_as_statement(closing, unproven=True)
                branches.append((condition, self._block(('elseif', 'else', 'endif'))))
                continue
            if word.lower == 'else':
                self._rest_as_statement(closing, unproven=True)
                otherwise = self._block(('endif',))
                self._closing('If', first.position, 'endif').step()
            return If(tuple(branches), otherwise, first.position)

    def _rest_as_statement(self, reader: Reader, *, unproven: bool = False) -> None:
        rest = []
        while not reader.at_end():
            rest.append(reader.step())
        if rest:
            self._queue.insert(0, rest)
            if unproven:
                self._mark('`Else Print 1`', rest[0].position)

    def _one_line_if(self, reader: Reader, first: Token, condition: Expression) -> If:
        self._depth += 1
        if self._depth > DEEPEST_BLOCK:
            self._depth = 0
            raise SyntaxProblem(first.position, 'blocks are nested too deeply')
        rest: list[list[Token]] = [[]]
        while not reader.at_end():
            rest[0].append(reader.step())
        rest += self._rest_of_line()
        branches: list[tuple[Expression, Block]] = []
        otherwise: Block = ()
        parts = _split_at_else(rest)
        for index, part in enumerate(parts):
            body: list[Statement] = []
            pending = [item for item in part if item]
            while pending:
                tokens = pending.pop(0)
                self._queue = pending  # a nested If uses the rest of the line
                body.extend(self._inline(tokens))
                pending = self._queue
            self._queue = []
            if index == 0:
                branches.append((condition, tuple(body)))
            else:
                otherwise = tuple(body)
        self._depth -= 1
        return If(tuple(branches), otherwise, first.position)

    def read_select(self, reader: Reader, first: Token) -> Select:
        subject = reader.expression()
        reader.end()
        cases: list[tuple[tuple[CaseItem, ...], Block]] = []
        default: Block = ()
        ends = ('case', 'default', 'send')
        stray = self._block(ends)
        if stray and not all(isinstance(item, Label) for item in stray):
            text = 'statements between Select and its first Case are never executed'
            self._problems.append(Problem(stray[0].at, 'syntax', text))
        while True:
            closing = self._closing('Select', first.position, *ends)
            word = closing.step().lower
            if word == 'send':
                closing.end()
                return Select(subject, tuple(cases), default, first.position)
            if word == 'default':
                self._rest_as_statement(closing, unproven=True)
                default = self._block(ends)
                continue
            items = [_case_item(closing)]
            while closing.takes(','):
                items.append(_case_item(closing))
            if len(items) > 1:
                self._mark('`Case 1, 2`', items[1].value.at)
            self._rest_as_statement(closing)
            cases.append((tuple(items), self._block(ends)))

    def read_do(self, reader: Reader, first: Token) -> Do:
        before = _test(reader)
        reader.end()
        body = self._block(('loop',))
        closing = self._closing('Do', first.position, 'loop')
        closing.step()
        after = _test(closing)
        closing.end()
        if before is not None and after is not None:
            self._mark('`Do While a` with `Loop Until b`', first.position)
        return Do(before, body, after, first.position)

    def read_for(self, reader: Reader, first: Token) -> For:
        variable = reader.target()
        if isinstance(variable, Apply):
            self._mark('`For a(1) = …`', variable.at)
        reader.need('=')
        low = reader.expression()
        reader.need('to')
        high = reader.expression()
        step = reader.expression() if reader.takes('step') else None
        reader.end()
        body = self._block(('next',))
        closing = self._closing('For', first.position, 'next')
        closing.step()
        if not closing.at_end():
            named = closing.target()
            if named.name.lower() != variable.name.lower():
                text = f'Next {named.name} ends For {variable.name} of line {first.position.line}'
                raise SyntaxProblem(named.at, text)
        closing.end()
        return For(variable, low, high, step, body, first.position)

    def read_exit(self, reader: Reader, first: Token) -> Exit:
        if not reader.sees('do', 'for', 'function'):
            raise reader.wrong('Do, For or Function')
        return Exit(reader.step().lower, first.position)

    def _call_statement(self, reader: Reader, first: Token) -> Call:
        call = self.call_arguments(reader, first)
        reader.end()
        return call


def _split_at_else(parts: list[list[Token]]) -> list[list[list[Token]]]:
    """Split the statements of a one-line If at its Else.

    An Else of a nested If is not a place to split.
    """
    result: list[list[list[Token]]] = [[[]]]
    inner = 0
    for number, part in enumerate(parts):
        if number:
            result[-1].append([])
        for token in part:
            if token.lower == 'if' and token.kind == NAME:
                inner += 1
            if token.lower == 'else' and token.kind == NAME:
                if inner == 0 and len(result) == 1:
                    result.append([[]])
                    continue
                inner -= 1
            result[-1][-1].append(token)
    return result


def _assignment(reader: Reader, word: str) -> Assign | None:
    """Parse `a = …` or `a(…) = …`. Return None if the statement is not an assignment."""
    after = reader.look(1)
    if word in COMMANDS and COMMANDS[word].form.startswith('@') and after.text != '=':
        return None
    if reader.look(reader.past_brackets(1) if after.text == '(' else 1).text != '=':
        return None
    target = reader.target()
    at = reader.need('=').position
    value = reader.expression()
    if reader.sees(',') and (target.name.lower() == 'p' or is_point_literal(target.name)):
        value = coordinates(value, reader)
    reader.end()
    return Assign(target, value, at)


def _case_item(reader: Reader) -> CaseItem:
    if reader.sees('<', '>', '<=', '>=', '=', '<>', '=<', '=>'):
        sign = reader.step().text
        return CaseItem(SAME.get(sign, sign), reader.expression())
    return CaseItem('=', reader.expression())


def _test(reader: Reader) -> Test | None:
    if reader.sees('while', 'until'):
        until = reader.step().lower == 'until'
        return Test(until, reader.expression())
    return None


def _displayed(first: Token) -> list[Statement]:
    """Return `Print` statements for a setting without an argument, such as `Speed`."""
    at = first.position
    lines: list[tuple[Expression, ...]] = [
        tuple(Apply(first.text, (Argument(Number(item, at)),), at) for item in line)
        for line in SHOWN[first.lower]
    ]
    shown: list[Statement] = [
        Print(None, line, True, at) for line in lines or [(Name(first.text, at),)]
    ]
    if note := SHOWN_IN_LOW_POWER.get(first.lower):
        low = Binary('=', Name('Power', at), Number(0, at), at)
        shown.insert(0, If(((low, (Print(None, (Text(note, at),), True, at),)),), (), at))
    return shown


def _unknown(first: Token, reader: Reader) -> tuple[str, str]:
    word = first.lower
    if word in KEYWORDS:
        return f'{first.text} cannot start a statement', 'syntax'
    if is_a('function', word) or word in CONSTANTS:
        return f'{first.text} is not a statement', 'syntax'
    what = 'variable or function' if reader.look(1).text in ('=', '(') else 'statement or function'
    near = near_name(first.text[:40], _NAMES)
    meant = f': did you mean {near}?' if near else ''
    return f'unknown {what} {first.text[:40]}{meant}', 'unknown'


def _check_name(name: Token, what: str) -> None:
    word = name.lower
    if word in KEYWORDS or word in TYPES or word in TASK_TYPE_WORDS:
        text = f'{name.text} is a reserved word of SPEL+: it cannot name a {what}'
        raise SyntaxProblem(name.position, text, 'reserved')


def _type(reader: Reader) -> str:
    token = reader.name('a type')
    if token.lower not in TYPES:
        raise SyntaxProblem(token.position, f'{token.text} is not a type')
    return token.lower


def declaration(reader: Reader, scope: str) -> Declaration:
    """Parse `[Global [Preserve]] [Static] type name[(bounds)], …`.

    Static marks the variables of a library (RC+ 8), which are stored here like all shared
    variables.
    """
    at = reader.here.position
    if scope == 'local' and reader.sees('global', 'static'):
        word = reader.here.text
        raise SyntaxProblem(at, f'{word} inside a function: put it above all functions')
    if reader.takes('global'):
        scope = 'preserve' if reader.takes('preserve') else 'global'
    reader.takes('static')
    kind = _type(reader)
    variables = []
    while True:
        name = reader.name('the name of a variable')
        _check_name(name, 'variable')
        if (kind == 'string') != name.text.endswith('$'):
            text = f'{name.text}: only names of strings end in $'
            raise SyntaxProblem(name.position, text, 'type')
        bounds: list[Expression] = []
        if reader.takes('('):
            bounds.append(reader.expression())
            while reader.takes(','):
                bounds.append(reader.expression())
            reader.need(')')
            if len(bounds) > 3:
                raise SyntaxProblem(name.position, 'an array has at most three dimensions', 'type')
        variables.append(Variable(name.text, tuple(bounds), name.position))
        if not reader.takes(','):
            break
    reader.end()
    return Declaration(kind, tuple(variables), scope, at)  # type: ignore[arg-type]


def _parameters(reader: Reader) -> tuple[Parameter, ...]:
    if reader.takes(')'):
        return ()
    read = []
    while True:
        by_reference = reader.takes('byref')
        if not by_reference:
            reader.takes('byval')
        name = reader.name('the name of a parameter')
        _check_name(name, 'parameter')
        array = reader.takes('(')
        if array:
            reader.need(')')
            if not by_reference:
                text = f'{name.text}(): arrays are passed ByRef only'
                raise SyntaxProblem(name.position, text, 'type')
        kind = _parameter_type(reader)
        read.append(Parameter(name.text, kind, by_reference, array, name.position))
        if not reader.takes(','):
            break
    reader.need(')')
    return tuple(read)


def _parameter_type(reader: Reader) -> str:
    """Parse `As` and a type.

    RC+ also accepts `AsInteger`, which occurs in a real project.
    """
    word = reader.here.lower
    if word.startswith('as') and word[2:] in TYPES:
        reader.step()
        return word[2:]
    reader.need('as')
    return _type(reader)
