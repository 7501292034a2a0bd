# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Without a fault, the gate stays open after any sequence of requests."""

import asyncio

import numpy as np
import pytest
from support.driver_harness import JOINTS, LIMITS, cell, pose
from support.event_loop import now, run, stand_still, until
from support.examples import one_in
from support.streams import JOG, SERVO, positions, send, velocities

from epson_driver.driver.outcome import End
from epson_driver.motion import Trajectory
from epson_driver.sim_controller.condition.states import Event

MAX_ACTIONS = 9
FACTORS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
DISTANCES = (0.0, 2e-4, 0.005, 0.1, 0.3)
"""Maximum joint distances of goals, rad. Some are below their tolerance."""

REACH = 0.6
"""Maximum joint positions, rad."""


class Play:
    """A sequence of random actions. `log` has each of them with its time, s."""

    def __init__(self, harness, controller, random):
        self.log = []
        self.goals = []
        self._harness = harness
        self._controller = controller
        self._random = random
        self._streams = set()

    def __str__(self):
        return '\n'.join(self.log)

    async def act(self):
        """Perform some actions with short pauses."""
        actions = (
            *[self._goal] * 5,
            *[self._scale] * 4,
            *[self._cancel] * 2,
            self._stop,
            self._pause,
            self._setpoint,
            self._stream,
            self._stall,
        )
        for _ in range(self._random.integers(2, MAX_ACTIONS + 1)):
            text = await self._random.choice(actions)()
            self.log.append(f'{now():.4f} {text}')
            gaps = (0.0, 0.01, self._random.uniform(0.0, 0.3), self._random.uniform(0.0, 1.2))
            await asyncio.sleep(self._random.choice(gaps))

    async def end(self):
        """Continue at full speed without streams."""
        for stream in self._streams:
            stream.cancel()
        await asyncio.gather(*self._streams, return_exceptions=True)
        self._set(1.0)
        canceled = await self._cancel() if self._random.random() < 0.5 else ''
        self.log.append(f'{now():.4f} at full speed {canceled}')

    def submit(self, farthest=None):
        """Submit a goal of one to six points from the current position."""
        random = self._random
        at = self._harness.at
        points = random.integers(1, 7)
        farthest = random.choice(DISTANCES) if farthest is None else farthest
        steps = at + random.uniform(-farthest, farthest, (points, JOINTS))
        if random.random() < 0.2:  # a rest
            steps[points // 2 :] = steps[points // 2]
        steps = np.clip(steps, -REACH, REACH)
        step = random.choice([0.05, 0.1, 0.2])
        step = max(step, 1.5 * float(np.max(np.ptp([at, *steps], axis=0) / LIMITS.velocity)))
        times = np.arange(1, points + 1) * step
        if random.random() < 0.05:
            times[-1] += random.uniform(0.0, 8.0)
        if random.random() < 0.7:
            times, steps = np.append(0.0, times), np.vstack([at, steps])
        submitted = self._harness.execute(Trajectory(LIMITS.names, times, steps))
        self.goals.append(submitted)
        return submitted

    async def _goal(self):
        goal = self.submit().handle.goal.trajectory
        return f'goal {goal.times.round(3).tolist()} {goal.positions.round(4).tolist()}'

    async def _cancel(self):
        running = [goal for goal in self.goals if not goal.outcomes]
        for goal in running[-self._random.integers(1, 3) :]:
            self._harness.driver.goal_queue.cancel(goal.handle)
        return f'cancel {len(running)}'

    async def _scale(self):
        return f'scaling {self._set(float(self._random.choice(FACTORS)))}'

    def _set(self, factor):
        self._harness.driver.goal_queue.set_speed(factor)
        return factor

    async def _stop(self):
        return f'~/stop: {await self._harness.commands.stop()}'

    async def _pause(self):
        seconds = self._random.choice([0.0, 0.02, 0.3, 1.0])
        self._controller.apply(Event.PAUSE)
        await asyncio.sleep(seconds)
        self._controller.apply(Event.CONTINUE)
        return f'the controller was paused for {seconds}'

    async def _setpoint(self):
        velocity = self._random.uniform(-0.3, 0.3, JOINTS)
        self._harness.driver.servo.take(velocities(velocity, source=JOG))
        return f'a setpoint {velocity.round(3).tolist()}'

    async def _stream(self):
        start, velocity = self._harness.at, self._random.uniform(-0.2, 0.2, JOINTS)
        seconds = self._random.uniform(0.1, 1.0)

        def at(time):
            return positions(start + velocity * time, source=SERVO)

        stream = asyncio.create_task(send(self._harness, at, seconds))
        self._streams.add(stream)
        stream.add_done_callback(self._streams.discard)
        return f'a stream of {velocity.round(3).tolist()} rad/s for {seconds:.3f} s'

    async def _stall(self):
        seconds = self._random.uniform(0.0, 0.6)
        stand_still(seconds)
        return f'nothing was scheduled for {seconds:.3f} s'


SEQUENCES, BLOCK, SLOW_BLOCKS = 2000, 4, 6
"""Number of sequences, of sequences played with one arm, and of blocks in the slow tests."""

LONGEST = 300.0
"""Maximum duration of a sequence, s: a long segment may run at a factor of 0.01."""

pytestmark = pytest.mark.invariant(5)


def scale(harness, factor):
    harness.driver.goal_queue.set_speed(factor)


def submit(harness, times, positions, goal_time=0.0):
    trajectory = Trajectory(LIMITS.names, np.array(times), np.array(positions))
    return harness.execute(trajectory, goal_time=goal_time)


async def succeeds(harness, goal):
    outcome = await goal.end()
    assert outcome.end is End.SUCCEEDED, outcome.text
    assert harness.gate is None
    assert np.abs(harness.at - goal.handle.goal.trajectory.positions[-1]).max() < 0.01
    return outcome


# --- slow points ---------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize('factor', [0.1, 0.01])
async def test_goal_started_at_a_small_speed_factor_succeeds_on_arrival(factor):
    """The first point has the minimum velocity, which the goal's clock takes into account."""
    async with cell() as (harness, _):
        scale(harness, factor)
        await asyncio.sleep(0.02)
        goal = harness.submit(pose(0.1), step=1.5)
        start = now()
        await asyncio.sleep(0.1)
        scale(harness, 1.0)
        await succeeds(harness, goal)
        assert now() - start < 14.0


@pytest.mark.slow
async def test_briefly_slow_goal_succeeds_after_a_stream():
    async with cell() as (harness, _):
        harness.driver.servo.take(velocities([0.2, *[0.0] * (JOINTS - 1)]))
        await asyncio.sleep(0.9)
        goal = harness.submit(harness.at + pose(0.1), step=2.0)
        for factor in (0.01, 1.0):
            await asyncio.sleep(0.01)
            scale(harness, factor)
        await succeeds(harness, goal)


@pytest.mark.slow
async def test_goal_after_canceled_goals_with_slow_points_succeeds():
    """The next point waits for the slow ones, so a missing reply is not a fault."""
    first = [0.1914, -0.0509, -0.2106, 0.226, 0.2207, 0.1201]
    back = [0.1197, -0.0353, 0.0287, 0.3654, 0.011, -0.0386]
    second = [-0.1958, 0.0626, 0.232, 0.2333, 0.0756, 0.1911]
    third = [0.0585, 0.1222, -0.0755, -0.1307, -0.0622, -0.0254]

    async with cell(smooth=True) as (harness, _):
        scale(harness, 0.3)
        await asyncio.sleep(0.01)
        canceled = submit(harness, [0.0, 0.213, 0.426], [pose(), first, back], goal_time=3.0)
        scale(harness, 0.01)
        await asyncio.sleep(0.01)
        harness.driver.goal_queue.cancel(canceled.handle)
        submit(harness, [1.1141], [second])
        goal = submit(harness, [0.0, 1.5152], [pose(), third], goal_time=3.0)
        await asyncio.sleep(0.311)
        scale(harness, 1.0)
        await succeeds(harness, goal)


# --- plans with a rest -----------------------------------------------------------------


@pytest.mark.parametrize('smooth', one_in(2, [False, True]))
@pytest.mark.parametrize('rest', one_in(2, [[7.0], [0.5] * 14]), ids=['one segment', 'many'])
async def test_plan_with_a_long_rest_succeeds(smooth, rest):
    async with cell(smooth=smooth) as (harness, _):
        start = now()
        times = np.cumsum([0.0, 0.3, *rest, 0.2])
        path = [pose(), *[pose(0.1)] * (1 + len(rest)), pose(0.2)]
        await succeeds(harness, submit(harness, times, path))
        assert now() - start > times[-1]


@pytest.mark.slow
async def test_plan_that_ends_with_a_long_rest_succeeds():
    async with cell() as (harness, _):
        path = [pose(), pose(0.1), pose(0.1)]
        await succeeds(harness, submit(harness, [0.0, 0.3, 7.3], path))


# --- random sequences ------------------------------------------------------------


@pytest.mark.parametrize(
    'block',
    [
        pytest.param(block, marks=pytest.mark.slow if block < SLOW_BLOCKS else pytest.mark.soak)
        for block in range(SEQUENCES // BLOCK)
    ],
)
def test_inv5_random_requests_keep_the_gate_open_and_the_next_goal_succeeds(block):
    async def check():
        async with cell(smooth=bool(block % 2)) as (harness, controller):
            for number in range(BLOCK):
                play = Play(harness, controller, np.random.default_rng([block, number]))
                async with asyncio.timeout(LONGEST):
                    await play.act()
                    await play.end()
                    await until(lambda: not harness.driver.busy and harness.driver.goal_queue.idle)
                assert harness.gate is None, play
                assert await harness.rests(), play
                assert all(len(goal.outcomes) == 1 for goal in play.goals), play
                await succeeds(harness, play.submit(0.1))

    run(check(), patience=BLOCK * LONGEST)
