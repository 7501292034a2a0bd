# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random points, events and scenarios for smoothers, and checks of their motion."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmark.exact_extrema import Extrema, Recorded, exact_extrema
from benchmark.family_members import SCARA
from epson_driver.motion import Array, JointLimits, Trajectory
from epson_driver.motion.joint_motion import JointMotion
from epson_driver.motion.smoother import Mode

MAX_REST_S = 60.0
"""Maximum time from the last phase to rest, s."""


@dataclass
class Scenario:
    """A smoother and its scenario."""

    rng: np.random.Generator
    limits: JointLimits
    smoother: Recorded
    step: float
    start: Array
    position: Array
    """The last point sent, or the arm's position at a stop."""
    end: Array
    """The required end position: the last point sent, or the end of a later stop."""
    done: list[str] = field(default_factory=list)

    def let_pass(self, seconds: float) -> None:
        """Step for a time, s."""
        end = self.smoother.now + seconds
        while self.smoother.now < end:
            self.smoother.step(self.step)

    def near(self, reach: float) -> Array:
        """Return a point within the limits, at most `reach` of the range from the last one."""
        span = self.limits.position_max - self.limits.position_min
        point = self.position + self.rng.uniform(-reach, reach, len(span)) * span
        clipped: Array = np.clip(point, self.limits.position_min, self.limits.position_max)
        return clipped

    def send(self, point: Array, duration: float | None) -> None:
        """Send a point."""
        self.smoother.append(point, duration)
        self.position = self.end = point


def trajectory(scenario: Scenario) -> None:
    """Send points immediately or on demand of the look-ahead, without waiting for the end."""
    rng, smoother = scenario.rng, scenario.smoother
    points, durations = random_points(rng, scenario.limits)
    known = float(rng.choice([0.2, 0.4, np.inf]))
    for number, point in enumerate(points):
        shortest = np.max(np.abs(point - scenario.position) / scenario.limits.velocity)
        duration = (
            None if durations is None else float(max(durations[number], 2.0 * shortest, 1e-3))
        )
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
            offset = np.sin(2.0 * np.pi * frequency * number * period)
            scenario.send(middle + reach * offset, period if timed else None)


def hold(scenario: Scenario) -> None:
    """Hold on the path, and resume."""
    scenario.smoother.hold()
    scenario.let_pass(float(scenario.rng.uniform(0.0, 0.5)))
    scenario.smoother.resume()


def resting_place(smoother: Recorded) -> Array:
    """Return the end of the executed motion, shape (n,)."""
    _, executed = smoother.executed[-1]
    if executed is None:
        return smoother.motion.position
    if isinstance(executed, JointMotion):
        return executed.end
    return executed.path.at(executed.timing.end)[0]


def stop(scenario: Scenario) -> None:
    """Stop, which drops all points."""
    scenario.smoother.stop()
    if scenario.rng.random() < 0.5:
        scenario.let_pass(float(scenario.rng.uniform(0.0, 0.3)))
    scenario.position = scenario.smoother.motion.position
    scenario.end = resting_place(scenario.smoother)


def replace(scenario: Scenario) -> None:
    """Stop, and send other points at once."""
    scenario.position = scenario.smoother.motion.position
    reach = float(scenario.rng.choice([0.01, 0.1, 0.4]))
    points = [scenario.near(reach) for _ in range(int(scenario.rng.integers(1, 5)))]
    scenario.smoother.stop()
    for point in points:
        scenario.send(point, None)


PHASES: tuple[Callable[[Scenario], None], ...] = (trajectory, stream, hold, stop, replace)


def random_scenario(seed: int) -> tuple[Scenario, Extrema]:
    """Return a completed scenario, and the exact extrema of its motion."""
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
    smoother.resume()
    smoother.finish()
    end = smoother.now + MAX_REST_S
    while smoother.moving:
        smoother.step(scenario.step)
        assert smoother.now < end, f'seed {seed}: no rest: {scenario.done}'
    return scenario, exact_extrema(smoother, start)


def assert_exact(exact: Extrema, text: str = '') -> None:
    """Assert the limits at every instant, and a motion without jumps."""
    assert exact.worst <= 1.0 + 1e-6, text
    assert exact.outside <= 1e-10, text
    assert exact.position_jump <= 1e-11, text
    assert exact.velocity_jump <= 1e-8, text
    assert exact.acceleration_jump <= 1e-4, text  # a start that is reverted within 1 µs


def assert_kept(seed: int) -> None:
    """Assert all limits at every instant, the end at the last point, and plans without NaN."""
    with np.errstate(invalid='raise'):
        scenario, exact = random_scenario(seed)
    smoother = scenario.smoother
    text = f'seed {seed}, {", ".join(scenario.done)}: {exact}'
    assert_exact(exact, text)
    assert smoother.violations == smoother.planner_errors == 0, text
    assert np.max(np.abs(smoother.motion.position - scenario.end)) <= 1e-6, text


NAMES = ('a', 'b')

LIMITS = JointLimits(
    NAMES,
    np.full(2, -3.0),
    np.full(2, 3.0),
    np.array([8.0, 4.0]),
    np.array([50.0, 40.0]),
    np.array([500.0, 400.0]),
)

SHARE = np.linspace(0.0, 1.0, 12)[:, None]

CURVE = np.hstack([2.0 * SHARE - 1.0, np.sin(4.0 * SHARE)])

PLAN = Trajectory(NAMES, np.linspace(0.0, 2.2, 12), CURVE)


def motion_of(times, position):
    """Return a motion of joint a alone, from a function of time."""
    q = position(times)
    v = np.gradient(q, times)
    columns = [np.stack([row, 0.0 * row], axis=1) for row in (q, v, np.gradient(v, times))]
    return Trajectory(NAMES, times, *columns)


LONGEST = 8.0
"""Maximum duration of a run's stream, s."""

ARM = JointLimits(  # EPSON C3-A601S: config/robots/c3.yaml has the same velocities
    tuple(f'joint_{i}' for i in range(1, 7)),
    np.radians([-170.0, -160.0, -51.0, -200.0, -135.0, -360.0]),
    np.radians([170.0, 65.0, 225.0, 200.0, 135.0, 360.0]),
    np.radians([450.0, 450.0, 514.0, 553.0, 553.0, 720.0]),
    np.radians([4500.0, 4500.0, 5140.0, 5530.0, 5530.0, 7200.0]),
    np.radians([45000.0, 45000.0, 51400.0, 55300.0, 55300.0, 72000.0]),
)
SLOW = JointLimits(
    ('a', 'b', 'c'),
    np.full(3, -2.0),
    np.full(3, 2.0),
    np.array([1.0, 2.0, 3.0]),
    np.array([3.0, 10.0, 9.0]),
    np.array([15.0, 100.0, 40.0]),
)


@dataclass
class Run:
    """A run, and its samples every dt, shape (m, n)."""

    seed: int
    limits: JointLimits
    smoother: Recorded
    dt: float
    start: Array
    positions: list[Array] = field(default_factory=list)
    velocities: list[Array] = field(default_factory=list)
    accelerations: list[Array] = field(default_factory=list)
    stops: int = 0
    """Number of uncommanded rests between the ends."""
    complete: bool = True
    """Whether the run had no events."""


def random_points(rng: np.random.Generator, limits: JointLimits) -> tuple[Array, Array | None]:
    """Return points, shape (k, n), with close pairs and duplicates, and durations."""
    span = limits.position_max - limits.position_min
    middle = (limits.position_max + limits.position_min) / 2.0
    n = len(span)
    # steps of a tenth of the range, of most of it, or many short ones
    reach = rng.choice([0.05, 0.2, 0.45, 0.5])
    points = [middle + rng.uniform(-0.3, 0.3, n) * span]
    direction = rng.normal(size=n)
    for _ in range(int(rng.integers(4, 14))):
        here = points[-1]
        kind = rng.choice(['far', 'far', 'on', 'on', 'pair', 'pair', 'double', 'dense'])
        if kind == 'far':
            new = middle + rng.uniform(-reach, reach, n) * span
        elif kind == 'on':
            direction = direction + 0.3 * rng.normal(size=n)
            new = here + 0.03 * span * direction / np.linalg.norm(direction)
        elif kind == 'double':
            new = here.copy()
        elif kind == 'dense':
            unit = direction / np.linalg.norm(direction)
            points.extend(
                np.clip(here + i * 4e-3 * unit, limits.position_min, limits.position_max)
                for i in range(1, 8)
            )
            continue
        else:
            unit = rng.normal(size=n)
            new = here + rng.choice([2.5e-4, 3e-4, 5e-4, 1e-3, 3e-3]) * unit / np.abs(unit).max()
        points.append(np.clip(new, limits.position_min, limits.position_max))
    chain = np.array(points)
    if rng.random() < 0.5:
        return chain, None
    fastest = np.max(np.abs(np.diff(chain, axis=0)) / limits.velocity, axis=1)
    pace = rng.choice([1.0, 1.5, 3.0])
    return chain, np.concatenate(([0.0], np.maximum(pace * fastest, rng.choice([1e-3, 0.01]))))


def random_run(seed: int, dt: float, smoother_class: type[Recorded] = Recorded) -> Run:
    """Return a completed random run of points, holds and stops, some with other points at once."""
    rng = np.random.default_rng([seed, 20])
    limits = (ARM, ARM, SCARA, SLOW)[int(rng.integers(4))]
    points, durations = random_points(rng, limits)
    latency = float(rng.choice([0.0, 0.02, 0.04, 0.1]))
    look_ahead = float(rng.choice([0.2, 0.3, 0.5, np.inf]))
    mode = Mode.TIME_PRESERVING if durations is not None else Mode.TIME_OPTIMAL
    smoother = smoother_class(limits, points[0], mode, latency=latency)
    events: list[tuple[float, str, float]] = []
    if rng.random() < 0.6:
        for _ in range(int(rng.integers(1, 5))):
            what = str(rng.choice(['hold', 'hold', 'hold', 'stop', 'replace']))
            events.append((float(rng.uniform(0.0, 2.5)), what, float(rng.uniform(0.05, 1.0))))
            if what == 'hold':
                events.append((events[-1][0] + 0.4, 'resume', 0.0))
    events.sort()
    run = Run(seed, limits, smoother, dt, points[0], complete=not events)
    following, time, still = 1, 0.0, 0
    while following < len(points) or smoother.moving or events:
        if time > LONGEST:
            following, events = len(points), []
            smoother.resume()
        if time > 4.0 * LONGEST:
            raise AssertionError(f'seed {seed}: no rest')
        while following < len(points) and smoother.look_ahead < look_ahead:
            smoother.append(
                points[following], None if durations is None else float(durations[following])
            )
            following += 1
            if following == len(points):
                smoother.finish()
        while events and events[0][0] <= time:
            _, what, number = events.pop(0)
            if what == 'stop':
                smoother.stop()
            elif what == 'hold':
                smoother.hold()
            elif what == 'resume':
                smoother.resume()
            else:
                first = int(number * (len(points) - 1))
                smoother.stop()
                for point in points[first : first + 4]:
                    smoother.append(point)
        if not events and following == len(points):
            smoother.resume()
        motion = smoother.step(dt)
        time += dt
        run.positions.append(motion.position)
        run.velocities.append(motion.velocity)
        run.accelerations.append(motion.acceleration)
        rests = smoother.at_rest and smoother.points_ahead > 0 and smoother.now > 0.5
        run.stops += rests and not still and run.complete
        still = rests
    return run


ROUNDING = 4.0
"""Rounding error of a position, in units in the last place."""


def sampled_extrema(run: Run) -> Extrema:
    """Return the extrema of the sampled output from differences, as a cross-check.

    Velocity, acceleration and jerk are checked twice: as reported, and from positions alone. The
    rounding of positions is excluded: at 10 kHz a unit in the last place is up to 3.5e-3 rad/s³.
    """
    q = np.concatenate([[run.start] * 3, run.positions])
    limits, dt = run.limits, run.dt
    result = Extrema()
    for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), 1):
        name = ('velocity', 'acceleration', 'jerk')[order - 1]
        rounding = ROUNDING * 2.0**order * np.spacing(np.max(np.abs(q)))
        result.add(
            **{
                name: float(
                    np.max((np.abs(np.diff(q, order, axis=0)) - rounding) / dt**order / bound)
                )
            }
        )
    a = np.array(run.accelerations)
    result.add(
        velocity=float(np.max(np.abs(run.velocities) / limits.velocity)),
        acceleration=float(np.max(np.abs(a) / limits.acceleration)),
        jerk=float(np.max(np.abs(np.diff(a, axis=0, prepend=0.0 * a[:1])) / dt / limits.jerk)),
        outside=float(np.max(np.maximum(q - limits.position_max, limits.position_min - q))),
    )
    return result


def assert_within_all_limits(seed: int, dt: float) -> None:
    run = random_run(seed, dt)
    exact, sampled = exact_extrema(run.smoother, run.start), sampled_extrema(run)
    text = f'seed {seed}: {exact}, sampled every {dt} s: {sampled}'
    assert_exact(exact, text)
    assert sampled.worst <= 1.0 + 1e-4, text
    assert sampled.outside <= 1e-10, text
    assert run.smoother.violations == 0, text
