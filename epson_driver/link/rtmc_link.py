# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A link to an RC800 with Real-time Motion Control, which replaces the motion and state links.

* The motion mode of the controller is enabled only during a motion (`rtmc_motion.py`). At rest,
  and after each stop, no message of this driver can move the arm.
* At rest the joints and the motors are polled, because the notices contain neither.
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NoReturn

import numpy as np

from epson_driver.error_texts import ErrorText, ErrorTexts
from epson_driver.inputs import printable
from epson_driver.link.connection import (
    Address,
    ReceiveTimeout,
    Tap,
    WireEvent,
    wait_for_silence,
)
from epson_driver.link.link import Link
from epson_driver.link.rtmc_motion import (
    BUFFER,
    END_TIMEOUT_S,
    NO_REPLY,
    REPLY_TIMEOUT_S,
    OnReply,
    RtmcMotion,
)
from epson_driver.link.states import LinkEvent, LinkState
from epson_driver.motion import JointLimits
from epson_driver.rtmc.messages import (
    JOINTS_DATA,
    OperationMode,
    Request,
    RtmcError,
    RtmcMessage,
    RtmcStatus,
    decode,
    decode_text,
)
from epson_driver.rtmc.session import RefusedError, RtmcSession
from epson_driver.rtmc.stream_feeder import StreamFeeder
from epson_driver.rtmc.transport import (
    DISCOVERY_PERIOD_S,
    DISCOVERY_TIMEOUT_S,
    OWN,
    Arrival,
    Connect,
    Transport,
    TransportError,
)
from epson_driver.simple_message import (
    Dialect,
    JointPosition,
    JointTrajPt,
    Message,
    Packet,
    joint_data,
    topic,
)

SAME = 1e-4  # maximum difference of polled joints that counts as rest, rad or m

_log = logging.getLogger(__name__)


class RtmcLink(Link):
    """A Link to an RC800, which passes its state and unexpected failures to `on_packet`.

    `limits`: limits of the joints that the controller uses. `model`: name of the robot model.
    `cycle`: time between two targets, s. The link is lost if no message arrives for `timeout` s.
    `errors`: table of error texts, to which the controller's own texts are added.
    """

    def __init__(
        self,
        host: str,
        port: int,
        limits: JointLimits,
        model: str,
        *,
        on_packet: Callable[[Packet], None],
        on_state: Callable[[LinkState, str], None],
        password: str = '',
        cycle: float = 0.002,
        period: float = 0.02,
        timeout: float = 1.0,
        errors: ErrorTexts | None = None,
        connect: Connect,
    ) -> None:
        self._transport: Transport | None = None
        super().__init__('rtmc', host, port, on_packet=on_packet, on_state=on_state)
        self._limits = limits
        self._model = model.upper().replace('_', '-')
        self._password = password
        self._period = period
        self._open = connect
        self._errors = errors
        self._asked = 0  # error number whose text was requested
        self._silence = ReceiveTimeout(timeout)
        self.session: RtmcSession | None = None
        self._sender: int | None = None  # of the messages of this session
        self._ended: asyncio.Future[str]  # why the session ends: no further motion begins
        self.gone = False
        self._motion = RtmcMotion(self, limits, cycle, on_packet)
        self._wake = asyncio.Event()
        self._status: RtmcStatus | None = None
        self._powered: bool | None = None
        self._in_motion = False
        self.joints: tuple[float, ...] = (0.0,) * len(limits.names)
        self.joints_at = 0.0
        self.load: tuple[float, float, int] | None = None

    # Requests of the driver.

    @property
    def moves(self) -> bool:
        """Whether a motion is executed, during which most requests are refused."""
        return self._motion.active

    def scale(self, requested: Callable[[], float]) -> Callable[[], float]:
        """Move along all points at the requested rate, above 0. Return a function for the rate."""
        self._motion.requested_rate = requested
        return lambda: self._motion.rate

    def move(self, point: JointTrajPt, on_reply: OnReply) -> None:
        """Move to a point after all earlier points. `on_reply` is called when it is accepted."""
        self._check_connected()
        if self.closing:
            raise ConnectionError(f'the {self.name} link is being closed')
        self._motion.move(point, on_reply)

    def follow_stream(self, stream: StreamFeeder) -> None:
        """Begin to follow a stream, if the link is available."""
        if self.connected and not self.closing:
            self._motion.follow(stream)

    def stop(self, on_reply: OnReply) -> None:
        """Discard all points, and brake. `on_reply` is called when the new targets are set."""
        self._check_connected()
        self._motion.stop()
        self._confirm(on_reply)

    def accept(self, on_reply: OnReply) -> None:
        """Acknowledge a setpoint of a stream, whose motion the tracker already sends."""
        self._check_connected()
        self._confirm(on_reply)

    def _confirm(self, on_reply: OnReply) -> None:
        asyncio.get_running_loop().call_soon(self._motion.acknowledge, 0, on_reply)

    def _check_connected(self) -> None:
        if not self.connected or self.session is None:
            raise ConnectionError(f'{self.name} link is {self.state.value}')

    def post(self, message: Message, on_reply: object) -> NoReturn:
        self.send_topic(message)

    def send_topic(self, message: Message) -> NoReturn:
        raise ConnectionError(f'{message} cannot be sent to Real-time Motion Control')

    def follow(self, dialect: Dialect) -> None:
        """Do nothing, because the protocol has one byte order."""

    def reconnect(self, why: str) -> None:
        if self.session is not None:
            self._end(why)

    async def switch_motors(self, on: bool) -> None:
        """Switch the motors and, when on, the power to high. Raises RefusedError, TimeoutError."""
        self._motion.stop()
        await self._motion.wait()
        await self.ask(Request.SET_MOTORS, int(on))
        if on:
            await self.ask(Request.SET_POWER, 1)
        self._wake.set()

    async def reset(self) -> None:
        await self.ask(Request.RESET)

    # The connection.

    async def _connect_and_receive(self) -> float | None:
        self._ended, self.gone = asyncio.get_running_loop().create_future(), False
        self._sender = None
        where = f'{self.host}:{self.port}'
        try:
            transport = await self._open(self.host, self.port)
        except TransportError as error:
            self.failure = error
            self._step(LinkEvent.FAILED, str(error))
            return None
        self._transport = transport
        transport.trace(self._tap is not None)
        session = RtmcSession(
            transport,
            self._limits.units,
            self._on_notice,
            self._on_moved,
            self._motion.on_problem,
        )
        transport.listen(partial(self._arrived, session), self.fail)
        established: float | None = None
        why = 'closed'
        try:
            if (hello := await self._discover(session)) is not None:
                self.session = session
                self.last_received = self._now()
                self._on_event(WireEvent.OPENED)
                self._silence.restart(self._now())
                work = asyncio.create_task(self._serve_session(hello))
                watch = asyncio.create_task(wait_for_silence(self._silence))
                try:
                    futures = (self._ended, work, watch)
                    await asyncio.wait(futures, return_when=asyncio.FIRST_COMPLETED)
                    self.gone = self.gone or watch.done()
                    why = f'silent for {self._silence.timeout:g} s'
                    why = next((future.result() for future in futures[:2] if future.done()), why)
                finally:
                    established = self.statistics.connected_since
                    await self._close_session(work, watch)
            else:
                why = 'no controller with Real-time Motion Control answers'
        finally:
            self._on_event(WireEvent.CLOSED)
            self.session = self._transport = None
            await transport.aclose()
        event = LinkEvent.LOST if self.connected else LinkEvent.FAILED
        self.statistics.connected_since = None
        self._step(event, f'{where}: {why}')
        return established

    async def _discover(self, session: RtmcSession) -> asyncio.Future[RtmcMessage] | None:
        """Request a session with a discovered controller. Return the pending reply, or None."""
        hello = RtmcMessage(Request.CONNECT, 1, 0, self._password.encode() or b'\0')
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(DISCOVERY_TIMEOUT_S):
                while True:
                    with contextlib.suppress(ConnectionError):
                        return session.request(hello)
                    await asyncio.sleep(DISCOVERY_PERIOD_S)
        return None

    async def _serve_session(self, hello: asyncio.Future[RtmcMessage]) -> str:
        """Set up the session, then poll the state at rest. Return why the session ends."""
        try:
            async with asyncio.timeout(REPLY_TIMEOUT_S):
                await hello
            self._status = RtmcStatus.decode(await self.ask(Request.STATUS))
            self._establish()
            prepared = False
            while True:
                self._wake.clear()
                if not self._motion.active:
                    prepared = prepared or await self._prepare()
                    await self._poll()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(self._period):
                        await self._wake.wait()
        except (RefusedError, RtmcError) as error:
            return str(error)
        except TimeoutError:
            return NO_REPLY

    async def _prepare(self) -> bool:
        """Set formats and buffer, and check the model. Return False if the mode is not Auto.

        Raises RtmcError if the controller has another robot.
        """
        if self._status is None or self._status.mode is not OperationMode.AUTO:
            return False
        await self.ask(Request.SET_SEND_FORMAT, 0)
        await self.ask(Request.SET_RECEIVE_FORMAT, 0)
        await self.ask(Request.SET_BUFFER, BUFFER)
        if (await self.ask(Request.CHECK_MODEL, data=self._model.encode())).low:
            return True
        name = (await self.ask(Request.MODEL)).data.rstrip(b'\0').decode(errors='replace')
        raise RtmcError(f'the robot is a {name}, not a {self._model}: configure its model')

    async def _poll(self) -> None:
        joints = powered = None
        with contextlib.suppress(RefusedError):  # a motion has begun, or the mode is not Auto
            joints = (await self.ask(Request.JOINTS)).values(JOINTS_DATA)
            powered = bool((await self.ask(Request.MOTORS)).low)
        if joints is not None and self.session is not None and not self._motion.active:
            self._powered = powered
            positions = self.session.positions(joints)
            self._in_motion = bool(np.any(np.abs(np.subtract(positions, self.joints)) > SAME))
            self._on_joints(positions, self.last_received)
        if self._status is not None and self._status.error != self._asked:
            await self._learn_text(self._status.error)
        self._publish_status()

    async def _learn_text(self, error: int) -> None:
        """Request the text of an error number that the table lacks."""
        self._asked = error
        if error and self._errors is not None and error not in self._errors:
            with contextlib.suppress(RefusedError):
                if text := decode_text((await self.ask(Request.MESSAGES, error)).data):
                    self._errors[error] = ErrorText(printable(text))

    async def ask(self, number: Request, low: int = 0, data: bytes = b'\0') -> RtmcMessage:
        """Send a request, and return the reply.

        Raises RefusedError, TimeoutError, or ConnectionError if the link is down.
        """
        if self.session is None:
            raise ConnectionError(f'{self.name} link is {self.state.value}')
        answer = self.session.request(RtmcMessage(number, low, 0, data))
        async with asyncio.timeout(REPLY_TIMEOUT_S):
            return await answer

    async def _close_session(self, *tasks: asyncio.Task[str] | asyncio.Task[None]) -> None:
        """Brake, and end the motion and the session in an orderly way if the link still works."""
        for task in tasks:
            task.cancel()
        self._end('closed')
        try:
            await self._motion.brake()
            await asyncio.gather(*tasks, return_exceptions=True)
            if not self.gone:
                with contextlib.suppress(TimeoutError, RefusedError):
                    async with asyncio.timeout(END_TIMEOUT_S):
                        await self.ask(Request.CONNECT, 0)
        finally:
            self.gone = True
            await self._motion.close()
            self._status = self._powered = None

    def _end(self, why: str) -> None:
        if not self._ended.done():
            self._ended.set_result(why)

    @property
    def closing(self) -> bool:
        return self._ended.done()

    def lose(self, why: str) -> None:
        self.gone = True
        self._end(why)

    def fail(self, error: Exception) -> None:
        if not self._ended.done():
            self._ended.set_exception(error)
        else:
            _log.error('real-time motion', exc_info=error)

    # State.

    def report_motion(self, in_motion: bool) -> None:
        if in_motion is not self._in_motion:
            self._in_motion = in_motion
            self._publish_status()

    def on_motion_end(self) -> None:
        self._wake.set()

    def _arrived(self, session: RtmcSession, arrival: Arrival) -> None:
        if arrival.sender == OWN:
            self._record(WireEvent.SENT, arrival)
            return
        if self._sender is None:
            self._sender = arrival.sender
        if arrival.sender != self._sender:
            if arrival.data is not None:
                self._end('two controllers answer')
            return
        if arrival.data is None:
            self._on_event(WireEvent.ENDED)
            self.lose('the controller has left')
            return
        self.last_received = arrival.time
        self._silence.restart(self._now())
        self.statistics.frames_received += 1
        self.statistics.bytes_received += len(arrival.data)
        try:
            self._record(WireEvent.RECEIVED, arrival)
            session.receive(arrival.data, arrival.time)
        except RtmcError as error:
            self._end(str(error))

    # Trace. The messages are recorded as the bytes of one TCP connection.

    @property
    def trace(self) -> Tap | None:
        return self._tap

    @trace.setter
    def trace(self, tap: Tap | None) -> None:
        self._tap = tap
        if self._transport is not None:
            self._transport.trace(tap is not None)

    @property
    def addresses(self) -> tuple[Address, Address] | None:
        return (
            None if self.session is None or self._transport is None else self._transport.addresses
        )

    def _record(self, event: WireEvent, arrival: Arrival) -> None:
        """Record a message, except one with the password."""
        if self._tap is None or arrival.data is None:
            return
        message = decode(arrival.data)
        if event is WireEvent.SENT and message.number == Request.CONNECT:
            message = replace(message, data=b'')
        self._tap(event, message.encode(), self._now() - arrival.time)

    def _on_moved(self, positions: tuple[float, ...], full: bool, time: float) -> None:
        self._motion.on_moved(full, time)
        self._on_joints(positions, time)

    def _on_joints(self, positions: tuple[float, ...], time: float) -> None:
        self.joints, self.joints_at = positions, time
        self._publish(topic(JointPosition(0, joint_data(positions))))

    def _on_notice(self, message: RtmcMessage) -> None:
        try:
            if message.number == Request.STATUS_NOTICE:
                self._status = RtmcStatus.decode(message)
                self._publish_status()
        except RtmcError as error:
            self._end(str(error))

    def _publish(self, packet: Packet) -> None:
        if not (self.closing and self._ended.exception() is not None):
            self._on_packet(packet)  # after an exception it would fail in each cycle

    def _publish_status(self) -> None:
        state = self._status
        if state is None or not self.connected:
            return
        powered = self._powered
        if state.estop or self._motion.active:
            powered = not state.estop
        self.flags = tuple(
            flag
            for flag, active in (
                ('EStop', state.estop),
                ('Safeguard', state.safeguard_open),
                ('Teach', state.mode is OperationMode.TEACH),
                ('Error', state.error),
            )
            if active
        )
        self._publish(topic(state.simple_status(powered, in_motion=self._in_motion)))
