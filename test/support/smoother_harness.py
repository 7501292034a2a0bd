# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Random runs of the smoother, and the exact extrema of what they executed.

The extrema owe nothing to the package's own verification: the pieces that were executed are taken
apart by the passages of the knots (by bisection), each derivative is interpolated at Chebyshev
nodes, exactly as it is a polynomial, and looked at where its own derivative vanishes.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from epson_driver.motion import Array, JointLimits
from epson_driver.motion.smoother import Mode, Smoother
from epson_driver.motion.smoother.active_plan import ActivePlan
from epson_driver.motion.smoother.joint_motion import JointMotion

LONGEST = 8.0
"""The stream of a run ends then, s."""

NODES = chebyshev.chebpts1(17)
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(NODES, 16))
_S = (NODES + 1.0) / 2.0

ARM = JointLimits(  # EPSON C3-A601S: config/robots/c3_a601s.yaml has the same velocities
    tuple(f'joint_{i}' for i in range(1, 7)),
    np.radians([-170.0, -160.0, -51.0, -200.0, -135.0, -360.0]),
    np.radians([170.0, 65.0, 225.0, 200.0, 135.0, 360.0]),
    np.radians([450.0, 450.0, 514.0, 553.0, 553.0, 720.0]),
    np.radians([4500.0, 4500.0, 5140.0, 5530.0, 5530.0, 7200.0]),
    np.radians([45000.0, 45000.0, 51400.0, 55300.0, 55300.0, 72000.0]),
)
SCARA = JointLimits(
    ('joint_1', 'joint_2', 'joint_3', 'joint_4'),
    np.array([-2.3, -2.6, -0.15, -6.2]),
    np.array([2.3, 2.6, 0.0, 6.2]),
    np.array([7.85, 11.8, 1.1, 36.6]),
    np.array([78.0, 118.0, 11.0, 366.0]),
    np.array([780.0, 1180.0, 110.0, 3660.0]),
    ('rad', 'rad', 'm', 'rad'),
)
SLOW = JointLimits(
    ('a', 'b', 'c'),
    np.full(3, -2.0),
    np.full(3, 2.0),
    np.array([1.0, 2.0, 3.0]),
    np.array([3.0, 10.0, 9.0]),
    np.array([15.0, 100.0, 40.0]),
)


class Recorded(Smoother):
    """A smoother that keeps what it executes: since when, and the plan, joint motion or rest."""

    def __init__(self, *args: Any, **named: Any) -> None:
        self.executed: list[tuple[float, ActivePlan | JointMotion | None]] = [(0.0, None)]
        super().__init__(*args, observer=self._record, **named)

    def _record(self, now: float, what: ActivePlan | JointMotion | None) -> None:
        self.executed.append((now, what))


@dataclass
class Run:
    """What a run was, and its samples every dt, shape (m, n)."""

    seed: int
    limits: JointLimits
    smoother: Recorded
    dt: float
    start: Array
    positions: list[Array] = field(default_factory=list)
    velocities: list[Array] = field(default_factory=list)
    accelerations: list[Array] = field(default_factory=list)
    stops: int = 0
    """Rests at neither end that nobody asked for."""
    complete: bool = True
    """Whether nothing but points was said: no event."""


def random_points(rng: np.random.Generator, limits: JointLimits) -> tuple[Array, Array | None]:
    """Return points, shape (k, n), with close pairs and duplicates amid ways, and durations."""
    span = limits.position_max - limits.position_min
    middle = (limits.position_max + limits.position_min) / 2.0
    n = len(span)
    # a way of a tenth of the range, one of most of it, or many short ones
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
    """Return a random run: points, scales, holds, stops and replacements, until it rests."""
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
            what = str(rng.choice(['scale', 'scale', 'hold', 'stop', 'replace']))
            events.append((float(rng.uniform(0.0, 2.5)), what, float(rng.uniform(0.05, 1.0))))
            if what == 'hold':
                events.append((events[-1][0] + 0.4, 'scale', 1.0))
    events.sort()
    run = Run(seed, limits, smoother, dt, points[0], complete=not events)
    following, time, still = 1, 0.0, 0
    while following < len(points) or smoother.moving or events:
        if time > LONGEST:
            following, events = len(points), []
            smoother.scale = 1.0
        if time > 4.0 * LONGEST:
            raise AssertionError(f'seed {seed}: it does not come to rest')
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
                smoother.scale = 0.0
            elif what == 'scale':
                smoother.scale = number
            else:
                first = int(number * (len(points) - 1))
                smoother.replace(points[first : first + 4])
        if not events and following == len(points) and smoother.scale < 0.2:
            smoother.scale = 1.0
        motion = smoother.step(dt)
        time += dt
        run.positions.append(motion.position)
        run.velocities.append(motion.velocity)
        run.accelerations.append(motion.acceleration)
        stands = smoother.at_rest and smoother.points_ahead > 0 and smoother.now > 0.5
        run.stops += stands and not still and run.complete
        still = stands
    return run


@dataclass
class Extrema:
    """The largest multiples of the limits; positions: excess of the limits, jumps: both in rad.

    velocity_jump, acceleration_jump: multiples of the limits.
    """

    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    outside: float = 0.0
    position_jump: float = 0.0
    velocity_jump: float = 0.0
    acceleration_jump: float = 0.0

    def add(self, **values: float) -> None:
        for name, value in values.items():
            setattr(self, name, max(getattr(self, name), value))

    @property
    def worst(self) -> float:
        return max(self.velocity, self.acceleration, self.jerk)


def exact_extrema(run: Run) -> Extrema:
    """Return the extrema of all that a run executed."""
    found = Extrema()
    limits = run.limits
    zeros = np.zeros(len(limits.names))
    state = (run.start, zeros, zeros)
    ends = [begin for begin, _ in run.smoother.executed[1:]] + [run.smoother.now]
    for (begin, what), end in zip(run.smoother.executed, ends, strict=True):
        if what is None:
            if end > begin:
                state = (state[0], zeros, zeros)
            continue
        if isinstance(what, ActivePlan):
            spans = _plan_spans(what, begin - what.begin, end - what.begin)
        else:
            spans = _joint_spans(what, end - begin)
        if spans is None:
            continue
        durations, derivatives, first, last = spans
        found.add(
            position_jump=float(np.max(np.abs(first[0] - state[0]))),
            velocity_jump=float(np.max(np.abs(first[1] - state[1]) / limits.velocity)),
            acceleration_jump=float(np.max(np.abs(first[2] - state[2]) / limits.acceleration)),
        )
        state = last
        q, v, a, j = derivatives(durations[:, None] * _S)
        outside = np.maximum(_largest(q - limits.position_max), _largest(limits.position_min - q))
        found.add(
            outside=outside,
            velocity=max(_largest(v / limits.velocity), _largest(-v / limits.velocity)),
            acceleration=max(
                _largest(a / limits.acceleration), _largest(-a / limits.acceleration)
            ),
            jerk=max(_largest(j / limits.jerk), _largest(-j / limits.jerk)),
        )
    return found


def _largest(values: Array) -> float:
    """Return the maximum of polynomials given at the nodes, shape (m, 17, n)."""
    series = np.moveaxis(_TO_SERIES @ values, 1, 2).reshape(-1, 17)
    signs = (-1.0) ** np.arange(17)
    best = float(max(series.sum(axis=1).max(), (series @ signs).max(), values.max()))
    bounds = series[:, 0] + np.abs(series[:, 1:]).sum(axis=1)
    for index in np.argsort(-bounds):
        if bounds[index] <= best + 1e-10 * abs(best):
            break
        roots = chebyshev.chebroots(chebyshev.chebder(series[index]))
        inside = roots[np.abs(roots.real) <= 1.0].real
        if len(inside):
            best = max(best, float(chebyshev.chebval(inside, series[index]).max()))
    return best


def _quintics(active: ActivePlan) -> Array:
    """Return the coefficients of each segment by u from its first knot, (k - 1, 6, n)."""
    knots = active.path.knots
    h = np.diff(knots.u)
    result = []
    for i, length in enumerate(h):
        powers = length ** np.arange(6)
        matrix = np.zeros((6, 6))
        matrix[0, 0] = matrix[1, 1] = 1.0
        matrix[2, 2] = 2.0
        matrix[3] = 1.0
        matrix[4] = np.arange(6)
        matrix[5] = np.arange(6) * np.arange(-1, 5)
        right = [
            knots.position[i] * 0.0, knots.first[i] * length, knots.second[i] * length**2,
            knots.position[i + 1] - knots.position[i], knots.first[i + 1] * length,
            knots.second[i + 1] * length**2,
        ]  # fmt: skip
        segment = np.linalg.solve(matrix, np.array(right)) / powers[:, None]
        segment[0] = knots.position[i]
        result.append(segment)
    return np.array(result)


def _plan_spans(active: ActivePlan, begin: float, end: float) -> Any:
    """Return the durations of the parts of a plan, what gives its derivatives, and both ends."""
    timing, knots = active.timing, active.path.knots.u
    end = min(end, timing.duration)
    if end <= begin:
        return None
    pieces = []
    for piece, (since, until) in enumerate(zip(timing.times[:-1], timing.times[1:], strict=True)):
        low, high = max(since, begin), min(until, end)
        if high <= low:
            continue
        u, v, a = timing.positions[piece], timing.velocities[piece], timing.accelerations[piece]
        j = timing.jerks[piece]
        cuts = [low - since, high - since]
        reach = [u + t * (v + t * (a / 2 + t * j / 6)) for t in cuts]
        for knot in knots[(knots > reach[0] + 1e-12) & (knots < reach[1] - 1e-12)]:
            below, above = cuts[0], cuts[-1]
            for _ in range(80):  # u rises: halving finds the passage to rounding
                guess = (below + above) / 2.0
                if u + guess * (v + guess * (a / 2 + guess * j / 6)) < knot:
                    below = guess
                else:
                    above = guess
            cuts.insert(-1, guess)
        for t, t_end in pairwise(cuts):
            middle = (t + t_end) / 2.0
            where = u + middle * (v + middle * (a / 2 + middle * j / 6))
            segment = int(np.clip(np.sum(knots <= where) - 1, 0, len(knots) - 2))
            pieces.append(
                (
                    t_end - t, segment,
                    u - knots[segment] + t * (v + t * (a / 2 + t * j / 6)),
                    v + t * (a + t * j / 2), a + t * j, j,
                )
            )  # fmt: skip
    columns = [np.array(column) for column in zip(*pieces, strict=True)]
    durations, segments, (o, v, a, j) = columns[0], columns[1].astype(int), columns[2:]
    c = _quintics(active)[segments]  # (m, 6, n)

    def derivatives(t: Array) -> tuple[Array, Array, Array, Array]:
        w = (o[:, None] + t * (v[:, None] + t * (a[:, None] / 2 + t * j[:, None] / 6)))[..., None]
        x = (v[:, None] + t * (a[:, None] + t * j[:, None] / 2))[..., None]
        y = (a[:, None] + t * j[:, None])[..., None]
        z = j[:, None, None]
        of_u = []
        for order in range(4):
            total = np.zeros((*t.shape, c.shape[2]))
            for n in range(5, order - 1, -1):
                total = total * w + c[:, None, n] * float(np.prod(np.arange(n, n - order, -1)))
            of_u.append(total)
        q, q1, q2, q3 = of_u
        return q, q1 * x, q1 * y + q2 * x**2, q1 * z + 3 * q2 * x * y + q3 * x**3

    return durations, derivatives, *_both_ends(durations, derivatives)


def _joint_spans(motion: JointMotion, end: float) -> Any:
    """Return the same for a joint motion."""
    times, jerks, states = motion.times, motion.jerks, motion.states
    cuts = np.unique(np.clip(np.append(times.ravel(), end), 0.0, end))
    if len(cuts) < 2:
        return None
    middles = (cuts[:-1] + cuts[1:]) / 2.0
    parts = []
    for joint in range(len(times)):
        piece = times[joint, 1:].searchsorted(middles, side='right')
        rests = piece == jerks.shape[1]
        t = np.where(rests, 0.0, cuts[:-1] - np.append(times[joint], 0.0)[piece])
        p, v, a = states[:, joint, piece]
        j = np.append(jerks[joint], 0.0)[piece]
        v, a = np.where(rests, 0.0, v), np.where(rests, 0.0, a)
        parts.append(
            (p + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j, j)
        )
    p, v, a, j = (np.array(column).T[:, None, :] for column in zip(*parts, strict=True))

    def derivatives(t: Array) -> tuple[Array, Array, Array, Array]:
        t = t[..., None]
        return (
            p + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j,
            np.broadcast_to(j, (*t.shape[:2], j.shape[2])),
        )  # fmt: skip

    durations = np.diff(cuts)
    return durations, derivatives, *_both_ends(durations, derivatives)


def _both_ends(durations: Array, derivatives: Any) -> Any:
    at_start = derivatives(np.zeros((len(durations), 1)))
    at_end = derivatives(durations[:, None])
    return (
        tuple(values[0, 0] for values in at_start[:3]),
        tuple(values[-1, 0] for values in at_end[:3]),
    )


ROUNDING = 4.0
"""By how many units in the last place a position may be off."""


def sampled_extrema(run: Run) -> Extrema:
    """Return the extrema of what was given out, from differences: the cross-check.

    Velocity, acceleration and jerk twice each: of what is said, and of the positions alone. What
    the rounding of positions can make of their differences is left out: at 10 kHz a unit in the
    last place is up to 3.5e-3 rad/s³.
    """
    q = np.concatenate([[run.start] * 3, run.positions])
    limits, dt = run.limits, run.dt
    found = Extrema()
    for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), 1):
        name = ('velocity', 'acceleration', 'jerk')[order - 1]
        rounding = ROUNDING * 2.0**order * np.spacing(np.max(np.abs(q)))
        found.add(
            **{
                name: float(
                    np.max((np.abs(np.diff(q, order, axis=0)) - rounding) / dt**order / bound)
                )
            }
        )
    a = np.array(run.accelerations)
    found.add(
        velocity=float(np.max(np.abs(run.velocities) / limits.velocity)),
        acceleration=float(np.max(np.abs(a) / limits.acceleration)),
        jerk=float(np.max(np.abs(np.diff(a, axis=0, prepend=0.0 * a[:1])) / dt / limits.jerk)),
        outside=float(np.max(np.maximum(q - limits.position_max, limits.position_min - q))),
    )
    return found


def assert_within_all_limits(seed: int, dt: float) -> None:
    run = random_run(seed, dt)
    exact, sampled = exact_extrema(run), sampled_extrema(run)
    what = f'seed {seed}: {exact}; sampled every {dt} s: {sampled}'
    assert exact.worst <= 1.0 + 1e-6, what
    assert exact.outside <= 1e-10, what
    assert exact.position_jump <= 1e-11, what
    assert exact.velocity_jump <= 1e-8, what
    assert exact.acceleration_jump <= 1e-4, what  # a start that is taken back within 1 µs
    assert sampled.worst <= 1.0 + 1e-4, what
    assert sampled.outside <= 1e-10, what
    assert run.smoother.violations == 0, what
