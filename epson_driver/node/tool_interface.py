# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tool (TCP) of motion primitives: `~/set_tool`, and its frame on `/tf_static`.

The tool is where the request or the parameters `tool.…` say, in tool0. The payload is
checked, and told to a controller that takes statements; to others it goes not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from epson_msgs.srv import SetTool
from geometry_msgs.msg import Pose, TransformStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from epson_driver.inputs import FRAME_NAME, InputError, shown
from epson_driver.motion import Array
from epson_driver.node.loop_bridge import LoopBridge
from epson_driver.node.motion_primitives import MotionPrimitives, ToolBusyError
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.tool_motion.tool_pose import (
    check_tool_distance,
    finite_numbers,
    pose_of_quaternion,
)

BASE, FLANGE = 'base_link', 'tool0'
"""Links of every model: where `frame_id` ends, and what tools hang on."""

STATIC_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""That of tf2_ros' StaticTransformBroadcaster."""


@dataclass(frozen=True, eq=False)
class NamedTool:
    """A tool. name: without the links' prefix. values: x y z, m, and a unit quaternion x y z w.

    pose: the same as a homogeneous matrix, shape (4, 4), in tool0.
    """

    name: str
    values: Array
    pose: Array


def named_tool(
    model: RobotModel,
    values: Array | list[float],
    name: str,
    fields: tuple[str, str] = ('pose', 'name'),
) -> NamedTool:
    """Return a checked tool. fields: the names of pose and name in an error text.

    Raises ValueError that names the field, its value and the limit.
    """
    pose_field, name_field = fields
    FRAME_NAME.checked(name, name_field)
    if name in links(model):
        raise InputError(
            f'{name_field} = {shown(name)}: the arm, or its place, has a frame of that name'
        )
    array = finite_numbers(pose_field, values)
    if array.shape != (7,):
        raise InputError(
            f'{pose_field} has {array.size} numbers: must have 7, x y z and a quaternion x y z w'
        )
    pose = pose_of_quaternion(pose_field, array)
    check_tool_distance(pose_field, pose)
    array[3:] /= np.linalg.norm(array[3:])
    return NamedTool(name, array, pose)


def links(model: RobotModel) -> set[str]:
    """Return the frames of an arm without their prefix, and the one that it stands in."""
    numbered = (f'link_{index}' for index, _ in enumerate(model.joint_names, 1))
    return {'world', BASE, 'base_link_inertia', 'base', *numbered, 'flange', FLANGE}


def link_prefix(frame_id: str) -> str:
    """Return the prefix of the links' names, by the frame of the joint states."""
    return frame_id.removesuffix(BASE) if frame_id.endswith(BASE) else ''


class ToolInterface:
    """Sets the tool of motion primitives. `parameters`: the node's values by name.

    Raises InputError for parameters that cannot be used.
    """

    def __init__(
        self,
        node: Node,
        primitives: MotionPrimitives,
        bridge: LoopBridge,
        parameters: Mapping[str, Any],
        callback_group: CallbackGroup,
    ) -> None:
        self._logger = node.get_logger()
        self._clock = node.get_clock()
        self._primitives = primitives
        self._model = load_robot_model(parameters['robot_model'])
        self._prefix = link_prefix(parameters['frame_id'])
        self._usual_name: str = parameters['tool.name']
        try:
            tool = named_tool(
                self._model,
                parameters['tool.pose'],
                self._usual_name,
                ('parameter tool.pose', 'parameter tool.name'),
            )
        except ValueError as error:
            raise InputError(str(error)) from error
        self._static = node.create_publisher(TFMessage, '/tf_static', STATIC_QOS)
        if not np.array_equal(tool.pose, np.eye(4)):
            self._apply(tool)
        bridge.create_service(SetTool, '~/set_tool', self._serve, callback_group)

    # in the executor's thread, and without an await: no sequence can begin in between
    async def _serve(
        self, request: SetTool.Request, response: SetTool.Response
    ) -> SetTool.Response:
        try:
            payload = self._model.checked_payload(request.payload)
            tool = named_tool(
                self._model, pose_values(request.pose), request.name or self._usual_name
            )
            self._apply(tool)
            told = self._primitives.set_payload(payload)
        except (ValueError, ToolBusyError) as error:
            response.message = str(error)
            response.success = False
        else:
            response.message = self._sentence(tool, payload, told)
            response.success = True
        self._logger.info(f'~/set_tool: {response.message}')
        return response

    def _apply(self, tool: NamedTool) -> None:
        """Raises ToolBusyError."""
        self._primitives.set_tool(tool.pose)
        self._static.publish(TFMessage(transforms=[self._transform(tool)]))

    def _transform(self, tool: NamedTool) -> TransformStamped:
        message = TransformStamped(child_frame_id=self._prefix + tool.name)
        message.header.frame_id = self._prefix + FLANGE
        message.header.stamp = self._clock.now().to_msg()
        set_values(message.transform, tool.values, ('translation', 'rotation'))
        return message

    def _sentence(self, tool: NamedTool, payload: float, told: bool) -> str:
        x, y, z = tool.values[:3]
        text = (
            f'motion primitives move {self._prefix}{tool.name} from now on, at {x:g}, {y:g}, '
            f'{z:g} m in {self._prefix}{FLANGE}'
        )
        if payload:
            note = 'told with each motion' if told else 'a note, which the controller is not told'
            text += f'; payload {payload:g} kg: {note}'
        return text


def set_values(message: Any, values: Array, fields: tuple[str, str]) -> None:
    """Set place and turn of a message, by their names, to x y z and a quaternion x y z w."""
    left = iter(values.tolist())
    for field, names in zip(fields, ('xyz', 'xyzw'), strict=True):
        for name in names:
            setattr(getattr(message, field), name, next(left))


def pose_values(pose: Pose) -> list[float]:
    """Return x y z and the quaternion x y z w of a message."""
    place = [getattr(pose.position, name) for name in 'xyz']
    return place + [getattr(pose.orientation, name) for name in 'xyzw']
