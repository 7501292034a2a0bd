# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random actions of users on an arm without faults."""

import asyncio

import numpy as np

from epson_driver.motion import Trajectory
from epson_driver.sim_controller.condition.states import Event
from support.driver_harness import JOINTS, LIMITS
from support.event_loop import now, stand_still
from support.streams import JOG, SERVO, positions, send, velocities

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
