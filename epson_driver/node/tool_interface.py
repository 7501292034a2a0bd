# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The tool (TCP) of motion primitives, the service `~/set_tool`, and frames on `/tf_static`.

The service or the parameters `tool.…` define the pose of the tool in tool0. A request's payload is
only sent to controllers that run no motion program.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from epson_msgs.srv import SetTool
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from epson_driver.inputs import FRAME_NAME, InputError, shown
from epson_driver.motion import Array
from epson_driver.node.loop_bridge import LATCHED, NodeContext
from epson_driver.node.motion_primitives import MotionPrimitives, ToolBusyError, pose_values
from epson_driver.robots import RobotModel
from epson_driver.tool_motion.tool_pose import (
    check_tool_distance,
    finite_numbers,
    pose_of_quaternion,
)

BASE, FLANGE = 'base_link', 'tool0'
"""Links that every model has: the base of the arm, and the parent of the tool."""


class StaticFrames:
    """Publishes the frames of the tool and of taught points on `/tf_static`.

    All frames are in one message, because a late subscriber only receives the last message.
    `prefix`: prefix of all link and frame names. The methods take names without the prefix.
    """

    def __init__(self, context: NodeContext) -> None:
        self.prefix = link_prefix(context.values['frame_id'])
        self._clock = context.node.get_clock()
        self._publisher = context.node.create_publisher(TFMessage, '/tf_static', LATCHED)
        self._tool: str = context.values['tool.name']
        self._transforms: dict[str, dict[str, TransformStamped]] = {'tool': {}}

    def taken(self, name: str, owner: str) -> bool:
        others = (names for item, names in self._transforms.items() if item != owner)
        return (name == self._tool and owner != 'tool') or any(name in names for names in others)

    def publish(self, owner: str, parent: str, frames: Mapping[str, Array]) -> None:
        """Replace the frames of an owner. frames: by name, x y z, m, and a quaternion x y z w."""
        stamp = self._clock.now().to_msg()
        transforms = self._transforms[owner] = {}
        for name, values in frames.items():
            message = transforms[name] = TransformStamped(child_frame_id=self.prefix + name)
            message.header.frame_id = self.prefix + parent
            message.header.stamp = stamp
            set_values(message.transform, values, ('translation', 'rotation'))
        if messages := [item for names in self._transforms.values() for item in names.values()]:
            self._publisher.publish(TFMessage(transforms=messages))


def links(model: RobotModel) -> set[str]:
    numbered = (f'link_{index}' for index, _ in enumerate(model.joint_names, 1))
    return {'world', BASE, 'base_link_inertia', 'base', *numbered, 'flange', FLANGE}


def link_prefix(frame_id: str) -> str:
    return frame_id.removesuffix(BASE) if frame_id.endswith(BASE) else ''


def set_values(message: Any, values: Array, fields: tuple[str, str]) -> None:
    numbers = iter(values.tolist())
    for field, names in zip(fields, ('xyz', 'xyzw'), strict=True):
        for name in names:
            setattr(getattr(message, field), name, next(numbers))


@dataclass(frozen=True, eq=False)
class NamedTool:
    """A tool (TCP) and its frame.

    * name: name of the frame without the prefix of the arm's links.
    * values: pose of the tool in tool0: x y z, m, and a unit quaternion x y z w.
    * pose: the same pose as a homogeneous matrix, shape (4, 4), m.
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
    """Return a checked tool. `fields`: names of the fields of pose and name, for error texts."""
    pose_field, name_field = fields
    FRAME_NAME.checked(name, name_field)
    if name in links(model):
        raise InputError(
            f'{name_field} = {shown(name)}: must not be the name of a frame of the arm or its base'
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
    def __init__(
        self, context: NodeContext, primitives: MotionPrimitives, frames: StaticFrames
    ) -> None:
        self._logger = context.node.get_logger()
        self._primitives = primitives
        self._frames = frames
        self._model = context.setup.model
        self._default_name: str = context.values['tool.name']
        try:
            tool = named_tool(
                self._model,
                context.values['tool.pose'],
                self._default_name,
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
                self._model, pose_values(request.pose), request.name or self._default_name
            )
            self._apply(tool)
            sent = self._primitives.set_payload(payload)
        except (ValueError, ToolBusyError) as error:
            response.message = str(error)
            response.success = False
        else:
            response.message = self._sentence(tool, payload, sent)
            response.success = True
        self._logger.info(f'~/set_tool: {response.message}')
        return response

    def _apply(self, tool: NamedTool) -> None:
        if self._frames.taken(tool.name, 'tool'):
            raise InputError(f'name = {shown(tool.name)}: must not be the name of a taught point')
        self._primitives.set_tool(tool.pose)
        self._frames.publish('tool', FLANGE, {tool.name: tool.values})

    def _sentence(self, tool: NamedTool, payload: float, sent: bool) -> str:
        x, y, z = tool.values[:3]
        prefix = self._frames.prefix
        text = (
            f'motion primitives now use {prefix}{tool.name}, at {x:g}, {y:g}, '
            f'{z:g} m in {prefix}{FLANGE}'
        )
        if payload:
            note = 'sent with each motion' if sent else 'only noted, not sent to the controller'
            text += f', payload {payload:g} kg: {note}'
        return text
