# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The session of one client of the remote port: lines with commands, and their answers.

A line ends with CR LF, LF or CR. As on a real controller, a client is disconnected if it does not
log in in time, or if it is silent for too long after the login.
"""

import logging
from collections.abc import Callable

from epson_driver.remote_ethernet.client import RemoteErrorNumber
from epson_driver.sim_controller.clock import Timer
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.ports import Send
from epson_driver.sim_controller.remote.remote_commands import MAX_CHARACTERS, Dialogue, answer

MAX_LINE_CHARACTERS = MAX_CHARACTERS + len('$Execute,""')
"""Maximum length of a line without its end. A client that sends a longer one is disconnected."""

LOGIN_TIMEOUT_S = 300.0
_ROUNDING_S = 1e-6  # s
_CR, _LF = b'\r'[0], b'\n'[0]

_log = logging.getLogger(__name__)


class RemoteSession:
    """The session of one remote client, with a separate login.

    Several sessions can exist at a time.
    """

    def __init__(
        self,
        controller: Controller,
        send: Send,
        hang_up: Callable[[], None],
    ) -> None:
        self._dialogue = Dialogue(controller, self._reply, controller.clients.check_login)
        self._clock = controller.clock
        self._timeout = controller.profile.remote.session_timeout
        self._send = send
        self._hang_up = hang_up
        self._line = bytearray()
        self._after_cr = False
        self._open = True
        self.has_accepted_command = False  # an accepted login, `$Sim,…` or other command
        self.last_command_time = self._clock.now  # s, initially the time of the connection
        self._timer: Timer | None = None
        self._watch()

    @property
    def logged_in(self) -> bool:
        return self._dialogue.logged_in

    def receive(self, data: bytes) -> None:
        for byte in data:
            if not self._open:
                return
            after_cr, self._after_cr = self._after_cr, byte == _CR
            if byte in (_CR, _LF):
                if not (byte == _LF and after_cr):
                    self._answer()
            elif len(self._line) < MAX_LINE_CHARACTERS:
                self._line.append(byte)
            else:
                self._send(b'!,%d\r\n' % RemoteErrorNumber.FORMAT)
                self._end(f'a line of more than {MAX_LINE_CHARACTERS} characters')

    def closed(self) -> None:
        self._open = False
        self._line.clear()
        if self._timer is not None:
            self._timer.cancel()

    def _answer(self) -> None:
        text = self._line.decode('ascii', errors='replace')
        self._line.clear()
        self.last_command_time = self._clock.now
        if not text:  # some clients end a line with CR CR LF
            return
        try:
            reply = answer(self._dialogue, text)
        except ConnectionRefusedError as error:
            self._end(str(error))
            return
        if reply is not None:
            self.has_accepted_command |= reply.startswith('#')
            self._reply(reply)

    def _reply(self, reply: str) -> None:
        if self._open:  # the connection may have ended during the command
            shown = (sign if sign.isprintable() or sign in '\r\n' else '?' for sign in reply)
            self._send(''.join(shown).encode() + b'\r\n')
            self._watch()

    @property
    def _allowed_silence(self) -> float:
        """Timeout for a silent client, s (0: no timeout)."""
        return self._timeout if self._dialogue.logged_in else LOGIN_TIMEOUT_S

    def _watch(self) -> None:
        """Set the timer for the timeout of a silent client.

        An existing timer remains if it is due early enough.
        """
        due = self.last_command_time + self._allowed_silence
        if not self._allowed_silence or (self._timer is not None and self._timer.due <= due):
            return
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._clock.after(max(due - self._clock.now, 0.0), self._check_timeout)

    def _check_timeout(self) -> None:
        self._timer = None
        if self._dialogue.controller.command_window.executes:  # the client waits for its result
            self.last_command_time = self._clock.now
        if (
            self._allowed_silence
            and self._clock.now >= self.last_command_time + self._allowed_silence - _ROUNDING_S
        ):
            self._end(f'no command for {self._allowed_silence:g} s')
        else:
            self._watch()

    def _end(self, reason: str) -> None:
        _log.warning('remote client: %s: closed', reason)
        self.closed()
        self._hang_up()
