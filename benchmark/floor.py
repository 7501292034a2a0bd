# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Publish joint states with as little code as possible: a reference for the driver.

A StreamReader and struct decode them into one reused message, without checks and velocities. The
program has no other topic and no motion interface, so it has no practical use.
"""

import argparse
import asyncio
import socket
import struct

import rclpy
from rclpy.clock import Clock
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

JOINT_POSITION = 10
PREFIX = struct.Struct('<i')
MESSAGE = struct.Struct('<3ii6f')
"""Layout after the prefix: type, communication type, reply code, sequence and six joints."""


async def forward(port: int, publisher: Publisher, clock: Clock, message: JointState) -> None:
    """Publish each JOINT_POSITION of a state port, until the controller closes it."""
    reader, writer = await asyncio.open_connection('127.0.0.1', port)
    writer.get_extra_info('socket').setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    while True:
        try:
            (length,) = PREFIX.unpack(await reader.readexactly(4))
            frame = await reader.readexactly(length)
        except asyncio.IncompleteReadError:
            return
        msg_type, _, _, _, *joints = MESSAGE.unpack_from(frame)
        if msg_type == JOINT_POSITION:
            message.header.stamp = clock.now().to_msg()
            message.position = joints
            publisher.publish(message)


def main() -> None:
    """Run until the controller closes the connection."""
    parser = argparse.ArgumentParser(prog='benchmark.floor', description=__doc__)
    parser.add_argument('port', type=int, help='state port of a controller on this machine')
    parser.add_argument('topic', help='topic for the joint states')
    arguments = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node('floor')
    publisher = node.create_publisher(JointState, arguments.topic, 10)
    message = JointState(name=[f'joint_{number}' for number in range(1, 7)])
    asyncio.run(forward(arguments.port, publisher, node.get_clock(), message))


if __name__ == '__main__':
    main()
