# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Declares the node's parameters from the table of settings, and runs the requested traces."""

import asyncio
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter

from epson_driver.error_texts import load_error_texts
from epson_driver.inputs import InputError, near_name, shown
from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.setup.setup import profile_defaults
from epson_driver.setup.table import ROWS, TABLE, Row, joint_rows
from epson_driver.trace import Trace, TraceError, open_trace
from epson_driver.trace.trace import MEGABYTE

Loaded = TypeVar('Loaded')

_log = logging.getLogger(__name__)


def descriptor(row: Row) -> ParameterDescriptor:
    shown_row = ParameterDescriptor(
        description=row.description + ('' if row.now else ' Read at the start.'),
        read_only=not row.now,
        additional_constraints=f'one of: {", ".join(row.choices)}' if row.choices else '',
    )
    if row.low is not None and row.high is not None:
        if isinstance(row.default, int):
            shown_row.integer_range = [
                IntegerRange(from_value=int(row.low), to_value=int(row.high), step=0)
            ]
        else:
            shown_row.floating_point_range = [
                FloatingPointRange(from_value=row.low, to_value=row.high, step=0.0)
            ]
    return shown_row


def declare(node: Node) -> dict[str, Any]:
    """Declare all parameters on an rclpy node and return their values by name.

    The controller's profile and the robot model determine some of the defaults. Raises InputError
    if a value is invalid, or ParameterException if rclpy rejects it. `robot` is an argument of the
    launch files only. As a parameter it is an error, because the node would ignore it and drive
    the default robot.
    """
    if 'robot' in (_overrides(node) or ()):
        raise InputError('parameter robot: is unknown; pass the file alone: client robot.yaml')
    values = declare_rows(node, [ROWS['controller']])
    defaults = profile_defaults(_loaded('controller', values, load_controller_profile))
    values |= declare_rows(node, [ROWS['robot_model']])
    model = _loaded('robot_model', values, load_robot_model)
    defaults['joint_names'] = list(model.joint_names)
    rows = [row for row in TABLE if row.name not in values]
    values |= declare_rows(
        node, [replace(row, default=defaults.get(row.name, row.default)) for row in rows]
    )
    _loaded('error_texts', values, load_error_texts)
    for joint, unit in zip(values['joint_names'], model.limits.units, strict=False):
        values |= declare_rows(node, joint_rows(joint, unit))
    return values


def undeclared(node: Node) -> Iterator[str]:
    """Yield a warning for each given parameter that the node does not have."""
    overrides = _overrides(node)
    if overrides is None:
        yield 'this rclpy does not list the given parameters: misspelled ones are ignored'
        return
    for name in overrides:
        if not node.has_parameter(name):
            near = near_name(name, node.get_parameters_by_prefix(''))
            yield f'parameter {name} is ignored: it is unknown' + (
                f'; did you mean {near}?' if near else ''
            )


def _overrides(node: Node) -> dict[str, Parameter] | None:
    """Return the parameters given at the start by name, or None if rclpy does not store them.

    rclpy stores them in a private attribute. Its option
    automatically_declare_parameters_from_overrides is no alternative: it fails for an empty array
    before `declare` can report the parameter's name.
    """
    return getattr(node, '_parameter_overrides', None)


def rejection(changes: Iterable[Parameter]) -> str:
    """Return why a parameter cannot have its new value, or ''. rclpy checks ranges and types."""
    for change in changes:
        if change.name in ROWS and ROWS[change.name].choices:
            try:
                ROWS[change.name].allowed.checked(change.value, f'parameter {change.name}')
            except InputError as error:
                return str(error)
    return ''


def declare_rows(node: Node, rows: Iterable[Row]) -> dict[str, Any]:
    values = {}
    for row in rows:
        value = _declared(node, row)
        if isinstance(row.default, list):
            value = list(value or ())  # rclpy has None for []
        if value is None:
            raise InputError(f'parameter {row.name}: has no value')
        row.allowed.checked(value, f'parameter {row.name}')
        values[row.name] = value
    return values


def _declared(node: Node, row: Row) -> Any:
    """Declare a parameter and return its value.

    Integers are accepted for doubles, even in a list.
    """
    try:
        return node.declare_parameter(row.name, row.default, descriptor(row)).value
    except InvalidParameterTypeException:
        given = node.declare_parameter(row.name, None, ParameterDescriptor(dynamic_typing=True))
        node.undeclare_parameter(row.name)
        kinds = given.type_, Parameter(row.name, value=row.default).type_
        if kinds == (Parameter.Type.INTEGER, Parameter.Type.DOUBLE):
            exact: Any = float(given.value)
        elif kinds == (Parameter.Type.INTEGER_ARRAY, Parameter.Type.DOUBLE_ARRAY):
            exact = [float(value) for value in given.value]
        else:
            raise
        return node.declare_parameter(row.name, exact, descriptor(row), ignore_override=True).value


def _loaded(name: str, values: dict[str, Any], load: Callable[[str], Loaded]) -> Loaded:
    try:
        return load(values[name])
    except (OSError, InputError) as error:
        raise InputError(f'parameter {name} = {shown(values[name])}: {error}') from error


class Tracing:
    """Starts and ends traces according to the parameters. Must be created in the driver's loop.

    Any peer in the ROS domain may set `trace_file` and `trace_size`. `trace_folder` can only be
    set when the driver is started.
    """

    def __init__(self, trace: Trace, values: Mapping[str, Any]) -> None:
        self._trace = trace
        self._folder: str = values['trace_folder']
        self._loop = asyncio.get_running_loop()
        try:
            self.change(values)
        except TraceError as error:
            _log.error('%s', error)

    def change(self, values: Mapping[str, Any]) -> None:
        """Apply new values of the trace parameters. Any thread may call this."""
        name = values.get('trace_file')
        file = open_trace(self._folder, name) if name else None
        if 'trace_size' in values:
            self._call(setattr, self._trace, 'largest', values['trace_size'] * MEGABYTE)
        if file is not None:
            self._call(self._trace.begin, file)
        elif name is not None:
            self._call(self._trace.end, 'the parameter trace_file was cleared')

    def _call(self, function: Callable[..., object], *arguments: object) -> None:
        self._loop.call_soon_threadsafe(function, *arguments)
