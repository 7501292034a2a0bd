# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The DDS transport of Real-time Motion Control in memory, for a loop in virtual time.

Messages arrive in order after a delay. A participant that hangs, dies or is cut off is lost after
LEASE_S, and is found again when it returns. Each participant runs in the context in which it was
opened, so that a test can suspend the process that it belongs to.
"""

import asyncio
import contextlib
import ctypes
from collections import deque
from collections.abc import Callable, Iterator
from contextvars import copy_context
from typing import Any
from unittest.mock import patch

from epson_driver.driver import channel
from epson_driver.rtmc.transport import Arrival, Transport, library
from epson_driver.sim_controller.network import servers
from epson_driver.sim_controller.network.pacer import Pacer
from epson_driver.sim_controller.rtmc_port import RtmcPort

LEASE_S = 1.0
"""Silence after which a participant is lost, s, as in interfaces/epson_rtmc."""

TICK_S = 0.05
"""Period in which a participant is announced and looks for others, s."""

OnArrival = Callable[[Arrival], None]


class Participant:
    """One side of the transport: the driver's, or the controller's at UDP port `port`."""

    def __init__(self, bus: 'DdsBus', port: int, on_arrival: OnArrival, *, serves: bool) -> None:
        self.port, self.serves = port, serves
        self.number = bus.new_number()
        self.seen = bus.now()
        self._bus = bus
        self._on_arrival = on_arrival
        self._matched: set[Participant] = set()
        self._arrivals: deque[tuple[Participant, bytes | None]] = deque()
        self._due = 0
        self._context = copy_context()
        self._loop = asyncio.get_running_loop()
        bus.participants.append(self)
        self._timer = self._loop.call_soon(self._tick)

    def write(self, data: bytes) -> bool:
        for peer in self._matched:
            peer.arrive(self, data)
        return bool(self._matched)

    async def close(self) -> None:
        self._timer.cancel()
        if self in self._bus.participants:
            self._bus.participants.remove(self)
            for peer in self._matched:
                peer.arrive(self, None)

    def arrive(self, sender: 'Participant', data: bytes | None) -> None:
        """Receive a message, or the departure of its sender, after the delay of the network."""
        self._arrivals.append((sender, data))
        self._loop.call_later(self._bus.delay(), self._take, 1, context=self._context)

    def _take(self, more: int = 0) -> None:
        self._due += more
        while self._due and not self._bus.cut_off(self.port):
            self._due -= 1
            sender, data = self._arrivals.popleft()
            if data is None:
                self._lose(sender)
            elif sender in self._matched and self in self._bus.participants:
                self._on_arrival(Arrival(sender.number, data, self._loop.time()))

    def _lose(self, peer: 'Participant') -> None:
        if peer in self._matched:
            self._matched.discard(peer)
            self._on_arrival(Arrival(peer.number, None, self._loop.time()))

    def _tick(self) -> None:
        bus = self._bus
        cut_off = bus.cut_off(self.port)
        if not cut_off:
            self.seen = bus.now()
        for peer in list(self._matched):
            if bus.now() - peer.seen > LEASE_S:
                self._lose(peer)
        for peer in bus.participants:
            pair = peer.port == self.port and peer.serves is not self.serves
            if pair and not cut_off and bus.now() - peer.seen <= TICK_S * 1.5:
                self._matched.add(peer)
        self._take()
        self._timer = self._loop.call_later(TICK_S, self._tick, context=self._context)


class VirtualTransport(Transport):
    """A client's side without DDS and thread. `write(data)` sends a message to the controller."""

    addresses = ('127.0.0.1', 7001), ('127.0.0.1', 7000)

    def __init__(self, write: Callable[[bytes], bool]) -> None:
        def send(data: Any, size: int) -> int:
            try:
                return write(data[:size])
            except Exception as error:  # noqa: BLE001 - the owner raises it
                self._on_failure(error)
                return 0

        pointer = ctypes.POINTER(ctypes.c_char)
        self._writer = ctypes.CFUNCTYPE(ctypes.c_int, pointer, ctypes.c_uint32)(send)
        self._use(library().epson_rtmc_without_dds(self._writer))

    def listen(
        self, on_arrival: Callable[[Arrival], None], on_failure: Callable[[Exception], None]
    ) -> None:
        self._on_arrival, self._on_failure = on_arrival, on_failure

    def arrive(self, arrival: Arrival) -> None:
        """Receive a message, and pass it on."""
        try:
            if arrival.data is None:
                self._on_arrival(arrival)
            else:
                self.receive(arrival.data, arrival.time, arrival.sender)
            while (passed := self.take()) is not None:
                self._on_arrival(passed)
        except Exception as error:  # noqa: BLE001 - the owner raises it
            self._on_failure(error)

    def receive(self, data: bytes, time: float = 0.0, sender: int = 1) -> None:
        """Receive a message, as the transport's thread."""
        self._call('receive', data, len(data), time, sender)


class _Client(VirtualTransport):
    """The driver's side."""

    def __init__(self, bus: 'DdsBus', port: int) -> None:
        self._side = Participant(bus, port, self.arrive, serves=False)
        super().__init__(self._side.write)

    async def aclose(self) -> None:
        await self._side.close()
        self.close()


class _Server:
    """The controller's side, instead of RtmcServer."""

    def __init__(self, bus: 'DdsBus', pacer: Pacer, port: int) -> None:
        self._pacer = pacer
        self._side = Participant(bus, port, self._receive, serves=True)
        self.close = self._side.close
        with pacer.present() as controller:
            self._port = RtmcPort(controller, self._side.write)

    def _receive(self, arrival: Arrival) -> None:
        try:
            with self._pacer.present():
                self._port.receive(arrival.sender, arrival.data)
        except Exception as error:  # noqa: BLE001 - raised by the pacer's `run`
            self._pacer.fail(error)


class DdsBus:
    """All participants. `delay` draws the time of a message in transit, s.

    `cut_off(port)`: whether messages of this UDP port are held back. `clock`: true time, s (None:
    the loop's).
    """

    def __init__(
        self,
        delay: Callable[[], float] = float,
        cut_off: Callable[[int], bool] = lambda _port: False,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self.delay = delay
        self.cut_off = cut_off
        self.now = clock or asyncio.get_running_loop().time
        self.participants: list[Participant] = []
        self._numbers = 0

    def new_number(self) -> int:
        self._numbers += 1
        return self._numbers

    async def connect(self, _host: str, port: int) -> Transport:
        return _Client(self, port)

    def _serve(self, pacer: Pacer, _address: str, port: int) -> Any:
        return _Server(self, pacer, port)

    @contextlib.contextmanager
    def used(self) -> Iterator[None]:
        """Use the bus instead of DDS, for drivers and controllers that are created meanwhile."""
        with (
            patch.object(channel, 'connect', self.connect),
            patch.object(servers, 'RtmcServer', self._serve),
        ):
            yield
