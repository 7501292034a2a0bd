# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The minimal path of joint states from a controller into ROS: the reference for the driver.

It is a StreamReader, struct, and one reused message. It checks nothing, has no velocities, no
other topic and no motion interface, so it has no practical use.
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
        (length,) = PREFIX.unpack(await reader.readexactly(4))
        frame = await reader.readexactly(length)
        msg_type, _, _, _, *joints = MESSAGE.unpack_from(frame)
        if msg_type == JOINT_POSITION:
            message.header.stamp = clock.now().to_msg()
            message.position = joints
            publisher.publish(message)


def main() -> None:
    """Run until the controller closes the connection."""
    parser = argparse.ArgumentParser(prog='benchmark.floor', description=__doc__)
    parser.add_argument('port', type=int, help='of the state, on this machine')
    parser.add_argument('topic')
    arguments = parser.parse_args()
    rclpy.init()
    node = rclpy.create_node('floor')
    publisher = node.create_publisher(JointState, arguments.topic, 10)
    message = JointState(name=[f'joint_{number}' for number in range(1, 7)])
    asyncio.run(forward(arguments.port, publisher, node.get_clock(), message))


if __name__ == '__main__':
    main()
