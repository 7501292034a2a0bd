# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver with many cut connections and many goals."""

import asyncio
import contextlib
import gc
import random
import resource
import sys
import threading
import weakref
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
from support.driver_harness import JOINTS, Harness, cell, pose, simulated
from support.event_loop import now, run, until
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from epson_driver.driver.arm_commands import ArmCommands
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.link import LinkState
from epson_driver.link.states import BACK_OFF
from epson_driver.node import goal_server
from epson_driver.node.node import ClientNode
from epson_driver.processes.processes import free_ros_domain
from epson_driver.sim_controller.faults.fault_kinds import parse

CUTS, CELLS = 100, 4
"""Number of cuts, and of robots that are cut at the same time to keep the test short."""

SEED = 11000
PORTS = ('motion', 'state', 'motion+state', 'motion+state+io')
PLANNED = 0.5
"""Planned time of a motion, s. It takes longer with its accelerations."""

LATEST = 1.4
"""Maximum time from goal to cut, s: some goals have ended then."""

LONGEST = 0.35
"""Maximum duration of a cut, s."""

AT_GOAL = 0.01
"""Goal tolerance, rad."""

SETTLED = 0.03
"""Age of a connection that was not accepted only to be closed, s."""

WITHIN = 1.5
"""Maximum time from the controller's return to both links, s."""

PATIENCE = 100.0
"""Timeout of a test on a busy machine, s."""


class History:
    """The states of a link and their start times."""

    def __init__(self, link):
        self.link = link
        self.steps = []
        self._report = link._on_state
        link._on_state = self._on_state

    def _on_state(self, state, why):
        self.steps.append((now(), state))
        self._report(state, why)

    @property
    def since(self):
        """Return when the current state started."""
        return self.steps[-1][0] if self.steps else 0.0

    @property
    def settled(self):
        return self.link.connected and now() - self.since >= SETTLED

    def attempts(self, after):
        """Return how many connection attempts started after a time."""
        return sum(at > after and state is LinkState.CONNECTING for at, state in self.steps)


def open_sockets():
    count = 0
    for file in Path('/proc/self/fd').iterdir():
        with contextlib.suppress(FileNotFoundError):  # the directory's own
            count += str(file.readlink()).startswith('socket:')
    return count


class CutCell:
    """A driver and a controller whose links are cut repeatedly."""

    def __init__(self, harness, controller, number):
        self.harness = harness
        self.controller = controller
        self.chance = random.Random(SEED + number)
        links = (harness.driver.motion_link, harness.driver.state_link)
        self.histories = {link.name: History(link) for link in links}
        self.ends = Counter()
        self.back_after = []
        self.handles = []

    async def cut(self):
        """Cut at a random moment of a goal, and check all consequences."""
        harness, controller = self.harness, self.controller
        await harness.commands.enable()
        target = pose(-0.4 if harness.at[0] > 0.0 else 0.4, self.chance.uniform(0.0, 0.2))
        goal = harness.submit(
            (harness.at + target) / 2, target, step=PLANNED / 2, tolerance=AT_GOAL
        )
        self.handles.append(weakref.ref(goal.handle))
        await asyncio.sleep(self.chance.uniform(0.0, LATEST))

        ports = self.chance.choice(PORTS)
        ended_before = bool(goal.outcomes)
        controller.faults.start(
            parse(f'cut {self.chance.uniform(0.01, LONGEST):.3f} port={ports}')
        )
        cut_links = [name for name in self.histories if name in ports]
        await self.returned(cut_links)
        self.ends[self.check_end(goal, target, ended_before)] += 1
        await self.nothing_moves_before_enable()
        assert len(goal.outcomes) == 1
        harness.events.samples.clear()
        harness.events.statuses.clear()

    def check_end(self, goal, target, ended_before):
        """Check the goal's outcome; return how it ended."""
        outcome = goal.outcome
        if outcome.end is End.SUCCEEDED:
            assert abs(self.controller.servo.actual - target).max() <= AT_GOAL
            return 'succeeded before the cut'
        assert not ended_before, outcome
        assert outcome.end is End.ABORTED
        assert outcome.code is ErrorCode.PATH_TOLERANCE_VIOLATED
        assert 'link was lost' in outcome.text
        assert 'moving to point' in outcome.text
        return 'aborted: ' + outcome.text.split(' was lost')[0]

    async def returned(self, names):
        """Wait for the controller, then for the links, with one attempt for each."""
        faults, driver = self.controller.faults, self.harness.driver
        await until(lambda: not any(faults.rejects(name) for name in names))
        start = now()
        histories = [self.histories[name] for name in names]
        await until(lambda: all(history.settled for history in self.histories.values()))
        assert all(history.attempts(after=start) <= 1 for history in histories)
        self.back_after.append(max(0.0, *(history.since - start for history in histories)))
        await until(lambda: driver.robot.sample is not None and driver.robot.status is not None)
        for history in self.histories.values():
            history.steps.clear()

    async def nothing_moves_before_enable(self):
        """Check that the gate is closed, goals are refused and the arm rests with both links."""
        harness, controller = self.harness, self.controller
        assert 'link was lost' in harness.gate
        await until(lambda: not controller.in_motion and controller.servo.settled)
        rest = controller.servo.actual.copy()
        refused = harness.submit(pose(0.1))
        assert refused.outcome.code is ErrorCode.INVALID_GOAL
        assert 'link was lost' in refused.outcome.text
        samples = len(harness.events.samples)
        await until(lambda: len(harness.events.samples) > samples + 5)
        assert np.array_equal(controller.servo.actual, rest)
        assert not controller.moving

    def check_nothing_is_kept(self):
        driver = self.harness.driver
        assert driver.goal_queue.idle
        assert not driver.changed.waiting
        gc.collect()
        assert all(handle() is None for handle in self.handles)


@pytest.mark.invariant(4)
@pytest.mark.slow
def test_inv4_100_cuts_end_their_goals_cleanly_and_move_nothing():
    """A link retries at most `max(BACK_OFF)` s after the previous attempt.

    The first attempt after the controller's return succeeds. The test prints its time.
    """
    assert max(BACK_OFF) < WITHIN
    ends, back_after = Counter(), []

    async def scenario():
        async with cell() as one, cell() as two, cell() as three, cell() as four:
            cells = [CutCell(*item, number) for number, item in enumerate((one, two, three, four))]
            await asyncio.sleep(0.1)  # connections of ~/enable are closed
            tasks, sockets = len(asyncio.all_tasks()), open_sockets()

            async def all_cuts(one):
                for _ in range(CUTS // CELLS):
                    await one.cut()

            async with asyncio.TaskGroup() as group:
                for one in cells:
                    group.create_task(all_cuts(one))
            await asyncio.sleep(0.1)
            assert len(asyncio.all_tasks()) == tasks, asyncio.all_tasks()
            assert open_sockets() <= sockets
            for one in cells:
                one.check_nothing_is_kept()
                ends.update(one.ends)
                back_after.extend(one.back_after)

    gc.collect()  # cycles left by earlier tests
    before = open_sockets()
    run(scenario(), PATIENCE)
    assert open_sockets() <= before
    assert ends.total() == CUTS
    for text, count in sorted(ends.items()):
        print(f'{count:3} {text}')
    quantiles = np.quantile(back_after, [0.0, 0.5, 0.9, 0.99, 1.0])
    within = sum(seconds <= WITHIN for seconds in back_after)
    print(f'{within} of {CUTS} within {WITHIN:g} s of the return')
    print('back after, s (least, median, 90 %, 99 %, most):', *(f'{q:.3f}' for q in quantiles))
    assert len([text for text in ends if text.startswith('aborted')]) == 2, 'both links were cut'


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
        self._thread = threading.Thread(target=self._executor.spin)

    async def __aenter__(self):
        self._driving = asyncio.create_task(self.client.run())
        self._thread.start()
        return self

    async def __aexit__(self, *_):
        self._driving.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._driving
        self._executor.shutdown()
        self._thread.join()
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
    monkeypatch.setattr(goal_server, 'RESULT_TIMEOUT_S', KEPT)

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
