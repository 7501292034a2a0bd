# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Taught points: the service `~/taught_points`, and their frames on `/tf_static`.

Points are stored in the file of the parameter `points_file`, in the format of RC+ (.pts) or of the
Python API (.yaml). Without a file, they are lost when the node ends.
"""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

from epson_msgs.srv import TaughtPoints as Service
from geometry_msgs.msg import Pose

from epson_driver.driver.goal.goal_execution import GoalExecution
from epson_driver.driver.goal.goal_queue import FRESH_POSE_TIMEOUT_S, GoalHandle
from epson_driver.driver.goal.planning_cancellation import PlanningCancellation
from epson_driver.driver.outcome import End, GoalRejectedError, Outcome
from epson_driver.driver.state.robot_state import JointSample
from epson_driver.driver.tasks import wait_for_fresh_state
from epson_driver.inputs import InputError, number, printable, shown
from epson_driver.motion import Array
from epson_driver.node.goal_server import GoalServer
from epson_driver.node.loop_bridge import NodeContext
from epson_driver.node.messages import outcome_text
from epson_driver.node.motion_primitives import MotionPrimitives
from epson_driver.node.tool_interface import BASE, StaticFrames, links, set_values
from epson_driver.node.trajectory_messages import invalid_goal
from epson_driver.taught_points import EpsonPoint, Posture, TaughtPoints, taught
from epson_driver.tool_motion.tool_pose import quaternion_pose

SPEED = number(0.01, 1.0, 'of the joint limits')
DEFAULT_SPEED, ACCELERATION = 0.2, 0.5


class PointsInterface:
    """Serves taught points of a driver's arm. A missing file is created with the first point."""

    def __init__(
        self,
        context: NodeContext,
        goals: GoalServer,
        primitives: MotionPrimitives,
        frames: StaticFrames,
    ) -> None:
        self._logger = context.node.get_logger()
        self._setup = context.setup
        self._driver = context.driver
        self._goals = goals
        self._primitives = primitives
        self._bridge = context.bridge
        self._frames = frames
        self._links = links(context.setup.model)
        self._points = TaughtPoints()
        file: str = context.values['points_file']
        self._file = Path(file).expanduser() if file else None
        try:
            if self._file is not None and self._file.exists():
                self._points.load(self._file)
        except (OSError, ValueError) as error:
            raise InputError(f'parameter points_file: {error}') from error
        self._actions: dict[int, Callable[[Service.Request], Awaitable[str]]] = {
            Service.Request.LIST: self._list,
            Service.Request.TEACH: self._teach,
            Service.Request.GO: self._go,
            Service.Request.FORGET: self._forget,
        }
        self._publish()
        self._bridge.create_service(Service, '~/taught_points', self._serve)

    # --- from ROS: in the executor's thread -------------------------------------------------

    async def _serve(
        self, request: Service.Request, response: Service.Response
    ) -> Service.Response:
        try:
            act = self._actions.get(request.action)
            if act is None:
                raise InputError(
                    f'action = {request.action}: must be LIST (0), TEACH (1), GO (2) or FORGET (3)'
                )
            response.message = await act(request)
            response.success = True
        except GoalRejectedError as rejection:
            response.message = outcome_text(rejection.outcome)
        except (ValueError, OSError) as error:
            response.message = str(error)
        for name, pose in self._poses().items():
            response.names.append(name)
            response.poses.append(_filled(pose))
        if request.action != Service.Request.LIST:
            self._logger.info(f'~/taught_points: {response.message}')
        return response

    async def _list(self, _request: Service.Request) -> str:
        count = len(self._points)
        return f'{count} point{"" if count == 1 else "s"} of {self._where()}'

    async def _teach(self, request: Service.Request) -> str:
        if self._taken(request.name):
            raise InputError(
                f'name = {shown(request.name)}: must not be the name of a frame of the arm, its '
                'base or its tool'
            )
        point, arm = await self._bridge.in_loop(self._here)
        self._points.set(request.name, point, arm)
        self._save()
        return f'point {request.name} saved at the current tool pose, in {self._where()}'

    async def _forget(self, request: Service.Request) -> str:
        self._points.remove(request.name)
        self._save()
        return f'point {request.name} deleted, in {self._where()} (tf keeps its frame)'

    async def _go(self, request: Service.Request) -> str:
        speed = SPEED.checked(request.speed, 'speed') if request.speed else DEFAULT_SPEED
        point = self._points.get(request.name)
        outcome = await self._bridge.in_loop(partial(self._move, request.name, point, speed))
        if outcome.end is not End.SUCCEEDED:
            raise GoalRejectedError(outcome.code, outcome.text, outcome.remedy)
        return f'point {request.name}: {outcome.text}'

    def _save(self) -> None:
        self._publish()
        if self._file is not None:
            try:
                self._points.save(self._file)
            except (OSError, ValueError) as error:
                raise InputError(f'applied, but not saved: {error}') from error

    def _where(self) -> str:
        return 'this node' if self._file is None else printable(self._file)

    def _poses(self) -> dict[str, Array]:
        to_base_link = self._primitives.kinematics.from_base
        return {name: to_base_link(point.pose) for name, point in self._points.places.items()}

    def _publish(self) -> None:
        # A point in a file may have the name of another frame. Such a point has no frame on tf.
        frames = {
            name: quaternion_pose(pose)
            for name, pose in self._poses().items()
            if not self._taken(name)
        }
        self._frames.publish('points', BASE, frames)

    def _taken(self, name: str) -> bool:
        return name in self._links or self._frames.taken(name, 'points')

    # --- in the loop's thread ---------------------------------------------------------------

    async def _here(self) -> tuple[EpsonPoint, Posture | str]:
        """Return the tool's pose, and the arm's posture or why the posture is unknown."""
        robot = self._driver.robot
        now = await wait_for_fresh_state(robot.stale, self._driver.changed, FRESH_POSE_TIMEOUT_S)
        if (why := robot.why_not_ready(now)) is not None:
            raise InputError(f'joint position unknown: {why}')
        assert robot.sample is not None  # noqa: S101 - for the type checker
        return taught(self._primitives.kinematics, robot.sample.positions)

    async def _move(self, name: str, point: EpsonPoint, speed: float) -> Outcome:
        plan = PlanningCancellation()
        start = await self._primitives.start_positions(plan)
        arm, statements = self._primitives.kinematics, self._driver.statements
        result = arm.inverse(arm.from_base(point.pose), start)
        if not len(result):
            raise invalid_goal(
                f'point {name}: out of reach, no joint positions reach it',
            )
        trajectory, written = self._setup.joint_move(start, result[0], speed, ACCELERATION)
        goal = self._setup.goal(trajectory, None if statements is None else written(statements))
        ended: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()

        def end(outcome: Outcome) -> None:
            if not ended.done():
                ended.set_result(outcome)

        handle = GoalHandle(goal, end, self._on_feedback, plan=plan)
        self._driver.goal_queue.submit(handle)
        return await ended

    def _on_feedback(self, execution: GoalExecution, sample: JointSample) -> None:
        self._goals.publish_state(execution, sample)


def _filled(pose: Array) -> Pose:
    message = Pose()
    set_values(message, quaternion_pose(pose), ('position', 'orientation'))
    return message
