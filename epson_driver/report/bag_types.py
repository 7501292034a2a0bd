# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The message types of our bags for the library rosbags, which needs no ROS installation."""

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

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
"""Copies of interfaces/industrial_msgs, from ROS-Industrial. A test compares them."""


def typestore() -> Any:
    """Return the types of ROS 2 Jazzy and industrial_msgs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in INDUSTRIAL_MSGS.items():
        store.register(get_types_from_msg(definition, name))
    return store
