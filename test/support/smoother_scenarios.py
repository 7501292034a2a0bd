# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random scenarios for the smoother: what people and programs do to it, one after the other.

Trajectories all at once and little by little, streams of single points with jitter and losses,
holds, scales, stops and replacements; each begins whenever the one before is over, which is mostly
in the middle of a motion.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmark.exact_extrema import Extrema, Recorded, exact_extrema
from benchmark.family_members import SCARA
from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Mode
from epson_driver.motion.smoother.joint_motion import JointMotion
from support.smoother_harness import ARM, SLOW, random_points

MAX_REST_S = 60.0
"""After the last phase it must come to rest within so long, s."""


@dataclass
class Scenario:
    """A smoother, what is done to it, and what was done."""

    rng: np.random.Generator
    limits: JointLimits
    smoother: Recorded
    step: float
    start: Array
    position: Array
    """The last point sent, or where the arm was when it was told to stop."""
    end: Array
    """Where it must rest in the end: at the last point sent, or where the stop after it ends."""
    done: list[str] = field(default_factory=list)

    def let_pass(self, seconds: float) -> None:
        """Let time pass."""
        end = self.smoother.now + seconds
        while self.smoother.now < end:
            self.smoother.step(self.step)

    def near(self, reach: float) -> Array:
        """Return a point within a share of the range from the last one, inside the limits."""
        span = self.limits.position_max - self.limits.position_min
        point = self.position + self.rng.uniform(-reach, reach, len(span)) * span
        clipped: Array = np.clip(point, self.limits.position_min, self.limits.position_max)
        return clipped

    def send(self, point: Array, duration: float | None) -> None:
        """Send a point."""
        self.smoother.append(point, duration)
        self.position = self.end = point


def trajectory(scenario: Scenario) -> None:
    """Send points at once or as look-ahead asks for them; go on before all has been driven."""
    rng, smoother = scenario.rng, scenario.smoother
    points, durations = random_points(rng, scenario.limits)
    known = float(rng.choice([0.2, 0.4, np.inf]))
    for number, point in enumerate(points):
        way = np.max(np.abs(point - scenario.position) / scenario.limits.velocity)
        duration = None if durations is None else float(max(durations[number], 2.0 * way, 1e-3))
        waited = 0.0
        while smoother.look_ahead > known and waited < 1.0:
            scenario.let_pass(scenario.step)
            waited += scenario.step
        scenario.send(point, duration)
    if rng.random() < 0.5:
        smoother.finish()


def stream(scenario: Scenario) -> None:
    """Send single points on a sine of each joint, with jitter and losses."""
    rng = scenario.rng
    period = float(rng.choice([0.01, 0.02, 0.033]))
    timed = bool(rng.random() < 0.5)
    middle = scenario.position.copy()
    room = np.minimum(middle - scenario.limits.position_min, scenario.limits.position_max - middle)
    frequency = float(rng.choice([0.3, 1.0]))
    speed = rng.uniform(0.0, 0.5) * scenario.limits.velocity / (2.0 * np.pi * frequency)
    reach = rng.choice([-1.0, 1.0], len(room)) * np.minimum(speed, room)
    for number in range(1, 1 + int(rng.uniform(0.3, 1.2) / period)):
        scenario.let_pass(max(period + float(rng.uniform(-0.004, 0.004)), 0.0))
        if rng.random() < 0.98:
            way = np.sin(2.0 * np.pi * frequency * number * period)
            scenario.send(middle + reach * way, period if timed else None)


def hold(scenario: Scenario) -> None:
    """Pause on the path, and go on."""
    scenario.smoother.scale = 0.0
    scenario.let_pass(float(scenario.rng.uniform(0.0, 0.5)))
    scenario.smoother.scale = 1.0


def scale(scenario: Scenario) -> None:
    """Change the speed."""
    scenario.smoother.scale = float(scenario.rng.uniform(0.05, 1.0))


def resting_place(smoother: Recorded) -> Array:
    """Return where what is executed now ends, shape (n,)."""
    _, executed = smoother.executed[-1]
    if executed is None:
        return smoother.motion.position
    if isinstance(executed, JointMotion):
        return executed.end
    return executed.path.at(executed.timing.end)[0]


def stop(scenario: Scenario) -> None:
    """Forget all points, and rest."""
    scenario.smoother.stop()
    if scenario.rng.random() < 0.5:
        scenario.let_pass(float(scenario.rng.uniform(0.0, 0.3)))
    scenario.position = scenario.smoother.motion.position
    scenario.end = resting_place(scenario.smoother)


def replace(scenario: Scenario) -> None:
    """Go elsewhere, straight out of the motion."""
    scenario.position = scenario.smoother.motion.position
    reach = float(scenario.rng.choice([0.01, 0.1, 0.4]))
    points = [scenario.near(reach) for _ in range(int(scenario.rng.integers(1, 5)))]
    scenario.smoother.replace(np.array(points))
    scenario.position = scenario.end = points[-1]


PHASES: tuple[Callable[[Scenario], None], ...] = (trajectory, stream, hold, scale, stop, replace)


def random_scenario(seed: int) -> tuple[Scenario, Extrema]:
    """Return a scenario that is over, and the exact extrema of its motion."""
    rng = np.random.default_rng([seed, 500])
    limits = (ARM, ARM, SCARA, SLOW)[int(rng.integers(4))]
    middle = (limits.position_max + limits.position_min) / 2.0
    start = middle + 0.3 * rng.uniform(-1.0, 1.0, len(middle)) * (limits.position_max - middle)
    mode = Mode.TIME_PRESERVING if rng.random() < 0.5 else Mode.TIME_OPTIMAL
    latency = float(rng.choice([0.0, 0.02, 0.05]))
    smoother = Recorded(limits, start, mode, latency=latency)
    step = float(rng.choice([0.002, 0.004]))
    scenario = Scenario(rng, limits, smoother, step, start, position=start, end=start)
    for number in range(int(rng.integers(3, 7))):
        phase = PHASES[int(rng.integers(2 if number == 0 else len(PHASES)))]
        scenario.done.append(phase.__name__)
        phase(scenario)
        scenario.let_pass(float(rng.choice([0.0, 0.05, 0.3])))
    smoother.scale = 1.0
    smoother.finish()
    end = smoother.now + MAX_REST_S
    while smoother.moving:
        smoother.step(scenario.step)
        assert smoother.now < end, f'seed {seed}: it does not come to rest: {scenario.done}'
    return scenario, exact_extrema(smoother, start)


def assert_kept(seed: int) -> None:
    """Check that a scenario keeps all limits at every instant, and ends at its last point.

    Nor may any number of a plan become NaN.
    """
    with np.errstate(invalid='raise'):
        scenario, exact = random_scenario(seed)
    smoother = scenario.smoother
    what = f'seed {seed}, {", ".join(scenario.done)}: {exact}'
    assert exact.worst <= 1.0 + 1e-6, what
    assert exact.outside <= 1e-10, what
    assert exact.position_jump <= 1e-11, what
    assert exact.velocity_jump <= 1e-8, what
    assert exact.acceleration_jump <= 1e-4, what  # a start that is taken back within 1 µs
    assert smoother.violations == smoother.planner_errors == 0, what
    assert np.max(np.abs(smoother.motion.position - scenario.end)) <= 1e-6, what
