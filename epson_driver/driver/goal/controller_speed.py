# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speed scaling by the controller's own smoother, which acts on the points that it has, too.

Only where the profile says that the program takes SPEED_SHARE. Points are sent as they are planned
then, so that the arm must never get one before it knows the share:

1. The share is told first on each connection. No point is sent on it before the controller has
   confirmed that it can do this; what follows is in order, as all goes over one connection.
2. A share that is refused, or not answered in time, stops everything: the arm gate closes. It is
   told again when somebody enables the arm.
3. A stream's setpoints are scaled where they are made: for them the share is 1.
"""

import asyncio
from collections.abc import Callable
from functools import partial

from epson_driver.driver.delivery.reply_rejection import reply_rejection
from epson_driver.link import Link, PendingRequest
from epson_driver.simple_message import Packet, SpeedShare

TIMEOUT_S = 1.0
"""A share that is not answered within this time counts as refused, s."""

LOOKS = 4
"""The time-out is cut into so many looks, each of which counts once, however late it is: an answer
that came while this process was not scheduled is read before the next one."""

ROUNDING = 1e-6
"""Between the share that was told and the one that is confirmed."""


class ControllerSpeed:
    """Tells the controller on a motion link at which share of all speeds to go.

    `share` returns the present one; `on_fault` is called with a clause if it is not confirmed.
    """

    def __init__(
        self, link: Link, share: Callable[[], float], on_fault: Callable[[str], None]
    ) -> None:
        self._link = link
        self._share = share
        self._on_fault = on_fault
        self._told: float | None = None
        self._able = False
        self._asked = self._answered = 0

    def greet(self) -> None:
        """Tell the share on a new connection."""
        self._told, self._able = None, False
        self._answered = self._asked  # what the last connection left open is over
        self.update()

    def update(self) -> None:
        """Tell the share if it is another one. Without a link the next greeting does."""
        share = self._share()
        if share == self._told:
            return
        self._told = None
        try:
            on_reply = partial(self._on_reply, self._asked + 1, share)
            waiting = self._link.post(SpeedShare(share), on_reply)
        except ConnectionError as error:
            if self._link.connected:
                self._fail(f'the speed scaling {share:g} could not be sent: {error}')
            return
        self._asked += 1
        self._told = share
        self._look(self._asked, waiting, LOOKS)

    def tell_again(self) -> None:
        """Tell the share once more if it was not confirmed."""
        if self._told is None:
            self.update()

    def before_point(self) -> None:
        """Make sure that a point may be sent. Raises ConnectionError with a clause."""
        if not self._able:
            raise ConnectionError(
                'the controller has not confirmed that it scales the speed, as its profile says '
                '(program.scales_speed)'
            )
        self.update()
        if self._told is None:
            raise ConnectionError('the speed scaling could not be sent')

    def _on_reply(self, number: int, share: float, packet: Packet, _now: float) -> None:
        if number <= self._answered:
            return
        self._answered = number
        message = packet.message
        why = reply_rejection(packet)
        if why is None:
            if isinstance(message, SpeedShare) and abs(message.share - share) <= ROUNDING:
                self._able = True
                return
            why = 'it confirms another one'
        self._fail(f'the controller refused the speed scaling {share:g} ({why})')

    def _look(self, number: int, waiting: PendingRequest, left: int) -> None:
        if number <= self._answered:
            return
        if left:
            loop = asyncio.get_running_loop()
            loop.call_later(TIMEOUT_S / LOOKS, self._look, number, waiting, left - 1)
            return
        self._answered = number
        self._link.give_up(waiting)
        self._fail(f'the controller did not answer the speed scaling within {TIMEOUT_S:g} s')

    def _fail(self, why: str) -> None:
        self._able, self._told = False, None
        self._on_fault(why)
