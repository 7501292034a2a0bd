# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The clients connected to each port, and the sessions of the motion and state ports.

A client connection serves one client of one port. It consists of a transport, on which simulated
faults act, and a session.
"""

import logging
from collections.abc import Callable, Iterator
from itertools import cycle
from operator import attrgetter

from epson_driver.sim_controller.clock import Clock, Timer
from epson_driver.sim_controller.condition.errors import ErrorNumber, Rejection
from epson_driver.sim_controller.condition.states import Tasks
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.faults.faults import FaultyTransport
from epson_driver.sim_controller.io.io_session import IoSession
from epson_driver.sim_controller.io.motoman_io_session import MotomanIoSession
from epson_driver.sim_controller.ports import (
    Answers,
    Client,
    Send,
    Session,
    answer_frame,
)
from epson_driver.sim_controller.programs.motion_program import MotionProgram
from epson_driver.sim_controller.remote.remote_session import RemoteSession
from epson_driver.sim_controller.spel_host.program_network import ProgramNetwork
from epson_driver.simple_message import (
    Frame,
    FrameError,
    Framer,
    Message,
    MessageType,
    encode,
    topic,
)

MAX_CATCH_UP_SLOTS = 200
"""Maximum number of late state messages, 1 s at 200 Hz. Older ones are dropped."""

_Slot = tuple[Callable[[], Message], ...]


class StateSession:
    """Session of one client of the state port. It sends joint positions every `state_period` s."""

    def __init__(self, controller: Controller, send: Send) -> None:
        self._dialect = controller.dialect
        self._send = send
        self._framer = Framer(self._dialect.byte_order)
        profile = controller.profile.state
        feedback = profile.message == 'joint_feedback'
        joints = controller.joint_feedback if feedback else controller.joint_position
        self._answers: Answers = {
            MessageType.JOINT_POSITION: controller.joint_position,
            MessageType.STATUS: controller.status,
            MessageType.GET_VERSION: controller.version,
        }
        slots: list[_Slot] = [(joints,)] * profile.joint_positions_per_status
        if profile.status_with_joints:
            slots[-1] = (joints, controller.status)
        else:
            slots.append((controller.status,))
        self._slots: Iterator[_Slot] = cycle(slots)
        self._at_rest: _Slot | None = (controller.status,) if profile.status_at_rest else None
        self._in_motion = False  # in the last slot
        self._controller = controller
        self._timer = controller.clock.every(
            controller.state_period, self._tick, catch_up=MAX_CATCH_UP_SLOTS
        )
        self._open = True

    def receive(self, data: bytes) -> None:
        self._framer.receive_data(data)
        while self._open and (frame := self._framer.next_frame()) is not None:
            reply = answer_frame(frame, self._answers)
            if reply is not None:
                self._send(encode(reply, self._dialect))

    def closed(self) -> None:
        self._open = False
        self._timer.cancel()

    def _tick(self) -> None:
        slot = next(self._slots)
        moved, self._in_motion = self._in_motion, self._controller.in_motion
        if self._at_rest is not None and moved and not self._in_motion:
            slot = self._at_rest
        for message in slot:
            self._send(encode(topic(message()), self._dialect))


SLICES = 20
"""Number of slices into which `ClientWatchdog` divides its timeout.

A scheduling delay of this process counts as at most one slice, however long it is. The messages
that arrived during the delay are therefore read before the timeout expires.
"""


class ClientWatchdog:
    """Timeout for a client that sends heartbeats: a PING as a topic (REP-I0006).

    `silent` is called once, up to one slice late, when such a client has sent nothing for
    `timeout` s. `receive` must be called with every message of the client. A client without
    heartbeats, like a ROS 1 driver, may be silent indefinitely.
    """

    def __init__(self, clock: Clock, timeout: float, silent: Callable[[], None]) -> None:
        self._clock = clock
        self._slice = timeout / SLICES
        self._silent = silent
        self._silent_slices = -1
        self._timer: Timer | None = None

    def receive(self, frame: Frame) -> None:
        """Restart the timeout after a message. The first heartbeat starts the timeout."""
        self._silent_slices = -1  # the current slice does not count
        if frame.heartbeat and self._timer is None:
            self._timer = self._clock.every(self._slice, self._end_slice, first=self._slice)

    def end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _end_slice(self) -> None:
        self._silent_slices += 1
        if self._silent_slices == SLICES:
            self._silent()


class MotionSession:
    def __init__(self, controller: Controller, send: Send) -> None:
        self._controller = controller
        self._watchdog: ClientWatchdog | None = None
        program, timeout = controller.program, controller.profile.server.client_timeout
        if timeout and isinstance(program, MotionProgram):
            self._watchdog = ClientWatchdog(
                controller.clock, timeout, lambda: program.client_silent(timeout)
            )
        self._framer = Framer(controller.dialect.byte_order)
        self._open = True
        controller.reply = send
        controller.client_connected()

    def receive(self, data: bytes) -> None:
        """Process received bytes.

        Raises FrameError if frame synchronization is lost. The session then ends.
        """
        self._framer.receive_data(data)
        try:
            while self._open and (frame := self._framer.next_frame()) is not None:
                if self._watchdog is not None:
                    self._watchdog.receive(frame)
                self._controller.program.receive(frame)
        except FrameError as error:
            self._controller.errors.enter(Rejection(ErrorNumber.CORRUPT_MESSAGE, str(error)))
            self.closed()
            raise

    def closed(self) -> None:
        if self._open:
            self._open = False
            if self._watchdog is not None:
                self._watchdog.end()
            try:
                self._controller.client_lost()
            finally:
                self._controller.reply = None


_log = logging.getLogger(__name__)

MAX_REMOTE_CLIENTS = 16
"""Maximum number of remote clients. If there are more, a new client replaces another one."""

GRACE_S = 0.1
"""Time after its connection in which a remote client is not evicted, s.

The client can then send a command.
"""

MAX_NEWCOMERS = MAX_REMOTE_CLIENTS // 2
"""Maximum number of clients that a full remote port accepts within GRACE_S."""


class ClientConnection(Session):
    def __init__(
        self, clients: 'ClientConnections', controller: Controller, port: str, client: Client
    ) -> None:
        self.port = port
        self._clients = clients
        self.local = client.local
        self._connection_time = controller.clock.now
        self._abort = client.abort
        self._close = client.close
        self._controller = controller
        self._transport = FaultyTransport(
            port, controller.clock, controller.faults, client.send, self.hang_up
        )
        self.session = clients.session(port, self._transport.send, client)
        self._open = True

    @property
    def eviction_priority(self) -> tuple[bool, bool, bool, float]:
        """The sort key of a client. A full remote port evicts the client with the lowest key.

        Its parts in order of precedence: whether the client is new, whether it is on this machine,
        whether one of its commands, such as a login, was accepted, and the time of its last
        command, s. A client that waits for the answer to `$Execute` has no advantage.
        """
        session = self.session
        if not isinstance(session, RemoteSession):
            raise TypeError(f'a client of the {self.port} port is never evicted')
        new = self._controller.clock.now < self._connection_time + GRACE_S
        return new, self.local, session.has_accepted_command, session.last_command_time

    def receive(self, data: bytes) -> None:
        data = self._transport.receive(data)
        if not data or not self._open:
            return
        try:
            self.session.receive(data)
        except FrameError:
            self.closed()
            raise

    def hang_up(self) -> None:
        self._abort()
        self.closed()

    def disconnect_after_flush(self) -> None:
        """Remove the client immediately, and close the connection once all bytes are sent."""
        self._close()
        self.closed()

    def closed(self) -> None:
        if self._open:
            self._open = False
            self._clients.remove(self)
            self.session.closed()  # before the transport, which still sends its last answers
            self._transport.close()


class ClientConnections:
    """All client connections of one controller. `spel`: ports of its SPEL+ program, if any."""

    def __init__(self, controller: Controller, spel: ProgramNetwork | None = None) -> None:
        self._controller = controller
        self._spel = spel
        self._connections: list[ClientConnection] = []
        self._boot: Timer | None = None

    def connect(self, port: str, client: Client) -> ClientConnection:
        """Start to serve a client of `port`: motion, state, io or remote.

        The caller calls the connection's `closed` when the connection ends for any reason. If the
        remote port is full, a new client replaces another one, so an E-stop command always gets
        through. If all its clients are on this machine, a client on another machine is refused
        instead. Raises ConnectionRefusedError, with the reason, if the client is refused.
        """
        reason = self._rejection(port)
        if reason is None and port == 'remote':
            reason = self._make_room(client)
        if reason is not None:
            raise ConnectionRefusedError(reason)
        connection = ClientConnection(self, self._controller, port, client)
        self._connections.append(connection)
        return connection

    def session(self, port: str, send: Send, client: Client) -> Session:
        if self._spel is not None and port != 'remote':
            return self._spel.session(port, send, client.close)
        return _open(self._controller, port, send, client)

    def remove(self, connection: ClientConnection) -> None:
        self._connections.remove(connection)

    def hang_up(self, *ports: str) -> None:
        for connection in self._of(*ports):
            connection.hang_up()

    def disconnect_after_flush(self, port: str) -> None:
        for connection in self._of(port):
            connection.disconnect_after_flush()

    def has_client(self, port: str) -> bool:
        return bool(self._of(port))

    def make_room(self, port: str) -> None:
        """Disconnect the oldest client of `port`, unless the arm is in motion or has points."""
        connections = self._of(port)
        if connections and not self._controller.moving:
            _log.warning('the oldest %s client is disconnected to admit a new client', port)
            connections[0].hang_up()

    def dismiss_remote(self, why: str) -> None:
        """Disconnect the remote client with the lowest `eviction_priority`, if any. Log `why`."""
        key = attrgetter('eviction_priority')
        connection = min(self._of('remote'), key=key, default=None)
        if connection is not None:
            accepted = 'an' if connection.eviction_priority[2] else 'no'
            _log.warning(
                'a remote client that has sent %s accepted command is disconnected '
                'to admit a new client: %s',
                accepted,
                why,
            )
            connection.hang_up()

    def _of(self, *ports: str) -> list[ClientConnection]:
        return [connection for connection in self._connections if connection.port in ports]

    def check_login(self) -> None:
        """Raise ConnectionRefusedError if a client is logged in and only one is allowed."""
        sessions = [connection.session for connection in self._of('remote')]
        one = self._controller.profile.remote.clients == 1
        if one and any(isinstance(item, RemoteSession) and item.logged_in for item in sessions):
            raise ConnectionRefusedError(
                'another client is logged in, and only one may be logged in at a time'
            )

    def boot(self, seconds: float) -> None:
        if self._boot is not None:
            self._boot.cancel()
        self._boot = self._controller.clock.after(seconds, self._booted)
        self.hang_up(*{connection.port for connection in self._connections})

    @property
    def boots(self) -> bool:
        return self._boot is not None

    def _booted(self) -> None:
        self._boot = None
        _log.info('booted')

    def _rejection(self, port: str) -> str | None:
        if self.boots:
            return 'the controller boots'
        if self._controller.faults.rejects(port):
            return 'the fault `cut` is active'
        if self._spel is not None and port != 'remote':
            return self._spel.rejection(port)
        if port != 'remote' and not self._controller.profile.program.loaded:
            return 'no program is loaded'
        if port == 'motion' and self.has_client(port):
            return 'another motion client is connected'
        return None

    def _make_room(self, client: Client) -> str | None:
        connections = self._of('remote')
        if len(connections) < MAX_REMOTE_CLIENTS:
            return None
        if not client.local and all(connection.local for connection in connections):
            return f'{len(connections)} clients of this machine are connected'
        self.dismiss_remote(f'{len(connections)} are connected')
        return None


def _open(controller: Controller, port: str, send: Send, client: Client) -> Session:
    match port:
        case 'motion':
            return MotionSession(controller, send)
        case 'state':
            return StateSession(controller, send)
        case 'io' if controller.profile.io.access == 'motoman':
            return MotomanIoSession(controller.io, controller.dialect, send)
        case 'io':
            return IoSession(
                controller.io,
                controller.dialect,
                controller.clock,
                send,
                lambda: _no_io(controller),
            )
        case 'remote':
            return RemoteSession(controller, send, client.close)
    raise ValueError(f'{port} must be motion, state, io or remote')


def _no_io(controller: Controller) -> str | None:
    tasks = controller.condition.tasks
    return None if tasks is Tasks.RUNNING else f'the I/O server is {tasks.value}'
