# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ROS utilities of a process: executor thread, polled subscriptions, stamps, transport, log."""

import contextvars
import logging
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from pathlib import Path
from socket import gethostbyname
from tempfile import NamedTemporaryFile
from typing import Any

from builtin_interfaces.msg import Time as TimeMessage
from rcl_interfaces.msg import Log
from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.utilities import get_rmw_implementation_identifier

from epson_driver.log_lines import PrintableFormatter

MAX_ERRORS = 100
"""Number of executor errors after which the thread ends."""

LEAVE_TIMEOUT_S = 2.0
"""Timeout for sending the last replies, s."""

LAST_ROUNDS = 3
"""Executor cycles before the thread ends: one for the future of a goal, one for the task that
sends the reply, and a spare one."""


class RosThread:
    """A thread that spins an executor until `leave`.

    * on_error: called in the thread with each exception, and if the thread ends early.
    * context: the nodes' context, or None for rclpy's default context.

    After an exception, the thread continues if possible, so that requests are answered while the
    arms stop. It does not use `spin_until_future_complete`, with which rclpy adds a callback in
    every cycle.
    """

    def __init__(
        self, on_error: Callable[[str, BaseException], None], context: Context | None = None
    ) -> None:
        self.executor = SingleThreadedExecutor(context=context)
        self._on_error = on_error
        self._exited = threading.Event()
        self._thread = threading.Thread(target=self._run, name='rclpy executor', daemon=True)

    def start(self) -> None:
        self._thread.start()

    def leave(self) -> bool:
        if not self._thread.is_alive():
            self._exited.set()
            return True
        self.executor.create_task(self._leave, LAST_ROUNDS)
        self._thread.join(LEAVE_TIMEOUT_S)
        return not self._thread.is_alive()

    def _leave(self, rounds: int) -> None:
        if rounds:
            self.executor.create_task(self._leave, rounds - 1)
        else:
            self._exited.set()

    def _run(self) -> None:
        errors = 0
        try:
            while not self._exited.is_set():
                try:
                    self.executor.spin_once()
                except BaseException as error:  # noqa: BLE001 - SystemExit, too
                    self._on_error('serving ROS failed', error)
                    errors += 1
                    if errors >= MAX_ERRORS or not self.executor.context.ok():
                        return
        finally:
            if not self._exited.is_set():
                end = RuntimeError('ROS requests are no longer served')
                self._on_error('ROS executor thread ended', end)


def polled_subscription(
    node: Node, kind: Any, topic: str, qos: QoSProfile | int, *, raw: bool = False
) -> Any:
    """Return a subscription whose messages are read by `take`, and not by an executor.

    An executor would rebuild its wait set for each of hundreds of messages a second.
    """
    return node.create_subscription(kind, topic, _never, qos, raw=raw)


def take(subscription: Any) -> Any:
    """Return the next message of a polled subscription, or None if no message is pending."""
    with subscription.handle:
        result = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if result is None else result[0]


def take_all(subscription: Any, maximum: int) -> list[Any]:
    messages: list[Any] = []
    while len(messages) < maximum and (message := take(subscription)) is not None:
        messages.append(message)
    return messages


def level(line: Log) -> int:
    return line.level if isinstance(line.level, int) else int.from_bytes(line.level, 'little')


def _never(_message: Any) -> None:
    raise RuntimeError('this subscription has no executor')


MAX_READING_NS = 100_000
"""Maximum time for reading both clocks, ns. A longer reading was interrupted and is dropped."""

MIN_JUMP_NS = 1_000_000
"""Minimum change of the offset between the clocks that counts as a jump, not as drift, ns."""

DRIFT_FILTER_DIVISOR = 256
"""Divisor of the drift correction per reading, because each reading of the two clocks is noisy."""

MIN_SPACING_NS = 1_000
"""Minimum spacing of stamps, ns. tf ignores a repeated stamp."""

NS_PER_S = 1_000_000_000

MIN_STEP_BACK_NS = 100_000_000
"""Minimum backward jump of the ROS clock after which stamps also jump back, ns. After a smaller
jump, and for a late sample under a slow or paused clock, stamps advance by MIN_SPACING_NS."""


class RosTimeStamps:
    def __init__(self, clock: Clock, monotonic: Callable[[], float]) -> None:
        self._clock = clock
        self._monotonic = monotonic
        self._ahead: int | None = None
        self._reading = self._last = 0
        self._message = TimeMessage()

    def stamp(self, time: float) -> TimeMessage:
        """Convert a monotonic time, s, to a stamp, which is only valid until the next call."""
        before = self._monotonic()
        ros = self._clock.now().nanoseconds
        after = self._monotonic()
        ahead = ros - _nanoseconds(before)
        if self._ahead is None:
            self._ahead, self._reading = ahead, ros
        elif after - before < MAX_READING_NS * 1e-9:
            drift = ahead - self._ahead
            self._ahead += drift if abs(drift) > MIN_JUMP_NS else drift // DRIFT_FILTER_DIVISOR
            if ros < self._reading - MIN_STEP_BACK_NS:
                self._last = 0
            self._reading = ros
        self._last = stamp = max(_nanoseconds(time) + self._ahead, self._last + MIN_SPACING_NS)
        self._message.sec, self._message.nanosec = divmod(stamp, NS_PER_S)
        return self._message


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_RANGES = ('', 'SUBNET', 'SYSTEM_DEFAULT', 'OFF')
"""Values of RANGE with which Fast DDS obeys TRANSPORTS. rcl treats any other value as LOCALHOST,
and for LOCALHOST rmw_fastrtps adds shared memory to every profile."""

_LOCALHOST = """<dds xmlns="http://www.eprosima.com"><profiles>
<transport_descriptors><transport_descriptor><transport_id>udp</transport_id><type>UDPv4</type>
<maxInitialPeersRange>32</maxInitialPeersRange></transport_descriptor></transport_descriptors>
<participant profile_name="localhost" is_default_profile="true"><rtps>
<builtin><initialPeersList>{}</initialPeersList>
<metatrafficUnicastLocatorList><locator><udpv4/></locator></metatrafficUnicastLocatorList></builtin>
<userTransports><transport_id>udp</transport_id></userTransports>
<useBuiltinTransports>false</useBuiltinTransports></rtps></participant></profiles></dds>"""
"""The profile that rmw_fastrtps uses for LOCALHOST (no multicast, 32 participants), but without
shared memory."""


@contextmanager
def udp_by_default() -> Iterator[None]:
    """Use UDP instead of shared memory for the context and the first node created in the block.

    Shared memory of Fast DDS fails silently between users, and when /dev/shm is emptied. Nodes
    then still discover each other, but no message arrives, not even a call of `~/stop`.

    Fast DDS profiles and transports that a user has defined take precedence. Other middlewares are
    not affected. Raises OSError if the disk is full, ValueError if the name of a static peer
    cannot be resolved.
    """
    before = dict(os.environ)
    user_defined = any(map(before.get, PROFILES)) or Path('DEFAULT_FASTRTPS_PROFILES.xml').exists()
    shared = (before.get(TRANSPORTS) or 'UDPv4') != 'UDPv4'
    fast_dds = get_rmw_implementation_identifier().startswith('rmw_fastrtps')
    if user_defined or shared or not fast_dds:
        yield
        return
    with NamedTemporaryFile('w', suffix='.xml') as file:
        changes = {TRANSPORTS: 'UDPv4'}
        localhost_only = before.get('ROS_LOCALHOST_ONLY') == '1'
        if localhost_only or before.get(RANGE, '') not in _RANGES:
            names = '' if localhost_only else before.get('ROS_STATIC_PEERS', '')
            peers = ''.join(map(_peer, filter(None, ('127.0.0.1', *names.split(';')))))
            file.write(_LOCALHOST.format(peers))
            file.flush()
            changes = {PROFILES[0]: file.name, RANGE: 'SYSTEM_DEFAULT', 'ROS_LOCALHOST_ONLY': ''}
        os.environ.update(changes)
        try:
            yield
        finally:
            for name in changes:
                del os.environ[name]
            os.environ.update({name: before[name] for name in changes if name in before})


def _peer(name: str) -> str:
    try:
        return f'<locator><udpv4><address>{gethostbyname(name)}</address></udpv4></locator>'
    except (OSError, UnicodeError) as error:
        raise ValueError(f'ROS_STATIC_PEERS: {name}: {error}') from error


_LOGGER: ContextVar[RcutilsLogger] = ContextVar('ros_logger')


def context_of(logger: RcutilsLogger) -> contextvars.Context:
    """Return a context in which log records are sent to the rclpy logger `logger`."""
    context = copy_context()
    context.run(_LOGGER.set, logger)
    return context


class RosLogHandler(logging.Handler):
    """Sends records of `logging` to the ROS logger of the current context, or else to `logger`.

    Several nodes may share an event loop. The context of a task or callback identifies its node.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        super().__init__()
        self.setFormatter(PrintableFormatter())
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._write(_LOGGER.get(self._logger), self.format(record), record)
        except Exception:  # noqa: BLE001 - like every handler of `logging`
            self.handleError(record)

    @staticmethod
    def _write(logger: RcutilsLogger, text: str, record: logging.LogRecord) -> None:
        if record.levelno >= logging.ERROR:
            logger.error(text)
        elif record.levelno >= logging.WARNING:
            logger.warning(text)
        elif record.levelno >= logging.INFO:
            logger.info(text)
        else:
            logger.debug(text)
