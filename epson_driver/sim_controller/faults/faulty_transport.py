# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The transport between a session and its socket, which applies the active faults."""

import logging
import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.faults.disturbances import DISTURBANCES, OutgoingMessage, is_reply
from epson_driver.sim_controller.faults.faults import ActiveFault, Faults
from epson_driver.sim_controller.ports import Send

MAX_DELAYED_BYTES = 262_144
"""Maximum number of bytes delayed by faults on one connection. More bytes close the connection."""

_log = logging.getLogger(__name__)


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
    """A connection whose messages are affected by faults. No fault changes their order.

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
        if not self._closed:
            self.close()
            self._hang_up()

    def changed(self, release: bool = False) -> None:
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
