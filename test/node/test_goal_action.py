# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Goals and single points at the node: log lines and the rate of feedback."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import JOINTS, LIMITS, Submitted, cell, pose
from support.event_loop import until

from epson_driver.driver.goal.goal import Goal
from epson_driver.driver.outcome import End, ErrorCode, Outcome
from epson_driver.motion import Trajectory
from epson_driver.node.goal_server import WARNING, PointStreams, Throttle
from epson_driver.node.loop_bridge import CANCELED, outcome_line

CODE = ErrorCode.SUCCESSFUL


@pytest.mark.parametrize(
    ('outcome', 'line'),
    [
        (
            Outcome(End.SUCCEEDED, CODE, 'at the goal after 1.00 s'),
            'goal succeeded: at the goal after 1.00 s',
        ),
        (
            Outcome(End.CANCELED, CODE, 'canceled, the arm is at rest'),
            'goal canceled, the arm is at rest',
        ),
        (CANCELED, 'goal canceled before it could start'),
        (
            Outcome(End.ABORTED, ErrorCode.INVALID_GOAL, 'the arm is not enabled'),
            'goal aborted: the arm is not enabled',
        ),
    ],
)
def test_goal_s_end_is_logged_without_repetition(outcome: Outcome, line: str) -> None:
    assert outcome_line(outcome) == line


@pytest.mark.parametrize('period', [0.004, 0.0055, 0.007, 0.013, 0.05])
@pytest.mark.parametrize('rate', [5.0, 20.0])
def test_throttle_keeps_the_mean_rate(period, rate):
    throttle = Throttle()
    times = 1000.0 + np.arange(0.0, 20.0, period)
    passed = [time for time in times if throttle.passes(float(time), rate)]
    assert len(passed) == pytest.approx(20.0 * rate, abs=2)
    assert np.diff(passed).max() < 1.0 / rate + period + 1e-9


PERIOD = 0.02


def test_stream_of_single_points_is_reported_once():
    streams = PointStreams()
    texts = [streams.record_and_check(1, 0.0, PERIOD * count) for count in range(100)]
    assert [count for count, text in enumerate(texts) if text] == [2]
    assert texts[2] == WARNING
    again = [streams.record_and_check(1, 5.0, 60.0 + PERIOD * count) for count in range(100)]
    assert [count for count, text in enumerate(again) if text] == [2]


def test_stream_of_windows_is_reported_once():
    """MoveIt Servo sends these if it is configured for ~/joint_trajectory."""
    streams = PointStreams()
    texts = [streams.record_and_check(20, 0.2, 0.01 * count) for count in range(100)]
    assert [count for count, text in enumerate(texts) if text] == [2]


async def test_every_goal_of_single_points_ends_and_the_arm_stops():
    async with cell() as (harness, _):
        goals = []
        for count in range(1, 51):
            target = pose(0.006 * count)  # 0.3 rad/s
            single = Trajectory(LIMITS.names, np.array([PERIOD]), target[None])
            goals.append(Submitted(Goal(single, np.full(JOINTS, 0.01), goal_time=0.0)))
            harness.driver.goal_queue.submit(goals[-1].handle)
            await asyncio.sleep(PERIOD)
        await until(lambda: all(goal.outcomes for goal in goals))
        for goal in goals[:-1]:
            assert goal.outcome.end is End.ABORTED or goal.outcome.end is End.SUCCEEDED
            assert goal.outcome.text
        assert await harness.rests()
        assert not harness.driver.goal_queue.busy
        assert harness.gate is None
        assert 0.0 < harness.at[0] <= 0.3 + 1e-3
        fastest = max(abs(sample.velocities).max() for _, sample in harness.events.samples)
        assert fastest < LIMITS.velocity[0]
        following = harness.submit(harness.at + pose(0.1))
        assert (await following.end()).end is End.SUCCEEDED
