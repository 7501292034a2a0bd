# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conditions of Wait, Till, Sense, Find and Trap: inputs, states and shared integer variables.

The controller evaluates the left side repeatedly while the task waits. This side can therefore not
use values that only the task can access, such as local variables. The right side is evaluated
once, when the statement starts (SPEL+ manual p881, p859).
"""

from epson_driver.spel.errors import SyntaxProblem
from epson_driver.spel.expression_code import COMPARE, Expressions, check_count
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.scope import Scope, against_true
from epson_driver.spel.syntax import Apply, Binary, Expression, Name, Unary
from epson_driver.spel.values import INT, TYPES, type_word
from epson_driver.spel.words import is_a

_JOIN = {'and': 'and', 'or': 'or', 'xor': '!='}


def is_condition(expression: Expression, scope: Scope) -> bool:
    """Return whether an expression after Wait is a condition, not a time."""
    if isinstance(expression, Binary):
        return expression.operator in ('and', 'or', 'xor', 'mask', *COMPARE)
    if isinstance(expression, Unary):
        return expression.operator == 'not'
    if isinstance(expression, Name | Apply) and scope.variable(expression.name) is None:
        rule = FUNCTIONS.get(expression.name.lower())
        return is_a('function', expression.name) if rule is None else rule.event
    return False


def condition(expression: Expression, expressions: Expressions) -> tuple[str, str]:
    """Compile a condition to Python.

    Return the lines that are executed once, before the wait, and the expression that is tested.
    """
    before: list[str] = []
    test = _test(expression, expressions, before)
    return ''.join(f'{line}\n' for line in before), test


def _test(expression: Expression, expressions: Expressions, before: list[str]) -> str:
    if isinstance(expression, Binary) and expression.operator in _JOIN:
        left = _test(expression.left, expressions, before)
        right = _test(expression.right, expressions, before)
        if expression.operator == 'xor':
            return f'(bool({left}) != bool({right}))'
        return f'({left} {_JOIN[expression.operator]} {right})'
    if isinstance(expression, Unary) and expression.operator == 'not':
        return f'(not {_test(expression.operand, expressions, before)})'
    if isinstance(expression, Binary) and expression.operator in COMPARE:
        expression = against_true(expression)
        left = _event(expression.left, expressions, before)
        right = _once(expression.right, expressions, before)
        return f'({left} {COMPARE[expression.operator]} {right})'
    return _event(expression, expressions, before)


def _once(expression: Expression, expressions: Expressions, before: list[str]) -> str:
    """Add a line to `before` that evaluates an expression once, to a whole number.

    Return the name of the Python variable with the value.
    """
    name = expressions.temporary()
    before.append(f'{name} = {expressions.whole(expression)}')
    return name


def _event(expression: Expression, expressions: Expressions, before: list[str]) -> str:
    if isinstance(expression, Binary) and expression.operator == 'mask':
        left = _event(expression.left, expressions, before)
        return f'({left} & {_once(expression.right, expressions, before)})'
    if isinstance(expression, Name | Apply):
        variable = expressions.scope.variable(expression.name)
        if variable is not None:
            wrong = ''
            if variable.place != 'g':
                wrong = 'is a local variable'
            elif variable.array:
                wrong = 'is an array'
            elif TYPES[variable.type].kind != INT:
                wrong = f'is {type_word(variable.type)}'
            if wrong:
                text = f'{expression.name} {wrong}: a condition takes whole Global or module '
                raise SyntaxProblem(expression.at, f'{text}variables only', 'wait-condition')
            return expressions.read(variable).text
        rule = FUNCTIONS.get(expression.name.lower())
        if rule is not None and rule.event:
            if isinstance(expression, Name):
                return expressions.value(expression).text
            check_count(rule, expression.arguments, expression.at)
            arguments = ', '.join(
                _once(argument.value, expressions, before) for argument in expression.arguments
            )
            if rule.by == 'task':
                return f't_{rule.name.lower()}(v[0], {arguments})'
            return f'v[0].value({rule.name.lower()!r}, ({arguments},))'
        if rule is None and is_a('function', expression.name):
            return expressions.value(expression).text
    text = 'a condition takes inputs, outputs, memory, states and whole global variables only'
    raise SyntaxProblem(expression.at, text, 'wait-condition')
