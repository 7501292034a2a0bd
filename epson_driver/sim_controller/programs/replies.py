# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The forms of the reply to a point that controllers are known to send."""

from collections.abc import Callable

from epson_driver.simple_message import JointPosition, Message, MessageType, Opaque

REPLIES: dict[str, Callable[[int], Message]] = {
    'sequence': JointPosition,
    'zero': lambda sequence: JointPosition(),
    'header': lambda sequence: Opaque(MessageType.JOINT_TRAJ_PT),
}
"""The reply to the point with a sequence, by the profile's word for its form."""
