# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tool (TCP) of motion primitives: `~/set_tool`, and its frame on `/tf_static`.

The request or the parameters `tool.…` define the pose of the tool in tool0. The payload is
checked, and sent only to controllers that execute statements.
"""

from dataclasses import dataclass

import numpy as np
from epson_msgs.srv import SetTool
from geometry_msgs.msg import Pose

from epson_driver.inputs import FRAME_NAME, InputError, shown
from epson_driver.motion import Array
from epson_driver.node.loop_bridge import NodeContext
from epson_driver.node.motion_primitives import MotionPrimitives, ToolBusyError
from epson_driver.node.static_frames import FLANGE, StaticFrames, links
from epson_driver.robots import RobotModel
from epson_driver.tool_motion.tool_pose import (
    check_tool_distance,
    finite_numbers,
    pose_of_quaternion,
)


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

    Raises ValueError with the field, its value and the limit.
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


class ToolInterface:
    """Sets the tool of motion primitives. Raises InputError for invalid parameters."""

    def __init__(
        self, context: NodeContext, primitives: MotionPrimitives, frames: StaticFrames
    ) -> None:
        self._logger = context.node.get_logger()
        self._primitives = primitives
        self._frames = frames
        self._model = context.setup.model
        self._usual_name: str = context.values['tool.name']
        try:
            tool = named_tool(
                self._model,
                context.values['tool.pose'],
                self._usual_name,
                ('parameter tool.pose', 'parameter tool.name'),
            )
        except ValueError as error:
            raise InputError(str(error)) from error
        if not np.array_equal(tool.pose, np.eye(4)):
            self._apply(tool)
        context.bridge.create_service(SetTool, '~/set_tool', self._serve)

    # in the executor's thread and without an await: no sequence can start in between
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
        """Use a tool, and publish its frame. Raises ToolBusyError, InputError."""
        if self._frames.taken(tool.name, 'tool'):
            raise InputError(f'name = {shown(tool.name)}: a taught point has a frame of that name')
        self._primitives.set_tool(tool.pose)
        self._frames.publish('tool', FLANGE, {tool.name: tool.values})

    def _sentence(self, tool: NamedTool, payload: float, told: bool) -> str:
        x, y, z = tool.values[:3]
        prefix = self._frames.prefix
        text = (
            f'motion primitives move {prefix}{tool.name} from now on, at {x:g}, {y:g}, '
            f'{z:g} m in {prefix}{FLANGE}'
        )
        if payload:
            note = 'told with each motion' if told else 'a note, which the controller is not told'
            text += f'; payload {payload:g} kg: {note}'
        return text


def pose_values(pose: Pose) -> list[float]:
    """Return x y z and the quaternion x y z w of a message."""
    place = [getattr(pose.position, name) for name in 'xyz']
    return place + [getattr(pose.orientation, name) for name in 'xyzw']
