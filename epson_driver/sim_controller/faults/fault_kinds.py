# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The kinds of faults, as one table: effect, ports and parameters of each.

A fault disturbs the controller's messages, cuts or silences its connections, or is a failure of
the controller. No fault changes a byte from a client: a session receives the bytes that were sent,
or nothing. So no fault can cause a motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from epson_driver.simple_message import MAX_JOINTS

DATA_PORTS = ('motion', 'state', 'io')
"""The ports that carry messages. `all` of them is the default."""

REMOTE_PORT = 'remote'
"""The port through which users clear faults. It is disturbed only if named, and temporarily."""

MAX_SECONDS = 3600.0  # s
MAX_COUNT = 1_000_000

Value = float | None
"""A parameter's value. None: not specified, and the parameter's text describes the default."""


class FaultError(ValueError):
    """An invalid fault. The text names the fault, the parameter, its value and the limit."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter: a number from `low` to `high`, `whole` or not, or one of the `choices`."""

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
        """The allowed range, in words."""
        if self.choices:
            return ' or '.join(self.choices)
        unit = f' {self.unit}' if self.unit else ''
        number = 'whole number' if self.whole else 'number'
        return f'a {number} from {self.low:.12g} to {self.high:.12g}{unit}'

    def read(self, text: str) -> float:
        """Return the value of a text. Raises ValueError without a message if it is invalid."""
        if self.choices:
            return self.choices.index(text)
        value = int(text) if self.whole else float(text)
        if not self.low <= value <= self.high:  # also false for a value that is not finite
            raise ValueError
        return value

    def write(self, value: float) -> str:
        """Return the text that `read` converts to the value."""
        if self.choices:
            return self.choices[int(value)]
        return str(int(value)) if float(value).is_integer() else repr(value)


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of fault. `ports` are the ports that it can affect.

    `replies` limits it to replies to requests. `boots`: it closes every connection, including the
    requester's, and cannot be ended early.
    """

    text: str
    parameters: tuple[Parameter, ...]
    ports: tuple[str, ...] = ()
    default_ports: tuple[str, ...] = ()
    replies: bool = False
    boots: bool = False


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault with all its values and the ports it affects. Created by `fault_text.parse`."""

    name: str
    values: Mapping[str, Value]
    ports: tuple[str, ...] = ()

    @property
    def kind(self) -> Kind:
        """Its row in `FAULTS`."""
        return FAULTS[self.name]

    def number(self, name: str) -> float:
        """Return a value, or 0 if the fault lacks it or it is not specified."""
        return self.values.get(name) or 0.0


AFTER = Parameter('after', 'time until it begins', 0.0, unit='s')
SEED = Parameter(
    'seed',
    "what chance is drawn from; none: the simulation's seed",
    None,
    high=2**31 - 1,
    whole=True,
)
SKIP = Parameter(
    'skip', 'messages that pass before the first it strikes', 0, 0, MAX_COUNT, whole=True
)


def _for(default: float = 0.0, low: float = 0.0) -> Parameter:
    text = 'how long it lasts' if low else 'how long it lasts; 0: until it is cleared'
    return Parameter('for', text, default, low, unit='s')


def _count(default: int) -> Parameter:
    text = 'messages it strikes, then it ends; 0: no limit'
    return Parameter('count', text, default, 0, MAX_COUNT, whole=True)


def _seconds(text: str, default: float, high: float = 60.0) -> Parameter:
    return Parameter('seconds', text, default, 0.0, high, 's')


def _joint(text: str, default: int, low: int) -> Parameter:
    return Parameter('joint', text, default, low, MAX_JOINTS, whole=True)


def _on_links(text: str, *parameters: Parameter) -> Kind:
    """Return a fault of connections, which may be requested for the remote port too."""
    return Kind(text, (*parameters, AFTER), (*DATA_PORTS, REMOTE_PORT), DATA_PORTS)


def _on_messages(
    text: str, *parameters: Parameter, ports: tuple[str, ...], replies: bool = False
) -> Kind:
    """Return a fault of messages."""
    return Kind(text, (*parameters, SKIP, _for(), AFTER), DATA_PORTS, ports, replies)


def _of_controller(text: str, *parameters: Parameter, boots: bool = False) -> Kind:
    return Kind(text, (*parameters, AFTER), boots=boots)


FAULTS: dict[str, Kind] = {
    'cut': _on_links(
        'The cable is cut: every connection of the ports is closed at once, and new ones are '
        'closed as soon as they are open.',
        _for(1.0),
    ),
    'half_open': _on_links(
        'Silence: connections stay open, but no byte passes in either direction, and what is sent '
        'meanwhile is lost. A connection on which bytes of the client were lost is closed when it '
        'ends: a stream cannot go on with a hole in it.',
        _for(),
    ),
    'delay': _on_links(
        'Everything the controller sends comes later by the same time.',
        _seconds('how much later', 0.05),
        _for(),
    ),
    'jitter': _on_links(
        'Every message the controller sends comes later by a random time, in the same order.',
        _seconds('how much later at most', 0.05),
        SEED,
        _for(),
    ),
    'coalesce': _on_links(
        'What the controller sends is gathered for a time and arrives as one piece.',
        _seconds('how long it is gathered', 0.05, 10.0),
        _for(),
    ),
    'one_byte': _on_links(
        'The controller sends every byte in a segment of its own.',
        _for(),
    ),
    'bit_errors': _on_messages(
        'Bits of a message are flipped, anywhere in it, its length included.',
        Parameter('rate', 'share of the messages that are hit', 0.1, 0.0, 1.0),
        Parameter('bits', 'bits flipped in a message that is hit', 1, 1, 64, whole=True),
        SEED,
        _count(0),
        ports=('state',),
    ),
    'wrong_length': _on_messages(
        'The length at the beginning of a message is wrong.',
        Parameter('add', 'added to the true length', 4, -(2**16), 2**30, 'bytes', True),
        Parameter(
            'value',
            'the length itself; none: what `add` says',
            None,
            -(2**31),
            2**31 - 1,
            whole=True,
        ),
        _count(1),
        ports=('state',),
    ),
    'lost_reply': _on_messages(
        'The reply to a request is never sent; the request is carried out.',
        _count(1),
        ports=('motion',),
        replies=True,
    ),
    'late_reply': _on_messages(
        'The reply to a request is sent too late, and what follows on that connection not before '
        'it.',
        _seconds('how much later', 2.0),
        _count(1),
        ports=('motion',),
        replies=True,
    ),
    'wrong_byte_order': _on_messages(
        'The controller writes its messages in the other byte order: the four bytes of every word '
        'are reversed.',
        _count(0),
        ports=('motion', 'state', 'io'),
    ),
    'frozen_encoder': _of_controller(
        'The encoder of a joint stands still: the controller reports the position of the moment '
        'in which it began, whatever the arm does.',
        _joint('which joint; 0: all', 0, 0),
        _for(),
    ),
    'servo_error': _of_controller(
        'The servo of a joint reports an error: the motors lose their power until a person resets '
        'it; a critical one until the controller is booted again.',
        _joint('which joint', 1, 1),
        Parameter('critical', 'whether only booting helps', 0, choices=('no', 'yes')),
    ),
    'estop_at_point': _of_controller(
        'The E-stop is pressed when the arm begins to go to that point, counted since the fault '
        'began.',
        Parameter('point', 'at which point, counted from 1', 1, 1, MAX_COUNT, whole=True),
    ),
    'reboot': _of_controller(
        'The controller is switched off and on: all connections are closed, the remote ones too, '
        'the motors are off, and until it is up it takes no new connection. It cannot be cleared.',
        _for(5.0, 0.1),
        boots=True,
    ),
}
"""Name → kind of fault. The name of each fault's first parameter may be omitted."""
