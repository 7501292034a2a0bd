# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Writes a run as an MCAP bag for Foxglove, PlotJuggler and `ros2 bag`.

The bag has no command topics, because playing them could move a robot. Plans are written to
`report/plan`.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from epson_driver.report.figures import Figures
from epson_driver.report.run import FLAGS, NANOSECONDS, Run, RunError

INDUSTRIAL_MSGS = {
    'industrial_msgs/msg/TriState': """int8 val
int8 UNKNOWN=-1
int8 TRUE=1
int8 ON=1
int8 ENABLED=1
int8 HIGH=1
int8 CLOSED=1
int8 FALSE=0
int8 OFF=0
int8 DISABLED=0
int8 LOW=0
int8 OPEN=0
""",
    'industrial_msgs/msg/RobotMode': """int8 val
int8 UNKNOWN=-1
int8 MANUAL=1
int8 AUTO=2
""",
    'industrial_msgs/msg/RobotStatus': """std_msgs/Header header
industrial_msgs/RobotMode mode
industrial_msgs/TriState e_stopped
industrial_msgs/TriState drives_powered
industrial_msgs/TriState motion_possible
industrial_msgs/TriState in_motion
industrial_msgs/TriState in_error
int32[] error_codes
""",
}
"""The message definitions of interfaces/industrial_msgs. A test compares both."""


def typestore() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in INDUSTRIAL_MSGS.items():
        store.register(get_types_from_msg(definition, name))
    return store


METADATA_VERSION: Final = 9  # version of metadata.yaml that ROS 2 Jazzy writes
LEVELS = {'info': 20, 'warning': 30, 'error': 40}  # levels of rcl_interfaces/Log

TOPICS = {
    'joint_states': 'sensor_msgs/msg/JointState',
    'robot_status': 'industrial_msgs/msg/RobotStatus',
    'report/plan': 'trajectory_msgs/msg/JointTrajectory',
    'report/events': 'rcl_interfaces/msg/Log',
    'report/reply_latency': 'std_msgs/msg/Float64',
}


def write_bag(run: Run, numbers: Figures, folder: Path) -> None:
    """Write a run, with the velocities of `numbers`, into a new folder.

    Raises RunError if the folder exists, and OSError if the bag cannot be written. In this case
    the new folder is removed.
    """
    if folder.exists():
        raise RunError(f'{folder}: must be a new folder for the bag')
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f'.{folder.name}', dir=folder.parent) as scratch:
        made = Path(scratch, folder.name)
        _write(run, numbers, made)
        made.replace(folder)


def _write(run: Run, numbers: Figures, folder: Path) -> None:
    store = typestore()
    rows = sorted(_messages(run, numbers, store), key=lambda row: row[0])
    writer = Writer(folder, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(f'/{topic}', kind, typestore=store)
            for topic, kind in TOPICS.items()
        }
        for stamp, topic, message in rows:
            data = store.serialize_cdr(message, TOPICS[topic])
            writer.write(connections[topic], stamp, data)


def _messages(run: Run, numbers: Figures, store: Any) -> Iterator[tuple[int, str, Any]]:
    """Yield the messages of a run: time, ns since 1970, topic and message."""
    types = store.types
    time_type, header_type = types['builtin_interfaces/msg/Time'], types['std_msgs/msg/Header']

    def stamp(time: float) -> Any:
        return time_type(*divmod(run.nanoseconds(time), NANOSECONDS))

    def message(topic: str, time: float, *fields: Any, **more: Any) -> tuple[int, str, Any]:
        return run.nanoseconds(time), topic, types[TOPICS[topic]](*fields, **more)

    names = list(run.joint_names)
    none = np.array([], dtype=float)
    for time, position, velocity in zip(
        run.times.tolist(), run.positions, numbers.velocities, strict=True
    ):
        fields = (header_type(stamp(time), ''), names, position.copy(), velocity.copy(), none)
        yield message('joint_states', time, *fields)
    tri, mode = types['industrial_msgs/msg/TriState'], types['industrial_msgs/msg/RobotMode']
    for condition in run.conditions:
        more = {name: tri(value) for name, value in zip(FLAGS, condition.flags, strict=True)}
        more['error_codes'] = np.array(condition.error_codes, dtype=np.int32)
        more |= {'header': header_type(stamp(condition.time), ''), 'mode': mode(condition.mode)}
        yield message('robot_status', condition.time, **more)
    point = types['trajectory_msgs/msg/JointTrajectoryPoint']
    duration = types['builtin_interfaces/msg/Duration']
    for plan in run.plans:
        times = [duration(*divmod(round(t * 1e9), NANOSECONDS)) for t in plan.times.tolist()]
        points = [
            point(position.copy(), none, none, none, time)
            for time, position in zip(times, plan.positions, strict=True)
        ]
        yield message('report/plan', plan.sent, header_type(stamp(plan.sent), ''), names, points)
    for event in run.events:
        text = f'{event.text}\n{event.remedy}' if event.remedy else event.text
        source = ('epson_driver report', text, '', '', 0)  # node, text, file, function, line
        yield message('report/events', event.time, stamp(event.time), LEVELS[event.level], *source)
    for reply in run.replies:
        yield message('report/reply_latency', reply.time, reply.latency)
