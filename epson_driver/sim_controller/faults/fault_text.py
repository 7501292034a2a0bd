# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Faults as text, in both directions: a name, followed by any number of `key=value`.

Spaces, commas or a colon separate the parts. One parser therefore reads the command line
(`delay:seconds=0.2,port=state`), the pendant's input (`delay seconds=0.2`) and the remote port.
The first parameter needs no name: `estop_at_point 3`.
"""

import re
from collections.abc import Iterable
from dataclasses import replace
from textwrap import wrap

from epson_driver.sim_controller.faults.fault_kinds import (
    FAULTS,
    REMOTE_PORT,
    Fault,
    FaultError,
    Kind,
    Parameter,
    Value,
)

COLUMNS = 80
"""Line width of a description."""

_MAX_QUOTED_CHARACTERS = 40
"""Maximum characters of an invalid text that an error repeats."""


def parse(text: str) -> Fault:
    """Return the fault that a text names, with defaults for missing parameters.

    Raises FaultError with the parameter, its value and the allowed range.
    """
    name, *parts = [part for part in re.split(r'[\s,:]+', text.lower()) if part] or ['']
    if name not in FAULTS:
        raise FaultError(f'{_quote(name)} is no fault: must be one of {", ".join(FAULTS)}')
    kind = FAULTS[name]
    given: dict[str, str] = {}
    for position, part in enumerate(parts):
        key, separator, value = part.partition('=')
        if not separator and position == 0:
            key, value = kind.parameters[0].name, part
        elif not separator or not value:
            raise FaultError(f'{name}: {_quote(part)} must be key=value')
        if key in given:
            raise FaultError(f'{name}: {key} is given twice')
        if key not in _keys(kind):
            raise FaultError(
                f'{name}: {_quote(key)} is no parameter: must be one of {", ".join(_keys(kind))}'
            )
        given[key] = value
    ports = _ports(name, kind, given.pop('port')) if 'port' in given else kind.default_ports
    values = {each.name: _value(name, each, given.get(each.name)) for each in kind.parameters}
    return on_ports(Fault(name, values), ports)


def on_ports(fault: Fault, ports: tuple[str, ...]) -> Fault:
    """Return the fault on these ports. Raises FaultError if no client could clear it."""
    if REMOTE_PORT in ports and not fault.number('for'):
        raise FaultError(
            f'{fault.name}: port = remote needs for = … s, more than 0: nobody could clear it'
        )
    return replace(fault, ports=ports)


def write(fault: Fault) -> str:
    """Return the text of a fault with its port, omitting parameters that are 0 or None."""
    parts = [fault.name]
    for parameter in fault.kind.parameters:
        value = fault.values[parameter.name]
        if value is not None and (value or parameter.default != 0):
            parts.append(f'{parameter.name}={parameter.write(value)}')
    if fault.ports:
        parts.append(f'port={"+".join(fault.ports)}')
    return ' '.join(parts)


def describe(names: Iterable[str] = FAULTS) -> str:
    """Return a description of faults by name, with their parameters."""
    lines = []
    for name in names:
        kind = FAULTS[name]
        said = [kind.text, *(f'{key}: {text}' for key, text in parameter_texts(kind).items())]
        lines.append(name)
        for each in said:
            lines += wrap(each, COLUMNS, initial_indent=' ' * 4, subsequent_indent=' ' * 6)
    return '\n'.join(lines)


def parameter_texts(kind: Kind) -> dict[str, str]:
    """Return each parameter's meaning, range and default."""
    texts = {}
    for each in kind.parameters:
        default = 'none' if each.default is None else each.write(each.default)
        texts[each.name] = f'{each.text} ({each.range}; {default})'
    if kind.ports:
        default = '+'.join(kind.default_ports)
        texts['port'] = f'which ports ({", ".join(kind.ports)}, several with +, all; {default})'
    return texts


def _keys(kind: Kind) -> tuple[str, ...]:
    names = tuple(each.name for each in kind.parameters)
    return (*names, 'port') if kind.ports else names


def _value(name: str, parameter: Parameter, text: str | None) -> Value:
    if text is None:
        return parameter.default
    try:
        return parameter.read(text)
    except ValueError:
        rule = f'must be {parameter.range}'
        raise FaultError(f'{name}: {parameter.name} = {_quote(text)}: {rule}') from None


def _ports(name: str, kind: Kind, text: str) -> tuple[str, ...]:
    """Return the ports named, in the table's order. `all` excludes the remote port."""
    if text == 'all':
        return tuple(port for port in kind.ports if port != REMOTE_PORT)
    named = text.split('+')
    if not set(named) <= set(kind.ports):
        rule = f'must be {", ".join(kind.ports)}, several of them with + between, or all'
        raise FaultError(f'{name}: port = {_quote(text)}: {rule}')
    return tuple(port for port in kind.ports if port in named)


def _quote(text: str) -> str:
    return repr(
        text if len(text) <= _MAX_QUOTED_CHARACTERS else text[:_MAX_QUOTED_CHARACTERS] + '…'
    )
