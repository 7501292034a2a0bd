# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks arguments of the Python API against the annotations of the called method."""

import inspect
from collections.abc import Callable
from functools import cache, wraps
from os import PathLike
from types import NoneType, UnionType
from typing import Any, ParamSpec, TypeVar, get_args, get_origin

from epson_driver.api.errors import argument_errors
from epson_driver.inputs import Rule
from epson_driver.taught_points import plain

P = ParamSpec('P')
T = TypeVar('T')

_SAID: dict[Any, str] = {
    bool: 'True or False',
    str: 'the path of a file',
    PathLike: 'the path of a file',
    Callable: 'a function',
    NoneType: 'None',
}


def checked_arguments(method: Callable[P, T]) -> Callable[P, T]:
    """Decorate a method, awaited or not, so that it raises ArgumentError for invalid arguments.

    Flags, functions, paths and objects of this package are checked against their annotations.
    The method itself checks numbers, names and shapes, and raises ValueErrors. numpy numbers are
    converted to Python's.
    """
    call: Any = method
    code = call.__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]

    @cache
    def rules() -> dict[str, Rule | None]:
        return {name: _rule(each) for name, each in call.__annotations__.items()}

    def check(args: tuple[Any, ...], kwargs: dict[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        values, named = [plain(each) for each in args], {k: plain(v) for k, v in kwargs.items()}
        for name, value in [*zip(names, values, strict=False), *named.items()]:
            if (rule := rules().get(name)) is not None:
                rule.checked(value, name)
        return values, named

    @wraps(method)
    def run(*args: Any, **kwargs: Any) -> Any:
        with argument_errors():
            values, named = check(args, kwargs)
            return call(*values, **named)

    @wraps(method)
    async def run_awaited(*args: Any, **kwargs: Any) -> Any:
        with argument_errors():
            values, named = check(args, kwargs)
            return await call(*values, **named)

    return run_awaited if inspect.iscoroutinefunction(method) else run  # type: ignore[return-value]


def _rule(annotation: Any) -> Rule | None:
    """Return the rule for an argument, or None if the method checks it."""
    kinds = get_args(annotation) if isinstance(annotation, UnionType) else (annotation,)
    kinds = tuple(get_origin(kind) or kind for kind in kinds)
    classes = [kind for kind in kinds if isinstance(kind, type)]
    ours = [kind for kind in classes if kind.__module__.startswith('epson_driver.')]
    if len(classes) < len(kinds) or not all(kind in _SAID or kind in ours for kind in kinds):
        return None
    if kinds in ((str,), (str, NoneType)):  # a name: the method knows the valid ones
        return None
    said = [_SAID.get(kind, kind.__name__) for kind in classes]

    def read(value: Any) -> Any:
        if not isinstance(value, kinds):
            raise TypeError
        return value

    return Rule(read, f'must be {" or ".join(dict.fromkeys(said))}')
