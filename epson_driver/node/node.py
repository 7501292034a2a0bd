# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node: it connects topics, services and the action with the `Driver`.

It has two threads. The first one runs rclpy's executor. The second one runs the driver's event
loop, which also publishes. Requests enter the loop through `call_soon_threadsafe`, and replies
return through an rclpy future.
"""

import asyncio
import os
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from epson_msgs.srv import SetSpeedScaling
from industrial_msgs.msg import RobotStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

from epson_driver.driver.arm_commands import ArmCommands, CommandError
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks import report_task_error, run_task_group
from epson_driver.node import messages, parameters
from epson_driver.node.diagnostics import Diagnostics
from epson_driver.node.goal_server import GoalServer
from epson_driver.node.io_interface import GripperServer, IoInterface
from epson_driver.node.loop_bridge import LATCHED, DriverEndedError, LoopBridge, NodeContext
from epson_driver.node.messages import error_text
from epson_driver.node.motion_primitives import MotionPrimitives
from epson_driver.node.points_interface import PointsInterface
from epson_driver.node.ros_process import RosTimeStamps, context_of
from epson_driver.node.servo_interface import ServoInterface
from epson_driver.node.tool_interface import StaticFrames, ToolInterface
from epson_driver.setup.setup import make_setup
from epson_driver.simple_message import Status
from epson_driver.trace import TraceError

PERIOD_S = 0.05
"""Time between two published values of a changing speed scaling, s."""


class SpeedScalingInterface:
    def __init__(self, context: NodeContext) -> None:
        self._goals = context.driver.goal_queue
        self._scaling = self._goals.scaling
        self._bridge = context.bridge
        self._logger = context.node.get_logger()
        self._ramp: asyncio.Task[None] | None = None
        self._factor = context.node.create_publisher(Float64, '~/speed_scaling', LATCHED)
        self._factor.publish(Float64(data=self._scaling.target))
        self._bridge.create_service(SetSpeedScaling, '~/set_speed_scaling', self._serve)

    async def _serve(
        self, request: SetSpeedScaling.Request, response: SetSpeedScaling.Response
    ) -> SetSpeedScaling.Response:
        try:
            response.message = await self._bridge.in_loop(partial(self._set, request.factor))
            response.success = True
        except ValueError as error:
            response.message = str(error)
            response.success = False
        self._logger.info(f'~/set_speed_scaling: {response.message}')
        return response

    async def _set(self, factor: float) -> str:
        message = self._goals.set_speed(factor)
        if self._ramp is not None:
            self._ramp.cancel()
        self._ramp = asyncio.create_task(self._publish())
        self._ramp.add_done_callback(report_task_error)
        return message

    async def _publish(self) -> None:
        factor = None
        while factor != self._scaling.target:
            if factor is not None:
                await asyncio.sleep(PERIOD_S)
            factor = self._scaling.factor(asyncio.get_running_loop().time())
            self._factor.publish(Float64(data=factor))


LOOK_PERIOD_S = 0.25
"""Period of the search for nodes with the same name, s. rclpy has no events for graph changes."""

DISCOVERY_S = 2.0
"""Maximum time in which nodes discover each other, s (measured on a busy machine: 1.2 s)."""

FAST_DDS = bytes((1, 15))
"""First bytes of a GUID of Fast DDS. Two bytes follow for the host, and two for the process."""


class DuplicateNodes:
    """Finds other nodes with this node's name, or with a service of the same name.

    Must be created after the services of the node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._names = [
            node.resolve_service_name('~/follow_joint_trajectory/_action/send_goal'),
            *(service.service_name for service in node.services),
        ]

    def __call__(self) -> str:
        """Return a clause with the shared name and the other processes, or '' if none exist."""
        node = self._node
        name = next((item for item in self._names if node.handle.get_count_services(item) > 1), '')
        own = (node.get_name(), node.get_namespace())
        if not name and node.get_node_names_and_namespaces().count(own) < 2:
            return ''
        return (name or node.get_fully_qualified_name()) + self._processes(name)

    def _processes(self, service: str) -> str:
        result: list[Any] = self._node.get_subscriptions_info_by_topic(
            f'rq{service}Request', no_mangle=True
        )
        guids = {bytes(item.endpoint_gid[:12]) for item in result}
        known = sorted(guid for guid in guids if guid.startswith(FAST_DDS))
        own = next((guid for guid in known if _process(guid) == os.getpid() % 2**16), b'')
        return ''.join(
            f', process {_process(guid)} (modulo 65536) on '
            + ('this machine' if guid[2:4] == own[2:4] else f'host {guid[2:4].hex()} of DDS')
            for guid in known
            if guid != own
        )


def _process(guid: bytes) -> int:
    return int.from_bytes(guid[4:6], 'little')


class ClientNode:
    """Connects an rclpy node with a driver. Must be created in the driver's event loop."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._loop = asyncio.get_running_loop()
        self._context = context_of(node.get_logger())
        values = parameters.declare(node)
        for sentence in parameters.undeclared(node):
            node.get_logger().warning(sentence)
        self._setup = make_setup(values)
        self._parameters = self._setup.values
        for sentence in self._setup.model.cautions:
            node.get_logger().warning(sentence)
        self.driver = self._setup.make_driver(self)
        self._tracing = self._context.run(parameters.Tracing, self.driver.trace, self._parameters)
        self._bridge = LoopBridge(node, self._context, self.driver.fault)
        self.commands = ArmCommands(self.driver, self._bridge.all_taken)
        """Implementation of `~/stop`, `~/enable`, `~/disable` and `~/reset_error`."""
        self._joint_state = messages.JointStateWriter(
            self.driver.configuration.limits.names, self._parameters['frame_id']
        )
        self._status = messages.RobotStatusWriter()
        self._clock = node.get_clock()
        self._stamps = RosTimeStamps(self._clock, self._loop.time)
        self._joint_states = node.create_publisher(JointState, 'joint_states', 10)
        self._robot_status = node.create_publisher(RobotStatus, 'robot_status', 10)
        self._link_state = node.create_publisher(String, '~/link_state', LATCHED)
        self._diagnostic_array = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        for name, command in (
            ('stop', self.commands.stop),
            ('enable', self.commands.enable),
            ('disable', self.commands.disable),
            ('reset_error', self.commands.reset_error),
        ):
            serve = self._trigger(name, command)
            self._bridge.create_service(Trigger, f'~/{name}', serve)
        context = NodeContext(self.driver, self._setup, self._bridge)
        self._io = IoInterface(context)
        wiring = self._setup.gripper
        self.gripper_server = None if wiring is None else GripperServer(context, wiring)
        self._speed = SpeedScalingInterface(context)
        self.goal_server = GoalServer(context, self.commands)
        self._primitives = MotionPrimitives(context, self.goal_server)
        frames = StaticFrames(context)
        self._tool = ToolInterface(context, self._primitives, frames)
        self._taught = PointsInterface(context, self.goal_server, self._primitives, frames)
        self._servo = ServoInterface(context, self.goal_server.take_trajectory)
        self._diagnostics = Diagnostics(
            self.driver, node.get_fully_qualified_name().lstrip('/'), self._servo.publishers
        )
        self.driver.second_driver = DuplicateNodes(node)
        self.driver.second_driver_known = self._loop.time() + DISCOVERY_S
        node.add_on_set_parameters_callback(self._on_set_parameters)
        self.on_link_state(self.driver.state_link.state.value, 'starting')

    async def run(self) -> None:
        parts = {
            'the driver': self.driver.run,
            'diagnostics': self._publish_diagnostics,
            'searching for nodes with the same name': self._look_for_second_driver,
        }
        together = run_task_group(parts, self.driver.shut_down)
        await self._loop.create_task(together, context=self._context)

    async def shut_down(self) -> None:
        busy = self._busy
        await self._loop.create_task(self.driver.shut_down(), context=self._context)
        await self._bridge.results_sent(lambda: self._busy, busy=busy)

    @property
    def _busy(self) -> bool:
        return self.goal_server.busy or self._primitives.busy

    def end(self) -> None:
        self._bridge.end()

    # --- from ROS: these run in the executor's thread ---------------------------------------

    def _trigger(
        self, name: str, command: Callable[[], Coroutine[Any, Any, str]]
    ) -> Callable[[Trigger.Request, Trigger.Response], Awaitable[Trigger.Response]]:
        async def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message = await self._bridge.in_loop(command)
                response.success = True
            except CommandError as error:
                response.message = error_text(error)
                response.success = False
            self._node.get_logger().info(f'~/{name}: {response.message}')
            return response

        return serve

    def _on_set_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        try:
            why = self._set_parameters(changes)
        except (TraceError, DriverEndedError) as error:
            why = str(error)
        except Exception as error:  # noqa: BLE001 - it is logged, answered, and stops the arm
            why = self._bridge.failed('setting parameters', error)
        return SetParametersResult(successful=not why, reason=why)

    def _set_parameters(self, changes: list[Parameter]) -> str:
        """Apply all changes, or none if a change is invalid.

        Return the reason in this case, else ''.

        rclpy has already checked ranges and read-only flags from the descriptors.
        """
        values = {
            parameter.name: parameter.value
            for parameter in changes
            if parameter.name in self._parameters
        }
        if why := parameters.rejection(changes):
            return why
        self._context.copy().run(self._tracing.change, values)  # the loop uses the original
        self._parameters.update(values)
        self._bridge.to_loop(self._setup.apply, self.driver)
        return ''

    # --- from the driver: these run in the loop's thread ------------------------------------

    def on_joints(self, sample: JointSample) -> None:
        stamp = self._stamps.stamp(sample.measured)
        self._joint_states.publish(self._joint_state.write(sample, stamp))
        self.goal_server.on_joints(sample, stamp)

    def on_status(self, status: Status) -> None:
        stamp = self._clock.now().to_msg()
        self._robot_status.publish(self._status.write(status, stamp))

    def on_link_state(self, name: str, why: str) -> None:
        self._node.get_logger().debug(f'link {name}: {why}')
        self._link_state.publish(String(data=name))

    async def _look_for_second_driver(self) -> None:
        while True:
            self.driver.check_second_driver()
            await asyncio.sleep(LOOK_PERIOD_S)

    async def _publish_diagnostics(self) -> None:
        publish = self._diagnostic_array.publish
        await self._diagnostics.run(lambda: self._clock.now().to_msg(), publish)
