# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reads a run from a bag of `ros2 bag record` (MCAP or SQLite) or of bag_file.py."""

import os
import resource
from array import array as packed
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection

from epson_driver.error_texts import ErrorTexts
from epson_driver.inputs import MEGABYTE, InputError, open_file, printable, read_yaml
from epson_driver.motion import Array
from epson_driver.report.bag_file import typestore
from epson_driver.report.run import (
    FLAGS,
    NANOSECONDS,
    Arrival,
    Condition,
    Event,
    Plan,
    Reply,
    Run,
    RunError,
    Traffic,
    array,
    condition_events,
    sent_times,
)
from epson_driver.report.trace_run import LINK_LOST

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, DATA_END = 0x01, 0x02, 0x0F  # MCAP operation codes
_LENGTH = 9  # length of a record's operation code and of its length field together, bytes

_END = bytes([FOOTER]) + (20).to_bytes(8, 'little') + bytes(20) + MAGIC
"""A footer without a summary, which makes readers of MCAP files scan all records."""


def whole_mcap(path: Path, folder: Path) -> Path | None:
    """Write the complete records of a possibly truncated MCAP file into a new file in `folder`.

    Returns its path, or None if `path` is no MCAP file.
    """
    copy = folder / path.name
    with open_file(path) as source:
        if source.read(len(MAGIC)) != MAGIC:
            return None
        size = path.stat().st_size
        with copy.open('wb') as target:
            target.write(MAGIC)
            while len(head := source.read(_LENGTH)) == _LENGTH:
                length = int.from_bytes(head[1:], 'little')
                if head[0] in (0, FOOTER, DATA_END) or source.tell() + length > size:
                    break
                target.write(head + source.read(length))
            target.write(_END)
    return copy


JOINT_STATE = 'sensor_msgs/msg/JointState'
ROBOT_STATUS = 'industrial_msgs/msg/RobotStatus'
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'
LOG = 'rcl_interfaces/msg/Log'
STRING = 'std_msgs/msg/String'
FLOAT = 'std_msgs/msg/Float64'
CONTROLLER_STATE = 'control_msgs/msg/JointTrajectoryControllerState'
WARNING, ERROR = 30, 40  # levels of rcl_interfaces/Log
MAX_JOINT_STATES = 3_000_000  # maximum number in one bag: 4.6 hours at 182 Hz
BASE_BYTES, GROWTH = 128 * MEGABYTE, 50
"""Maximum memory for reading a bag: BASE_BYTES, plus GROWTH bytes for each byte of the bag."""

CUT_OFF = 'the file is truncated: its end with the index is missing, complete messages were read'

Reference = tuple[float, float, list[float]]  # time, time since the start, s, and positions

TOPICS_TO_RECORD = (
    "record joint_states, robot_status, rosout and the driver's ~/link_state, ~/controller_state"
)


def read_bag(path: Path, texts: ErrorTexts, namespace: str | None = None) -> Run:
    """Return the run in a bag.

    * path: folder of the bag, or the file of a bag with a single file.
    * namespace: namespace of the robot, needed if the bag has several joint_states topics.

    Raises RunError if joint states are missing, or if the bag cannot be read.
    """
    maximum = BASE_BYTES + GROWTH * _size(path)
    try:
        with _bounded(maximum):
            try:
                return _read_whole(path, path, texts, namespace)
            except (RunError, MemoryError):
                raise
            except Exception:
                files = [path] if path.is_file() else list(path.glob('*.mcap'))
                with TemporaryDirectory(prefix='epson_driver_') as folder:
                    copy = whole_mcap(files[0], Path(folder)) if len(files) == 1 else None
                    if copy is None:
                        raise
                    return _read_whole(copy, path, texts, namespace, CUT_OFF)
    except (RunError, InputError):
        raise
    except MemoryError as error:
        text = f'expands to more than {maximum / MEGABYTE:.0f} MB of memory: record fewer topics'
        raise RunError(printable(f'{path}: {text}')) from error
    except (AnyReaderError, OSError) as error:
        raise RunError(printable(f'{path}: {error}')) from error
    except Exception as error:  # the library's exceptions for a damaged bag are not documented
        why = 'nested too deeply' if isinstance(error, RecursionError) else repr(error)
        raise RunError(printable(f'{path}: cannot be read as a bag: {why}')) from error


def _size(path: Path) -> int:
    """Return the size of a bag on the disk, bytes. Raises InputError if a file is unusable."""
    files = [item for item in path.iterdir() if not item.is_dir()] if path.is_dir() else [path]
    if (described := path / 'metadata.yaml') in files:
        read_yaml(described, largest=10 * MEGABYTE)
    size = 0
    for element in files:
        with open_file(element) as file:
            status = os.fstat(file.fileno())
            size += min(status.st_size, status.st_blocks * 512)
    return size


@contextmanager
def _bounded(maximum: int) -> Iterator[None]:
    """Limit additional memory and written files in the block to `maximum` bytes.

    A compressed bag may expand to any size.
    """
    used = int(Path('/proc/self/statm').read_text('ascii').split()[0]) * resource.getpagesize()
    kinds = (resource.RLIMIT_AS, resource.RLIMIT_FSIZE)
    before = {kind: resource.getrlimit(kind) for kind in kinds}
    for item, (soft, hard) in before.items():
        resource.setrlimit(item, (min(used + maximum, soft % 2**64), hard))  # -1: no limit
    try:
        yield
    finally:
        for item, limits in before.items():
            resource.setrlimit(item, limits)


def _read_whole(
    file: Path, path: Path, texts: ErrorTexts, namespace: str | None, note: str = ''
) -> Run:
    with AnyReader([file], default_typestore=typestore()) as reader:
        return _Bag(reader, path, namespace, note).run(texts)


class _Bag:
    """Collects a run from the messages of a bag.

    `note`: a sentence about damage of the bag, or ''.
    """

    def __init__(self, reader: Any, path: Path, namespace: str | None, note: str) -> None:
        self._reader = reader
        self._path = path
        self._note = note
        self._states: Any = self._choose(namespace)
        self._prefix = self._states.topic.rpartition('/')[0]
        self._began = 0
        self._names: tuple[str, ...] = ()
        self._damaged = False
        self._times, self._positions, self._velocities = packed('d'), packed('d'), packed('d')
        self._conditions: list[Condition] = []
        self._plans: list[Plan] = []
        self._events: list[Event] = []
        self._replies: list[Reply] = []
        self._links: list[tuple[float, str, bool]] = []
        self._followed: list[Reference] = []
        self._traffic: dict[tuple[str, str], list[float]] = defaultdict(list)
        self._ours = any(item.topic.endswith('/report/events') for item in reader.connections)

    def _choose(self, namespace: str | None) -> Any:
        connections = self._reader.connections
        result = {item.topic: item for item in connections if item.msgtype == JOINT_STATE}
        if namespace is not None:
            topic = f'/{namespace.strip("/")}/joint_states'.replace('//', '/')
            if topic not in result:
                has = ', '.join(sorted(result)) or 'none'
                raise RunError(
                    f'{self._path}: it contains no {topic} (topics with joint states: {has})'
                )
            return result[topic]
        if not result:
            topics = ', '.join(sorted(item.topic for item in connections)) or 'none'
            why = self._note or TOPICS_TO_RECORD
            raise RunError(f'{self._path}: it contains no joint states (topics: {topics}): {why}')
        # `ros2 bag record -a` also records ~/joint_commands, which the driver receives
        named = {topic: item for topic, item in result.items() if topic.endswith('/joint_states')}
        result = named or result
        if len(result) > 1:
            text = f'it contains joint states of several robots ({", ".join(sorted(result))})'
            raise RunError(f'{self._path}: {text}: choose one with --namespace')
        return next(iter(result.values()))

    def _belongs(self, connection: Connection) -> bool:
        return connection.topic == '/rosout' or connection.topic.startswith(f'{self._prefix}/')

    def run(self, texts: ErrorTexts) -> Run:
        self._began = int(self._reader.start_time)
        takers: dict[str, Callable[[Connection, float, Any], None]] = {
            JOINT_STATE: self._joint_state,
            ROBOT_STATUS: self._robot_status,
            TRAJECTORY: self._trajectory,
            LOG: self._log,
            STRING: self._string,
            FLOAT: self._float,
            CONTROLLER_STATE: self._controller_state,
        }
        connections = [
            item
            for item in self._reader.connections
            if item.msgtype in takers
            and self._belongs(item)
            and (item.msgtype != JOINT_STATE or item is self._states)
        ]
        broken = self._note
        end = 0.0
        for connection, stamp, message in self._read(connections):
            if isinstance(message, str):
                broken = message
                break
            end = (stamp - self._began) / NANOSECONDS
            self._traffic[connection.topic, connection.msgtype].append(end)
            takers[connection.msgtype](connection, end, message)
        if not self._times:
            raise RunError(f'{self._path}: {self._states.topic} has no message with positions')
        return self._finished(texts, end, broken)

    def _read(self, connections: list[Connection]) -> Iterator[tuple[Any, int, Any]]:
        """Yield the connection, the time, ns, and the message of each record.

        If the bag is damaged, the last item is a text about the damage instead.
        """
        try:
            for connection, stamp, data in self._reader.messages(connections=connections):
                yield connection, stamp, self._reader.deserialize(data, connection.msgtype)
        except Exception as error:  # a truncated bag ends there
            if not self._times or isinstance(error, MemoryError):
                raise
            yield None, 0, f'the bag is truncated: {error!r}'

    def _joint_state(self, _connection: Connection, time: float, message: Any) -> None:
        if not self._names:
            self._names = tuple(message.name)
        if tuple(message.name) != self._names or len(message.position) != len(self._names):
            return
        if not (np.isfinite(message.position).all() and np.isfinite(message.velocity).all()):
            if not self._damaged:
                text = 'joint states with values that are not finite'
                self._events.append(Event(time, 'warning', text, 'check their publisher'))
            self._damaged = True
            return
        if len(self._times) >= MAX_JOINT_STATES:
            raise RunError(f'{self._path}: more than {MAX_JOINT_STATES} joint states')
        stamp = message.header.stamp
        measured = (stamp.sec * NANOSECONDS + stamp.nanosec - self._began) / NANOSECONDS
        if abs(measured - time) > 5.0:  # no stamp, or another clock
            measured = time
        if self._times and measured <= self._times[-1]:
            measured = self._times[-1] + 1e-6
        self._times.append(measured)
        self._positions.extend(message.position)
        if len(message.velocity) == len(self._names):
            self._velocities.extend(message.velocity)

    def _robot_status(self, _connection: Connection, time: float, message: Any) -> None:
        flags = tuple(int(getattr(message, name).val) for name in FLAGS)
        codes = tuple(int(code) for code in message.error_codes)
        mode = int(message.mode.val)
        self._conditions.append(Condition(time, flags, mode, codes))

    def _trajectory(self, connection: Connection, time: float, message: Any) -> None:
        order = self._order(message.joint_names)
        if order is None or not message.points:
            return
        times = array([_seconds(p.time_from_start) for p in message.points])
        rows = [p.positions for p in message.points]
        if wrong := _why_no_plan(times, rows, len(message.joint_names)):
            text = f'an invalid trajectory ({connection.topic}): {wrong}'
            self._events.append(Event(time, 'warning', text, 'check its publisher'))
            return
        positions = array([[row[k] for k in order] for row in rows], len(order))
        self._plans.append(Plan(time, times - times[0], positions))
        if not self._ours:
            text = f'a trajectory of {len(times)} points ({connection.topic})'
            self._events.append(Event(time, 'info', text))

    def _controller_state(self, _connection: Connection, time: float, message: Any) -> None:
        order = self._order(message.joint_names)
        reference = message.reference
        if order is None or len(reference.positions) != len(message.joint_names):
            return
        if not np.isfinite(reference.positions).all():
            return
        since = _seconds(reference.time_from_start)
        self._followed.append((time, since, [float(reference.positions[k]) for k in order]))

    def _log(self, connection: Connection, time: float, message: Any) -> None:
        if connection.topic == '/rosout' and 'epson' not in message.name:
            return
        text, _, remedy = message.msg.partition('\n') if self._ours else (message.msg, '', '')
        level = 'info'
        if message.level >= WARNING:
            level = 'error' if message.level >= ERROR else 'warning'
        self._events.append(Event(time, level, text, remedy))

    def _string(self, connection: Connection, time: float, message: Any) -> None:
        if connection.topic.endswith('/link_state'):
            up = message.data == 'connected'
            self._links.append((time, 'motion and state', up))
            level, remedy = ('info', '') if up else ('warning', LINK_LOST)
            self._events.append(Event(time, level, f'link: {message.data}', remedy))

    def _float(self, connection: Connection, time: float, message: Any) -> None:
        if connection.topic.endswith('/report/reply_latency'):
            self._replies.append(Reply(time, float(message.data), 'request'))

    def _sent(self) -> list[float]:
        arrivals = [Arrival(time, joints=True) for time in self._times]
        arrivals += [Arrival(condition.time, joints=False) for condition in self._conditions]
        return sent_times(sorted(arrivals, key=lambda arrival: arrival.time))

    def _order(self, names: list[str]) -> list[int] | None:
        """Return the index in `names` of each joint of the robot, or None if one is missing."""
        if not self._names:
            return None  # the joints are unknown before the first joint state
        return [names.index(n) for n in self._names] if set(self._names) <= set(names) else None

    def _finished(self, texts: ErrorTexts, end: float, broken: str) -> Run:
        joints = len(self._names)
        notes = [f'from a bag: {self._states.topic} and other topics of the robot']
        events = list(self._events)
        if broken:
            notes.append(broken)
            events.append(Event(end, 'error', 'the recording ends here'))
        if not self._conditions:
            text = 'no robot_status, so motors, E-stop and errors are unknown'
            notes.append(f'{text}: {TOPICS_TO_RECORD}')
        if not self._ours:
            events += condition_events(self._conditions, texts)
        plans = self._plans or list(_followed_plans(self._followed, joints))
        if not plans:
            notes.append('it contains no plan: neither ~/controller_state nor a trajectory')
        measured = len(self._velocities) == len(self._positions)
        return Run(
            source=self._path.name,
            began=self._began,
            joint_names=self._names,
            times=array(self._times),
            positions=array(self._positions, joints),
            velocities=array(self._velocities, joints) if measured else None,
            sent=np.maximum.accumulate(array(self._sent())),
            conditions=self._conditions,
            plans=sorted(plans, key=lambda plan: plan.sent),
            events=sorted(events, key=lambda event: event.time),
            traffic=[
                Traffic(topic, kind.rpartition('/')[2], array(times))
                for (topic, kind), times in sorted(self._traffic.items())
            ],
            replies=self._replies,
            links=self._links,
            notes=notes,
            ended=end,
        )


def _seconds(duration: Any) -> float:
    return float(duration.sec + duration.nanosec / NANOSECONDS)


def _why_no_plan(times: Array, rows: Sequence[Any], joints: int) -> str:
    """Return why the points of a trajectory are invalid, or ''.

    The driver rejects such trajectories, too.
    """
    for number, row in enumerate(rows):
        if len(row) != joints:
            return f'point {number} has {len(row)} positions for {joints} joints'
        if not np.isfinite(row).all():
            return f'point {number} has positions that are not finite'
    falls = np.flatnonzero(np.diff(times) <= 0.0)
    if len(falls):
        return f'point {int(falls[0]) + 1} must be later than the previous point'
    return ''


def _followed_plans(followed: list[Reference], joints: int) -> Iterator[Plan]:
    """Yield a plan for each goal, made from the references in ~/controller_state."""
    rows: list[Reference] = []
    for row in followed:
        if rows and row[1] < rows[-1][1]:  # the time from the start has been reset
            yield _plan(rows, joints)
            rows = []
        if not rows or row[1] > rows[-1][1]:
            rows.append(row)
    if rows:
        yield _plan(rows, joints)


def _plan(rows: list[Reference], joints: int) -> Plan:
    times = array([since for _, since, _ in rows])
    return Plan(rows[0][0] - rows[0][1], times, array([p for *_, p in rows], joints))
