# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What each stage of a state message costs, driver and floor, one by one: a process of its own.

The subscriber of the topic must be there: without one DDS sends nothing.
"""

import asyncio
import json
import socket
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from benchmark.floor import MESSAGE, PREFIX
from benchmark.state_sender import frame
from epson_driver.driver.state.robot_state import RobotState, StateRules
from epson_driver.link.connection import Connection, Receivers
from epson_driver.node.messages import JointStateWriter
from epson_driver.node.ros_time import RosTimeStamps
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import PacketFramer

ROUNDS = 5
MESSAGES = 2000
PUBLISHED = 400
PUBLISH_PERIOD_S = 0.001
PERIOD_S = 1 / 182
JOINTS = [f'joint_{number}' for number in range(1, 7)]


@dataclass(frozen=True)
class Stages:
    """CPU time of each stage, s per message: (floor, driver)."""

    socket: tuple[float, float]
    decode: tuple[float, float]
    velocity: tuple[float, float]
    message: tuple[float, float]
    publish: tuple[float, float]

    @staticmethod
    def read(text: str) -> 'Stages':
        """Return what `main` has printed."""
        data = json.loads(text)
        return Stages(**{name: (pair[0], pair[1]) for name, pair in data.items()})


def fastest(work: Callable[[], None]) -> float:
    """Return the CPU time of one of MESSAGES calls' work, s, in the best of some rounds."""
    times = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        work()
        times.append((time.thread_time() - begin) / MESSAGES)
    return min(times)


def decoding() -> tuple[float, float]:
    """Return what it costs to cut frames and read them."""
    frames = [frame(number) for number in range(MESSAGES)]

    def floor() -> None:
        for data in frames:
            PREFIX.unpack(data[:4])
            MESSAGE.unpack_from(data[4:])

    framer = PacketFramer()

    def ours() -> None:
        for data in frames:
            framer.receive_data(data)
            if framer.next_packet() is None:
                raise AssertionError('a frame is missing')

    return fastest(floor), fastest(ours)


def velocities() -> tuple[float, float]:
    """Return what it costs to check joints, to find when they were measured, and how fast."""
    limits = load_robot_model('c3_a601s').limits
    state = RobotState(len(JOINTS), rules=StateRules(PERIOD_S, limits))
    number = 0

    def ours() -> None:
        nonlocal number
        for _ in range(MESSAGES):
            number += 1
            state.on_joints((number * 1e-6,) * 10, number * PERIOD_S)

    return 0.0, fastest(ours)


def messages(node: Node) -> tuple[float, float]:
    """Return what it costs to fill the ROS message."""
    clock, joints = node.get_clock(), (0.1,) * 6
    message = JointState(name=JOINTS)

    def floor() -> None:
        for _ in range(MESSAGES):
            message.header.stamp = clock.now().to_msg()
            message.position = joints

    state = RobotState(len(JOINTS))
    state.on_joints((0.1,) * 10, 0.0)
    sample = state.on_joints((0.1,) * 10, 0.01)
    if sample is None:
        raise AssertionError('no sample')
    stamps, writer = RosTimeStamps(clock, time.monotonic), JointStateWriter(JOINTS)

    def ours() -> None:
        for _ in range(MESSAGES):
            writer.write(sample, stamps.stamp(sample.measured))

    return fastest(floor), fastest(ours)


def publishing(publisher: Publisher) -> tuple[float, float]:
    """Return what it costs this thread to publish; the driver's message has velocities."""
    found = []
    for message in (
        JointState(name=JOINTS, position=[0.1] * 6),
        JointState(name=JOINTS, position=[0.1] * 6, velocity=[0.1] * 6),
    ):
        used = 0.0
        for _ in range(PUBLISHED):
            begin = time.thread_time()
            publisher.publish(message)
            used += time.thread_time() - begin
            time.sleep(PUBLISH_PERIOD_S)
        found.append(used / PUBLISHED)
    return found[0], found[1]


async def reading() -> tuple[float, float]:
    """Return what the event loop and the socket cost, less what is made of the bytes.

    Each message lets the next one be sent in the same loop; what that costs is measured, too.
    """
    data = frame(1)
    ours, theirs = socket.socketpair()
    begin = time.thread_time()
    for _ in range(MESSAGES):
        theirs.send(data)
        ours.recv(1000)
    sending = (time.thread_time() - begin) / MESSAGES / 2
    reader, writer = await asyncio.open_connection(sock=ours)
    begin = time.thread_time()
    for _ in range(MESSAGES):
        theirs.send(data)
        (length,) = struct.unpack('<i', await reader.readexactly(4))
        await reader.readexactly(length)
    streams = (time.thread_time() - begin) / MESSAGES - sending
    writer.close()
    theirs.close()
    ours, theirs = socket.socketpair()
    done = asyncio.get_running_loop().create_future()
    left = MESSAGES

    def taken(packet: object) -> None:
        nonlocal left
        left -= 1
        if left:
            theirs.send(data)
        else:
            done.set_result(None)

    receivers = Receivers(lambda _: None, taken, lambda _: None, lambda _: None)
    connection = Connection(receivers, PacketFramer(), 1.0)
    await asyncio.get_running_loop().create_connection(lambda: connection, sock=ours)
    connection.begin()
    begin = time.thread_time()
    theirs.send(data)
    await done
    protocol = (time.thread_time() - begin) / MESSAGES - sending
    connection.end('measured')
    theirs.close()
    return streams, protocol


def main() -> None:
    """Print the stages as JSON."""
    rclpy.init()
    node = rclpy.create_node('stages')
    publisher = node.create_publisher(JointState, sys.argv[1], 10)
    until = time.monotonic() + 30.0
    while not publisher.get_subscription_count() and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(0.5)
    decode = decoding()
    streams, protocol = asyncio.run(reading())
    stages = Stages(
        # the protocol has decoded its messages
        (streams, max(protocol - decode[1], 0.0)),
        decode,
        velocities(),
        messages(node),
        publishing(publisher),
    )
    print(json.dumps(asdict(stages)))
    rclpy.shutdown()


if __name__ == '__main__':
    main()
