# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The newest state of the arm and its controller: joints, velocities, status, and its age."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from epson_driver.driver.state.joint_mapping import JointMapping, unmapped
from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S, JointVelocity, Values
from epson_driver.driver.state.plausibility import DEFAULT_MARGINS, JointBounds, Margins
from epson_driver.driver.state.sender_clock import LATE_SLOTS, RequestClock, SenderClock
from epson_driver.error_texts import ErrorTexts, load_error_texts
from epson_driver.motion import Array, JointLimits
from epson_driver.simple_message import Status, TriState


class PauseDetector:
    """Detects a pause of the controller: motion was possible and no longer is, without an error.

    The detection uses STATUS. A controller whose STATUS has never reported that motion is possible
    does not report pauses either.
    """

    def __init__(self) -> None:
        self.interrupted = False  # motion is denied, the arm may still brake
        self.paused = False  # whether the controller denies motion and the arm is at rest
        self.main_ended = False  # motion is denied with an error number
        self._was_possible = False

    def update(self, status: Status) -> None:
        self._was_possible |= status.motion_possible == TriState.TRUE
        denied = (
            self._was_possible
            and status.motion_possible == TriState.FALSE
            and status.in_error != TriState.TRUE
        )
        self.interrupted = denied and not status.error_code
        is_at_rest = status.in_motion == TriState.FALSE
        self.paused = self.interrupted and is_at_rest
        self.main_ended = denied and is_at_rest and not self.interrupted


MAX_ARRIVALS = 2048  # maximum number of arrival times stored for diagnostics: two seconds at 1 kHz
JOINT_MOVED = 1e-3  # minimum change of a joint that the model lacks, rad or m

MAX_POSE_AGE_S = 0.3
MAX_POSE_AGE_SLOTS = 6
"""Maximum age of joint positions, in message periods, or MAX_POSE_AGE_S if that is longer. Older
positions do not show where the arm is, so no motion may start. MAX_POSE_AGE_S allows network
bursts of 0.2 s. The limit in periods is for controllers that send only a few times a second."""

CALM_MESSAGES = 10
"""Number of messages after a late message whose joints may be outdated, because a controller's
program may be delayed between measuring the joints and sending them."""

DISTRUST_TIME_S = 1.0  # time after an implausible joint state in which no motion may start, s

WITHHELD = 'the controller sends no joints while it moves the arm or cannot move it: '

MAX_TIME_RESOLUTION_S = 0.0004
"""Coarsest resolution with which a controller's time stamps are used, s. It is 1 % of the window
in which velocities are estimated."""


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Measured joint positions and velocities. Times are monotonic, s."""

    time: float  # time of arrival
    positions: Array  # shape (n,), rad or m
    velocities: Array  # shape (n,), rad/s or m/s
    measured: float  # estimated time of measurement plus the network's minimum delay (SenderClock)


@dataclass(frozen=True, slots=True)
class StateRules:
    """Timing of the controller's state messages, and limits for their plausibility check."""

    period: float = 0.005  # first estimate of the time between two messages, s
    limits: JointLimits | None = None  # for the plausibility check; None: none
    margins: Margins = DEFAULT_MARGINS  # tolerances of this check
    timeout: float = math.inf  # joints older than this are stale, however long the period is, s
    on_request: bool = False  # no state without a request, and none while the arm moves


NO_RULES = StateRules()


class RobotState:
    """The newest state of the arm and its controller. Times are the event loop's, s.

    The state is cleared when the link is lost, so that stale values cannot be mistaken for fresh
    ones (docs/invariants.md, 6).

    * `joints`: number of joints. `errors`: texts of error numbers, or None for EPSON's texts.
    * `mapping`: converts joint values of messages to those of `sample` (the ROS convention).
    * `joints_unavailable`: function that returns whether the controller currently reports no
      joints, for example because it moves the arm.

    `sample` is None until the joint velocities are known, because a single position does not show
    that the arm is at rest.
    """

    def __init__(
        self,
        joints: int,
        errors: ErrorTexts | None = None,
        mapping: JointMapping | None = None,
        rules: StateRules = NO_RULES,
        joints_unavailable: Callable[[], bool] = lambda: False,
    ) -> None:
        self._joints = joints
        self._mapping = unmapped(joints) if mapping is None else mapping
        self.errors = load_error_texts() if errors is None else errors
        self._rules = rules
        self._joints_unavailable = joints_unavailable
        self._bounds = JointBounds(joints, rules.limits, rules.margins)
        self.clear()

    def clear(self) -> None:
        self.sample: JointSample | None = None
        self.status: Status | None = None
        self.status_time = 0.0
        self.status_measured = 0.0
        """Estimated time at which the newest status was sent, plus the minimum delay, s."""
        self.arrivals: deque[float] = deque(maxlen=MAX_ARRIVALS)
        """Arrival times of this connection's last joint messages, in order."""
        self.bounded = 0  # number of velocity estimates that were clipped to the plausible maximum
        self._pause = PauseDetector()
        clock = RequestClock if self._rules.on_request else SenderClock
        self._clock: SenderClock | RequestClock = clock(self._rules.period)
        self._velocity = JointVelocity()
        self._before: Values | None = None
        self._others: Values | None = ()
        """First positions of the joints that the model lacks. None: one of these has moved."""
        self._measured = 0.0
        self._received = self._calm_until = 0.0
        self._calm = CALM_MESSAGES
        self._time_stamp: float | None = None
        self._impossible: tuple[float, str] | None = None

    def on_joints(
        self,
        data: tuple[float, ...],
        now: float,
        velocities: tuple[float, ...] | None = None,
        time_stamp: float | None = None,
    ) -> JointSample | None:
        """Process the ten joint values (`data`) of a message, and its measured velocities if any.

        Returns None for the first joint values of a connection, because their velocity is unknown.
        Raises ValueError, and ignores the values, if they are implausible.
        """
        self._step(now, self._passed(time_stamp, now - self._measured + MAX_POSE_AGE_S))
        elapsed = longest = max(now - self._measured, self._clock.period)
        if self._calm < CALM_MESSAGES:
            longest = max(longest, now - self._calm_until)
        try:
            positions = self._possible(data, longest)
            rates = None if velocities is None else self._possible_velocities(velocities)
        except ValueError as error:
            self._impossible = now, str(error)
            raise
        clock, velocity = self._clock, self._velocity
        if rates is None:
            rates = velocity.fitted(clock.time, positions, clock.gap, elapsed)
        else:
            velocity.measured(clock.time, positions, rates)
        self._before, self._measured = positions, clock.measured
        self.arrivals.append(now)
        if rates is None:
            return None
        if velocities is None and self._bounds.why_not_so_fast(rates) is not None:
            rates = self._bounds.bounded(rates)
            self.bounded += 1
        self.sample = JointSample(now, np.array(positions), np.array(rates), clock.measured)
        return self.sample

    def moved_beyond_model(self, data: tuple[float, ...]) -> int | None:
        """Return the number of a joint that moves but is not in the model, or None.

        A number is returned only once.
        """
        others = data[self._joints :]
        if self._others is None or others == self._others:
            return None
        steps = [abs(new - old) for new, old in zip(others, self._others, strict=False)]
        self._others = self._others or others
        for joint, step in enumerate(steps, self._joints + 1):
            if step > JOINT_MOVED:
                self._others = None
                return joint
        return None

    def on_status(self, status: Status, now: float) -> None:
        self._step(now, None)
        if self.joints_unavailable:  # the arm's motion during this time is unknown
            self._velocity = JointVelocity()
        self.status = status
        self.status_time = now
        self.status_measured = self._clock.measured
        self._pause.update(status)

    def enabled(self) -> None:
        """Restart the detection of pauses, because the arm was enabled."""
        self._pause = PauseDetector()
        if self.status is not None:
            self._pause.update(self.status)

    @property
    def paused(self) -> bool:
        """Whether the controller has stopped permitting motion, but reports no error."""
        return self._pause.interrupted

    @property
    def main_ended(self) -> bool:
        return self._pause.main_ended

    @property
    def in_motion(self) -> int:
        """Value of in_motion in the newest status, a `TriState`; UNKNOWN without a status."""
        return TriState.UNKNOWN if self.status is None else self.status.in_motion

    def why_not_ready(self, now: float) -> str | None:
        if self._impossible is not None and now - self._impossible[0] < DISTRUST_TIME_S:
            return self._impossible[1]
        if self.sample is None:
            return 'no joint state from the controller'
        if self.stale(now):
            why = WITHHELD if self.joints_unavailable else ''
            return f'{why}the newest joint state is {now - self.sample.measured:.3g} s old'
        return None

    @property
    def joints_unavailable(self) -> bool:
        return self._joints_unavailable()

    def stale(self, now: float) -> bool:
        usual = max(MAX_POSE_AGE_S, MAX_POSE_AGE_SLOTS * self._clock.period)
        max_age = min(usual, self._rules.timeout)
        if self.sample is None:
            return False
        return self.joints_unavailable or now - self.sample.measured > max_age

    def why_not_at_rest(self, stopped_velocity: float) -> str | None:
        """Return the evidence that the arm moves, or None if it is at rest."""
        sample, bounds = self.sample, self._bounds
        if sample is None:
            return 'no joint state from the controller'
        fastest = int(np.argmax(np.abs(sample.velocities)))
        speed = float(sample.velocities[fastest])
        if abs(speed) >= stopped_velocity:
            return f'{bounds.names[fastest]} at {speed:.3g} {bounds.units[fastest]}/s'
        if self.in_motion == TriState.TRUE:
            return 'in_motion of the controller'
        window = self._velocity.in_window()
        for joint, value in enumerate(window[-1] if window else ()):
            moved = max(abs(value - item[joint]) for item in window)
            if moved >= stopped_velocity * VELOCITY_WINDOW_S:
                return f'{bounds.names[joint]} just now by {moved:.3g} {bounds.units[joint]}'
        return None

    def _step(self, now: float, passed: float | None) -> None:
        """Update the clock. `passed`: time since the previous message by its time stamp, s."""
        if self._received and now - self._received > (1 + LATE_SLOTS) * self._clock.period:
            if self._calm >= CALM_MESSAGES:
                self._calm_until = self._received
            self._calm = 0
        else:
            self._calm += 1
        self._received = now
        gap = self._clock.gap
        shift = self._clock.step(now, passed)
        if shift and gap is not None and self._velocity.shift(gap, shift):
            self._measured += shift

    def _passed(self, time_stamp: float | None, longest: float) -> float | None:
        """Return the time since the previous stamp, s. None if implausible or above `longest`."""
        before, self._time_stamp = self._time_stamp, time_stamp
        if time_stamp is None or before is None:
            return None
        if abs(time_stamp) * 2.0**-23 > MAX_TIME_RESOLUTION_S:
            return None
        passed = time_stamp - before
        return passed if self._clock.period / 10 <= passed <= longest else None

    def _possible(self, data: tuple[float, ...], longest: float) -> Values:
        """Return `data` as positions in the ROS convention. Raises ValueError if implausible."""
        positions = _finite('position', data[: self._joints])
        if not self._mapping.identity:
            positions = self._mapping.positions_to_ros(np.array(positions)).tolist()
        why = self._bounds.why_not_there(positions)
        if why is None and self._before is not None:
            why = self._bounds.why_not_from(self._before, positions, longest)
        if why is not None:
            raise ValueError(why)
        return positions

    def _possible_velocities(self, data: tuple[float, ...]) -> Values:
        velocities = _finite('velocity', data[: self._joints])
        if not self._mapping.identity:
            velocities = self._mapping.velocities_to_ros(np.array(velocities)).tolist()
        if (why := self._bounds.why_not_so_fast(velocities)) is not None:
            raise ValueError(why)
        return velocities


def _finite(quantity: str, data: tuple[float, ...]) -> Values:
    if not math.isfinite(sum(data)):
        for joint, value in enumerate(data, 1):
            if not math.isfinite(value):
                raise ValueError(f'joint {joint}: {quantity} {value} is not finite')
    return data
