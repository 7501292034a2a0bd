# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Computes the figures of a run: message rates and intervals, reply latencies, and each motion."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from epson_driver.motion import Array, Trajectory
from epson_driver.report.measure import Recording, measure
from epson_driver.report.run import NANOSECONDS, Event, Plan, Run
from epson_driver.robots import RobotModel

HALF_WINDOW_S = 0.03
"""Half width of the window around a sample to which a parabola is fitted, s."""

MIN_NEIGHBOURS, MAX_NEIGHBOURS = 2, 25
"""Minimum and maximum number of samples in a window on either side."""

LATE_PERIODS = 5.0
"""A joint state is very late after an interval of more than this multiple of the median."""

UNLIKELY_SHARE = 0.3
"""Relative deviation from a fit to many samples above which the fit replaces a velocity."""

SHORTEST_SHARE = 0.9
"""Minimum interval at which joint states are sent, as a fraction of the median interval."""

CHUNK = 20_000
"""Number of samples fitted together. It bounds the memory."""


def likely_derivatives(sent: Array, came: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations from estimated sending times, shape (k, m) each.

    `sent`, `came`: sending and arrival times, s, shape (k,). `positions`: shape (k, m).

    A controller sends periodically, so joint states that arrive in a burst were delayed in
    transit. Around a very late joint state, the sending times are uncertain. There, a fit
    to the arrivals of MAX_NEIGHBOURS samples on either side replaces velocities that deviate
    strongly from it, and their accelerations.
    """
    if len(came) < 2 * MIN_NEIGHBOURS + 1:
        return derivatives(sent, positions)
    gaps = np.diff(came)
    shortest = SHORTEST_SHARE * float(np.median(gaps))
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
    unlikely = np.abs(velocities - slopes) > UNLIKELY_SHARE * np.abs(slopes)
    unlikely &= doubtful[:, None]
    velocities[unlikely], accelerations[unlikely] = slopes[unlikely], bends[unlikely]
    return velocities, accelerations


def apart(times: Array, shortest: float) -> Array:
    """Return ascending times, some moved earlier so that all are at least `shortest` s apart."""
    steps = shortest * np.arange(len(times))
    return np.asarray(np.minimum.accumulate((times - steps)[::-1])[::-1] + steps)


def derivatives(times: Array, positions: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations from parabolas fitted to positions, shape (k, m) each.

    Differences of neighbouring samples would turn the jitter of arrival times into spikes.

    `times`: shape (k,), s, ascending. `positions`: shape (k, m). The parabola of a sample is
    fitted to the samples within HALF_WINDOW_S, and to at least two on either side. Near the ends
    the window is one-sided. With fewer than five samples all results are 0.
    """
    count = len(times)
    if count < 2 * MIN_NEIGHBOURS + 1:
        return np.zeros_like(positions), np.zeros_like(positions)
    reach = math.ceil(HALF_WINDOW_S / max(float(np.median(np.diff(times))), 1e-6))
    reach = min(max(reach, MIN_NEIGHBOURS), MAX_NEIGHBOURS, (count - 1) // 2)
    return _fitted(times, positions, reach, degree=2)


def _fitted(times: Array, positions: Array, reach: int, degree: int) -> tuple[Array, Array]:
    """Return velocities and accelerations of polynomials fitted to `reach` samples on a side."""
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


FORMAT = 1
"""Version of the JSON format. It changes when a key is removed or changes its meaning."""

STANDSTILL_RAD = 5e-4
"""Displacement of a joint up to which the arm has not moved yet, rad or m."""

MAX_PAIRS = 25_000_000
"""Maximum plan points times joint states to compare. Longer motions are subsampled."""

STOP_SHARE = 0.02
"""Speed below which a moving arm is stopped, as a fraction of its top speed."""

MIN_STOP_S = 0.03
"""Minimum duration of a stop, s."""


@dataclass(frozen=True)
class Timing:
    """The number and rate, Hz, of messages, and their intervals or latencies, s.

    Values are None if fewer than two messages exist. `p99`: the 99 % quantile.
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
    * points, planned: number of points and duration of the plan.
    * dead_time: from `sent` to `began`.
    * moved: duration of the motion.
    * stops: number of stops during the motion that are not in the plan.
    * waypoint_deviation: largest distance of a point from the path, independent of time.

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
    """All measured values of a run.

    * velocities, accelerations: of the joint states, shape (k, m).
    * traffic: name, sender and intervals of each kind of message.
    * replies: name and latencies of each kind of request.
    """

    velocities: Array
    accelerations: Array
    joint_states: Timing
    traffic: tuple[tuple[str, str, Timing], ...]
    replies: tuple[tuple[str, Timing], ...]
    motions: tuple[Motion, ...]
    stops: tuple[tuple[float, float], ...]
    """Standstills during motions: start and duration, s."""


def figures(run: Run, metric: Array | None = None) -> Figures:
    """Return the figures of a run. Velocities measured by the controller are used if available.

    `metric`: JointLimits.rad_per_unit, shape (m,), which makes prismatic joints comparable with
    revolute ones when standstills are detected. Without it, all joints count as revolute.
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
    names = sorted({reply.name for reply in run.replies})
    return Figures(
        velocities,
        accelerations,
        _between(run.times),
        tuple((item.name, item.sender, _between(item.times)) for item in run.traffic),
        tuple(
            (name, _latencies([item.latency for item in run.replies if item.name == name]))
            for name in names
        ),
        tuple(motions),
        tuple(stops),
    )


def _between(times: Array) -> Timing:
    if len(times) < 2:
        return Timing(len(times))
    gaps = np.diff(times)
    span = float(times[-1] - times[0])
    return Timing(
        len(times),
        len(gaps) / span if span > 0.0 else None,
        float(np.median(gaps)),
        float(np.quantile(gaps, 0.99)),
        float(gaps.max()),
    )


def _latencies(values: Sequence[float]) -> Timing:
    return Timing(
        len(values),
        None,
        float(np.median(values)),
        float(np.quantile(values, 0.99)),
        float(max(values)),
    )


def _motion(
    plan: Plan, until: float, run: Run, velocities: Array, accelerations: Array, metric: Array
) -> Motion:
    """Return the figures of a plan's execution. `until`: the time of the next plan, s."""
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
    names = run.joint_names
    stops = commanded = None
    waypoint = None
    if len(plan.times) > 1 and len(moving) > 4:
        stride = math.ceil(len(plan.times) * len(here) / MAX_PAIRS)
        recording = Recording(
            run.times[here][::stride], positions[::stride], velocities[here][::stride]
        )
        trajectory = Trajectory(names, plan.times, plan.positions)
        measured = measure(trajectory, recording, metric)
        stops, commanded = measured.stops, measured.commanded_stops
        if np.any(metric != 1.0):
            measured = measure(trajectory, recording)
        waypoint = measured.waypoint_deviation
    return Motion(
        sent=plan.sent,
        points=len(plan.times),
        planned=float(plan.times[-1]),
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
    """Return start and duration, s, of each standstill of the arm between two times."""
    here = np.flatnonzero((run.times >= start) & (run.times <= end))
    speed = np.abs(velocities[here]).max(axis=1)
    at_rest = speed < STOP_SHARE * speed.max()
    moving = np.flatnonzero(~at_rest)
    if moving.size < 2:
        return []
    inside = at_rest[moving[0] : moving[-1]].astype(np.int8)
    edges = np.diff(inside, prepend=0, append=0)
    times = run.times[here][moving[0] :]
    result = [
        (float(times[first]), float(times[last] - times[first]))
        for first, last in zip(
            np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True
        )
    ]
    return [(time, duration) for time, duration in result if duration >= MIN_STOP_S]


def as_json(run: Run, numbers: Figures, events: Sequence[Event], model: RobotModel) -> Any:
    """Return the figures as data for json.dumps. Keys with times end in their unit."""
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
            {
                'name': name,
                'count': timing.count,
                'median_s': timing.median,
                'p99_s': timing.p99,
                'longest_s': timing.longest,
            }
            for name, timing in numbers.replies
        ],
        'motions': [_motion_json(motion) for motion in numbers.motions],
        'standstills': [
            {'time_s': time, 'duration_s': duration} for time, duration in numbers.stops
        ],
        'events': [
            {
                'time_s': event.time,
                'level': event.level,
                'text': event.text,
                'remedy': event.remedy,
            }
            for event in events
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
