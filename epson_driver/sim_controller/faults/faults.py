# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The active faults of a controller, and the transports on which they act.

Faults are timed by the controller's clock. Random faults are reproducible, because each connection
has a separate random generator. Its seed consists of the controller's seed, the fault and the
connection's number on its port.
"""

import logging
import random
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.faults.disturbances import DISTURBANCES, OutgoingMessage, is_reply
from epson_driver.sim_controller.faults.fault_kinds import (
    FAULTS,
    LINK_FAULTS,
    REAL_TIME_PORT,
    REMOTE_PORT,
    Fault,
    FaultError,
    on_ports,
    write,
)
from epson_driver.sim_controller.ports import Send

MAX_ACTIVE_FAULTS = 16  # including faults that have not started

ANSWER_TIME_S = 0.1
"""Minimum delay before a fault of the remote port starts, s.

The command that requests the fault is thus answered before the fault starts.
"""

MAX_DELAYED_BYTES = 262_144
"""Maximum number of bytes delayed by faults on one connection. More bytes close the connection."""

_log = logging.getLogger(__name__)


class Actions(Protocol):
    """Effects of faults on the controller, which never move the arm. Joints are indices from 0."""

    def freeze(self, joint: int | None) -> None:
        """Freeze the reported position of one more joint, or unfreeze all joints (None)."""

    def servo_error(self, joint: int, critical: bool = False) -> None:
        """Trigger a joint's servo error, which switches the motors off."""

    def press_estop(self) -> None:
        """Press the E-stop, which may already be pressed."""

    def reboot(self, seconds: float) -> None:
        """Switch off, which closes all connections, and restart after `seconds`."""


class ActiveFault:
    """A fault from its request to its end. `in_effect`: whether it has started."""

    def __init__(self, fault: Fault, number: int, seed: str) -> None:
        self.fault = fault
        self.number = number
        self.in_effect = False
        self.until: Timer | None = None  # timer of the start, then of the end
        self._seed = seed
        self._to_skip = int(fault.number('skip'))
        self._messages_left = int(fault.number('count')) or None
        self._points = int(fault.number('point'))

    @property
    def used_up(self) -> bool:
        return self._messages_left == 0

    def affects(self, *, reply: bool) -> bool:
        """Return whether the fault affects a message. Each call counts one message."""
        if self.fault.kind.replies and not reply:
            return False
        if self.used_up:
            return False
        if self._to_skip:
            self._to_skip -= 1
            return False
        if self._messages_left is not None:
            self._messages_left -= 1
        return True

    def point_reached(self) -> bool:
        self._points -= 1
        return self._points == 0

    def chance(self, port: str, serial: int) -> random.Random:
        # The seed is a text, because the hash of a tuple differs between processes.
        return random.Random(f'{self._seed} {self.fault.name} {port} {serial}')  # noqa: S311

    def text(self, now: float) -> str:
        """Return the fault and its remaining time or count, in one line without commas."""
        remark = ''
        if self.until is not None:
            seconds = max(self.until.due - now, 0.0)
            remark = f'{seconds:.1f} s left' if self.in_effect else f'starts in {seconds:.1f} s'
        elif self._messages_left is not None:
            remark = f'{self._messages_left} messages left'
        elif self._points > 0:
            remark = f'{self._points} points left'
        return f'{write(self.fault)} ({remark})' if remark else write(self.fault)


class Faults:
    """The faults of one controller, in the order in which they apply to a message.

    `joints` is the number of joints. `link`: the only port that the driver uses, if it is one of
    LINK_FAULTS. Faults that disturb connections then always affect this port.
    """

    def __init__(
        self, clock: Clock, seed: int, actions: Actions, joints: int, *, link: str = ''
    ) -> None:
        self._clock = clock
        self._seed = seed
        self._actions = actions
        self._joints = joints
        self._link = link
        self._active: list[ActiveFault] = []
        self._frozen: set[int] = set()
        self._requests = 0
        self._transports: dict[FaultyTransport, None] = {}
        self._serials: Counter[str] = Counter()

    # Requests of users.

    def start(self, fault: Fault) -> None:
        """Start a fault, now or after the time `after` in its values, s.

        Raises FaultError if the joint does not exist, if too many faults are active, if a fault of
        the remote port has no duration, or if Real-time Motion Control cannot have the fault.
        """
        if fault.name in LINK_FAULTS.get(self._link, ()):
            fault = on_ports(fault, (self._link,))
        elif fault.ports and self._link == REAL_TIME_PORT:
            raise FaultError(f'{fault.name}: DDS delivers each message completely')
        joint = int(fault.number('joint'))
        if joint > self._joints:
            rule = f'the robot has {self._joints} joints'
            raise FaultError(f'{fault.name}: joint = {joint}: {rule}')
        if len(self._active) >= MAX_ACTIVE_FAULTS:
            raise FaultError(
                f'{fault.name}: {MAX_ACTIVE_FAULTS} faults are active: clear some first'
            )
        self._requests += 1
        fault_seed = fault.values.get('seed')
        seed = f'{self._seed} {self._requests}' if fault_seed is None else f'own {fault_seed:.0f}'
        active = ActiveFault(fault, self._requests, seed)
        self._active.append(active)
        delay = fault.number('after')
        if REMOTE_PORT in fault.ports or fault.kind.boots:
            delay = max(delay, ANSWER_TIME_S)
        if delay > 0.0:
            active.until = self._clock.after(delay, lambda: self._take_effect(active))
        else:
            self._take_effect(active)

    def clear(self, name: str | None = None) -> int:
        """End all faults, or those named `name`, and send delayed messages.

        Return the number of ended faults. A reboot cannot be ended. Raises FaultError if the named
        fault is unknown, inactive or cannot be ended.
        """
        if name is not None and name not in FAULTS:
            raise FaultError(f'{name!r} is not a fault: must be one of {", ".join(FAULTS)}')
        matches = [item for item in self._active if name in (None, item.fault.name)]
        ended = [item for item in matches if not (item.in_effect and item.fault.kind.boots)]
        if name is not None and not ended:
            reason = (
                'it cannot be cleared: it ends automatically' if matches else 'it is not active'
            )
            raise FaultError(f'{name}: {reason}')
        for active in ended:
            self._remove(active)
        self._changed(release=True)
        return len(ended)

    def active(self) -> list[str]:
        return [item.text(self._clock.now) for item in self._active]

    # Notifications and queries of the controller.

    def point_started(self) -> None:
        """Count a point to which the arm starts to move.

        A fault that the point triggers takes effect when the clock next advances.
        """
        for active in list(self._active):
            if (
                active.in_effect
                and active.fault.name == 'estop_at_point'
                and active.point_reached()
            ):
                _log.warning('fault: %s', active.text(self._clock.now))
                self._remove(active)
                self._clock.after(0.0, self._actions.press_estop)

    def rejects(self, port: str) -> bool:
        return any(active.fault.name == 'cut' for active in self._in_effect(port))

    # Requests of transports.

    def attach(self, transport: 'FaultyTransport') -> int:
        """Register a connection and return its number among all connections of its port."""
        self._transports[transport] = None
        self._serials[transport.port] += 1
        return self._serials[transport.port]

    def detach(self, transport: 'FaultyTransport') -> None:
        self._transports.pop(transport, None)

    def disturbing(self, port: str) -> list[ActiveFault]:
        return [item for item in self._in_effect(port) if item.fault.name in DISTURBANCES]

    def on_triggered(self, active: ActiveFault) -> None:
        if active.used_up:
            self._end(active)

    def _in_effect(self, port: str) -> Iterator[ActiveFault]:
        return (item for item in self._active if item.in_effect and port in item.fault.ports)

    def _take_effect(self, active: ActiveFault) -> None:
        fault = active.fault
        active.in_effect = True
        active.until = None
        duration = fault.number('for')
        if duration:
            active.until = self._clock.after(duration, lambda: self._end(active))
        _log.warning('fault: %s', active.text(self._clock.now))
        self._changed()
        if fault.name == 'cut':
            for transport in [
                transport for transport in self._transports if transport.port in fault.ports
            ]:
                transport.cut()
        elif fault.name == 'servo_error':
            self._remove(active)  # the error itself lasts until a reset
            joint = int(fault.number('joint')) - 1
            self._actions.servo_error(joint, bool(fault.number('critical')))
        elif fault.name == 'reboot':
            self._actions.reboot(duration)

    def _end(self, active: ActiveFault) -> None:
        self._remove(active)
        self._changed()

    def _remove(self, active: ActiveFault) -> None:
        if active.until is not None:
            active.until.cancel()
        self._active.remove(active)
        _log.warning('fault over: %s', write(active.fault))

    def _changed(self, release: bool = False) -> None:
        self._freeze()
        for transport in list(self._transports):
            transport.changed(release)

    def _freeze(self) -> None:
        frozen: set[int] = set()
        for active in self._active:
            if active.in_effect and active.fault.name == 'frozen_encoder':
                joint = int(active.fault.number('joint'))
                frozen |= {joint - 1} if joint else set(range(self._joints))
        if self._frozen - frozen:
            self._frozen = set()
            self._actions.freeze(None)
        for joint in sorted(frozen - self._frozen):
            self._actions.freeze(joint)
        self._frozen = frozen


@dataclass(frozen=True, slots=True)
class _Delayed:
    """Bytes to send at the time `due`, s.

    `gathered`: whether they are sent together with other gathered bytes that are due.
    """

    due: float
    data: bytes
    gathered: bool
    one_byte: bool


class FaultyTransport:
    """The transport between a session and its socket. No fault changes the order of its messages.

    `transmit` writes to the socket immediately. `hang_up` closes the connection and is called at
    most once, possibly within `send`. `is_reply` determines whether a message is a reply.
    """

    def __init__(
        self,
        port: str,
        clock: Clock,
        faults: Faults,
        transmit: Send,
        hang_up: Callable[[], None],
        is_reply: Callable[[bytes], bool] = is_reply,
    ) -> None:
        self.port = port
        self._clock = clock
        self._faults = faults
        self._transmit = transmit
        self._hang_up = hang_up
        self._is_reply = is_reply
        self._disturbing: list[tuple[ActiveFault, random.Random]] = []
        self._delayed: deque[_Delayed] = deque()
        self._timer: Timer | None = None
        self._gather_end = 0.0  # time at which gathered messages are sent, s
        self._silent = False
        self._lost_bytes = False
        self._closed = False
        self.delayed_bytes = 0
        self._plain = True
        self._serial = faults.attach(self)
        self.changed()

    def send(self, message: bytes) -> None:
        if self._plain:
            self._transmit(message)
        elif not self._closed:
            self._send_disturbed(message)

    def receive(self, data: bytes) -> bytes:
        """Return the bytes that the session receives: `data`, or b'' if a fault discards them."""
        if self._silent:
            self._lost_bytes = self._lost_bytes or bool(data)
            return b''
        return b'' if self._closed else data

    def close(self) -> None:
        self._closed = True
        self._plain = False
        self._drop_delayed()
        self._faults.detach(self)

    def cut(self) -> None:
        """Close the connection immediately."""
        if not self._closed:
            self.close()
            self._hang_up()

    def changed(self, release: bool = False) -> None:
        """Apply a change of the active faults.

        `release`: send the delayed messages if no fault affects this connection any more.
        """
        if self._closed:
            return
        known = dict(self._disturbing)
        self._disturbing = [
            (active, known.get(active) or active.chance(self.port, self._serial))
            for active in self._faults.disturbing(self.port)
        ]
        self._silent = any(item.fault.name == 'half_open' for item, _ in self._disturbing)
        if self._silent:
            self._drop_delayed()
        elif self._lost_bytes:
            _log.info('%s client: disconnected because a fault has discarded its bytes', self.port)
            self.cut()
            return
        if release and self._delayed and not self._disturbing:
            self._release(self._delayed[-1].due)
        self._update_plain()

    def _send_disturbed(self, message: bytes) -> None:
        outgoing = OutgoingMessage(message)
        for active, chance in tuple(self._disturbing):
            if not outgoing.data:
                break
            if active.affects(reply=self._is_reply(message)):
                DISTURBANCES[active.fault.name](outgoing, active.fault, chance)
                self._faults.on_triggered(active)
        if outgoing.data and not self._closed:
            self._schedule(outgoing)

    def _schedule(self, outgoing: OutgoingMessage) -> None:
        now = self._clock.now
        due = now + outgoing.delay
        if outgoing.gather:
            if due >= self._gather_end:
                self._gather_end = due + outgoing.gather
            due = self._gather_end
        if self._delayed:
            due = max(due, self._delayed[-1].due)
        message = _Delayed(due, outgoing.data, outgoing.gather > 0.0, outgoing.one_byte)
        if due <= now and not self._delayed:
            self._emit(message.data, message.one_byte)
            return
        if self.delayed_bytes + len(message.data) > MAX_DELAYED_BYTES:
            _log.warning('%s client: too much data delayed by faults: disconnected', self.port)
            self.cut()
            return
        self._delayed.append(message)
        self.delayed_bytes += len(message.data)
        self._plain = False
        if self._timer is None:
            self._set_timer()

    def _set_timer(self) -> None:
        delay = max(self._delayed[0].due - self._clock.now, 0.0)
        self._timer = self._clock.after(delay, self._due)

    def _due(self) -> None:
        self._timer = None
        self._release(self._clock.now)
        if self._delayed:
            self._set_timer()
        self._update_plain()

    def _release(self, until: float) -> None:
        """Transmit the messages that are due by `until`, s.

        Gathered messages are sent in one piece.
        """
        while self._delayed and self._delayed[0].due <= until:
            first = self._delayed.popleft()
            data = [first.data]
            while first.gathered and self._delayed and self._same_batch(self._delayed[0], first):
                data.append(self._delayed.popleft().data)
            whole = b''.join(data)
            self.delayed_bytes -= len(whole)
            self._emit(whole, first.one_byte)

    @staticmethod
    def _same_batch(message: _Delayed, first: _Delayed) -> bool:
        return message.gathered and (message.due, message.one_byte) == (first.due, first.one_byte)

    def _emit(self, data: bytes, one_byte: bool) -> None:
        (self._transmit_bytes if one_byte else self._transmit)(data)

    def _transmit_bytes(self, data: bytes) -> None:
        for index in range(len(data)):
            self._transmit(data[index : index + 1])

    def _drop_delayed(self) -> None:
        self._delayed.clear()
        self.delayed_bytes = 0
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _update_plain(self) -> None:
        self._plain = not (self._closed or self._disturbing or self._delayed)
