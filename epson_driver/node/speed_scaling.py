# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The node's speed scaling: `~/set_speed_scaling` and `~/speed_scaling` over a `GoalQueue`."""

import asyncio
from functools import partial

from epson_msgs.srv import SetSpeedScaling
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64

from epson_driver.driver.tasks import report_task_error
from epson_driver.node.loop_bridge import NodeContext

PERIOD_S = 0.05
"""Time between two published values of a ramp, s."""


class SpeedScalingInterface:
    """Publishes the factor on changes, serves requests. Must be created in the driver's loop."""

    def __init__(self, context: NodeContext) -> None:
        self._goals = context.driver.goal_queue
        self._scaling = self._goals.scaling
        self._bridge = context.bridge
        self._logger = context.node.get_logger()
        self._ramp: asyncio.Task[None] | None = None
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._factor = context.node.create_publisher(Float64, '~/speed_scaling', latched)
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
