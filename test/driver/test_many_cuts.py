# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver with many goals and a goal of many points."""

import asyncio
import contextlib
import gc
import resource
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from support.driver_harness import JOINTS, Harness, pose, simulated
from support.event_loop import run, until
from support.spin_thread import SpinThread
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.arm_commands import ArmCommands
from epson_driver.driver.outcome import End
from epson_driver.node import loop_bridge
from epson_driver.node.node import ClientNode
from epson_driver.processes.processes import free_ros_domain
from epson_driver.sim_controller.faults.fault_kinds import parse

PATIENCE = 100.0
"""Timeout of a test on a busy machine, s."""


POINTS = 10_000
FIRST = 1_000
STEP = 2e-6
"""Distance between points, rad: a point takes a few ms."""

OBJECTS = 0.25
"""Maximum growth after the first 1,000 points, Python objects for each point. A message alone is
several."""

GROWTH = 4e6
"""Maximum growth of the process after the first 1,000 points, bytes: 450 for each point."""


def resident():
    """Return the memory of this process, bytes."""
    return int(Path('/proc/self/statm').read_text().split()[1]) * resource.getpagesize()


@pytest.mark.slow
def test_goal_of_10000_points_streams_without_memory_growth(caplog):
    caplog.set_level('ERROR')  # pytest stores every record

    async def scenario():
        async with simulated(profile='generic') as (_, ports), Harness(ports) as harness:
            await harness.ready()
            await harness.commands.enable()
            points = np.arange(1, POINTS + 1)[:, None] * pose(STEP)
            goal = harness.submit(*points, step=0.001, tolerance=100 * STEP)
            execution = goal.handle.execution

            def used_memory():
                """Return objects and bytes in use without the test's records."""
                harness.events.samples.clear()
                harness.events.statuses.clear()
                goal.feedback.clear()
                gc.collect()
                return sys.getallocatedblocks(), resident()

            used = []
            for count in range(FIRST, POINTS + 1, FIRST):
                while execution.point < count and not goal.outcomes:  # noqa: ASYNC110 - as `until`
                    await asyncio.sleep(0.02)
                used.append(used_memory())
            outcome = await goal.end()
            objects, size = (np.subtract(values, values[0]) for values in zip(*used, strict=True))
            print(outcome.text)
            print('objects more than after the first 1,000 points:', *objects)
            print('KiB more:', *(size // 1024))
            assert outcome.end is End.SUCCEEDED, outcome
            assert abs(harness.at - points[-1]).max() <= 100 * STEP
            assert harness.driver.motion_link.statistics.frames_sent > POINTS
            assert max(objects) < OBJECTS * (POINTS - FIRST)
            assert max(size) < GROWTH

    run(scenario(), PATIENCE)


GOALS = 100

KEPT = 2
"""Time for which a result is available, s."""

KINDS = ('cut', 'executed', 'executed', *['refused'] * 7)
"""Kinds of goals, in turn."""

EXPECTED = {
    'cut': (GoalStatus.STATUS_ABORTED, 'link was lost'),
    'executed': (GoalStatus.STATUS_SUCCEEDED, 'at the goal'),
    'refused': (GoalStatus.STATUS_ABORTED, 'outside the limits'),
}


class User:
    """A client node with its driver, and a user's node with an action client, in one executor."""

    def __init__(self, ports):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=free_ros_domain())
        settings = {f'{name}_port': getattr(ports, name) for name in ('motion', 'state', 'remote')}
        overrides = [Parameter(name, value=value) for name, value in settings.items()]
        self._nodes = [
            Node('epson_driver', context=self._context, parameter_overrides=overrides),
            Node('user', context=self._context),
        ]
        self.client = ClientNode(self._nodes[0])
        self.action = ActionClient(
            self._nodes[1], FollowJointTrajectory, '/epson_driver/follow_joint_trajectory'
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        for node in self._nodes:
            self._executor.add_node(node)
        self._thread = SpinThread(self._executor)

    async def __aenter__(self):
        self._driving = asyncio.create_task(self.client.run())
        self._thread.start()
        return self

    async def __aexit__(self, *_):
        self._driving.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._driving
        self._thread.end()
        for node in self._nodes:
            node.destroy_node()
        self._context.try_shutdown()

    async def enable(self):
        """Wait for the controller and enable the arm."""
        driver = self.client.driver
        await until(
            lambda: (
                driver.state_link.connected
                and driver.motion_link.connected
                and driver.robot.sample is not None
                and driver.robot.status is not None
            )
        )
        await ArmCommands(driver).enable()

    async def send(self, positions):
        """Send a goal of one point; return a future of its status and error text."""
        loop = asyncio.get_running_loop()
        accepted, done = loop.create_future(), loop.create_future()
        point = JointTrajectoryPoint(positions=positions)
        point.time_from_start.nanosec = 100_000_000
        names = [f'joint_{number + 1}' for number in range(JOINTS)]
        goal = FollowJointTrajectory.Goal(
            trajectory=JointTrajectory(joint_names=names, points=[point])
        )

        def report(future):
            answer = future.result()
            loop.call_soon_threadsafe(done.set_result, (answer.status, answer.result.error_string))

        def on_accepted(future):
            future.result().get_result_async().add_done_callback(report)
            loop.call_soon_threadsafe(accepted.set_result, None)

        def send():  # in the executor's thread, so the answer cannot arrive too early
            self.action.send_goal_async(goal).add_done_callback(on_accepted)

        self._executor.create_task(send)
        await accepted
        return done


@pytest.mark.slow
@pytest.mark.usefixtures('patient_driver')
def test_no_goal_handle_remains_after_100_goals_with_cuts(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setattr(loop_bridge, 'RESULT_TIMEOUT_S', KEPT)

    async def scenario():
        ends = Counter()
        async with simulated() as (controller, ports), User(ports) as user:
            await until(user.action.server_is_ready)
            await user.enable()
            driver, server = user.client.driver, user.client.goal_server._action.server
            for number in range(GOALS):
                kind = KINDS[number % len(KINDS)]
                at = driver.robot.sample.positions
                target = at + (0.02 if at[0] < 0.1 else -0.02)
                if kind == 'refused':
                    target[0] = 9.0
                done = await user.send(target.tolist())
                if kind == 'cut':
                    await until(lambda: driver.goal_queue.busy)
                    controller.faults.start(parse('cut for=0.05'))
                status, text = await done
                expected, words = EXPECTED[kind]
                assert (status, words in text) == (expected, True), (kind, status, text)
                ends[kind] += 1
                if kind == 'cut':
                    assert driver.gate.reason is not None
                    await until(lambda: not controller.faults.active())
                    await user.enable()
            assert server._goal_handles  # results are still available
            await until(lambda: not server._goal_handles)
            assert not server._result_futures
            assert not user.client.goal_server.busy
        print(dict(ends))

    run(scenario(), 110.0)
