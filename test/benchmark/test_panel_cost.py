# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What `make bench` makes of what it saw beside the panel."""

import pytest

pytest.importorskip('viser')

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from benchmark.panel import Window, median, stamp


def test_the_stamp_is_read_from_the_bytes_of_a_message() -> None:
    header = Header(stamp=Time(sec=1_795_000_000, nanosec=123_456_789), frame_id='base')
    message = JointState(header=header, name=['joint_1'], position=[1.0])
    assert stamp(serialize_message(message)) == pytest.approx(1_795_000_000.123456789, abs=1e-6)


def test_a_figure_is_the_median_of_its_windows() -> None:
    rows = [
        Window(180.0, 1.0, 9.0, 0.2),
        Window(170.0, 3.0, 8.0, 0.1),
        Window(90.0, 2.0, 7.0, 0.3),
    ]
    assert median(rows) == Window(170.0, 2.0, 8.0, 0.2)
