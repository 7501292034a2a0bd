# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The motions of an RC800 with Real-time Motion Control, from points to targets.

Points and STOP are not sent as such. The driver smooths the points, and the transport's thread
sends one target per control cycle (`Feeder`). A point is acknowledged once the smoother has
accepted it, and STOP once its targets have replaced those of the motion.
"""

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable
from typing import Protocol

import numpy as np

from epson_driver.motion import Array, JointLimits
from epson_driver.rtmc.conditions import Detail
from epson_driver.rtmc.cycle import CycleMeter
from epson_driver.rtmc.feeder import Feeder
from epson_driver.rtmc.messages import (
    BUFFER_SIZES,
    ECCENTRIC_DATA,
    JOINTS_DATA,
    WEIGHT_DATA,
    Request,
    RtmcMessage,
)
from epson_driver.rtmc.session import RefusedError, RtmcSession
from epson_driver.rtmc.stream_feeder import StreamFeeder
from epson_driver.simple_message import JointPosition, JointTrajPt, Packet, ReplyCode, reply

REPLY_TIMEOUT_S = 5.0  # EPSON's library disconnects then
NO_REPLY = f'no reply for {REPLY_TIMEOUT_S:g} s'

FILL_PERIOD_S = 0.01
HOLD_S = 0.08
"""Time for which the motion mode stays enabled after a motion, in addition to the time of a full
buffer, s. The servos follow the last target with a delay."""

END_TIMEOUT_S = 1.0  # maximum time besides braking before this side closes the connection, s
AT_REST_ATTEMPTS = 50  # attempts to enable the motion mode, which needs an arm at rest

MOVED = 0.01
"""Maximum difference between the joints at the start of a motion and the last reported joints,
against which the goal was checked, rad or m."""

BUFFER = BUFFER_SIZES[-1]

OnReply = Callable[[Packet, float], None]

_log = logging.getLogger(__name__)


class Peer(Protocol):
    """The connection to the controller.

    * session: current session, or None.
    * joints, joints_at: joints of the last reply, and its time, s.
    * load: mass, kg, inertia, kg m², and eccentricity, mm, that each motion sets, or None.
    * closing: whether no further motion may start.
    * gone: whether the controller cannot be reached, so that braking is impossible.
    """

    session: RtmcSession | None
    joints: tuple[float, ...]
    joints_at: float
    load: tuple[float, float, int] | None
    gone: bool

    @property
    def closing(self) -> bool: ...

    async def ask(self, number: Request, low: int = 0, data: bytes = b'\0') -> RtmcMessage:
        """Send a request, and return the reply. Raises RefusedError, TimeoutError, OSError."""

    def lose(self, why: str) -> None:
        """End the session, because the controller does not answer."""

    def fail(self, error: Exception) -> None:
        """End the session, because of a defect of this package."""

    def report_motion(self, in_motion: bool) -> None:
        """Publish whether the arm moves, if this has changed."""

    def on_motion_end(self) -> None:
        """Resume polling the state."""


class RtmcMotion:
    """Executes motions over one link. `on_packet`: called with an unexpected failure."""

    def __init__(
        self,
        peer: Peer,
        limits: JointLimits,
        cycle: float,
        on_packet: Callable[[Packet], None],
    ) -> None:
        self._peer = peer
        self._limits = limits
        self._cycle = CycleMeter(cycle)
        self._on_packet = on_packet
        self._points: deque[tuple[JointTrajPt, OnReply]] = deque()
        self._task: asyncio.Task[None] | None = None
        self._feeder: Feeder | StreamFeeder | None = None
        self._stream: StreamFeeder | None = None  # follows a stream when it has begun
        self._problem = ''  # why the controller accepts no further target of this motion
        self._stops = 0  # number of stops so far: one during `_begin` prevents the motion
        self.requested_rate: Callable[[], float] = lambda: 1.0  # see `Feeder`

    @property
    def active(self) -> bool:
        return self._task is not None

    @property
    def rate(self) -> float:
        """Rate along the motion, or the requested rate before the motion."""
        return self._feeder.rate if isinstance(self._feeder, Feeder) else self.requested_rate()

    def move(self, point: JointTrajPt, on_reply: OnReply) -> None:
        """Move to a point after all earlier points. `on_reply` is called when it is accepted."""
        self._points.append((point, on_reply))
        self._start()

    def follow(self, stream: StreamFeeder) -> None:
        """Start to follow a stream. Its commands have no effect before the motion has begun."""
        self._stream = stream
        self._start()

    def _start(self) -> None:
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._execute())
            self._task.add_done_callback(self._done)

    def stop(self) -> None:
        """Discard all points, and brake. If a motion is about to start, the arm does not move."""
        self._stops += 1
        self._stream = None
        self._points.clear()
        if self._feeder is not None:
            self._feeder.stop()

    async def wait(self) -> None:
        """Wait until no motion is active."""
        if self._task is not None:
            await asyncio.wait([self._task])

    async def brake(self) -> None:
        """Brake, and wait for the end of the motion."""
        try:
            self.stop()
        except Exception as error:  # noqa: BLE001 - the targets in the ring brake without a stop, too
            self._peer.fail(error)
        braking = 0.0 if self._feeder is None else self._feeder.braking_time
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(END_TIMEOUT_S + braking):
                if not self._peer.gone:
                    await self.wait()

    async def close(self) -> None:
        """End the motion, even if the arm moves."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        self._points.clear()

    def on_problem(self, why: str) -> None:
        """End the motion, because the controller executes no further targets. Log the reason."""
        self._problem = why
        _log.error('real-time motion: %s', why)

    def acknowledge(
        self, sequence: int, on_reply: OnReply, code: ReplyCode = ReplyCode.SUCCESS
    ) -> None:
        on_reply(reply(JointPosition(sequence), code), asyncio.get_running_loop().time())

    def on_moved(self, full: bool, time: float) -> None:
        """Process the reply to a target. `full`: whether the buffer of the controller was full."""
        try:
            self._cycle.add(time, full=full)
        except ValueError as error:
            if self._feeder is None:
                self.on_problem(str(error))
            else:
                self._feeder.stop(str(error))

    async def _execute(self) -> None:
        """Execute points until none are left. A stop or a failure discards them."""
        peer = self._peer
        while (self._points or self._stream) and not peer.closing:
            stops, self._problem = self._stops, ''
            stream, self._stream = self._stream, None
            try:
                position = await self._enable()
                try:
                    await self._hold(position)
                    if stops == self._stops and self._goes_on:
                        await self._feed(position, stream)
                except Exception as error:  # noqa: BLE001 - `run` raises it, after braking
                    peer.fail(error)
                    await self._brake()
                finally:
                    self._feeder = None
                    if stream is not None:
                        stream.end()
                    if peer.session is not None and not peer.gone:
                        peer.session.end()
                        await peer.ask(Request.SET_MODE, 0)
            except (RefusedError, ValueError) as error:
                self.on_problem(str(error))
            except TimeoutError:
                peer.lose(NO_REPLY)
            if self._problem and stops == self._stops:
                self._refuse_points()

    @property
    def _session(self) -> RtmcSession:
        if self._peer.session is None:
            raise ConnectionError('the link is closed')
        return self._peer.session

    @property
    def _goes_on(self) -> bool:
        return not (self._problem or self._peer.gone)

    async def _enable(self) -> Array:
        peer = self._peer
        if peer.load is not None:
            await peer.ask(Request.SET_WEIGHT, data=WEIGHT_DATA.pack(peer.load[0]))
            await peer.ask(Request.SET_INERTIA, 1, ECCENTRIC_DATA.pack(*peer.load[1:]))
        await peer.ask(Request.SET_POWER, 1)
        for attempt in range(AT_REST_ATTEMPTS):
            joints = (await peer.ask(Request.JOINTS_AT_REST)).values(JOINTS_DATA)
            position = np.array(self._session.positions(joints))
            if np.any(np.abs(position - peer.joints) > MOVED):
                raise ValueError('the arm has moved since the goal was checked')
            try:
                await peer.ask(Request.SET_MODE, 1)
                break
            except RefusedError as error:
                if error.low != Detail.DECELERATING << 8 or attempt == AT_REST_ATTEMPTS - 1:
                    raise
            await asyncio.sleep(FILL_PERIOD_S)
        return position

    async def _hold(self, position: Array) -> None:
        """Hold the arm until the controller's buffer is full and its cycle is measured."""
        self._cycle.restart()
        self._peer.joints_at = asyncio.get_running_loop().time()
        self._session.start(self._limits.settled(position))
        while self._goes_on and not self._cycle.ready:
            await self._wait()

    @property
    def _hold_time(self) -> float:
        return HOLD_S + BUFFER * self._cycle.cycle

    async def _wait(self) -> None:
        """Wait for one period. End the session if the controller no longer answers."""
        await asyncio.sleep(FILL_PERIOD_S)
        if asyncio.get_running_loop().time() - self._peer.joints_at > REPLY_TIMEOUT_S:
            self._peer.lose(NO_REPLY)

    async def _brake(self) -> None:
        feeder = self._feeder
        if feeder is None:
            return
        try:
            feeder.stop()
        except Exception:  # noqa: BLE001 - the targets in the ring brake without a stop, too
            _log.exception('real-time motion')
        while self._goes_on and not feeder.at_rest:
            await self._wait()
        await asyncio.sleep(self._hold_time)

    async def _feed(self, position: Array, stream: StreamFeeder | None) -> None:
        """Send the targets of one motion, until the arm is at rest."""
        feeder: Feeder | StreamFeeder
        if stream is None:
            cycle, rate = self._cycle.cycle, self.requested_rate
            feeder = Feeder(self._limits, position, cycle, self._session, rate)
        else:
            feeder = stream
            stream.begin(position, self._cycle.cycle, self._session)
        self._feeder = feeder
        resting, hold = 0.0, self._hold_time
        while resting < hold and self._goes_on:
            while self._points and isinstance(feeder, Feeder) and feeder.has_room:
                self._accept(feeder, *self._points.popleft())
            feeder.fill()
            if feeder.failed and not feeder.stopped:
                feeder.stop()
            resting = resting + FILL_PERIOD_S if feeder.at_rest else 0.0
            self._peer.report_motion(resting < hold / 2)
            await self._wait()
        if feeder.failed and not self._problem:
            self.on_problem(feeder.failed)

    def _accept(self, feeder: Feeder, point: JointTrajPt, on_reply: OnReply) -> None:
        code = ReplyCode.SUCCESS
        target = np.array(point.joints[: len(self._limits.names)])
        try:
            feeder.append(target, point.duration or None, starts=point.sequence == 0)
        except ValueError as error:
            _log.error('real-time motion: point %d: %s', point.sequence, error)
            code = ReplyCode.FAILURE
        self.acknowledge(point.sequence, on_reply, code)

    def _refuse_points(self) -> None:
        """Reject all points of a motion that failed. If none is left, publish a failure."""
        points = list(self._points)
        self._points.clear()
        for point, on_reply in points:
            self.acknowledge(point.sequence, on_reply, ReplyCode.FAILURE)
        if not points:
            self._on_packet(reply(JointPosition(0), ReplyCode.FAILURE))

    def _done(self, task: asyncio.Task[None]) -> None:
        if self._task is task:
            self._task = None
        self._peer.on_motion_end()
        if not task.cancelled() and (error := task.exception()) is not None:
            if isinstance(error, ConnectionError):
                return  # the link reports its end
            self._peer.fail(error if isinstance(error, Exception) else RuntimeError(str(error)))
