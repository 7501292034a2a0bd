# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Scripts of a client at the motion port, which send the same bytes to every program.

A script is a list of bytes to send, times to wait, s, and words for events at the controller.
"""

import struct

from support.controller_harness import STOP, frame, point, point_body

NAN, INF = float('nan'), float('inf')
TOPIC, REQUEST, REPLY = 1, 2, 3
START_DOWNLOAD, START_STREAMING, END = -1, -2, -3
WAIT = 0.3
Script = list[bytes | float | str]


def at(*degrees):
    """Return joint angles, rad."""
    values = [value * 0.017453292519943295 for value in degrees]
    return [*values, *[0.0] * (6 - len(values))]


def line(count, first=0, step=2.0, comm_type=REQUEST, seconds=0.3):
    """Return points that move joint 1 by `step` degrees each, with consecutive sequences."""
    return [
        point(first + number, at(step * (number + 1)), 0.0, seconds, comm_type)
        for number in range(count)
    ]


def ten(*values):
    """Return a point with ten joints, four more than the robot has."""
    return frame(11, REQUEST, 0, struct.pack('<i12f', 0, *at(1.0), *values, 0.0, 0.5))


SCRIPTS: dict[str, Script] = {
    'a stream': [*line(5)],
    'a stream that begins with -2': [point(START_STREAMING, at(1.0), 0.0, 0.3), *line(3, first=1)],
    'a stream after another': [*line(3), 3.0, *line(3)],
    'a sequence that leaves one out': [*line(2), WAIT, point(3, at(8.0), 0.0, 0.3)],
    'a sequence twice': [*line(2), WAIT, point(1, at(8.0), 0.0, 0.3)],
    'a first sequence that is not 0': [point(4, at(2.0), 0.0, 0.3)],
    'a stream after a failure': [point(4, at(2.0), 0.0, 0.3), WAIT, *line(2)],
    'the next point after a failure': [*line(2), 2.0, point(9, at(6.0)), WAIT, point(2, at(6.0))],
    'a sequence below -4': [point(-7, at(2.0), 0.0, 0.3)],
    'a joint that is not a number': [point(0, [NAN, *at()[1:]], 0.0, 0.3)],
    'a joint that is infinite': [point(0, [*at()[:5], INF], 0.0, 0.3)],
    'a joint that the robot lacks is not a number': [ten(0.0, NAN, 0.0, 0.0)],
    'a joint that the robot lacks has a value': [ten(0.0, 1.0, 0.0, 0.0)],
    'a joint out of range': [point(0, at(171.0), 0.0, 0.3)],
    'a joint out of range in a stream': [*line(2), point(2, at(0.0, 70.0)), *line(2, first=3)],
    'a velocity above 1': [point(0, at(2.0), 1.5, 0.3)],
    'a negative velocity': [point(0, at(2.0), -0.5, 0.3)],
    'a negative duration': [point(0, at(2.0), 0.0, -1.0)],
    'a duration that is not a number': [point(0, at(2.0), 0.0, NAN)],
    'a duration of two days': [point(0, at(2.0), 0.0, 172_800.0)],
    'a STOP at rest': [point(STOP)],
    'a STOP with the motors off': ['motors off', WAIT, point(STOP)],
    'a STOP with the E-stop pressed': ['E-stop press', WAIT, point(STOP)],
    'a STOP while paused': ['pause', WAIT, point(STOP)],
    'a STOP that is a topic': [point(STOP, comm_type=TOPIC)],
    'a point with the motors off': ['motors off', WAIT, point(0, at(2.0), 0.0, 0.3)],
    'a point with the E-stop pressed': ['E-stop press', WAIT, point(0, at(2.0), 0.0, 0.3)],
    'a point in MANUAL': ['mode manual', 1.0, point(0, at(2.0), 0.0, 0.3)],
    'a point after stop': ['stop', WAIT, point(0, at(2.0), 0.0, 0.3)],
    'a point that is a topic': [point(0, at(2.0), 0.0, 0.3, comm_type=TOPIC)],
    'a point that is a reply': [point(0, at(2.0), 0.0, 0.3, comm_type=REPLY, reply_code=1)],
    'a point with a reply code': [point(0, at(2.0), 0.0, 0.3, reply_code=1)],
    'a point of an unknown kind': [point(0, at(2.0), 0.0, 0.3, comm_type=9)],
    'a point that is too short': [frame(11, REQUEST, 0, point_body(0)[:-4])],
    'a point that is too long': [frame(11, REQUEST, 0, point_body(0) + bytes(4))],
    'a download of topics': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3, TOPIC),
        *line(3, first=1, comm_type=TOPIC),
        point(END, at(9.0), 0.0, 0.3, TOPIC),
    ],
    'a download of requests': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3),
        *line(3, first=1),
        point(END, at(9.0), 0.0, 0.3),
    ],
    'a download with a point out of range': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3),
        point(1, at(175.0), 0.0, 0.3),
        point(2, at(2.0), 0.0, 0.3),
        point(END, at(9.0), 0.0, 0.3),
    ],
    'a download that a STOP ends': [
        point(START_DOWNLOAD, at(1.0), 0.0, 0.3),
        point(1, at(2.0), 0.0, 0.3),
        point(STOP),
        point(END, at(9.0), 0.0, 0.3),
    ],
    'a PING': [frame(1, REQUEST, 0, bytes(40))],
    'an empty PING': [frame(1, REQUEST, 0)],
    'a PING that is a topic': [frame(1, TOPIC, 0, bytes(40))],
    'GET_VERSION': [frame(2, REQUEST, 0)],
    'an unknown request': [frame(999, REQUEST, 0, bytes(20))],
    'an unknown topic': [frame(999, TOPIC, 0, bytes(20))],
    'a message of type 0': [frame(0, REQUEST, 0)],
    'a message of a negative type': [frame(-5, REQUEST, 0, bytes(4))],
    'a PING in pieces': [
        frame(1, REQUEST, 0, bytes(40))[:7],
        0.1,
        frame(1, REQUEST, 0, bytes(40))[7:],
    ],
    'a length below 12': [struct.pack('<5i', 8, 1, 2, 0, 0)],
    'a length of 2 MB': [struct.pack('<i', 2_000_000) + bytes(100)],
    'a message of 2,000 bytes': [frame(999, TOPIC, 0, bytes(2000)), frame(1, REQUEST, 0)],
    'a message that does not end': [frame(1, REQUEST, 0, bytes(40))[:30], 3.0],
}
