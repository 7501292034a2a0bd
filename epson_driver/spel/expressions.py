# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parses expressions of SPEL+.

The operators in order of precedence: `( )`, `**`, `* /`, `Mod`, `+ -`, `Mask`, comparisons, `Not`,
`And`, `Or`, `Xor`.
"""

from collections.abc import Container

from epson_driver.spel.errors import Position, SyntaxProblem
from epson_driver.spel.functions import AXES, FUNCTIONS, POINT_FLAGS, STUB_RESULTS, TURNS
from epson_driver.spel.lexer import END, NAME, NUMBER, STRING, SYMBOL, Token
from epson_driver.spel.syntax import (
    Apply,
    Argument,
    Binary,
    Expression,
    Name,
    Number,
    PointChange,
    PointFlag,
    Target,
    Text,
    Unary,
)
from epson_driver.spel.values import POINT

DEEPEST = 40
"""Maximum nesting of brackets, signs and Nots."""

MAX_OPERATORS = 100
"""Maximum number of operators in one statement."""

_LEVELS: tuple[tuple[str, ...], ...] = (
    ('xor',),
    ('or',),
    ('and',),
    (),  # Not
    ('=', '<>', '<', '>', '<=', '>=', '=<', '=>'),
    ('mask',),
    ('+', '-'),
    ('mod',),
    ('*', '/'),
    ('**',),
)
_LEVEL = {operator: level for level, row in enumerate(_LEVELS) for operator in row}
_NOT = _LEVELS.index(())
SAME = {'=<': '<=', '=>': '>='}
"""Another form of an operator → its usual form."""
_POINT_FUNCTIONS = frozenset(
    [name for name, rule in FUNCTIONS.items() if rule.result == POINT]
    + [name for name, result in STUB_RESULTS.items() if result == POINT]
)
_FLAG_OF_ANGLE = ('j1a', 'j4a')


def is_point_literal(name: str) -> bool:
    return name[:1] in 'pP' and name[1:].isdigit() and name.isascii() and len(name) < 8


def _moves(token: Token) -> bool:
    return token.lower in AXES or token.lower in TURNS or token.lower[:2] == 'tl'


def _is_flag(token: Token) -> bool:
    word = token.lower
    return word in POINT_FLAGS or word in _FLAG_OF_ANGLE or token.kind == NUMBER or word == '('


class Reader:
    """Reads the tokens of one statement from the left.

    `labels`: the labels of points, in lower case.
    """

    def __init__(
        self, found: list[Token], at: Position, labels: Container[str] = frozenset()
    ) -> None:
        self._tokens = found
        self._labels = labels
        self._next = 0
        self._depth = 0
        self._operators = 0
        if found:
            (file, line, column), text = found[-1].position, found[-1].text
            at = Position(file, line, column + len(text))
        self._end = Token(END, '', '', at)
        self.here = self.look(0)

    def look(self, ahead: int) -> Token:
        """Return the token at the offset `ahead` from the next token.

        After the last token, return END.
        """
        index = self._next + ahead
        return self._tokens[index] if index < len(self._tokens) else self._end

    def past_brackets(self, ahead: int = 0) -> int:
        """Return the offset of the token after a pair of brackets.

        The brackets open at the offset `ahead`.
        """
        depth = 0
        while (token := self.look(ahead)).kind != END:
            depth += (token.text == '(') - (token.text == ')')
            ahead += 1
            if depth == 0:
                break
        return ahead

    def step(self) -> Token:
        token = self.here
        self._skip(1)
        return token

    def _skip(self, count: int) -> None:
        self._next += count
        self.here = self.look(0)

    def wrong(self, expected: str) -> SyntaxProblem:
        token = self.here
        result = token.text[:40] or token.kind
        return SyntaxProblem(token.position, f'expected {expected}, found {result}')

    def has(self, text: str) -> bool:
        return any(token.text == text for token in self._tokens[self._next :])

    def at_end(self) -> bool:
        return self.here.kind == END

    def end(self) -> None:
        if not self.at_end():
            raise self.wrong('the end of the statement')

    def sees(self, *texts: str) -> bool:
        token = self.here
        return token.kind in (NAME, SYMBOL) and token.lower in texts

    def takes(self, *texts: str) -> bool:
        """Read the next token if it is one of `texts`, names or signs.

        Return whether it was read.
        """
        if self.sees(*texts):
            self._skip(1)
            return True
        return False

    def need(self, text: str) -> Token:
        if not self.sees(text):
            raise self.wrong('a comma' if text == ',' else text)
        return self.step()

    def name(self, what: str) -> Token:
        if self.here.kind != NAME:
            raise self.wrong(what)
        return self.step()

    def expression(self) -> Expression:
        self._deeper()
        read = self._binary(0)
        self._depth -= 1
        return read

    def expressions(self) -> tuple[Expression, ...]:
        read = [self.expression()]
        while self.takes(','):
            read.append(self.expression())
        return tuple(read)

    def optional(self, *ends: str) -> Expression | None:
        """Parse an expression.

        Return None at the end of the statement, or before a word in `ends`.
        """
        return None if self.at_end() or self.sees(*ends) else self.expression()

    def _binary(self, lowest: int) -> Expression:
        """Parse operands joined by operators with a precedence of at least `lowest`."""
        if lowest <= _NOT and self.sees('not'):
            token = self.step()
            self._deeper()
            left: Expression = Unary('not', self._binary(_NOT), token.position)
            self._depth -= 1
        else:
            left = self._point()
        while (level := self._level()) >= lowest:
            token = self.step()
            self._operators += 1
            if self._operators > MAX_OPERATORS:
                raise SyntaxProblem(token.position, 'the expression is too long: split it')
            operator = SAME.get(token.lower, token.lower)
            left = Binary(operator, left, self._binary(level + 1), token.position)
        return left

    def _level(self) -> int:
        token = self.here
        return _LEVEL.get(token.lower, -1) if token.kind in (NAME, SYMBOL) else -1

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > DEEPEST:
            raise SyntaxProblem(
                self.here.position, 'the expression is nested too deeply: split it'
            )

    def _point(self) -> Expression:
        """Parse an operand.

        For a point, also parse the changes after it: `:Z(0)`, `+TLZ(10)`, `/L`, `@1`.
        """
        left = self._operand()
        while True:
            token, after = self.here, self.look(1)
            axis = after.kind == NAME and self.look(2).text == '('
            is_point = self._is_point(left)
            absolute = token.text == ':' and axis and after.lower in AXES
            if absolute or (is_point and token.text in ('+', '-') and axis and _moves(after)):
                self.step()
                self.step()
                value = self._in_brackets()
                left = PointChange(left, token.text, after.lower, value, token.position)
            elif is_point and token.text in ('/', '@') and _is_flag(after):
                self.step()
                left = self._flag(left, token)
            else:
                return left
            self._operators += 1
            if self._operators > MAX_OPERATORS:
                raise SyntaxProblem(self.here.position, 'the expression is too long: split it')

    def _flag(self, point: Expression, sign: Token) -> Expression:
        mark = '@' if sign.text == '@' else ''
        if self.sees('('):
            return PointFlag(point, mark, sign.position, self._in_brackets())
        word = self.step()
        value = self._in_brackets() if word.lower in _FLAG_OF_ANGLE else None
        return PointFlag(point, mark + word.lower, sign.position, value)

    def _in_brackets(self) -> Expression:
        self.need('(')
        value = self.expression()
        self.need(')')
        return value

    def _is_point(self, expression: Expression) -> bool:
        if isinstance(expression, PointChange | PointFlag):
            return True
        if isinstance(expression, Name | Apply):
            name = expression.name.lower()
            return (
                name in _POINT_FUNCTIONS
                or is_point_literal(name)
                or (isinstance(expression, Name) and name in self._labels)
            )
        return False

    def _operand(self) -> Expression:
        token = self.here
        if token.kind == NUMBER:
            self.step()
            assert not isinstance(token.value, str)  # noqa: S101 - the lexer makes numbers of them
            return Number(token.value, token.position, token.text)
        if token.kind == STRING:
            self.step()
            return Text(str(token.value), token.position)
        if token.text in ('-', '+'):
            self.step()
            self._deeper()
            operand = self._point()
            self._depth -= 1
            return Unary('-', operand, token.position) if token.text == '-' else operand
        if token.text == '(':
            self.step()
            inner = self.expression()
            self.need(')')
            return inner
        if token.kind == NAME:
            self.step()
            if self.sees('('):
                return Apply(token.text, self.arguments(), token.position)
            return Name(token.text, token.position)
        raise self.wrong('a value')

    def arguments(self) -> tuple[Argument, ...]:
        self.need('(')
        self._deeper()
        read = [] if self.sees(')') else [self.argument()]
        while self.takes(','):
            read.append(self.argument())
        self.need(')')
        self._depth -= 1
        return tuple(read)

    def argument(self) -> Argument:
        """Parse one argument, including `ByRef a` and `a()`."""
        by_reference = self.takes('byref')
        if not by_reference:
            self.takes('byval', '#')
        token = self.here
        if token.kind == NAME and self.look(1).text == '(' and self.look(2).text == ')':
            after = self.look(3)
            if after.kind == END or after.text in (',', ')', ';'):
                self._skip(3)
                return Argument(Name(token.text, token.position), by_reference, whole_array=True)
        return Argument(self.expression(), by_reference)

    def target(self) -> Target:
        token = self.name('a variable')
        if self.sees('('):
            return Apply(token.text, self.arguments(), token.position)
        return Name(token.text, token.position)
