# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Speed scaling and pauses on every kind of controller.

The speeds are measured at the simulated arm in each step, and not derived from messages.
"""

import asyncio
import contextlib
import itertools
from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import (
    HOME,
    LIMITS,
    pose,
    smooth_in_process,
)
from support.event_loop import now, until
from support.examples import one_in, quickly
from support.fault_play import cell_of, make_ready, standing, where
from support.streams import sending, velocities

from epson_driver.driver.goal.goal import GoalSettings, cause_timeout
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.smoothing import Smoothing
from epson_driver.motion import Trajectory
from epson_driver.profiles import load_controller_profile
from epson_driver.setup.setup import make_setup
from epson_driver.share import share_path
from epson_driver.sim_controller.condition.states import Event

FILES = share_path('config', 'controllers').glob('*.yaml')
PROFILES = sorted(path.stem for path in FILES)

WINDOW_S = 0.1
"""Period over which speeds are averaged, s: two points of the fastest controller."""


def back_and_forth(duration, distance=0.15, count=11):
    """Return a smooth plan of joint 1 from HOME and back."""
    fraction = np.linspace(0.0, 1.0, count)
    bump = 16 * fraction**2 * (1 - fraction) ** 2
    rate = 32 * fraction * (1 - fraction) * (1 - 2 * fraction)
    end = pose(distance)
    positions, velocities = np.outer(bump, end), np.outer(rate, end) / duration
    return Trajectory(LIMITS.names, fraction * duration, positions, velocities)


def one_point(duration, distance=0.15):
    """Return a plan to one point, which Remote Ethernet accepts too."""
    return Trajectory(LIMITS.names, np.array([duration]), pose(distance)[None, :])


class Speedometer:
    """Records the arm's position at each step of the controller."""

    def __init__(self, controller):
        self.times, self.positions = [now()], [where(controller)]
        step = controller.step

        def recorded(seconds):
            step(seconds)
            self.times.append(self.times[-1] + seconds)
            self.positions.append(where(controller))

        controller.step = recorded

    @property
    def peak(self):
        """Return the highest mean speed over WINDOW_S, rad/s."""
        times, positions = np.array(self.times), np.array(self.positions)
        ends = np.searchsorted(times, times + WINDOW_S)
        inside = np.flatnonzero(ends < len(times))
        moved = np.abs(positions[ends[inside]] - positions[inside]).max(axis=1)
        return float(np.max(moved / WINDOW_S, initial=0.0))


@contextlib.asynccontextmanager
async def robot(name, smoothing=None):
    """Run an enabled driver with a profile's defaults and its controller; yield both."""
    profile = load_controller_profile(name)
    settings = GoalSettings(cause_timeout=cause_timeout(profile.state))
    smoothing = smoothing or make_setup({'controller': name}).configuration.smoothing
    async with cell_of(
        profile,
        smooth=not profile.spel.project,
        limits=LIMITS,
        settings=settings,
        smoothing=smoothing,
        state_timeout=1.0,
    ) as (harness, controller, _):
        await make_ready(harness, controller)
        await harness.commands.enable()
        yield harness, controller


async def executed(name, trajectory, factor=1.0):
    """Return the text of a refusal and the arm's peak speed, rad/s."""
    async with robot(name) as (harness, controller):
        speedometer = Speedometer(controller)
        try:
            harness.driver.goal_queue.set_speed(factor)
        except ValueError as refusal:
            assert speedometer.peak == 0.0
            return str(refusal), 0.0
        outcome = await harness.execute(trajectory).end()
        if outcome.code is ErrorCode.INVALID_GOAL:
            assert speedometer.peak == 0.0
            return outcome.text, 0.0
        assert outcome.end is End.SUCCEEDED, outcome.text
        return '', speedometer.peak


@pytest.mark.invariant(10)
@pytest.mark.parametrize(
    ('name', 'plan'),
    quickly(
        [('fanuc', back_and_forth), ('remote', one_point), ('generic', one_point)],
        [(name, back_and_forth) for name in PROFILES if name != 'remote']
        + [(name, one_point) for name in ('abb', 'generic', 'motoman', 'remote', 'spel')],
    ),
)
async def test_inv10_speed_scaling_of_a_tenth_moves_the_arm_at_a_tenth_or_is_refused(name, plan):
    """It is reached by the speed scaling or by a plan that is ten times as slow."""
    refused, usual = await executed(name, plan(0.5))
    if refused:
        assert name == 'fanuc'
    for trajectory, factor in ((plan(0.5), 0.1), (plan(5.0), 1.0)):
        refusal, peak = await executed(name, trajectory, factor)
        if refusal:
            words = ('override', 'Remote Ethernet', 'minimum of')
            assert any(word in refusal for word in words), refusal
        else:
            assert 0.05 * usual <= peak <= 0.15 * usual


async def jogged(name, factor, speed=0.2, refusal=''):
    """Return the arm's peak speed, rad/s, in a velocity stream of joint 1."""
    async with robot(name) as (harness, controller):
        period = load_controller_profile(name).program.setpoint_period
        harness.driver.servo.settings = replace(harness.driver.servo.settings, period=period)
        speedometer = Speedometer(controller)
        if factor != 1.0:
            harness.driver.goal_queue.set_speed(factor)
        for _ in range(40):
            reason = harness.driver.servo.take(velocities(pose(speed))) or ''
            assert (refusal in reason) if refusal else not reason
            await asyncio.sleep(0.02)
        return speedometer.peak


@pytest.mark.invariant(10)
@pytest.mark.parametrize('name', one_in(4, ['simulated', 'generic', 'spel', 'rtmc']))
async def test_inv10_speed_scaling_of_a_tenth_slows_a_stream_to_a_tenth(name):
    speed = 2.0 if name == 'spel' else 0.2  # the minimum of SPEL+ is 1 % of the joint limits
    assert 0.05 * speed <= await jogged(name, 0.1, speed) <= 0.15 * speed


@pytest.mark.invariant(10)
@pytest.mark.parametrize(('name', 'refusal'), [('fanuc', 'override'), ('remote', 'no streams')])
async def test_inv10_stream_is_refused_if_the_controller_ignores_speeds(name, refusal):
    assert await jogged(name, 1.0, refusal=refusal) == 0.0


# --- pauses -----------------------------------------------------------------------------------

OBEYS_STOP = [name for name in PROFILES if name not in ('abb', 'remote')]

SLOW = 0.05
"""Share of the velocity limit during the pauses."""

SPEED = SLOW * float(LIMITS.velocity[0])
FRACTIONS = np.linspace(0.0, 1.0, 41)[1:]


def slow_path(name):
    """Return a plan of joint 1 at SLOW, or at the fixed speed of a controller that has one."""
    fraction = 0.2 if name == 'fanuc' else SLOW
    time = 0.2 + (FRACTIONS + 1.0 - np.cos(np.pi * FRACTIONS / 4)) / (
        fraction * LIMITS.velocity[0]
    )
    return Trajectory(LIMITS.names, time, np.array([pose(value) for value in FRACTIONS]))


async def paused_in_motion(harness, controller, trajectory, at=0.25):
    """Submit a goal and pause it when joint 1 passes `at`; return it and the arm's position."""
    goal = harness.execute(trajectory)
    await until(lambda: where(controller)[0] > at)
    here = where(controller)
    assert harness.driver.goal_queue.set_speed(0.0).startswith('pausing')
    return goal, here


@pytest.mark.invariant(3, 10)
@pytest.mark.parametrize('name', quickly(('simulated',), OBEYS_STOP, several=False))
async def test_inv10_goal_passes_the_same_points_after_a_pause(name):
    async with robot(name) as (harness, controller):
        goal, here = await paused_in_motion(harness, controller, slow_path(name))
        start = now()
        await standing(controller)
        assert now() - start < 0.7  # 0.3 s, braking, and detection of rest
        stopped = where(controller)
        limit = 0.05 if name != 'fanuc' else 0.2
        assert 0.0 <= stopped[0] - here[0] < limit
        await until(lambda: goal.handle.execution.state.value == 'paused')
        await asyncio.sleep(6.0)  # longer than any timeout
        np.testing.assert_array_equal(where(controller), stopped)
        assert not goal.outcomes
        speedometer = Speedometer(controller)
        harness.driver.goal_queue.set_speed(1.0)
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome.text
        path = np.array(speedometer.positions)
        assert path[:, 0].min() > stopped[0] - 1e-3  # no step back
        assert np.abs(path[:, 1:]).max() < 1e-3
        np.testing.assert_allclose(path[-1], pose(1.0), atol=2e-3)
        assert speedometer.peak < 1.3 * SPEED or name == 'fanuc'


def to_and_fro(count, share, distance=0.2):
    """Return a plan of joint 1 to `distance` and back, `count` times each."""
    path = np.tile([0.0, distance], count + 1)[: 2 * count + 1]
    times = np.arange(len(path)) * distance / (share * LIMITS.velocity[0])
    return Trajectory(LIMITS.names, times, np.array([pose(position) for position in path]))


def turns(path, distance=0.2):
    """Return how often joint 1 changed between both ends."""
    far = [at > distance / 2 for at in path if not distance * 0.15 < at < distance * 0.85]
    return int(np.count_nonzero(np.diff(far)))


@pytest.mark.invariant(10)
@pytest.mark.parametrize('at', quickly([0.45], [0.1, 0.45, 0.8], several=False))
@pytest.mark.parametrize(
    ('name', 'share', 'smoothing', 'max_turns'),
    one_in(
        4,
        [
            ('fanuc', 0.2, Smoothing(0.05), 8),
            ('fanuc', 0.2, None, 10),
            ('simulated', 0.05, None, 8),
            ('spel', 0.05, None, 8),
        ],
        several=True,
    ),
)
async def test_inv10_pause_on_a_path_to_and_fro_skips_no_point(
    name, share, smoothing, max_turns, at, monkeypatch
):
    """The goal pauses in motion and again, where the rest is replanned, during planning."""
    smooth_in_process(monkeypatch, delay=0.2)
    plan = to_and_fro(4, share)
    async with robot(name, smoothing) as (harness, controller):
        speedometer = Speedometer(controller)
        goal = harness.execute(plan)
        times = []
        take = goal.handle.on_feedback

        def on_feedback(execution, sample):
            times.append(0.0 if execution.desired is None else execution.desired[0])
            take(execution, sample)

        goal.handle.on_feedback = on_feedback
        queue = harness.driver.goal_queue
        await asyncio.sleep(at * (1.6 if name == 'fanuc' else 1.0) * plan.duration)
        for _ in range(2):
            queue.set_speed(0.0)
            await until(lambda: goal.handle.execution.state.value == 'paused')
            queue.set_speed(1.0)
            await until(lambda: goal.handle.execution.state.value != 'paused')
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome.text
        assert 8 <= turns(np.array(speedometer.positions)[:, 0]) <= max_turns
        assert min(times) >= 0.0
        if name != 'fanuc':  # its clock is not the arm's
            assert np.diff(times).min() > -0.3


@pytest.mark.invariant(10)
@pytest.mark.parametrize(('name', 'slow'), [('fanuc', 0.01), ('spel', 0.009)])
async def test_inv10_plan_paused_in_its_slow_part_resumes(name, slow, monkeypatch):
    """The rest alone would be refused as slower than the controller can move."""
    smooth_in_process(monkeypatch)
    path = np.array([0.0, 0.3, 0.33])
    times = np.append(0.0, np.cumsum(np.diff(path) / (np.array((0.2, slow)) * LIMITS.velocity[0])))
    plan = Trajectory(LIMITS.names, times, np.array([pose(position) for position in path]))
    async with robot(name) as (harness, controller):
        goal, _ = await paused_in_motion(harness, controller, plan, at=0.302)
        for _ in range(2):
            await until(lambda: goal.handle.execution.state.value == 'paused')
            harness.driver.goal_queue.set_speed(1.0)
            await until(lambda: goal.handle.execution.state.value == 'streaming')
            await asyncio.sleep(0.05)
            harness.driver.goal_queue.set_speed(0.0)
        await until(lambda: goal.handle.execution.state.value == 'paused')
        harness.driver.goal_queue.set_speed(1.0)
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome.text


@pytest.mark.invariant(3, 10)
@pytest.mark.parametrize('name', one_in(4, ['simulated', 'generic', 'spel', 'rtmc']))
async def test_inv10_stream_stays_stopped_until_the_pause_ends(name):
    async with robot(name) as (harness, controller):
        period = load_controller_profile(name).program.setpoint_period
        harness.driver.servo.settings = replace(harness.driver.servo.settings, period=period)
        async with sending(harness, lambda _: velocities(pose(0.2))):
            await until(lambda: where(controller)[0] > 0.1)
            here = where(controller)
            harness.driver.goal_queue.set_speed(0.0)
            await asyncio.sleep(1.0)
            stopped = where(controller)
            assert 0.0 <= stopped[0] - here[0] < 0.05
            await asyncio.sleep(1.0)
            np.testing.assert_array_equal(where(controller), stopped)
            harness.driver.goal_queue.set_speed(1.0)
            await until(lambda: where(controller)[0] > stopped[0] + 0.05)
        await standing(controller)
        assert harness.gate is None


async def test_goal_submitted_during_a_pause_starts_after_the_pause():
    async with robot('simulated') as (harness, controller):
        harness.driver.goal_queue.set_speed(0.0)
        goal = harness.execute(one_point(0.5))
        await asyncio.sleep(5.0)
        np.testing.assert_array_equal(where(controller), HOME)
        assert not goal.outcomes
        harness.driver.goal_queue.set_speed(1.0)
        assert (await goal.end()).end is End.SUCCEEDED


@pytest.mark.invariant(4, 5)
@pytest.mark.parametrize(
    ('event', 'when'),
    one_in(
        12,
        itertools.product(
            ['cancel', 'stop', 'disable', 'new goal', 'e_stop', 'cut'], ['pausing', 'paused']
        ),
        several=True,
    ),
)
async def test_inv4_paused_goal_that_has_ended_does_not_resume(event, when):
    async with robot('simulated') as (harness, controller):
        goal, _ = await paused_in_motion(harness, controller, slow_path('simulated'))
        execution = goal.handle.execution
        if when == 'paused':
            await until(lambda: execution.state.value == when)
        if event == 'cancel':
            harness.driver.goal_queue.cancel(goal.handle)
        elif event == 'new goal':
            other = harness.execute(one_point(1.0, distance=0.3))
        elif event == 'e_stop':
            controller.apply(Event.ESTOP_PRESS)
        elif event == 'cut':
            harness.driver.motion_link.reconnect('a test')
        else:
            await getattr(harness.commands, event)()
        outcome = await goal.end()
        assert outcome.end is (End.CANCELED if event == 'cancel' else End.ABORTED), outcome.text
        await standing(controller)
        stopped = where(controller)
        await asyncio.sleep(1.0)
        harness.driver.goal_queue.set_speed(1.0)
        if event == 'new goal':
            assert (await other.end()).end is End.SUCCEEDED
            stopped = pose(0.3)
        else:
            if event == 'e_stop':
                controller.apply(Event.ESTOP_RELEASE)
            await until(lambda: harness.driver.motion_link.connected)
            await make_ready(harness, controller, reset=event == 'e_stop')
            await harness.commands.enable()
        await asyncio.sleep(2.0)
        np.testing.assert_allclose(where(controller), stopped, atol=1e-3)


@pytest.mark.invariant(1)
async def test_inv1_arm_moved_during_a_pause_does_not_resume():
    async with robot('simulated') as (harness, controller):
        goal, _ = await paused_in_motion(harness, controller, slow_path('simulated'))
        await until(lambda: goal.handle.execution.state.value == 'paused')
        execution = goal.handle.execution
        execution._paused_at = execution._paused_at - pose(0.1)
        harness.driver.goal_queue.set_speed(1.0)
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert 'joint_1 moved by 0.1' in outcome.text
        assert 'during the pause: the limit is 0.02 rad' in outcome.text


@pytest.mark.slow
async def test_goal_with_random_pauses_succeeds_once():
    rng = np.random.default_rng(1)
    async with robot('simulated') as (harness, _):
        goal = harness.execute(slow_path('simulated'))
        for _ in range(12):
            await asyncio.sleep(float(rng.uniform(0.0, 0.5)))
            harness.driver.goal_queue.set_speed(float(rng.choice([0.0, 0.0, 0.5, 1.0])))
        harness.driver.goal_queue.set_speed(1.0)
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome.text
        assert len(goal.outcomes) == 1


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('abb', 'the controller has all points of a download'),
        ('remote', 'over Remote Ethernet alone'),
    ],
)
async def test_refused_pause_states_its_reason_and_the_motion_continues(name, reason):
    async with robot(name) as (harness, controller):
        goals = harness.driver.goal_queue
        with pytest.raises(ValueError, match=f'factor = 0: {reason}'):
            goals.set_speed(0.0)
        goal = harness.execute(one_point(2.0))
        await until(lambda: controller.in_motion)
        with pytest.raises(ValueError, match=f'factor = 0: {reason}'):
            goals.set_speed(0.0)
        assert goals.scaling.target == 1.0
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome.text
