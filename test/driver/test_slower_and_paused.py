# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A lower speed is lower at the arm, and a pause pauses, on every kind of controller.

The speeds are measured at the simulated arm, step by step, and not derived from messages.
"""

import asyncio
import contextlib
from dataclasses import replace

import numpy as np
import pytest
from support.driver_harness import HOME, JOINTS, LIMITS, Submitted, pose, smooth_on_the_spot
from support.event_loop import now, until
from support.fault_play import cell_of, make_ready, standing, where
from support.streams import sending, velocities

from epson_driver.driver.delivery.delivery_factory import delivery_rules
from epson_driver.driver.goal.goal import Goal, GoalSettings, cause_timeout
from epson_driver.driver.goal.planned_speed import PlannedSpeed
from epson_driver.driver.outcome import End, ErrorCode
from epson_driver.driver.smoothing import Smoothing, usual_smoothing
from epson_driver.motion import Trajectory
from epson_driver.profiles import load_controller_profile
from epson_driver.setup.setup import profile_defaults
from epson_driver.share import share_folder
from epson_driver.sim_controller.condition.states import Event

PROFILES = sorted(path.stem for path in share_folder('config', 'controllers').glob('*.yaml'))

WINDOW_S = 0.1
"""Speeds are means over this time, s: two points of the fastest controller."""


def smooth_way(duration, way=0.15, count=11):
    """Return a planned way of joint 1 from HOME and back, as a planner makes it."""
    share = np.linspace(0.0, 1.0, count)
    bump = 16 * share**2 * (1 - share) ** 2
    rate = 32 * share * (1 - share) * (1 - 2 * share)
    positions, velocities = np.outer(bump, pose(way)), np.outer(rate, pose(way)) / duration
    return Trajectory(LIMITS.names, share * duration, positions, velocities)


def one_point(duration, way=0.15):
    """Return a plan to one point, which Remote Ethernet takes too."""
    return Trajectory(LIMITS.names, np.array([duration]), pose(way)[None, :])


class Speedometer:
    """Records where the arm is at each step of the controller."""

    def __init__(self, controller):
        self.times, self.places = [now()], [where(controller)]
        step = controller.step

        def recorded(seconds):
            step(seconds)
            self.times.append(self.times[-1] + seconds)
            self.places.append(where(controller))

        controller.step = recorded

    @property
    def peak(self):
        """Return the highest mean speed over WINDOW_S, rad/s."""
        times, places = np.array(self.times), np.array(self.places)
        ends = np.searchsorted(times, times + WINDOW_S)
        inside = np.flatnonzero(ends < len(times))
        moved = np.abs(places[ends[inside]] - places[inside]).max(axis=1)
        return float(np.max(moved / WINDOW_S, initial=0.0))


@contextlib.asynccontextmanager
async def robot(name, smoothing=None):
    """Run an enabled driver with the defaults of a profile, and its controller."""
    profile = load_controller_profile(name)
    settings = GoalSettings(cause_timeout=cause_timeout(profile.state))
    smoothing = smoothing or usual_smoothing(profile.program)
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


def submit(harness, trajectory):
    submitted = Submitted(Goal(trajectory, np.full(JOINTS, 0.01), goal_time=0.0))
    harness.process.copy().run(harness.driver.goal_queue.submit, submitted.handle)
    return submitted


async def executed(name, trajectory, factor=1.0):
    """Return the outcome of a plan and the arm's highest speed, or the text of a refusal."""
    async with robot(name) as (harness, controller):
        speedometer = Speedometer(controller)
        try:
            harness.driver.goal_queue.set_speed(factor)
        except ValueError as refusal:
            assert speedometer.peak == 0.0
            return str(refusal), 0.0
        outcome = await submit(harness, trajectory).end()
        if outcome.code is ErrorCode.INVALID_GOAL:
            assert speedometer.peak == 0.0
            return outcome.text, 0.0
        assert outcome.end is End.SUCCEEDED, outcome.text
        return '', speedometer.peak


@pytest.mark.invariant(10)
@pytest.mark.parametrize(
    ('name', 'plan'),
    [(name, one_point if name == 'remote' else smooth_way) for name in PROFILES]
    + [(name, one_point) for name in ('abb', 'generic', 'motoman', 'spel')],
)
async def test_inv10_a_tenth_of_the_speed_is_a_tenth_at_the_arm_or_refused(name, plan):
    """By the speed scaling, and by a plan that is ten times as slow, as MoveIt makes it."""
    refused, usual = await executed(name, plan(0.5))
    if refused:
        assert name == 'fanuc'
    for trajectory, factor in ((plan(0.5), 0.1), (plan(5.0), 1.0)):
        why, peak = await executed(name, trajectory, factor)
        if why:
            assert any(word in why for word in ('override', 'Remote Ethernet', 'least that')), why
        else:
            assert 0.05 * usual <= peak <= 0.15 * usual


async def jogged(name, factor, speed=0.2, refused=''):
    """Return the arm's highest speed in a stream of velocities, of joint 1, rad/s."""
    async with robot(name) as (harness, controller):
        period = load_controller_profile(name).program.setpoint_period
        harness.driver.servo.settings = replace(harness.driver.servo.settings, period=period)
        speedometer = Speedometer(controller)
        if factor != 1.0:
            harness.driver.goal_queue.set_speed(factor)
        for _ in range(75):
            why = harness.driver.servo.take(velocities(pose(speed))) or ''
            assert (refused in why) if refused else not why
            await asyncio.sleep(0.02)
        return speedometer.peak


@pytest.mark.invariant(10)
@pytest.mark.parametrize('name', ['simulated', 'generic', 'spel'])
async def test_inv10_a_stream_at_a_tenth_is_a_tenth_at_the_arm(name):
    speed = 2.0 if name == 'spel' else 0.2  # SPEL+ has no speed below 1 % of the joint limits
    assert 0.05 * speed <= await jogged(name, 0.1, speed) <= 0.15 * speed


@pytest.mark.invariant(10)
@pytest.mark.parametrize(('name', 'why'), [('fanuc', 'override'), ('remote', 'no streams')])
async def test_inv10_a_stream_without_a_speed_of_its_own_is_refused(name, why):
    assert await jogged(name, 1.0, refused=why) == 0.0


# --- pauses -----------------------------------------------------------------------------------

OBEYS_STOP = [name for name in PROFILES if name not in ('abb', 'remote')]

SLOW = 0.05
"""Share of the velocity limit in the pauses here."""

SPEED = SLOW * float(LIMITS.velocity[0])
WAY = np.linspace(0.0, 1.0, 41)


def slow_way(name):
    """Return a way of joint 1 at SLOW, or as fast as a controller of that kind always is."""
    share = 0.2 if name == 'fanuc' else SLOW
    times = 0.2 + (WAY[1:] + 1.0 - np.cos(np.pi * WAY[1:] / 4)) / (share * LIMITS.velocity[0])
    return Trajectory(LIMITS.names, times, np.array([pose(place) for place in WAY[1:]]))


async def paused_on_the_way(harness, controller, trajectory, at=0.25):
    """Submit a goal, and pause it when joint 1 is there; return it and the arm's place then."""
    goal = submit(harness, trajectory)
    await until(lambda: where(controller)[0] > at)
    here = where(controller)
    assert harness.driver.goal_queue.set_speed(0.0).startswith('pausing')
    return goal, here


@pytest.mark.invariant(3, 10)
@pytest.mark.parametrize('name', OBEYS_STOP)
async def test_inv10_a_pause_brakes_and_the_rest_goes_through_the_same_points(name):
    async with robot(name) as (harness, controller):
        goal, here = await paused_on_the_way(harness, controller, slow_way(name))
        began = now()
        await standing(controller)
        assert now() - began < 0.7  # 0.3 s, braking, and how long a standstill takes to be seen
        stopped = where(controller)
        most = 0.05 if name != 'fanuc' else 0.2
        assert 0.0 <= stopped[0] - here[0] < most
        await until(lambda: goal.handle.execution.state.value == 'paused')
        await asyncio.sleep(6.0)  # longer than any patience
        np.testing.assert_array_equal(where(controller), stopped)
        assert not goal.outcomes
        speedometer = Speedometer(controller)
        harness.driver.goal_queue.set_speed(1.0)
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome.text
        places = np.array(speedometer.places)
        assert places[:, 0].min() > stopped[0] - 1e-3  # no step back
        assert np.abs(places[:, 1:]).max() < 1e-3
        np.testing.assert_allclose(places[-1], pose(1.0), atol=2e-3)
        assert speedometer.peak < 1.3 * SPEED or name == 'fanuc'


def to_and_fro(count, share, way=0.2):
    """Return a way of joint 1 to a place and back, `count` times each."""
    places = np.tile([0.0, way], count + 1)[: 2 * count + 1]
    times = np.arange(len(places)) * way / (share * LIMITS.velocity[0])
    return Trajectory(LIMITS.names, times, np.array([pose(place) for place in places]))


def visits(places, way=0.2):
    """Return how often joint 1 came to the far end after it was at the near one, and back."""
    ends = [place > way / 2 for place in places if not way * 0.15 < place < way * 0.85]
    return int(np.count_nonzero(np.diff(ends)))


@pytest.mark.invariant(10)
@pytest.mark.parametrize('at', [0.1, 0.45, 0.8])
@pytest.mark.parametrize(
    ('name', 'share', 'smoothing', 'most'),
    [
        ('fanuc', 0.2, None, 10),
        ('fanuc', 0.2, Smoothing(0.05), 8),
        ('spel', 0.05, None, 8),
        ('simulated', 0.05, None, 8),
    ],
)
async def test_inv10_no_point_of_a_way_to_and_fro_is_skipped_after_a_pause(
    name, share, smoothing, most, at, monkeypatch
):
    """Paused on the way, and, where the rest is planned first, once more while it is."""
    smooth_on_the_spot(monkeypatch, delay=0.2)
    plan = to_and_fro(4, share)
    async with robot(name, smoothing) as (harness, controller):
        speedometer = Speedometer(controller)
        goal = submit(harness, plan)
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
        turns = visits(np.array(speedometer.places)[:, 0])
        assert 8 <= turns <= most
        assert min(times) >= 0.0
        if name != 'fanuc':  # whose clock is not that of the arm
            assert np.diff(times).min() > -0.3


@pytest.mark.invariant(10)
@pytest.mark.parametrize(('name', 'slow'), [('fanuc', 0.01), ('spel', 0.009)])
async def test_inv10_a_plan_that_was_accepted_is_resumed_in_its_slow_part(name, slow, monkeypatch):
    """Its rest alone would be refused as slower than the controller."""
    smooth_on_the_spot(monkeypatch)
    places = np.array([0.0, 0.3, 0.33])
    times = np.append(
        0.0, np.cumsum(np.diff(places) / (np.array((0.2, slow)) * LIMITS.velocity[0]))
    )
    way = Trajectory(LIMITS.names, times, np.array([pose(place) for place in places]))
    async with robot(name) as (harness, controller):
        goal, _ = await paused_on_the_way(harness, controller, way, at=0.302)
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
@pytest.mark.parametrize('name', ['simulated', 'generic', 'spel'])
async def test_inv10_a_pause_stops_a_stream_which_continues_after_it(name):
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


async def test_a_goal_that_comes_in_a_pause_starts_after_it():
    async with robot('simulated') as (harness, controller):
        harness.driver.goal_queue.set_speed(0.0)
        goal = submit(harness, one_point(0.5))
        await asyncio.sleep(5.0)
        np.testing.assert_array_equal(where(controller), HOME)
        assert not goal.outcomes
        harness.driver.goal_queue.set_speed(1.0)
        assert (await goal.end()).end is End.SUCCEEDED


@pytest.mark.invariant(4, 5)
@pytest.mark.parametrize('when', ['pausing', 'paused'])
@pytest.mark.parametrize('event', ['cancel', 'stop', 'disable', 'new goal', 'e_stop', 'cut'])
async def test_inv4_nothing_that_was_paused_resumes_after_it_was_ended(event, when):
    async with robot('simulated') as (harness, controller):
        goal, _ = await paused_on_the_way(harness, controller, slow_way('simulated'))
        execution = goal.handle.execution
        if when == 'paused':
            await until(lambda: execution.state.value == when)
        if event == 'cancel':
            harness.driver.goal_queue.cancel(goal.handle)
        elif event == 'new goal':
            other = submit(harness, one_point(1.0, way=0.3))
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
async def test_inv1_an_arm_that_was_moved_in_the_pause_does_not_resume():
    async with robot('simulated') as (harness, controller):
        goal, _ = await paused_on_the_way(harness, controller, slow_way('simulated'))
        await until(lambda: goal.handle.execution.state.value == 'paused')
        execution = goal.handle.execution
        execution._paused_at = execution._paused_at - pose(0.1)
        harness.driver.goal_queue.set_speed(1.0)
        outcome = await goal.end()
        assert outcome.end is End.ABORTED
        assert 'joint_1 moved by 0.1' in outcome.text
        assert 'during the pause: the limit is 0.02 rad' in outcome.text


async def test_pause_and_resume_at_any_time_end_in_one_success():
    rng = np.random.default_rng(1)
    async with robot('simulated') as (harness, _):
        goal = submit(harness, slow_way('simulated'))
        for _ in range(12):
            await asyncio.sleep(float(rng.uniform(0.0, 0.5)))
            harness.driver.goal_queue.set_speed(float(rng.choice([0.0, 0.0, 0.5, 1.0])))
        harness.driver.goal_queue.set_speed(1.0)
        outcome = await goal.end()
        assert outcome.end is End.SUCCEEDED, outcome.text
        assert len(goal.outcomes) == 1


@pytest.mark.parametrize(
    ('name', 'why'),
    [
        ('abb', 'the controller has all points of a download'),
        ('remote', 'by Remote Ethernet alone'),
    ],
)
def test_a_pause_that_cannot_be_is_refused_by_name(name, why):
    profile = load_controller_profile(name)
    usual = profile_defaults(profile)
    rules = delivery_rules(profile, usual['interface'], usual['point_message'])
    with pytest.raises(ValueError, match=f'factor = 0: {why}'):
        PlannedSpeed(rules, LIMITS).check_factor(0.0, None)
