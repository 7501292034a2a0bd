# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Which variable, function or label a name denotes, and limits of declarations."""

from collections.abc import Mapping

from epson_driver.spel.code import Variable
from epson_driver.spel.errors import Position, SyntaxProblem
from epson_driver.spel.project_data import ProjectData
from epson_driver.spel.syntax import (
    Apply,
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
"""Scope → maximum elements of an array of numbers, and of strings (SPEL+ manual p952)."""


def constant(expression: Expression, constants: Mapping[str, int | str]) -> int | float | None:
    """Return the value of a constant numeric expression, or None for another expression."""
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
"""Functions that return 1 instead of True."""


def against_true(expression: Binary, scope: 'Scope') -> Binary:
    """Return `Sw(1) = True` as `Sw(1) <> 0`. Programs use it, but Sw returns 1, and True is -1."""
    for one, other in ((expression.left, expression.right), (expression.right, expression.left)):
        if (
            expression.operator in ('=', '<>')
            and isinstance(one, Name)
            and one.name.lower() == 'true'
            and isinstance(other, Name | Apply)
            and other.name.lower() in ONE_WHEN_ON
            and scope.variable(other.name) is None
        ):
            turned = '<>' if expression.operator == '=' else '='
            return Binary(turned, other, Number(0, one.at, '0'), expression.at)
    return expression


class Scope:
    """The names that are visible in a file or in a function of it."""

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
        """Return the scope inside a file."""
        return Scope(self._shared, self.functions, self.libraries, self.data, module)

    def for_function(self) -> 'Scope':
        """Return the scope inside a function, initially without locals."""
        return self.for_file(self._module)

    def point_number(self, name: str) -> int | None:
        """Return the number of the point with a label, or None."""
        return self.data.point_labels.get(name.lower())

    def variable(self, name: str) -> Variable | None:
        """Return the variable with a name, or None."""
        key = name.lower()
        return self._local.get(key) or self._module.get(key) or self._shared.get(key)

    def add_local(self, variable: Variable) -> None:
        """Add a local variable. Raises SyntaxProblem if the function has already declared it."""
        key = variable.name.lower()
        if key in self._local:
            text = f'{variable.name} is declared twice in the function'
            raise SyntaxProblem(variable.at, text, 'declaration')
        self._local[key] = variable

    def bounds(self, declared: Declaration, number: int) -> tuple[int, ...]:
        """Return the bounds of a declared variable. Raises SyntaxProblem if they are invalid."""
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
    """Raise SyntaxProblem if an array is larger than its scope allows."""
    numbers, strings = LIMITS[scope]
    maximum = strings if TYPES[type_name].kind == 's' else numbers
    if size(bounds) > maximum:
        text = (
            f'{name} has {size(bounds)} elements; {scope} arrays of this type: at most {maximum}'
        )
        raise SyntaxProblem(at, text, 'array-size')
