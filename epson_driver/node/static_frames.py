# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The frames of a robot's node on `/tf_static`: its tool, and its taught points."""

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from epson_driver.motion import Array
from epson_driver.node.loop_bridge import NodeContext
from epson_driver.robots import RobotModel

BASE, FLANGE = 'base_link', 'tool0'
"""Links of every model: the end of `frame_id`, and the parent of tools."""

STATIC_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""QoS of tf2_ros' StaticTransformBroadcaster."""


class StaticFrames:
    """Publishes all frames in one message, because a late subscriber only receives the last one.

    prefix: of the links' names. A frame has one owner, and a name without the prefix.
    """

    def __init__(self, context: NodeContext) -> None:
        self.prefix = link_prefix(context.values['frame_id'])
        self._clock = context.node.get_clock()
        self._publisher = context.node.create_publisher(TFMessage, '/tf_static', STATIC_QOS)
        self._tool: str = context.values['tool.name']
        self._transforms: dict[str, dict[str, TransformStamped]] = {'tool': {}}

    def taken(self, name: str, owner: str) -> bool:
        """Return whether another owner has, or may get, a frame of that name."""
        others = (names for each, names in self._transforms.items() if each != owner)
        return (name == self._tool and owner != 'tool') or any(name in names for names in others)

    def publish(self, owner: str, parent: str, frames: Mapping[str, Array]) -> None:
        """Replace the frames of an owner: x y z, m, and a quaternion x y z w, by name."""
        stamp = self._clock.now().to_msg()
        transforms = self._transforms[owner] = {}
        for name, values in frames.items():
            message = transforms[name] = TransformStamped(child_frame_id=self.prefix + name)
            message.header.frame_id = self.prefix + parent
            message.header.stamp = stamp
            set_values(message.transform, values, ('translation', 'rotation'))
        if together := [each for names in self._transforms.values() for each in names.values()]:
            self._publisher.publish(TFMessage(transforms=together))


def links(model: RobotModel) -> set[str]:
    """Return the frame names of an arm without prefix, including its parent frame."""
    numbered = (f'link_{index}' for index, _ in enumerate(model.joint_names, 1))
    return {'world', BASE, 'base_link_inertia', 'base', *numbered, 'flange', FLANGE}


def link_prefix(frame_id: str) -> str:
    """Return the prefix of the links' names, from the frame of the joint states."""
    return frame_id.removesuffix(BASE) if frame_id.endswith(BASE) else ''


def set_values(message: Any, values: Array, fields: tuple[str, str]) -> None:
    """Set position and orientation, given by field names, to x y z and a quaternion x y z w."""
    left = iter(values.tolist())
    for field, names in zip(fields, ('xyz', 'xyzw'), strict=True):
        for name in names:
            setattr(getattr(message, field), name, next(left))
