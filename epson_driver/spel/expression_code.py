# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Compiles expressions to Python text, and checks the types of their values.

Functions of the program may wait. They are therefore called by separate instructions before the
statement that contains the expression. Both sides of And and Or are always evaluated.
"""

import re
from collections.abc import Callable, Sequence
from math import inf
from typing import NamedTuple

from epson_driver.spel.code import Variable
from epson_driver.spel.errors import Position, Problem, SyntaxProblem, to_add
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.functions import FUNCTIONS, STUB_RESULTS, FunctionRule, counts
from epson_driver.spel.library import REAL_DIGITS
from epson_driver.spel.ranges import key_of, limits, outside
from epson_driver.spel.scope import Scope, against_true, constant
from epson_driver.spel.syntax import (
    Apply,
    Argument,
    Binary,
    Expression,
    Name,
    Number,
    Parameter,
    PointFlag,
    Target,
    Text,
    Unary,
)
from epson_driver.spel.values import (
    DOUBLE,
    INT,
    LONGEST_STRING,
    NUMBERS,
    POINT,
    SINGLE,
    STRING,
    TYPES,
    type_word,
)
from epson_driver.spel.words import is_a, not_simulated

OFFSET = re.compile(r'([XYZUVWRST])(\d+)', re.IGNORECASE)  # written in place of X(50) by mistake

COMPARE = {'=': '==', '<>': '!=', '<': '<', '>': '>', '<=': '<=', '>=': '>='}
"""Comparison operator → the same operator in Python."""
_BITS = {'and': '&', 'or': '|', 'xor': '^', 'mask': '&'}
_WORDS = {
    INT: 'a whole number',
    SINGLE: 'a number',
    DOUBLE: 'a number',
    STRING: 'a string',
    POINT: 'a point',
}
_DEEPEST_PYTHON = 90
"""Maximum nesting of brackets in the generated Python."""


class Code(NamedTuple):
    """A compiled expression.

    * text: its Python text.
    * kind: kind of its value, such as a number, a string or a point.
    * truth: its Python text as a condition, if this is different.
    """

    text: str
    kind: str
    truth: str = ''
    checked: bool = False
    """Whether the value needs no range check. The constants -1 and 0, and variables of the type
    Double or String, need no check."""


def check_count(rule: FunctionRule, arguments: Sequence[Argument], at: Position) -> None:
    minimum, maximum = counts(rule.arguments)
    if not minimum <= len(arguments) <= maximum:
        number = str(minimum) if minimum == maximum else f'{minimum} to {maximum}'
        text = f'{rule.name} takes {number} arguments, not {len(arguments)}'
        if maximum == 0:
            text = f'{rule.name} takes no arguments: write {rule.name}'
        raise SyntaxProblem(at, text, 'arguments')


class Expressions:
    """Compiles the expressions of one function to Python.

    `call` adds the instruction that calls a function of the program, and returns the index of the
    function's result in `v`.
    """

    def __init__(
        self,
        scope: Scope,
        call: Callable[[str, tuple[Argument, ...], Position], int],
    ) -> None:
        self.scope = scope
        self.notes: list[Problem] = []
        """Warnings about code that is allowed, but not recommended."""
        self._call = call
        self._temporaries = 0

    def temporary(self) -> str:
        self._temporaries += 1
        return f'_{self._temporaries}'

    # Values by kind

    def number(self, expression: Expression) -> Code:
        return self._expect(expression, NUMBERS, 'a number')

    def whole(self, expression: Expression) -> str:
        """Compile a number. A real number is rounded to a whole number, as in an assignment."""
        return _rounded(self.number(expression))

    def ranged(self, name: str, key: str, place: int, value: Expression, code: str) -> str:
        """Return `code`, the Python text of `value`, with a range check if one is needed.

        `key` and `place` select the range (`ranges.limits`). `name` appears in the error.
        """
        ends = limits(key, place)
        if ends is None or code.startswith("'"):  # a task's function
            return code
        fixed = constant(value, self.scope.constants)
        if isinstance(fixed, int | float) and not outside(key, place, fixed):
            return code
        number, (low, high) = self.temporary(), ends
        within = f'{low} <= ({number} := {code})' + (f' <= {high}' if high < inf else '')
        return f'({number} if {within} else REFUSE({name!r}, {key!r}, {place}, {number}))'

    def string(self, expression: Expression) -> str:
        return self._expect(expression, (STRING,), 'a string').text

    def point(self, expression: Expression) -> str:
        """Compile an expression. Raises SyntaxProblem if its value is not a point.

        A point label takes precedence over an I/O label with the same name.
        """
        labelled = self._labelled(expression)
        if labelled is not None:
            return f't_p(v[0], {labelled})'
        return self._expect(expression, (POINT,), 'a point').text

    def point_or_number(self, expression: Expression) -> Code:
        if self._labelled(expression) is not None:
            return Code(self.point(expression), POINT)
        return self._expect(expression, (POINT, *NUMBERS), 'a point or a number')

    def _labelled(self, expression: Expression) -> int | None:
        name = expression.name if isinstance(expression, Name) else ''
        return None if self.scope.variable(name) is not None else self.scope.point_number(name)

    def _expect(self, expression: Expression, kinds: Sequence[str], what: str) -> Code:
        code = self.value(expression)
        if code.kind not in kinds:
            text = f'must be {what}, is {_WORDS[code.kind]}'
            raise SyntaxProblem(expression.at, text, 'type')
        return code

    def truth(self, expression: Expression) -> str:
        code = self.number(expression)
        return code.truth or code.text

    def as_type(self, expression: Expression, type_name: str) -> str:
        target = TYPES[type_name]
        fixed = constant(expression, self.scope.constants)
        code = self.value(expression)
        if (code.kind in NUMBERS) != (target.kind in NUMBERS):
            text = f'{type_word(type_name)} cannot take {_WORDS[code.kind]}'
            raise SyntaxProblem(expression.at, text, 'type')
        if isinstance(fixed, int) and target.kind == INT and type_name != 'boolean':
            if not target.least <= fixed <= target.most:
                text = f'{fixed} does not fit {type_word(type_name)}'
                text += f' ({target.least}..{target.most})'
                raise SyntaxProblem(expression.at, text, 'overflow')
            return code.text
        self._note(expression, code, type_name)
        return self._converted(code, type_name)

    def _note(self, expression: Expression, code: Code, type_name: str) -> None:
        target = TYPES[type_name]
        if target.kind != INT or type_name == 'boolean':
            return
        name = type_word(type_name)
        if code.kind != INT:
            text = f'it is not documented how a Real is rounded to fit {name}: '
            text += 'write Int( ) or Fix( )'
            self.notes.append(Problem(expression.at, 'real-to-integer', text, warning=True))
        elif isinstance(expression, Name | Apply):
            variable = self.scope.variable(expression.name)
            if variable is not None and TYPES[variable.type].most > target.most:
                text = f'{expression.name} is {type_word(variable.type)} and may not fit {name}'
                self.notes.append(Problem(expression.at, 'integer-range', text, warning=True))

    def _converted(self, code: Code, type_name: str) -> str:
        target = TYPES[type_name]
        if target.kind == STRING:
            if code.checked:
                return code.text
            name = self.temporary()
            limit = f'len({name} := {code.text}) <= {LONGEST_STRING}'
            return f'({name} if {limit} else LONG({name}))'
        if type_name == 'boolean' and not code.truth:
            return f'(-1 if {code.text} else 0)'
        if target.kind == INT:
            if code.kind == INT and code.checked:
                return code.text
            name = self.temporary()
            within = f'{target.least} <= ({name} := {_rounded(code)}) <= {target.most}'
            return f'({name} if {within} else OVER({type_name!r}, {name}))'
        if target.kind == SINGLE:
            return f'SINGLE({code.text})'
        if code.kind == INT:
            return f'float({code.text})'
        if code.checked or code.kind == SINGLE:
            return code.text
        name = self.temporary()
        return f'({name} if ({name} := {code.text}) - {name} == 0.0 else FINITE({name}))'

    # Variables

    def read(self, variable: Variable) -> Code:
        kind = TYPES[variable.type].kind
        place = f'{variable.place}[{variable.slot}]'
        if variable.by_reference:
            place = f'{place}[0][{place}[1]]'
        return Code(place, kind, checked=kind in (DOUBLE, STRING))

    def array(self, argument: Argument) -> tuple[str, str]:
        """Return the Python text and the type of a whole array, or raise SyntaxProblem."""
        value = argument.value
        variable = self.scope.variable(value.name) if isinstance(value, Name) else None
        if variable is None or not variable.array:
            raise SyntaxProblem(value.at, 'must be an array', 'type')
        return f'{variable.place}[{variable.slot}]', variable.type

    def _element(self, variable: Variable, target: Apply) -> tuple[str, str]:
        """Return the Python text of an array's list, and of the index of the element `target`."""
        array = f'{variable.place}[{variable.slot}]'
        dimensions = len(variable.bounds)
        indices = target.arguments
        if dimensions and len(indices) != dimensions:
            text = f'{target.name} has {dimensions} dimensions, not {len(indices)}'
            raise SyntaxProblem(target.at, text, 'type')
        for argument in indices:
            if argument.by_reference or argument.whole_array:
                raise SyntaxProblem(target.at, 'an index must be a number', 'type')
        if len(indices) != 1 or not dimensions:
            codes = ', '.join(self.whole(argument.value) for argument in indices)
            return f'{array}.d', f'{array}.at({codes})'
        fixed = constant(indices[0].value, self.scope.constants)
        index = self.whole(indices[0].value)
        if isinstance(fixed, int):
            if fixed < 0:
                raise SyntaxProblem(target.at, f'index {fixed} is below 0', 'array-index')
            return f'{array}.d', index
        name = self.temporary()
        return f'{array}.d', f'{name} if ({name} := {index}) >= 0 else INDEX({name})'

    def place(self, target: Target) -> tuple[str, str]:
        """Return the Python text of an assignment target, and its type."""
        variable = self._stored_in(target)
        if isinstance(target, Apply):
            container, index = self._element(variable, target)
            return f'{container}[{index}]', variable.type
        return self.read(variable).text, variable.type

    def reference(self, target: Target) -> tuple[str, str]:
        """Return the Python text (list, index) of a variable's place, and the variable's type."""
        variable = self._stored_in(target)
        if isinstance(target, Apply):
            container, index = self._element(variable, target)
            return f'({container}, {index})', variable.type
        place = f'{variable.place}[{variable.slot}]'
        if variable.by_reference:
            return place, variable.type
        return f'({variable.place}, {variable.slot})', variable.type

    def taker(self, expression: Expression) -> tuple[str, str]:
        """Return the Python text of the Reference to a variable, and the variable's type."""
        if not isinstance(expression, Name | Apply):
            raise SyntaxProblem(expression.at, 'must be a variable', 'type')
        reference, type_name = self.reference(expression)
        return f'(*{reference}, {type_name!r})', type_name

    def _stored_in(self, target: Target) -> Variable:
        variable = self.scope.variable(target.name)
        if variable is None:
            what = 'array' if isinstance(target, Apply) else 'variable'
            raise SyntaxProblem(
                target.at, f'{target.name[:40]} is not a declared {what}', 'unknown'
            )
        if variable.array != isinstance(target, Apply):
            is_what = 'is an array: it needs an index' if variable.array else 'is not an array'
            raise SyntaxProblem(target.at, f'{target.name} {is_what}', 'type')
        return variable

    # Expressions

    def value(self, expression: Expression) -> Code:
        if isinstance(expression, Number):
            if isinstance(expression.value, int):
                return Code(str(expression.value), INT)
            return Code(repr(expression.value), DOUBLE, checked=True)
        if isinstance(expression, Text):
            if len(expression.value) > LONGEST_STRING:
                text = f'a string has at most {LONGEST_STRING} characters'
                raise SyntaxProblem(expression.at, text, 'string-length')
            return Code(repr(expression.value), STRING, checked=True)
        if isinstance(expression, Name):
            return self._name(expression)
        if isinstance(expression, Apply):
            return self._apply(expression)
        if isinstance(expression, Unary):
            return self._unary(expression)
        if isinstance(expression, Binary):
            return self._binary(expression)
        point = self.point(expression.point)
        if isinstance(expression, PointFlag):
            flag = repr(expression.flag)
            if expression.value is not None:
                flag = f'f"{expression.flag}{{{self.number(expression.value).text}:g}}"'
            return Code(f'v[0].flagged({point}, {flag})', POINT)
        moved = self.number(expression.value).text
        change = f'{expression.operator!r}, {expression.axis!r}, {moved}'
        return Code(f'CHANGED({point}, {change})', POINT)

    def _unary(self, expression: Unary) -> Code:
        code = self.number(expression.operand)
        if expression.operator == '-':
            return Code(f'(-{code.text})', code.kind, checked=code.kind == DOUBLE and code.checked)
        if code.kind != INT:
            raise SyntaxProblem(expression.at, 'Not needs a whole number', 'type')
        truth = f'(not {code.truth})' if code.truth else ''
        return Code(f'(~{code.text})', INT, truth, checked=bool(truth))

    def _binary(self, expression: Binary) -> Code:
        expression = against_true(expression)
        operator, at = expression.operator, expression.at
        left, right = self.value(expression.left), self.value(expression.right)
        if left.kind == right.kind == POINT and operator in ('+', '-'):
            return Code(f'ADDED({left.text}, {right.text}, {operator}1.0)', POINT)
        if POINT in (left.kind, right.kind):
            raise SyntaxProblem(at, f'{operator} does not take points', 'type')
        if (left.kind == STRING) != (right.kind == STRING):
            text = f'{operator} has {_WORDS[left.kind]} on one side'
            raise SyntaxProblem(at, f'{text} and {_WORDS[right.kind]} on the other', 'type')
        if operator in COMPARE:
            if left.kind == STRING and operator not in ('=', '<>'):
                raise SyntaxProblem(at, 'strings can be compared by = and <> only', 'type')
            compared = f'({left.text} {COMPARE[operator]} {right.text})'
            return Code(f'(-{compared})', INT, compared, checked=True)
        if left.kind == STRING:
            if operator != '+':
                raise SyntaxProblem(at, f'{operator} does not take strings', 'type')
            return Code(f'({left.text} + {right.text})', STRING)
        whole = left.kind == INT and right.kind == INT
        if operator in _BITS or operator == 'mod':
            if not whole:
                raise SyntaxProblem(at, f'{operator.capitalize()} needs whole numbers', 'type')
            if operator == 'mod':
                return Code(f'MOD({left.text}, {right.text})', INT)
            sign = _BITS[operator]
            truth = ''
            if left.truth and right.truth:
                truth = f'({left.truth} {sign} {right.truth})'
            text = f'({left.text} {sign} {right.text})'
            return Code(text, INT, truth, checked=bool(truth))
        if operator == '**':
            return Code(f'POWER({left.text}, {right.text})', DOUBLE, checked=True)
        text = f'({left.text} {operator} {right.text})'
        if operator == '/':
            return Code(text, DOUBLE)
        if whole:
            return Code(text, INT)
        kinds = {left.kind, right.kind}
        return Code(text, DOUBLE if DOUBLE in kinds else SINGLE)

    def _name(self, expression: Name) -> Code:
        name, key = expression.name, expression.name.lower()
        variable = self.scope.variable(name)
        if variable is not None:
            if variable.array:
                raise SyntaxProblem(
                    expression.at, f'{name} is an array: it needs an index', 'type'
                )
            return self.read(variable)
        if key in self.scope.constants:
            fixed = self.scope.constants[key]
            return Code(repr(fixed), INT if isinstance(fixed, int) else STRING, checked=True)
        if (number := self.point_number(name)) is not None:
            return Code(f't_p(v[0], {number})', POINT)
        if key in self.scope.data.unlabelled:
            return Code(f'UNLABELLED({name!r})', INT)
        return self._function(name, (), expression.at)

    def point_number(self, name: str) -> str | None:
        """Return the Python text of a point's number, or None if `name` is no point.

        The name is P1, a label, or `Pi`, which means `P(i)`.
        """
        if is_point_literal(name):
            return str(int(name[1:]))
        if (labelled := self.scope.point_number(name)) is not None:
            return str(labelled)
        variable = self.scope.variable(name[1:]) if name[:1] in 'pP' else None
        if variable is None or variable.array or TYPES[variable.type].kind != INT:
            return None
        return self.read(variable).text

    def which_point(self, expression: Expression) -> str:
        """Compile the number of a point.

        The point is given as P1, P(i), a label, a string with a label, or a number.
        """
        if isinstance(expression, Name):
            number = self.point_number(expression.name)
            if number is not None and self.scope.variable(expression.name) is None:
                return number
        if isinstance(expression, Apply) and expression.name.lower() == 'p':
            return self.whole(expression.arguments[0].value)
        code = self._expect(expression, (*NUMBERS, STRING), 'a point')
        return f'v[0].labelled({code.text})' if code.kind == STRING else _rounded(code)

    def _apply(self, expression: Apply) -> Code:
        variable = self.scope.variable(expression.name)
        if variable is not None and variable.array:
            container, index = self._element(variable, expression)
            kind = TYPES[variable.type].kind
            return Code(f'{container}[{index}]', kind, checked=kind in (DOUBLE, STRING))
        if variable is not None and expression.name.lower() not in self.scope.functions:
            raise SyntaxProblem(expression.at, f'{expression.name} is not an array', 'type')
        return self._function(expression.name, expression.arguments, expression.at)

    def _function(self, name: str, arguments: tuple[Argument, ...], at: Position) -> Code:
        key = name.lower()
        if key in self.scope.functions:
            result = self.scope.functions[key].result
            if not result:
                text = f'{name}: no As in its Function line, so RC+ assumes an Integer'
                self.notes.append(Problem(at, 'type', text, warning=True))
                result = 'integer'
            slot = self._call(name, arguments, at)
            kind = TYPES[result].kind
            return Code(f'v[{slot}]', kind, checked=kind in (DOUBLE, STRING))
        if key in self.scope.libraries:
            return self._library(key, arguments, at)
        rule = FUNCTIONS.get(key)
        if rule is None:
            if is_a('function', key):
                return self._stub(name, arguments, at)
            if is_a('statement', key) or is_a('keyword', key):
                raise SyntaxProblem(at, f'{name} has no value', 'syntax')
            what = 'function or array' if arguments else 'variable, constant or function'
            offset = OFFSET.fullmatch(name)
            hint = f': the offset of a point is {offset[1]}({offset[2]})' if offset else ''
            raise SyntaxProblem(at, f'unknown {what} {name[:40]}{hint}', 'unknown')
        return self._built_in(rule, arguments, at)

    def note_stub(self, name: str, at: Position) -> None:
        text = f'{not_simulated(name)}: to run it, {to_add("stubs", f"{name}: RESULT")}'
        self.notes.append(Problem(at, 'not-simulated', text, warning=True))

    def _stub(self, name: str, arguments: tuple[Argument, ...], at: Position) -> Code:
        self.note_stub(name, at)
        codes = ''.join(f'{self.stub_argument(argument)}, ' for argument in arguments)
        kind = STRING if name.endswith('$') else STUB_RESULTS.get(name.lower(), INT)
        return Code(f'v[0].ask({name!r}, ({codes}), {kind!r})', kind)

    def stub_argument(self, argument: Argument) -> str:
        """Compile an argument of a statement that is not simulated.

        An unknown name, such as a vision sequence or a window, becomes a string.
        """
        value = argument.value
        if argument.whole_array:
            return self.array(argument)[0]
        if isinstance(value, Name) and not self._means_something(value.name):
            return repr(value.name)
        return self.value(value).text

    def _means_something(self, name: str) -> bool:
        key, scope = name.lower(), self.scope
        known = key in scope.constants or key in scope.functions or is_a('function', key)
        return known or scope.variable(name) is not None or self.point_number(name) is not None

    def _built_in(self, rule: FunctionRule, arguments: tuple[Argument, ...], at: Position) -> Code:
        check_count(rule, arguments, at)
        kinds = rule.arguments.split(',')
        codes: list[Code] = []
        key = rule.name.lower()
        for place, (argument, kind) in enumerate(zip(arguments, kinds, strict=False)):
            code = self.argument(argument, kind[0])
            text = self.ranged(rule.name, key_of(key), place, argument.value, code.text)
            codes.append(code._replace(text=text))
        passed = ', '.join(code.text for code in codes)
        name = key.replace('$', '_s')
        result = codes[0].kind if rule.result == '=' else rule.result
        if rule.name == 'Str$' and codes[0].kind == SINGLE:
            passed += f', {REAL_DIGITS}'
        if rule.by == 'value' and rule.arguments == 'i,i' and self._is_uint32(arguments[0].value):
            passed += ', True'
        if rule.by == 'value':
            text = f'f_{name}({passed})'
        elif rule.by == 'task':
            text = f't_{name}(v[0]{", " if passed else ""}{passed})'
        else:
            text = f'v[0].value({key!r}, ({passed}{"," if passed else ""}))'
        return Code(text, result)

    def _is_uint32(self, expression: Expression) -> bool:
        if not isinstance(expression, Name | Apply):
            return False
        variable = self.scope.variable(expression.name)
        return variable is not None and variable.type == 'uint32'

    def argument(self, argument: Argument, kind: str) -> Code:
        """Compile an argument of a kind that functions.py and commands.py list."""
        value = argument.value
        if kind == 'a':
            return Code(self.array(argument)[0], INT)
        if argument.by_reference or argument.whole_array:
            raise SyntaxProblem(value.at, 'must be a value, not ByRef nor an array', 'type')
        if kind == 's':
            return Code(self.string(value), STRING)
        if kind == 'p':
            return Code(self.point(value), POINT)
        if kind == 'q':
            return Code(self.which_point(value), INT)
        if kind == 't' and isinstance(value, Name):
            key = value.name.lower()
            if key in self.scope.functions and self.scope.variable(key) is None:
                return Code(repr(key), INT)
        if kind == 'n':
            return self.number(value)
        if kind == 'x':
            return self._expect(value, (*NUMBERS, STRING), 'a number or a string')
        return Code(self.whole(value), INT)

    def _library(self, key: str, arguments: tuple[Argument, ...], at: Position) -> Code:
        number, declared = self.scope.libraries[key]
        passed = self.parameters(declared.name, declared.parameters, arguments, at)
        kind = TYPES[declared.result].kind
        return Code(f'v[0].library({number}, ({passed}{"," if passed else ""}))', kind)

    def parameters(
        self,
        name: str,
        parameters: tuple[Parameter, ...],
        arguments: tuple[Argument, ...],
        at: Position,
    ) -> str:
        if len(parameters) != len(arguments):
            text = f'{name} takes {len(parameters)} arguments, not {len(arguments)}'
            raise SyntaxProblem(at, text, 'arguments')
        codes = []
        for parameter, argument in zip(parameters, arguments, strict=True):
            if parameter.array:
                code, kind = self.array(argument)
            elif parameter.by_reference and argument.by_reference:
                if not isinstance(argument.value, Name | Apply):
                    raise SyntaxProblem(argument.value.at, 'ByRef needs a variable', 'type')
                code, kind = self.reference(argument.value)
            elif parameter.by_reference:
                kind = parameter.type
                code = f'([{self.as_type(argument.value, kind)}], 0)'
            else:
                if argument.by_reference or argument.whole_array:
                    text = f'{name}: {parameter.name} is not ByRef'
                    raise SyntaxProblem(argument.value.at, text, 'type')
                kind = parameter.type
                code = self.as_type(argument.value, kind)
            if TYPES[kind] != TYPES[parameter.type]:
                text = f'{name}: {parameter.name} is {type_word(parameter.type)}'
                text += f', not {type_word(kind)}'
                raise SyntaxProblem(argument.value.at, text, 'type')
            codes.append(code)
        return ', '.join(codes)


def _rounded(code: Code) -> str:
    return code.text if code.kind == INT else f'WHOLE({code.text})'


_QUOTED = re.compile(r"'(?:[^'\\]|\\.)*'" + r'|"(?:[^"\\]|\\.)*"')


def check_depth(text: str, at: Position) -> None:
    """Raise SyntaxProblem if an instruction has too many nested brackets for Python's compiler."""
    depth = deepest = 0
    for sign in _QUOTED.sub('', text):
        if sign in '([{':
            depth += 1
            deepest = max(deepest, depth)
        elif sign in ')]}':
            depth -= 1
    if deepest > _DEEPEST_PYTHON:
        raise SyntaxProblem(at, 'the expression is nested too deeply: split it')
