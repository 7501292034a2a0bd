# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The kinds of faults, as one table, and faults as text.

A fault disturbs messages of the controller, cuts or silences connections, or is a failure of the
controller itself. No fault changes the bytes that a client sends: a session receives these bytes
or nothing. So no fault can cause a motion.

The text of a fault is its name, followed by parameters `key=value`. Spaces, commas or a colon
separate them. One parser therefore reads the command line (`delay:seconds=0.2,port=state`), the
pendant's input (`delay seconds=0.2`) and the remote port. The key of the first parameter may be
omitted.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from textwrap import wrap

from epson_driver.simple_message import MAX_JOINTS

DATA_PORTS = ('motion', 'state', 'io')  # ports that carry simple messages

REMOTE_PORT = 'remote'
"""The port through which users clear faults. A fault of this port must have a duration."""

REAL_TIME_PORT = 'rtmc'
"""The UDP port of Real-time Motion Control. DDS delivers each message completely."""

MAX_SECONDS = 3600.0  # maximum value of a duration, s
MAX_COUNT = 1_000_000

Value = float | None
"""Value of a parameter, or None if it is not specified.

The parameter's text then describes the effect.
"""


class FaultError(ValueError):
    """The text of a fault is invalid.

    The message names the parameter, its value and the permitted values.
    """


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a fault: a number from `low` to `high`, or an index of `choices`.

    `text` describes it. `whole`: the number must be an integer.
    """

    name: str
    text: str
    default: Value
    low: float = 0.0
    high: float = MAX_SECONDS
    unit: str = ''
    whole: bool = False
    choices: tuple[str, ...] = ()

    @property
    def range(self) -> str:
        if self.choices:
            return ' or '.join(self.choices)
        unit = f' {self.unit}' if self.unit else ''
        number = 'whole number' if self.whole else 'number'
        return f'a {number} from {self.low:.12g} to {self.high:.12g}{unit}'

    def read(self, text: str) -> float:
        """Parse a value. Raises ValueError, without a message, if it is invalid."""
        if self.choices:
            return self.choices.index(text)
        value = int(text) if self.whole else float(text)
        if not self.low <= value <= self.high:  # also false for a value that is not finite
            raise ValueError
        return value

    def write(self, value: float) -> str:
        if self.choices:
            return self.choices[int(value)]
        return str(int(value)) if float(value).is_integer() else repr(value)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault, described by `text`, and the ports that it can affect.

    `replies`: it affects only replies to requests. `boots`: it closes all connections, including
    the connection of the client that requests it, and cannot be ended early.
    """

    text: str
    parameters: tuple[Parameter, ...]
    ports: tuple[str, ...] = ()
    default_ports: tuple[str, ...] = ()
    replies: bool = False
    boots: bool = False


@dataclass(frozen=True, slots=True)
class Fault:
    name: str
    values: Mapping[str, Value]
    ports: tuple[str, ...] = ()

    @property
    def kind(self) -> Kind:
        return FAULTS[self.name]

    def number(self, name: str) -> float:
        """Return the value of a parameter, or 0 if it does not exist or is not specified."""
        return self.values.get(name) or 0.0


AFTER = Parameter('after', 'time until its start', 0.0, unit='s')
SEED = Parameter(
    'seed',
    "random seed (none: the simulation's)",
    None,
    high=2**31 - 1,
    whole=True,
)
SKIP = Parameter(
    'skip', 'unaffected messages before the first affected one', 0, 0, MAX_COUNT, whole=True
)


def _for(default: float = 0.0, low: float = 0.0) -> Parameter:
    text = 'duration' if low else 'duration (0: until cleared)'
    return Parameter('for', text, default, low, unit='s')


def _count(default: int) -> Parameter:
    text = 'affected messages, after which it ends (0: no limit)'
    return Parameter('count', text, default, 0, MAX_COUNT, whole=True)


def _seconds(text: str, default: float, high: float = 60.0) -> Parameter:
    return Parameter('seconds', text, default, 0.0, high, 's')


def _joint(text: str, default: int, low: int) -> Parameter:
    return Parameter('joint', text, default, low, MAX_JOINTS, whole=True)


def _on_links(text: str, *parameters: Parameter) -> Kind:
    return Kind(text, (*parameters, AFTER), (*DATA_PORTS, REMOTE_PORT), DATA_PORTS)


def _on_messages(
    text: str, *parameters: Parameter, ports: tuple[str, ...], replies: bool = False
) -> Kind:
    return Kind(text, (*parameters, SKIP, _for(), AFTER), DATA_PORTS, ports, replies)


def _of_controller(text: str, *parameters: Parameter, boots: bool = False) -> Kind:
    return Kind(text, (*parameters, AFTER), boots=boots)


FAULTS: dict[str, Kind] = {
    'cut': _on_links(
        'The cable is cut: all connections of the ports are closed, and new ones are closed '
        'immediately.',
        _for(1.0),
    ),
    'half_open': _on_links(
        'Silence: connections stay open, but all data in both directions is lost. Connections '
        'that lost data of the client are closed at the end.',
        _for(),
    ),
    'delay': _on_links(
        'All messages of the controller are delayed by the same time.',
        _seconds('delay', 0.05),
        _for(),
    ),
    'jitter': _on_links(
        'Each message of the controller is delayed by a random time, without reordering.',
        _seconds('maximum delay', 0.05),
        SEED,
        _for(),
    ),
    'coalesce': _on_links(
        'Data of the controller is collected for a time and arrives as one segment.',
        _seconds('collection time', 0.05, 10.0),
        _for(),
    ),
    'one_byte': _on_links(
        'The controller sends each byte in a separate segment.',
        _for(),
    ),
    'bit_errors': _on_messages(
        'Bits of a message are flipped, including its length field.',
        Parameter('rate', 'fraction of affected messages', 0.1, 0.0, 1.0),
        Parameter('bits', 'bits flipped in an affected message', 1, 1, 64, whole=True),
        SEED,
        _count(0),
        ports=('state',),
    ),
    'wrong_length': _on_messages(
        'The length field of a message is wrong.',
        Parameter('add', 'added to the true length', 4, -(2**16), 2**30, 'bytes', True),
        Parameter(
            'value',
            'value of the length (none: true length plus `add`)',
            None,
            -(2**31),
            2**31 - 1,
            whole=True,
        ),
        _count(1),
        ports=('state',),
    ),
    'lost_reply': _on_messages(
        'The reply to a request is never sent, but the request is executed.',
        _count(1),
        ports=('motion',),
        replies=True,
    ),
    'late_reply': _on_messages(
        'The reply to a request is delayed, and later messages on the connection with it.',
        _seconds('delay', 2.0),
        _count(1),
        ports=('motion',),
        replies=True,
    ),
    'wrong_byte_order': _on_messages(
        'The controller uses the other byte order: the four bytes of each word are reversed.',
        _count(0),
        ports=('motion', 'state', 'io'),
    ),
    'frozen_encoder': _of_controller(
        'The encoder of a joint is frozen: the controller reports its position at the start of '
        'the fault.',
        _joint('joint number (0: all)', 0, 0),
        _for(),
    ),
    'servo_error': _of_controller(
        'The servo of a joint reports an error: the motors are off until it is reset, or, if it '
        'is critical, until the controller is booted.',
        _joint('joint number', 1, 1),
        Parameter('critical', 'whether only a boot resets it', 0, choices=('no', 'yes')),
    ),
    'estop_at_point': _of_controller(
        'The E-stop is pressed when the arm starts to move to a point, counted from the start of '
        'the fault.',
        Parameter('point', 'point number, from 1', 1, 1, MAX_COUNT, whole=True),
    ),
    'reboot': _of_controller(
        'The controller is switched off and on: all connections are closed, the motors are off, '
        'and connections are refused until it has booted. It cannot be cleared.',
        _for(5.0, 0.1),
        boots=True,
    ),
}

LINK_FAULTS: dict[str, frozenset[str]] = {
    REMOTE_PORT: frozenset(name for name, kind in FAULTS.items() if REMOTE_PORT in kind.ports),
    REAL_TIME_PORT: frozenset(('cut', 'half_open', 'delay', 'jitter', 'late_reply')),
}
"""The only port that a driver of some controllers uses → the faults that can affect it."""


COLUMNS = 80  # maximum line width of `describe`
_MAX_QUOTED_CHARACTERS = 40


def parse(text: str) -> Fault:
    """Return the fault that a text specifies, with defaults for missing parameters.

    Raises FaultError if the fault is unknown or a parameter or value is invalid.
    """
    name, *parts = [part for part in re.split(r'[\s,:]+', text.lower()) if part] or ['']
    if name not in FAULTS:
        raise FaultError(f'{_quote(name)} is not a fault: must be one of {", ".join(FAULTS)}')
    kind = FAULTS[name]
    texts: dict[str, str] = {}
    for position, part in enumerate(parts):
        key, separator, value = part.partition('=')
        if not separator and position == 0:
            key, value = kind.parameters[0].name, part
        elif not separator or not value:
            raise FaultError(f'{name}: {_quote(part)} must be key=value')
        if key in texts:
            raise FaultError(f'{name}: {key} is repeated')
        if key not in _keys(kind):
            raise FaultError(
                f'{name}: {_quote(key)} is unknown: must be one of {", ".join(_keys(kind))}'
            )
        texts[key] = value
    ports = _ports(name, kind, texts.pop('port')) if 'port' in texts else kind.default_ports
    values = {
        parameter.name: _value(name, parameter, texts.get(parameter.name))
        for parameter in kind.parameters
    }
    return on_ports(Fault(name, values), ports)


def on_ports(fault: Fault, ports: tuple[str, ...]) -> Fault:
    """Return the fault with these ports.

    Raises FaultError for the remote port if the fault has no duration, because clients could then
    not clear the fault.
    """
    if REMOTE_PORT in ports and not fault.number('for'):
        raise FaultError(
            f'{fault.name}: port = remote needs for = … s > 0, because it cannot be cleared'
        )
    return replace(fault, ports=ports)


def write(fault: Fault) -> str:
    """Return a fault as text, without parameters that have no effect (0 or None)."""
    parts = [fault.name]
    for parameter in fault.kind.parameters:
        value = fault.values[parameter.name]
        if value is not None and (value or parameter.default != 0):
            parts.append(f'{parameter.name}={parameter.write(value)}')
    if fault.ports:
        parts.append(f'port={"+".join(fault.ports)}')
    return ' '.join(parts)


def describe(names: Iterable[str] = FAULTS) -> str:
    lines = []
    for name in names:
        kind = FAULTS[name]
        message = [kind.text, *(f'{key}: {text}' for key, text in parameter_texts(kind).items())]
        lines.append(name)
        for item in message:
            lines += wrap(item, COLUMNS, initial_indent=' ' * 4, subsequent_indent=' ' * 6)
    return '\n'.join(lines)


def parameter_texts(kind: Kind) -> dict[str, str]:
    texts = {}
    for parameter in kind.parameters:
        default = 'none' if parameter.default is None else parameter.write(parameter.default)
        texts[parameter.name] = f'{parameter.text} ({parameter.range}; {default})'
    if kind.ports:
        default = '+'.join(kind.default_ports)
        texts['port'] = f'ports ({", ".join(kind.ports)}, several with +, all; {default})'
    return texts


def _keys(kind: Kind) -> tuple[str, ...]:
    names = tuple(parameter.name for parameter in kind.parameters)
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
    """Return the ports in a text such as `motion+state`. `all` excludes the remote port."""
    if text == 'all':
        return tuple(port for port in kind.ports if port != REMOTE_PORT)
    named = text.split('+')
    if not set(named) <= set(kind.ports):
        rule = f'must be all, or one or more of {", ".join(kind.ports)}, joined by +'
        raise FaultError(f'{name}: port = {_quote(text)}: {rule}')
    return tuple(port for port in kind.ports if port in named)


def _quote(text: str) -> str:
    return repr(
        text if len(text) <= _MAX_QUOTED_CHARACTERS else text[:_MAX_QUOTED_CHARACTERS] + '…'
    )
