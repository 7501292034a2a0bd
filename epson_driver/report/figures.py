# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Computes the measured values of a run.

The values are rates and intervals of messages, latencies of replies, and properties of motions.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.report.measure import Recording, measure
from epson_driver.report.run import NANOSECONDS, Event, Plan, Run
from epson_driver.robots import RobotModel

HALF_WINDOW_S = 0.03  # half width of the window around a sample to which a parabola is fitted, s
MIN_NEIGHBOURS, MAX_NEIGHBOURS = 2, 25  # number of samples in a window on either side
LATE_PERIODS = 5.0  # interval before a very late joint state / median interval
UNLIKELY_FRACTION = 0.3  # relative deviation of a velocity from a fit that then replaces it
SHORTEST_FRACTION = 0.9  # minimum interval of sending / median interval
CHUNK = 20_000  # number of samples fitted together, which bounds the memory


def likely_derivatives(sent: Array, came: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations of joint states, shape (k, m) each.

    They are computed from the estimated sending times `sent`, s, shape (k,). Near a very late
    joint state, the sending times are uncertain. Velocities there are compared with a fit to the
    arrival times `came` of MAX_NEIGHBOURS samples on either side. If a velocity deviates strongly,
    the fit replaces this velocity and its acceleration.
    """
    if len(came) < 2 * MIN_NEIGHBOURS + 1:
        return derivatives(sent, positions)
    gaps = np.diff(came)
    shortest = SHORTEST_FRACTION * float(np.median(gaps))
    sent, came = apart(sent, shortest), apart(came, shortest)
    velocities, accelerations = derivatives(sent, positions)
    late = np.flatnonzero(gaps > LATE_PERIODS * np.median(gaps))
    doubtful = np.zeros(len(came), dtype=bool)
    for index in late.tolist():
        doubtful[max(index - MAX_NEIGHBOURS, 0) : index + 1 + MAX_NEIGHBOURS] = True
    if not doubtful.any():
        return velocities, accelerations
    reach = min(MAX_NEIGHBOURS, (len(came) - 1) // 2)
    slopes, _ = _fitted(came, positions, reach, degree=1)
    _, bends = _fitted(came, positions, reach, degree=2)
    unlikely = np.abs(velocities - slopes) > UNLIKELY_FRACTION * np.abs(slopes)
    unlikely &= doubtful[:, None]
    velocities[unlikely], accelerations[unlikely] = slopes[unlikely], bends[unlikely]
    return velocities, accelerations


def apart(times: Array, shortest: float) -> Array:
    """Return ascending times whose neighbours are at least `shortest` s apart.

    Times that are closer to the next one are moved earlier.
    """
    steps = shortest * np.arange(len(times))
    return np.asarray(np.minimum.accumulate((times - steps)[::-1])[::-1] + steps)


def derivatives(times: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations from parabolas fitted to positions, shape (k, m) each.

    Differences of neighbouring samples would turn the jitter of arrival times into spikes. A fit
    covers the samples within HALF_WINDOW_S, and at least two on either side, except at the ends.
    With fewer than five samples all results are 0. `times`: shape (k,), s, ascending.
    """
    count = len(times)
    if count < 2 * MIN_NEIGHBOURS + 1:
        return np.zeros_like(positions), np.zeros_like(positions)
    reach = math.ceil(HALF_WINDOW_S / max(float(np.median(np.diff(times))), 1e-6))
    reach = min(max(reach, MIN_NEIGHBOURS), MAX_NEIGHBOURS, (count - 1) // 2)
    return _fitted(times, positions, reach, degree=2)


def _fitted(times: Array, positions: Array, reach: int, degree: int) -> tuple[Array, Array]:
    count = len(times)
    velocities, accelerations = np.empty_like(positions), np.zeros_like(positions)
    offsets = np.arange(-reach, reach + 1)
    for start in range(0, count, CHUNK):
        here = np.arange(start, min(start + CHUNK, count))
        window = np.clip(here, reach, count - 1 - reach)[:, None] + offsets
        since = times[window] - times[here, None]
        scale = np.abs(since).max(axis=1, keepdims=True)
        scale[scale == 0.0] = 1.0
        fraction = since / scale  # within ±2: the normal equations stay well conditioned
        powers = fraction[:, :, None] ** np.arange(degree + 1)
        normal = np.einsum('kwi,kwj->kij', powers, powers) + 1e-12 * np.eye(degree + 1)
        right = np.einsum('kwi,kwm->kim', powers, positions[window] - positions[here, None])
        fitted = np.linalg.solve(normal, right)
        velocities[here] = fitted[:, 1] / scale
        if degree > 1:
            accelerations[here] = 2.0 * fitted[:, 2] / scale**2
    return velocities, accelerations


FORMAT = 1  # of the JSON: changes when a key is removed or changes its meaning
STANDSTILL_RAD = 5e-4  # displacement of a joint up to which the arm has not moved yet, rad or m
MAX_PAIRS = 25_000_000  # maximum plan points × joint states to compare, else subsampled
STOP_FRACTION = 0.02  # speed below which a moving arm is stopped, as a fraction of its top speed
MIN_STOP_S = 0.03  # minimum duration of a stop, s


@dataclass(frozen=True)
class Timing:
    """Statistics of messages: count, rate, Hz, and intervals or latencies, s.

    Rate and intervals are None if there are fewer than two messages.
    """

    count: int
    rate: float | None = None
    median: float | None = None
    p99: float | None = None
    longest: float | None = None


@dataclass(frozen=True)
class Motion:
    """One plan and its execution. Times in s, angles in rad, lengths in m.

    * sent, began: times of the first point and of the first motion.
    * dead_time: from `sent` to `began`.
    * stops: stops that are not in the plan.
    * waypoint_deviation: largest distance of a planned point from the executed path, at any time.

    Values are None if the arm did not move.
    """

    sent: float
    points: int
    planned: float
    began: float | None = None
    dead_time: float | None = None
    moved: float | None = None
    stops: int | None = None
    commanded_stops: int | None = None
    waypoint_deviation: float | None = None
    end_deviation: float | None = None
    top_velocity: tuple[float, ...] = ()
    top_acceleration: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Figures:
    """All measured values of a run. Velocities and accelerations: shape (k, m)."""

    velocities: Array
    accelerations: Array
    joint_states: Timing
    traffic: tuple[tuple[str, str, Timing], ...]
    replies: tuple[tuple[str, Timing], ...]
    motions: tuple[Motion, ...]
    stops: tuple[tuple[float, float], ...]  # standstills during motions: start and duration, s


def figures(run: Run, metric: Array | None = None) -> Figures:
    """Return the measured values of a run.

    Velocities that the controller has measured are used if available.

    `metric`: JointLimits.rad_per_unit, shape (m,). This factor makes prismatic and revolute joints
    comparable.
    """
    metric = np.ones(len(run.joint_names)) if metric is None else metric
    sent = run.times if run.sent is None else run.sent
    fitted, accelerations = likely_derivatives(sent, run.times, run.positions)
    velocities = fitted if run.velocities is None else run.velocities
    motions, stops = [], []
    for number, plan in enumerate(run.plans, start=1):
        until = run.plans[number].sent if number < len(run.plans) else math.inf
        motion = _motion(plan, until, run, velocities, accelerations, metric)
        motions.append(motion)
        if motion.began is not None and motion.moved is not None:
            ended = motion.began + motion.moved
            stops += _standstills(run, velocities * metric, motion.began, ended)
    latencies: dict[str, list[float]] = defaultdict(list)
    for reply in run.replies:
        latencies[reply.name].append(reply.latency)
    return Figures(
        velocities,
        accelerations,
        _between(run.times),
        tuple((item.name, item.sender, _between(item.times)) for item in run.traffic),
        tuple((name, _quantiles(len(v), None, v)) for name, v in sorted(latencies.items())),
        tuple(motions),
        tuple(stops),
    )


def _between(times: Array) -> Timing:
    if len(times) < 2:
        return Timing(len(times))
    gaps, span = np.diff(times), float(times[-1] - times[0])
    return _quantiles(len(times), len(gaps) / span if span > 0.0 else None, gaps.tolist())


def _quantiles(count: int, rate: float | None, values: Sequence[float]) -> Timing:
    p99 = float(np.quantile(values, 0.99))
    return Timing(count, rate, float(np.median(values)), p99, max(values))


def _motion(
    plan: Plan, until: float, run: Run, velocities: Array, accelerations: Array, metric: Array
) -> Motion:
    """Return the measured values of a plan's execution. `until`: time of the next plan, s."""
    bare = Motion(plan.sent, len(plan.times), float(plan.times[-1]))
    here = np.flatnonzero((run.times >= plan.sent) & (run.times < until))
    if len(here) < 2:
        return bare
    positions = run.positions[here]
    before = run.positions[max(int(here[0]) - 1, 0)]
    away = np.abs(positions - before).max(axis=1) > STANDSTILL_RAD
    if not away.any():
        return bare
    first = int(np.argmax(away))
    settled = np.abs(positions - positions[-1]).max(axis=1) > STANDSTILL_RAD
    last = int(np.flatnonzero(settled)[-1]) + 1 if settled.any() else first
    last = max(last, first + 1) if first + 1 < len(here) else last
    moving = here[first : last + 1]
    began = float(run.times[moving[0]])
    stops = commanded = waypoint = None
    if len(plan.times) > 1 and len(moving) > 4:
        stride = math.ceil(len(plan.times) * len(here) / MAX_PAIRS)
        recording = Recording(
            run.times[here][::stride], positions[::stride], velocities[here][::stride]
        )
        trajectory = Trajectory(run.joint_names, plan.times, plan.positions)
        measured = measure(trajectory, recording, metric)
        stops, commanded = measured.stops, measured.commanded_stops
        if np.any(metric != 1.0):
            measured = measure(trajectory, recording)
        waypoint = measured.waypoint_deviation
    return replace(
        bare,
        began=began,
        dead_time=began - plan.sent,
        moved=float(run.times[moving[-1]]) - began,
        stops=stops,
        commanded_stops=commanded,
        waypoint_deviation=waypoint,
        end_deviation=float(np.abs(positions[-1] - plan.positions[-1]).max()),
        top_velocity=tuple(np.abs(velocities[moving]).max(axis=0).tolist()),
        top_acceleration=tuple(np.abs(accelerations[moving]).max(axis=0).tolist()),
    )


def _standstills(
    run: Run, velocities: Array, start: float, end: float
) -> list[tuple[float, float]]:
    """Return the standstills of the arm between two times: start and duration of each, s."""
    here = np.flatnonzero((run.times >= start) & (run.times <= end))
    speed = np.abs(velocities[here]).max(axis=1)
    at_rest = speed < STOP_FRACTION * speed.max()
    moving = np.flatnonzero(~at_rest)
    if moving.size < 2:
        return []
    inside = at_rest[moving[0] : moving[-1]].astype(np.int8)
    edges = np.diff(inside, prepend=0, append=0)
    times = run.times[here][moving[0] :]
    starts, ends = times[np.flatnonzero(edges == 1)], times[np.flatnonzero(edges == -1)]
    long = ends - starts >= MIN_STOP_S
    return list(zip(starts[long].tolist(), (ends - starts)[long].tolist(), strict=True))


def as_json(run: Run, numbers: Figures, events: Sequence[Event], model: RobotModel) -> Any:
    limits = model.limits
    return {
        'format': FORMAT,
        'source': run.source,
        'robot_model': model.name,
        'began': datetime.fromtimestamp(run.began / NANOSECONDS, UTC).isoformat(),
        'duration_s': run.ended,
        'joint_names': list(run.joint_names),
        'velocity_limits': limits.velocity.tolist(),
        'acceleration_limits': limits.acceleration.tolist(),
        'velocities': 'computed' if run.velocities is None else 'measured',
        'joint_states': _timing(numbers.joint_states),
        'messages': [
            {'name': name, 'sender': sender} | _timing(timing)
            for name, sender, timing in numbers.traffic
        ],
        'replies': [
            {'name': name, 'count': timing.count, 'median_s': timing.median}
            | {'p99_s': timing.p99, 'longest_s': timing.longest}
            for name, timing in numbers.replies
        ],
        'motions': [_motion_json(motion) for motion in numbers.motions],
        'standstills': [
            {'time_s': time, 'duration_s': duration} for time, duration in numbers.stops
        ],
        'events': [
            {'time_s': e.time, 'level': e.level, 'text': e.text, 'remedy': e.remedy}
            for e in events
        ],
        'notes': list(run.notes),
    }


_IN_SECONDS = ('sent', 'planned', 'began', 'dead_time', 'moved')


def _motion_json(motion: Motion) -> dict[str, Any]:
    return {
        f'{name}_s' if name in _IN_SECONDS else name: value
        for name, value in asdict(motion).items()
    }


def _timing(timing: Timing) -> dict[str, Any]:
    return {
        'count': timing.count,
        'rate_hz': timing.rate,
        'between_median_s': timing.median,
        'between_p99_s': timing.p99,
        'between_longest_s': timing.longest,
    }
