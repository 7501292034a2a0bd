# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The newest state of the controller, its age, and the velocities of the joints."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from epson_driver.driver.state.joint_mapping import JointMapping, unmapped
from epson_driver.driver.state.joint_velocity import VELOCITY_WINDOW_S, JointVelocity, Values
from epson_driver.driver.state.plausibility import DEFAULT_MARGINS, JointBounds, Margins
from epson_driver.driver.state.sender_clock import LATE_SLOTS, QuestionClock, SenderClock
from epson_driver.error_texts import ErrorTexts, load_error_texts
from epson_driver.motion import Array, JointLimits
from epson_driver.simple_message import Status, TriState


class PauseDetector:
    """Detects a pause from STATUS: motion was possible and now is not, without an error.

    A controller that has never reported motion as possible does not report pauses either, and
    never counts as paused.
    """

    def __init__(self) -> None:
        self.interrupted = False
        """Whether the controller denies motion. The arm may still brake."""
        self.paused = False
        """Whether the controller denies motion and the arm is at rest."""
        self.main_ended = False
        """Whether it denies motion and reports a past error: its program has ended."""
        self._was_possible = False

    def see(self, status: Status) -> None:
        """Process the next status."""
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


MAX_ARRIVALS = 2048
"""Maximum number of arrival times stored for diagnostics: two seconds at 1 kHz."""

MAX_POSE_AGE_S = 0.3
MAX_POSE_AGE_SLOTS = 6
"""Maximum age of a pose, in s or in slots of the controller's clock, whichever is longer. An older
pose does not show where the arm is, so no motion may start. Network bursts of 0.2 s are within
this age. The slots are for controllers that send a few times a second."""

CALM_MESSAGES = 10
"""Number of messages after a late one in which joints may have been measured when the late one was
due: a controller's program may be delayed between measuring and sending."""

DISTRUST_TIME_S = 1.0
"""Time after an implausible joint state in which no motion may start, s."""

WITHHELD = 'the controller sends no joints while it moves the arm or cannot move it: '

MAX_TIME_RESOLUTION_S = 0.0004
"""Coarsest resolution of a controller's time stamps, s: 1 % of the velocity window."""


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Measured joints. positions, velocities: shape (n,), rad and rad/s. Times are monotonic, s.

    time: arrival. measured: time of measurement, apart from the network's minimum delay (see
    SenderClock for the accuracy).
    """

    time: float
    positions: Array
    velocities: Array
    measured: float


@dataclass(frozen=True, slots=True)
class StateRules:
    """Expectations of the state: a message every `period` s, and joints within limits.

    Every message occupies a slot of the controller's clock, including each STATUS. The period is
    an initial value, which follows the arrivals. Without `limits` all joint values are accepted. A
    pose older than `timeout` s is stale, even if the controller sends rarely. `asked`: the
    controller reports its state only on request, and not while the arm moves.
    """

    period: float = 0.005
    limits: JointLimits | None = None
    margins: Margins = DEFAULT_MARGINS
    timeout: float = math.inf
    asked: bool = False


NO_RULES = StateRules()


class RobotState:
    """The newest state of `joints` joints and the controller. Times are the event loop's, s.

    It is cleared when the link is lost, so that stale values cannot be mistaken for fresh ones
    (docs/invariants.md, 6).
    `errors`: texts of the controller's error numbers, EPSON's by default. Inputs use the
    controller's joint convention, and `sample` uses the ROS convention, converted by `mapping`.
    `joints_unavailable` returns whether the controller currently reports no joints, for example
    while it moves the arm.

    There is no `sample` until the joints' velocities are known, because a single position does not
    show that the arm is at rest.
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
        """Clear the state because the link is lost."""
        self.sample: JointSample | None = None
        self.status: Status | None = None
        self.status_time = 0.0
        self.status_measured = 0.0
        """Time at which the newest status was created, with the accuracy of `measured`."""
        self.arrivals: deque[float] = deque(maxlen=MAX_ARRIVALS)
        """Arrival times of joints since the link was established, the newest last."""
        self.bounded = 0
        """Number of velocity estimates beyond a joint's capability, which were published as its
        maximum velocity."""
        self._pause = PauseDetector()
        clock = QuestionClock if self._rules.asked else SenderClock
        self._clock: SenderClock | QuestionClock = clock(self._rules.period)
        self._velocity = JointVelocity()
        self._before: Values | None = None
        self._measured = 0.0
        self._received = self._calm_until = 0.0
        self._calm = CALM_MESSAGES
        self._reported: float | None = None
        self._impossible: tuple[float, str] | None = None

    def on_joints(
        self,
        data: tuple[float, ...],
        now: float,
        velocities: tuple[float, ...] | None = None,
        told: float | None = None,
    ) -> JointSample | None:
        """Process the ten joint values of a message, and its measured velocities if any.

        `told`: the controller's time stamp, s, if it has one. Returns None for the first joints of
        a link, which have no velocity yet. Raises ValueError, naming the joint, its value and the
        possible range, if the values are implausible. They are then ignored.
        """
        self._step(now, self._passed(told, now - self._measured + MAX_POSE_AGE_S))
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

    def on_status(self, status: Status, now: float) -> None:
        """Process a STATUS message."""
        self._step(now, None)
        if self.joints_unavailable:  # the arm's motion during this time is unknown
            self._velocity = JointVelocity()
        self.status = status
        self.status_time = now
        self.status_measured = self._clock.measured
        self._pause.see(status)

    def enabled(self) -> None:
        """Forget earlier permissions of the controller because the arm was enabled."""
        self._pause = PauseDetector()
        if self.status is not None:
            self._pause.see(self.status)

    @property
    def paused(self) -> bool:
        """Whether the controller, without an error, denies motion that it allowed before."""
        return self._pause.interrupted

    @property
    def main_ended(self) -> bool:
        """Whether the controller denies motion since enabling, and reports a past error."""
        return self._pause.main_ended

    @property
    def in_motion(self) -> int:
        """Whether the controller reports motion, a `TriState`; UNKNOWN without a status."""
        return TriState.UNKNOWN if self.status is None else self.status.in_motion

    def why_not_ready(self, now: float) -> str | None:
        """Return why the arm's position is unknown, or None if it is known."""
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
        """Whether the controller reports no joints in its current condition."""
        return self._joints_unavailable()

    def stale(self, now: float) -> bool:
        """Return whether joints are available but too old to show where the arm is."""
        usual = max(MAX_POSE_AGE_S, MAX_POSE_AGE_SLOTS * self._clock.period)
        allowed = min(usual, self._rules.timeout)
        if self.sample is None:
            return False
        return self.joints_unavailable or now - self.sample.measured > allowed

    def why_not_standing(self, stopped_velocity: float) -> str | None:
        """Return the evidence that the arm moves, as a clause, or None if it is at rest.

        `stopped_velocity`: velocity below which a joint counts as stopped, rad/s or m/s.
        """
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
        """Advance the controller's clock by a message."""
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

    def _passed(self, told: float | None, longest: float) -> float | None:
        """Return the time between the last two joint messages by the controller, if plausible.

        On the wire the time stamp has seven digits, and its unit is not guaranteed. Slots are
        counted instead if it is too coarse, or longer than the time that has passed here.
        """
        before, self._reported = self._reported, told
        if told is None or before is None or abs(told) * 2.0**-23 > MAX_TIME_RESOLUTION_S:
            return None
        passed = told - before
        return passed if self._clock.period / 10 <= passed <= longest else None

    def _possible(self, data: tuple[float, ...], longest: float) -> Values:
        """Return positions in the ROS convention. Raises ValueError if they are implausible."""
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
        """Return velocities in the ROS convention. Raises ValueError if they are implausible."""
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
