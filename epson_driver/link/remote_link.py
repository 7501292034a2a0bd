# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A link to EPSON's Remote Ethernet port, which moves an arm without a SPEL+ program.

This one link replaces the motion link and the state link:

* A SPEL+ statement is sent as `$Execute`. The reply arrives when the statement has finished. STOP
  is sent as `$Abort`, whose reply is immediate. The arm may move until the reply to the aborted
  statement has arrived, too.
* The state is polled with `$GetStatus`, followed by `$Execute,"Print Agl(1), …"`. The time between
  two polls is `period` s. The controller only accepts the second command in AUTO, without E-stop,
  error or open door, and while it executes no statement. Otherwise joint positions are
  unavailable. This is no fault, so `joints_withheld` is set. The driver invents no joint values.
* A reply contains the name of its command, so the replies to `$GetStatus` and `$Abort` can
  overtake the reply to a running statement. A reply without a matching request ends the
  connection, because later replies could be matched wrongly.
* The controller serves one client. If the client disconnects, the controller still completes the
  client's command.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import NoReturn

from epson_driver.inputs import printable
from epson_driver.link import Link, LinkState, WireEvent
from epson_driver.link.connection import AnyFramer, Connection, ReceiveTimeout, wait_for_silence
from epson_driver.remote_ethernet.answers import (
    ask_flags,
    ask_positions,
)
from epson_driver.remote_ethernet.client import (
    Ask,
    RemoteError,
    RemoteErrorNumber,
    answer_to,
    without_password,
)
from epson_driver.simple_message import (
    ByteOrder,
    Dialect,
    FrameError,
    JointPosition,
    Message,
    Mode,
    Packet,
    Status,
    TriState,
    joint_data,
    topic,
)

MAX_LINE_BYTES = 8192
"""Maximum length of a line, bytes. A reply has at most 4,060 characters plus its command (RC+
7.0)."""


class LineFramer:
    """Splits bytes into lines, which end with CR, LF or both. Empty lines are dropped."""

    byte_order: ByteOrder | None = None

    def __init__(self) -> None:
        self.unread = b''  # bytes of an incomplete line
        self._lines: deque[bytes] = deque()

    def receive_data(self, data: bytes) -> None:
        """Add bytes. The computing time is linear in their number, even for empty lines."""
        *lines, self.unread = (self.unread + data).replace(b'\r', b'\n').split(b'\n')
        self._lines.extend(filter(None, lines))

    def next_packet(self) -> str | None:
        """Return the next line as printable text, or None if it is incomplete."""
        complete = bool(self._lines)
        line = self._lines.popleft() if complete else self.unread
        if len(line) > MAX_LINE_BYTES:
            self._lines.clear()
            self.unread = b''
            rule = f'a line has at most {MAX_LINE_BYTES} bytes'
            raise FrameError('line', f'{len(line)} bytes', rule)
        return printable(line.decode(errors='replace').strip()) if complete else None


ABORTED_TIMEOUT_S = 2.0  # wait for an aborted statement's reply before reconnecting, s

COMMAND_CONTINUES = (
    'the controller completes its command, unless the E-stop or the $Abort that is sent first on '
    'the next connection stops it'
)

AFTER_MOTION_S = 0.05  # between two polls after a motion, whose joints show rest

ONE_CLIENT = 'another Remote Ethernet client is connected, or the server is not running'

_FORBID_EXECUTE = {'Test', 'Teach', 'SError', 'Safeguard', 'EStop', 'Error', 'Paused', 'Running'}
"""Flags of GetStatus that prevent the controller from executing a statement."""

_SHOWN_CHARACTERS = 60

OnReply = Callable[[str | Exception], None]
"""Function called with the value of a reply, or with the error if no reply arrives.

The error is a RemoteError or a ConnectionError."""


@dataclass(eq=False)
class _Request:
    command: str  # the command without its `$`
    on_reply: OnReply
    sent: float = 0.0  # loop time of sending, s

    @property
    def name(self) -> str:
        return self.command.partition(',')[0].lower()


class RemoteLink(Link):
    """A Link to the Remote Ethernet port, which passes the polled state to `on_packet`.

    It is lost if no reply to a state request arrives for `timeout` s, even if other replies do.
    """

    def __init__(
        self,
        host: str,
        port: int,
        units: Sequence[str],
        *,
        on_packet: Callable[[Packet], None],
        on_state: Callable[[LinkState, str], None],
        password: str = '',
        period: float = 0.1,
        timeout: float = 1.0,
    ) -> None:
        super().__init__(
            'remote',
            host,
            port,
            on_packet=on_packet,
            on_state=on_state,
        )
        self._state_timeout = ReceiveTimeout(max(timeout, 2.0 * period))
        self._units = tuple(units)
        self._password = password
        self._period = period
        self._pending_requests: list[_Request] = []
        self._statements: deque[_Request] = deque()
        self._motion: _Request | None = None
        self._abort_time: float | None = None
        self._wake = asyncio.Event()
        self._motion_ended = False

    @property
    def moving(self) -> bool:
        return self._motion is not None

    def move(self, text: str, on_reply: OnReply) -> None:
        """Send `text`, SPEL+ statements that move the arm, as `$Execute`."""
        self._check_login()
        self._motion = _Request(f'Execute,"{text}"', on_reply)
        self.joints_withheld = True
        self._execute(self._motion)

    def abort(self, on_reply: OnReply) -> None:
        """Send `$Abort`, and drop a motion that has not been sent yet."""
        self._check_login()
        motion = self._motion
        if motion is not None and motion in self._statements:
            self._statements.remove(motion)
            self._motion = None
            motion.on_reply(RemoteError('Abort', RemoteErrorNumber.SYSTEM))
        if self._motion is not None and self._abort_time is None:
            self._abort_time = self._now()
        self._send(_Request('Abort', on_reply))

    def _check_login(self) -> None:
        if not self.connected:
            raise ConnectionError(f'remote link is {self.state.value}')

    def post(self, message: Message, on_reply: object) -> NoReturn:
        self.send_topic(message)

    def send_topic(self, message: Message) -> NoReturn:
        raise ConnectionError(f'{message} cannot be sent to a Remote Ethernet port')

    def follow(self, dialect: Dialect) -> None:
        """Do nothing, because text has no byte order."""

    async def ask(self, command: str) -> str:
        """Send a command, given without its `$`, and return the reply's value.

        Raises RemoteError if the controller refuses the command.
        """
        if not command.isprintable():
            shown = repr(without_password(command))
            raise ValueError(f'{shown} must be one command, a line of printable characters')
        answer: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        def on_reply(value: str | Exception) -> None:
            if answer.done():
                return
            if isinstance(value, str):
                answer.set_result(value)
            else:
                answer.set_exception(value)

        request = _Request(command, on_reply)
        if request.name != 'execute':
            self._send(request)
        elif self._motion is not None:
            raise RemoteError(command, RemoteErrorNumber.EXECUTING)
        else:
            self._execute(request)
        return await answer

    @asynccontextmanager
    async def session(self, timeout: float) -> AsyncIterator[Ask]:
        """Yield a function that sends a command and returns the answer, for several commands.

        Raises TimeoutError if the `with` block takes longer than `timeout` s.
        """
        self._check_login()
        async with asyncio.timeout(timeout):
            yield self.ask
        self._wake.set()

    def _new_framer(self) -> AnyFramer:
        return LineFramer()

    async def _serve(self, connection: Connection) -> str:
        connection.start()
        coroutines = self._log_in_and_poll(), self._watch_state()
        tasks = [asyncio.create_task(coroutine) for coroutine in coroutines]
        try:
            futures = (connection.ended, *tasks)
            await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
            why = next(future.result() for future in futures if future.done())
            if not self.connected and why == 'closed by the controller':
                why += f' at the login: {ONE_CLIENT}'
            return f'{why}; {COMMAND_CONTINUES}' if self.moving else why
        finally:
            for task in tasks:
                task.cancel()
            try:
                await asyncio.gather(*tasks, return_exceptions=True)
            finally:  # last: pending requests would otherwise never complete, and block others
                self._motion, self._abort_time, self.joints_withheld = None, None, False
                unanswered = [*self._pending_requests, *self._statements]
                self._pending_requests.clear()
                self._statements.clear()
                for request in unanswered:
                    request.on_reply(ConnectionError('the connection ended before the reply'))

    async def _watch_state(self) -> str:
        await wait_for_silence(self._state_timeout)
        return f'silent for {self._state_timeout.timeout:g} s'

    async def _log_in_and_poll(self) -> str:
        try:
            await self._ask_state(f'Login,{self._password}')
            self._establish()
            while True:
                self._wake.clear()
                wait = min(self._period, AFTER_MOTION_S) if self._motion_ended else self._period
                self._motion_ended = False
                await self._poll_state()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(wait):
                        await self._wake.wait()
                if self._abort_time and self._now() - self._abort_time > ABORTED_TIMEOUT_S:
                    return 'no reply to the aborted command'
        except (RemoteError, ConnectionError) as error:
            self.failure = error
            return str(error)

    async def _ask_state(self, command: str) -> str:
        answer = await self.ask(command)
        self._state_timeout.restart(self._now())
        return answer

    async def _poll_state(self) -> None:
        self.flags, number = await ask_flags(self._ask_state)
        joints: tuple[float, ...] | None = None
        powered: bool | None = None
        if self._motion is None and not _FORBID_EXECUTE.intersection(self.flags):
            with contextlib.suppress(RemoteError):  # the next flags contain the reason
                joints, powered = await ask_positions(self._ask_state, self._units)
        if self._motion is None:
            self.joints_withheld = joints is None
        self._on_packet(topic(_status(self.flags, number, powered, moving=self.moving)))
        if joints is not None:
            self._on_packet(topic(JointPosition(0, joint_data(joints))))

    def _execute(self, request: _Request) -> None:
        """Send a statement once no other statement runs, as a controller does not queue them."""
        self._statements.append(request)
        self._send_next()

    def _send_next(self) -> None:
        if self._statements and all(item.name != 'execute' for item in self._pending_requests):
            self._send(self._statements.popleft())

    def _send(self, request: _Request) -> None:
        connection = self._connection
        if connection is None:
            raise ConnectionError(f'remote link is {self.state.value}')
        request.sent = self._now()
        self._pending_requests.append(request)
        tap, self.trace = self.trace, None  # no password in a trace
        try:
            self._write(connection, f'${request.command}\r\n'.encode())
        finally:
            self.trace = tap
        if tap is not None:
            tap(WireEvent.SENT, f'${without_password(request.command)}\r\n'.encode())

    def _dispatch(self, packet: object) -> None:
        """Pass a reply to the oldest request with its command name."""
        line = str(packet)
        self.statistics.frames_received += 1
        for request in self._pending_requests:
            if (answer := answer_to(line, request.command)) is not None:
                break
        else:
            self.statistics.bad_frames['answer'] += 1
            if self._connection is not None:
                shown = line[:_SHOWN_CHARACTERS]
                self._connection.end(f"'{shown}' is not a reply to the request")
            return
        self._pending_requests.remove(request)
        self.statistics.reply_latencies.append(self.last_received - request.sent)
        if request is self._motion:
            self._motion = self._abort_time = None
            self._motion_ended = True
            self._wake.set()
        request.on_reply(answer)
        self._send_next()


def _status(flags: Sequence[str], number: int, powered: bool | None, *, moving: bool) -> Status:
    """Return the STATUS for a reply to GetStatus. `powered`: None if this was not polled."""
    active = set(flags)
    motors = TriState.UNKNOWN if powered is None else TriState(powered)
    if 'EStop' in active:
        motors = TriState.FALSE
    rest = TriState.UNKNOWN if 'Running' in active else TriState.FALSE
    manual = active & {'Teach', 'Test'}
    return Status(
        drives_powered=motors,
        e_stopped=TriState('EStop' in active),
        error_code=number,
        in_error=TriState(bool(active & {'Error', 'SError'})),
        in_motion=TriState.TRUE if moving else rest,
        mode=Mode.MANUAL if manual else Mode.AUTO if 'Auto' in active else Mode.UNKNOWN,
        motion_possible=TriState.FALSE if active & _FORBID_EXECUTE - {'Running'} else motors,
    )
