# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""One connection to the remote port, through which an arm moves without a SPEL+ program.

It serves as the motion link and the state link of other controllers:

* A Statement is sent as `$Execute`, and its reply arrives when it has finished. STOP is sent as
  `$Abort`, whose reply is immediate. Until the aborted statement is also answered, the arm may
  move.
* The state is polled `period` s after the previous reply: `$GetStatus`, then
  `$Execute,"Print Agl(1), …"`. The controller only accepts the second while it executes nothing,
  in AUTO, without E-stop, error or open door. Otherwise joints are unavailable, and
  `joints_withheld` marks this as expected. The driver never substitutes joint values.
* Replies contain the name of their command, so `$GetStatus` and `$Abort` can overtake a running
  statement. A reply without a matching request ends the connection, because later replies would be
  unreliable, too.
* The controller serves one client. If the client disconnects, the controller still completes its
  command.
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
from epson_driver.link.connection import AnyFramer, Connection, ReceiveTimeout, silent
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
"""Maximum length of a line. A reply has at most 4,060 characters plus its command (RC+ 7.0)."""


class LineFramer:
    """Splits bytes into lines, which end with CR, LF or both. Empty lines are dropped."""

    byte_order: ByteOrder | None = None

    def __init__(self) -> None:
        self.unread = b''
        """Bytes of an incomplete line."""
        self._lines: deque[bytes] = deque()

    def receive_data(self, data: bytes) -> None:
        """Add bytes. The cost is linear in their number, even for empty lines."""
        *lines, self.unread = (self.unread + data).replace(b'\r', b'\n').split(b'\n')
        self._lines.extend(filter(None, lines))

    def next_packet(self) -> str | None:
        """Return the next line, printable, or None. Raises FrameError if a line is too long."""
        complete = bool(self._lines)
        line = self._lines.popleft() if complete else self.unread
        if len(line) > MAX_LINE_BYTES:
            self._lines.clear()
            self.unread = b''
            rule = f'a line has at most {MAX_LINE_BYTES} bytes'
            raise FrameError('line', f'{len(line)} bytes', rule)
        return printable(line.decode(errors='replace').strip()) if complete else None


ABORTED_TIMEOUT_S = 2.0
"""Timeout for the reply of an aborted statement, s. After it the link reconnects."""

GOES_ON = (
    'the controller continues to the end of its command. The E-stop stops it, and so does the '
    '$Abort that is sent first on the next connection'
)

ONE_CLIENT = 'another Remote Ethernet client is connected, or the server is not running'

_FORBID_EXECUTE = {'Test', 'Teach', 'SError', 'Safeguard', 'EStop', 'Error', 'Paused', 'Running'}
"""Flags that prevent the controller from executing a statement."""

_SHOWN_CHARACTERS = 60

OnAnswer = Callable[[str | Exception], None]
"""Receives the value of a reply, or the RemoteError or ConnectionError in place of it."""


@dataclass(eq=False)
class _Question:
    """A command without its `$`. `answered` is called with the reply's value, or the error."""

    command: str
    answered: OnAnswer
    sent: float = 0.0

    @property
    def name(self) -> str:
        return self.command.partition(',')[0].lower()


class RemoteLink(Link):
    """A Link to the remote port. `units`: 'rad' or 'm', one per joint.

    The polled state is passed to `on_packet` as STATUS and JOINT_POSITION. The link is lost when
    no state request is answered for `timeout` s, even if other replies arrive.
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
        self._unanswered = ReceiveTimeout(max(timeout, 2.0 * period))
        self._units = tuple(units)
        self._password = password
        self._period = period
        self._asked: list[_Question] = []
        self._executes: deque[_Question] = deque()
        self._motion: _Question | None = None
        self._aborted: float | None = None
        self._wake = asyncio.Event()
        self.flags: tuple[str, ...] = ()
        """Flags of the last GetStatus reply that were set."""

    @property
    def moving(self) -> bool:
        """Whether a statement that moves the arm is unanswered."""
        return self._motion is not None

    def move(self, text: str, answered: OnAnswer) -> None:
        """Send statements that move the arm as `$Execute`. Raises ConnectionError."""
        self._check_login()
        self._motion = _Question(f'Execute,"{text}"', answered)
        self.joints_withheld = True
        self._execute(self._motion)

    def abort(self, answered: OnAnswer) -> None:
        """Send `$Abort`, and drop a motion that has not been sent yet. Raises ConnectionError."""
        self._check_login()
        motion = self._motion
        if motion is not None and motion in self._executes:
            self._executes.remove(motion)
            self._motion = None
            motion.answered(RemoteError('Abort', RemoteErrorNumber.SYSTEM))
        if self._motion is not None and self._aborted is None:
            self._aborted = self._now()
        self._send(_Question('Abort', answered))

    def _check_login(self) -> None:
        if not self.connected:
            raise ConnectionError(f'remote link is {self.state.value}')

    def post(self, message: Message, on_reply: object) -> NoReturn:
        """Raise ConnectionError, as `tell`: the remote port takes text only."""
        self.tell(message)

    def tell(self, message: Message) -> NoReturn:
        """Raise ConnectionError: the remote port takes text only."""
        raise ConnectionError(f'{message} is nothing for a remote port')

    def follow(self, dialect: Dialect) -> None:
        """Do nothing, because text has no byte order."""

    async def ask(self, command: str) -> str:
        """Send a command, without its `$`, and return the value of its reply.

        Raises RemoteError if the controller refuses it, or for a statement while another one moves
        the arm. Raises ConnectionError.
        """
        if not command.isprintable():
            shown = repr(without_password(command))
            raise ValueError(f'{shown} must be one command, a line of printable characters')
        answer: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        def answered(value: str | Exception) -> None:
            if answer.done():
                return
            if isinstance(value, str):
                answer.set_result(value)
            else:
                answer.set_exception(value)

        question = _Question(command, answered)
        if question.name != 'execute':
            self._send(question)
        elif self._motion is not None:
            raise RemoteError(command, RemoteErrorNumber.EXECUTING)
        else:
            self._execute(question)
        return await answer

    @asynccontextmanager
    async def session(self, timeout: float) -> AsyncIterator[Ask]:
        """Yield a function like `client.logged_in`, limited to `timeout` s.

        Raises TimeoutError, and as `ask`. Commands that need the arm at rest are refused while it
        moves.
        """
        self._check_login()
        async with asyncio.timeout(timeout):
            yield self.ask
        self._wake.set()

    # --- the dialogue -----------------------------------------------------------------------

    def _new_framer(self) -> AnyFramer:
        return LineFramer()

    async def _serve(self, connection: Connection) -> str:
        connection.begin()
        tasks = [asyncio.create_task(part) for part in (self._talk(), self._watch())]
        try:
            ends = (connection.ended, *tasks)
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            why = next(end.result() for end in ends if end.done())
            if not self.connected and why == 'closed by the controller':
                why += f' at the login: {ONE_CLIENT}'
            return f'{why}; {GOES_ON}' if self.moving else why
        finally:
            for task in tasks:
                task.cancel()
            try:
                await asyncio.gather(*tasks, return_exceptions=True)
            finally:  # last: pending requests would otherwise never complete, and block others
                self._motion, self._aborted, self.joints_withheld = None, None, False
                unanswered, self._asked = [*self._asked, *self._executes], []
                self._executes.clear()
                for question in unanswered:
                    question.answered(ConnectionError('the connection ended before the reply'))

    async def _watch(self) -> str:
        """Wait until the state is unanswered for the timeout. Return why the link is lost."""
        await silent(self._unanswered)
        return f'silent for {self._unanswered.patience:g} s'

    async def _talk(self) -> str:
        """Log in, then poll the state. Return why the dialogue has ended."""
        try:
            await self._ask_state(f'Login,{self._password}')
            self._establish()
            while True:
                await self._look()
                self._wake.clear()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(self._period):
                        await self._wake.wait()
                if self._aborted and self._now() - self._aborted > ABORTED_TIMEOUT_S:
                    return 'no reply to the aborted command'
        except (RemoteError, ConnectionError) as error:
            return str(error)

    async def _ask_state(self, command: str) -> str:
        answer = await self.ask(command)
        self._unanswered.heard(self._now())
        return answer

    async def _look(self) -> None:
        """Poll the state, and publish it."""
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

    def _execute(self, question: _Question) -> None:
        """Send a command once no other is running. A controller does not queue commands."""
        self._executes.append(question)
        self._send_next()

    def _send_next(self) -> None:
        if self._executes and all(item.name != 'execute' for item in self._asked):
            self._send(self._executes.popleft())

    def _send(self, question: _Question) -> None:
        connection = self._connection
        if connection is None:
            raise ConnectionError(f'remote link is {self.state.value}')
        question.sent = self._now()
        self._asked.append(question)
        tap, self.trace = self.trace, None  # no password in a trace
        try:
            self._write(connection, f'${question.command}\r\n'.encode())
        finally:
            self.trace = tap
        if tap is not None:
            tap(WireEvent.SENT, f'${without_password(question.command)}\r\n'.encode())

    def _dispatch(self, packet: object) -> None:
        """Pass a reply to the oldest request with its name."""
        line = str(packet)
        self.statistics.frames_received += 1
        for question in self._asked:
            if (answer := answer_to(line, question.command)) is not None:
                break
        else:
            self.statistics.bad_frames['answer'] += 1
            if self._connection is not None:
                shown = line[:_SHOWN_CHARACTERS]
                self._connection.end(f"'{shown}' is not a reply to the request")
            return
        self._asked.remove(question)
        self.statistics.reply_latencies.append(self.last_received - question.sent)
        if question is self._motion:
            self._motion = self._aborted = None
            self._wake.set()
        question.answered(answer)
        self._send_next()


def _status(flags: Sequence[str], number: int, powered: bool | None, *, moving: bool) -> Status:
    """Return the STATUS for the flags of GetStatus, including the state of the motors.

    The motors' state is printed with the joints. Without joints, an E-stop means that they are
    off.
    """
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
