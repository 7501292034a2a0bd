# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Hundreds of motions of the C3 and of a SCARA through the API, in virtual time.

The controller runs in this process, so every servo cycle can be checked.
"""

import asyncio
import gc
import threading
from pathlib import Path

import numpy as np
import pytest
from support.api_harness import robot_cell
from support.event_loop import run
from support.examples import one_in

from epson_driver.profiles import load_controller_profile
from epson_driver.robots.kinematics import rotation_of_uvw
from epson_driver.tool_motion.pose_path import arc, distance_from, line

READY = {
    'c3_a601s': [0.0, 0.2, 0.2, 0.0, -1.9, 0.0],
    'gx4_c251s': [0.3, 1.2, -0.05, 0.0],
}
"""Well-conditioned start position of each model."""

ACCURACY_M = 1e-4
LAG_S = load_controller_profile('simulated').servo.lag
LOOK_S = 0.01
"""Sampling interval of a motion, s."""

COUNTS = [3, pytest.param(100, marks=pytest.mark.soak)]
MODELS = pytest.mark.parametrize('model', one_in(2, READY))


def resident_kb():
    """Return the resident memory of this process, kB."""
    return int(Path('/proc/self/statm').read_text().split()[1]) * 4


async def sampled(motion, look):
    """Return the samples of `look` along a motion, which must succeed."""
    seen = [look()]
    while not motion.done:
        await asyncio.sleep(LOOK_S)
        seen.append(look())
    await motion.wait()
    return seen


def circumradius(points):
    """Return the radius of the circle through three points, shape (3, 3), m."""
    first, second, third = points
    sides = [np.linalg.norm(a - b) for a, b in ((first, second), (second, third), (third, first))]
    area = np.linalg.norm(np.cross(second - first, third - first)) / 2.0
    return float(np.prod(sides) / (4.0 * area))


@MODELS
@pytest.mark.parametrize('count', COUNTS)
def test_random_lines_and_arcs_follow_their_path(model, count):
    """The tolerance is 0.1 mm, plus the corner that lagging servos cut off an arc."""
    random = np.random.default_rng(count)
    worst = {'line': 0.0, 'arc': 0.0}

    async def one(robot, number):
        start = robot.pose
        end = start.copy()
        end[:3, 3] += random.uniform(-0.05, 0.05, 3) * (1.0 if model == 'c3_a601s' else 0.5)
        turn = random.uniform(-0.3, 0.3, 3) * ([1, 1, 1] if model == 'c3_a601s' else [1, 0, 0])
        end[:3, :3] = start[:3, :3] @ rotation_of_uvw(turn)
        via = (start[:3, 3] + end[:3, 3]) / 2 + random.uniform(-0.02, 0.02, 3)
        speed = random.uniform(0.1, 0.5)
        kind = 'arc' if number % 2 else 'line'
        if kind == 'arc':
            motion = await robot.move_arc(via, end, speed=speed, wait=False)
            path = arc(start, via, end)
        else:
            motion = await robot.move_line(end, speed=speed, wait=False)
            path = line(start, end)
        seen = await sampled(motion, lambda: robot.pose[:3, 3])
        places = np.array([path.pose(fraction)[:3, 3] for fraction in np.linspace(0.0, 1.0, 501)])
        away = max(distance_from(place, places) for place in seen)
        cut = 0.0
        if kind == 'arc':
            cut = (speed * LAG_S) ** 2 / (2.0 * circumradius([start[:3, 3], via, end[:3, 3]]))
        assert away < ACCURACY_M + cut
        assert np.abs(robot.pose - end).max() < 1e-5
        worst[kind] = max(worst[kind], away)

    async def scenario():
        async with robot_cell(model=model, smooth=True) as (robot, _):
            driven = refused = 0
            while driven < count:
                if (driven + refused) % 5 == 0:
                    await robot.move_joints(READY[model])
                try:
                    await one(robot, driven)
                    driven += 1
                except ValueError:  # out of reach or too fast
                    refused += 1
            assert refused <= count
            message = ', '.join(f'{kind}: {away * 1e3:.3f} mm' for kind, away in worst.items())
            print(f'{model}: {driven} driven, at most away: {message}; {refused} refused')

    run(scenario(), patience=36000.0)


MIN_WINDOW_S = 1e-4
"""Minimum duration for a velocity check, s: over 1e-13 s, rounding looks like a jump."""


def merged(dt, before, after):
    """Return cycles joined to windows of at least `MIN_WINDOW_S`, without a gap.

    dt: shape (k,), s. before, after: shape (k, n). The acceleration limit holds between the mean
    velocities of windows of any length, so no velocity jump is lost.
    """
    ends, since = [], 0.0
    for index, duration in enumerate(dt):
        since += duration
        if since >= MIN_WINDOW_S:
            ends.append(index)
            since = 0.0
    ends = np.array([*ends[:-1], len(dt) - 1])
    begins = np.array([0, *(ends[:-1] + 1)])
    return np.add.reduceat(dt, begins), before[begins], after[ends]


class CycleRecorder:
    """Records the commanded positions of an arm in every cycle."""

    def __init__(self, arm):
        self._arm, self._step = arm, arm.step
        self._cycles = []
        arm.step = self._record

    def _record(self, dt, execute):
        before = self._arm.commanded.copy()
        self._step(dt, execute)
        if dt > 0.0:
            self._cycles.append((dt, before, self._arm.commanded.copy()))

    def check(self, limits):
        """Assert that mean velocities respect all limits in every cycle, and clear the record."""
        dt = np.array([dt for dt, _, _ in self._cycles])
        before, after = (np.array([cycle[k] for cycle in self._cycles]) for k in (1, 2))
        self._cycles.clear()
        assert np.array_equal(before[1:], after[:-1])
        assert np.all(after >= limits.position_min - 1e-9)
        assert np.all(after <= limits.position_max + 1e-9)
        dt, before, after = merged(dt, before, after)
        dt = dt[:, None]
        velocities = (after - before) / dt
        assert np.all(np.abs(velocities) <= limits.velocity * (1.0 + 1e-6))
        changes = np.abs(np.diff(velocities, axis=0)) / ((dt[1:] + dt[:-1]) / 2.0)
        assert np.all(changes <= limits.acceleration * (1.0 + 1e-3) + 1e-6)


def near_trouble(model, number, random):
    """Return joints near a singularity or a limit, and how to turn the tool there."""
    joints = np.array(READY[model])
    if model == 'c3_a601s':  # straight wrist, stretched arm, joint limit
        joint, value = ((4, -0.05), (2, 1.5), (1, 1.1))[number % 3]
        turn = random.uniform(-0.4, 0.4, 3)
    else:  # stretched or folded
        joint, value = (1, (0.05, 2.4)[number % 2])
        turn = np.array([random.uniform(-0.4, 0.4), 0.0, 0.0])
    joints[joint] = value
    return joints, turn


@pytest.mark.slow
@MODELS
@pytest.mark.invariant(2)
@pytest.mark.parametrize('count', COUNTS)
def test_lines_near_singularities_are_rejected_or_respect_all_limits(model, count):
    random = np.random.default_rng(18)

    async def scenario():
        async with robot_cell(model=model, smooth=True) as (robot, controller):
            recorder = CycleRecorder(controller.arm)
            reasons = []
            for number in range(count):
                joints, turn = near_trouble(model, number, random)
                await robot.move_joints(joints)
                start = robot.pose
                end = start.copy()
                end[:3, 3] += random.uniform(-0.06, 0.06, 3)
                end[:3, :3] = start[:3, :3] @ rotation_of_uvw(turn)
                before = controller.arm.commanded.copy()
                try:
                    motion = await robot.move_line(end, slow=number % 4 < 2, wait=False)
                except ValueError as error:
                    reasons.append(str(error))
                    assert np.array_equal(before, controller.arm.commanded)
                    continue
                await motion.wait()
                assert np.abs(robot.pose - end).max() < 1e-5
                recorder.check(robot.model.limits)
            assert 0 < len(reasons) < count
            assert all('% of ' in reason or 'accuracy' in reason for reason in reasons)
            print(f'{model}: {len(reasons)} of {count} refused')

    run(scenario(), patience=36000.0)


@pytest.mark.slow
def test_many_short_moves_do_not_add_memory_tasks_or_threads():
    """100 moves, alternating joint and tool moves."""
    model = 'gx4_c251s'

    async def scenario():
        async with robot_cell(model=model) as (robot, _):
            await robot.move_joints(READY[model])
            home = robot.pose
            there = home.copy()
            there[2, 3] += 0.001
            near = np.array(READY[model]) + 0.002

            async def moves(count):
                for number in range(count):
                    if number % 4 == 0:
                        await robot.move_line(there, speed=1.0, acceleration=10.0)
                    elif number % 4 == 1:
                        await robot.move_line(home, speed=1.0, acceleration=10.0)
                    else:
                        await robot.move_joints(near if number % 4 == 2 else READY[model])
                gc.collect()
                tasks = len(asyncio.all_tasks())
                return len(gc.get_objects()), tasks, threading.active_count(), resident_kb()

            first = await moves(60)  # fills bounded histories, e.g. of latencies
            last = await moves(100)
            print(f'{model}: objects, tasks, threads, kB: {first}, {last}')
            assert last[0] - first[0] < 60  # one leaked object per move would be 100
            assert last[1] <= first[1]
            assert last[2] <= first[2]
            assert last[3] - first[3] < 2048

    run(scenario(), patience=36000.0)
