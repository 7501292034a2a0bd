# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Finds the variable, function or label that a name denotes. Checks the limits of declarations."""

from collections.abc import Mapping

from epson_driver.spel.code import Variable
from epson_driver.spel.errors import Position, SyntaxProblem
from epson_driver.spel.project_data import ProjectData
from epson_driver.spel.syntax import (
    Binary,
    Declaration,
    Declare,
    Expression,
    Function,
    Name,
    Number,
    Unary,
)
from epson_driver.spel.values import TYPES, size
from epson_driver.spel.words import CONSTANTS

LIMITS = {
    'local': (2_000, 200),
    'module': (100_000, 10_000),
    'global': (100_000, 10_000),
    'preserve': (4_000, 400),
}
"""Scope → maximum number of elements in an array of numbers, and in an array of strings. Source:
SPEL+ manual p952."""


def constant(expression: Expression, constants: Mapping[str, int | str]) -> int | float | None:
    """Return the value of a numeric expression, or None if it is not constant."""
    if isinstance(expression, Number):
        return expression.value
    if isinstance(expression, Name):
        fixed = constants.get(expression.name.lower())
        return None if isinstance(fixed, str) else fixed
    if isinstance(expression, Unary):
        value = constant(expression.operand, constants)
        if value is None:
            return None
        return -value if expression.operator == '-' else ~int(value)
    if isinstance(expression, Binary):
        left = constant(expression.left, constants)
        right = constant(expression.right, constants)
        if left is None or right is None:
            return None
        if expression.operator == '/' and right:
            return left / right
        if expression.operator in ('+', '-', '*'):
            signs = {'+': left + right, '-': left - right, '*': left * right}
            return signs[expression.operator]
    return None


ONE_WHEN_ON = frozenset({'sw', 'memsw', 'oport', 'btst', 'motor', 'power', 'cp'})
"""Functions that return 1 when on, although True is -1."""


def against_true(expression: Binary) -> Binary:
    """Convert `i = True` to `i <> 0`, which is its meaning in the SPEL+ manual (p420).

    This matters for functions such as Sw, which return 1, because True is -1 (p995).
    """
    for one, other in ((expression.left, expression.right), (expression.right, expression.left)):
        named = isinstance(one, Name) and one.name.lower() == 'true'
        if named and expression.operator in ('=', '<>'):
            turned = '<>' if expression.operator == '=' else '='
            return Binary(turned, other, Number(0, one.at, '0'), expression.at)
    return expression


class Scope:
    def __init__(
        self,
        shared: dict[str, Variable],
        functions: Mapping[str, Function],
        libraries: Mapping[str, tuple[int, Declare]],
        data: ProjectData,
        module: dict[str, Variable] | None = None,
    ) -> None:
        self._shared = shared
        self._module = {} if module is None else module
        self._local: dict[str, Variable] = {}
        self.functions = functions
        self.libraries = libraries
        self.data = data
        self.constants: dict[str, int | str] = {**CONSTANTS, **data.labels}

    def for_file(self, module: dict[str, Variable]) -> 'Scope':
        return Scope(self._shared, self.functions, self.libraries, self.data, module)

    def for_function(self) -> 'Scope':
        return self.for_file(self._module)

    def point_number(self, name: str) -> int | None:
        return self.data.point_labels.get(name.lower())

    def variable(self, name: str) -> Variable | None:
        key = name.lower()
        return self._local.get(key) or self._module.get(key) or self._shared.get(key)

    def add_local(self, variable: Variable) -> None:
        key = variable.name.lower()
        if key in self._local:
            text = f'{variable.name} is declared twice in the function'
            raise SyntaxProblem(variable.at, text, 'declaration')
        self._local[key] = variable

    def bounds(self, declared: Declaration, number: int) -> tuple[int, ...]:
        variable = declared.variables[number]
        result = []
        for expression in variable.bounds:
            bound = constant(expression, self.constants)
            if not isinstance(bound, int) or bound < 0:
                text = f'{variable.name}: the bounds of an array must be whole numbers from 0 on'
                raise SyntaxProblem(variable.at, text, 'declaration')
            result.append(bound)
        bounds = tuple(result)
        check_size(variable.name, declared.type, declared.scope, bounds, variable.at)
        return bounds


def check_size(
    name: str, type_name: str, scope: str, bounds: tuple[int, ...], at: Position
) -> None:
    numbers, strings = LIMITS[scope]
    maximum = strings if TYPES[type_name].kind == 's' else numbers
    if size(bounds) > maximum:
        text = (
            f'{name} has {size(bounds)} elements; {scope} arrays of this type: at most {maximum}'
        )
        raise SyntaxProblem(at, text, 'array-size')
