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
    """Reads it from STATUS: motion was possible and now is not, without an error.

    A controller that has never said that motion is possible does not tell, and is never paused.
    """

    def __init__(self) -> None:
        self.interrupted = False
        """Whether the controller denies motion; the arm may still brake."""
        self.paused = False
        """Whether the controller denies motion and the arm stands."""
        self.main_ended = False
        """Whether it denies motion and tells an error that is over: its program has ended."""
        self._was_possible = False

    def see(self, status: Status) -> None:
        """Take the next status."""
        self._was_possible |= status.motion_possible == TriState.TRUE
        denied = (
            self._was_possible
            and status.motion_possible == TriState.FALSE
            and status.in_error != TriState.TRUE
        )
        self.interrupted = denied and not status.error_code
        stands = status.in_motion == TriState.FALSE
        self.paused = self.interrupted and stands
        self.main_ended = denied and stands and not self.interrupted


MAX_ARRIVALS = 2048
"""Arrival times that are kept for diagnostics: two seconds at 1 kHz."""

MAX_POSE_AGE_S = 0.3
MAX_POSE_AGE_SLOTS = 6
"""A pose that is older, in s or in slots of the controller's clock, whichever is longer, says
nothing about where the arm is: nothing may begin there. Bursts of 0.2 s, as networks make them,
are within it; the slots are for controllers that send a few times a second."""

CALM_MESSAGES = 10
"""So many messages after one that came late joints may have been measured when that was due: what
holds up a controller's program may do so between measuring and sending."""

DISTRUST_TIME_S = 1.0
"""How long nothing may begin after something impossible was reported, s."""

WITHHELD = 'the controller tells no joints now, as it moves the arm or cannot move it: '

MAX_TIME_RESOLUTION_S = 0.0004
"""The coarsest time that a controller may tell, s: 1 % of the window of velocities."""


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Measured joints. positions, velocities: shape (n,), rad and rad/s. Times are monotonic, s.

    time: when they came. measured: when they were measured, but for the least delay of the
    network (see SenderClock for how well that is known).
    """

    time: float
    positions: Array
    velocities: Array
    measured: float


@dataclass(frozen=True, slots=True)
class StateRules:
    """Expectations of the state: a message each `period` s, and joints within limits.

    Every message takes a slot of the controller's clock, those with a STATUS, too. The period is
    what to begin with; it follows what comes. Without `limits` joints may be anything. A pose that
    is older than `timeout` s says nothing, however seldom one comes. `asked`: the controller tells
    its state when it is asked, and not while the arm moves.
    """

    period: float = 0.005
    limits: JointLimits | None = None
    margins: Margins = DEFAULT_MARGINS
    timeout: float = math.inf
    asked: bool = False


NO_RULES = StateRules()


class RobotState:
    """The newest joints and status, for `joints` joints. Times are the event loop's, s.

    Emptied when the link is lost: nothing stale can be taken for fresh (docs/invariants.md, 6).
    `errors` says what the controller's error numbers mean; EPSON's, unless it is given.
    What comes in is counted as the controller does, `sample` as ROS does, by `mapping`. `withheld`
    returns whether the controller tells no joints now, as while it moves the arm.

    There is no `sample` until it is known how fast the joints move: of joints that came once
    nobody can say that they stand.
    """

    def __init__(
        self,
        joints: int,
        errors: ErrorTexts | None = None,
        mapping: JointMapping | None = None,
        rules: StateRules = NO_RULES,
        withheld: Callable[[], bool] = lambda: False,
    ) -> None:
        self._joints = joints
        self._mapping = unmapped(joints) if mapping is None else mapping
        self.errors = load_error_texts() if errors is None else errors
        self._rules = rules
        self._withheld = withheld
        self._bounds = JointBounds(joints, rules.limits, rules.margins)
        self.clear()

    def clear(self) -> None:
        """Forget everything: the link is gone."""
        self.sample: JointSample | None = None
        self.status: Status | None = None
        self.status_time = 0.0
        self.status_measured = 0.0
        """When the newest status was made, as `JointSample.measured`."""
        self.arrivals: deque[float] = deque(maxlen=MAX_ARRIVALS)
        """When joints came, the newest last; only since the link was established."""
        self.bounded = 0
        """How often positions and times gave more than a joint can do, and it was published as
        moving as fast as it can."""
        self._pause = PauseDetector()
        clock = QuestionClock if self._rules.asked else SenderClock
        self._clock: SenderClock | QuestionClock = clock(self._rules.period)
        self._velocity = JointVelocity()
        self._before: Values | None = None
        self._measured = 0.0
        self._heard = self._calm_until = 0.0
        self._calm = CALM_MESSAGES
        self._told: float | None = None
        self._impossible: tuple[float, str] | None = None

    def on_joints(
        self,
        data: tuple[float, ...],
        now: float,
        velocities: tuple[float, ...] | None = None,
        told: float | None = None,
    ) -> JointSample | None:
        """Take the ten joint values of a message, and velocities if it measured them.

        `told`: the controller's time of it, s, if it has one. Returns None for the first joints
        of a link: they have no velocity yet. Raises ValueError that names the joint, its value
        and what is possible, if they cannot be true; they count for nothing then.
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
        """Take a STATUS message."""
        self._step(now, None)
        if self.withheld:  # nobody knows how the arm moves meanwhile
            self._velocity = JointVelocity()
        self.status = status
        self.status_time = now
        self.status_measured = self._clock.measured
        self._pause.see(status)

    def enabled(self) -> None:
        """Forget what the controller allowed before, as the arm was enabled."""
        self._pause = PauseDetector()
        if self.status is not None:
            self._pause.see(self.status)

    @property
    def paused(self) -> bool:
        """The controller, without an error, denies motion that it allowed since enabling."""
        return self._pause.interrupted

    @property
    def main_ended(self) -> bool:
        """The controller denies motion since enabling, and tells an error that is over."""
        return self._pause.main_ended

    @property
    def in_motion(self) -> int:
        """`TriState`: does the controller say that the arm moves? UNKNOWN without a status."""
        return TriState.UNKNOWN if self.status is None else self.status.in_motion

    def why_not_ready(self, now: float) -> str | None:
        """Return why the arm's position is not known now, or None."""
        if self._impossible is not None and now - self._impossible[0] < DISTRUST_TIME_S:
            return self._impossible[1]
        if self.sample is None:
            return 'no joint state from the controller'
        if self.stale(now):
            why = WITHHELD if self.withheld else ''
            return f'{why}the newest joint state is {now - self.sample.measured:.3g} s old'
        return None

    @property
    def withheld(self) -> bool:
        """Whether the controller reports no joints in its present condition."""
        return self._withheld()

    def stale(self, now: float) -> bool:
        """Return whether there are joints, but too old ones to say where the arm is."""
        usual = max(MAX_POSE_AGE_S, MAX_POSE_AGE_SLOTS * self._clock.period)
        allowed = min(usual, self._rules.timeout)
        if self.sample is None:
            return False
        return self.withheld or now - self.sample.measured > allowed

    def why_not_standing(self, stopped_velocity: float) -> str | None:
        """Return the evidence that the arm moves, as a clause, or None if it stands.

        `stopped_velocity`: rad/s or m/s, below which a joint counts as standing.
        """
        sample, bounds = self.sample, self._bounds
        if sample is None:
            return 'no joint state from the controller'
        fastest = int(np.argmax(np.abs(sample.velocities)))
        speed = float(sample.velocities[fastest])
        if abs(speed) >= stopped_velocity:
            return f'{bounds.names[fastest]} at {speed:.3g} {bounds.units[fastest]}/s'
        if self.in_motion == TriState.TRUE:
            return 'the controller says so'
        window = self._velocity.in_window()
        for joint, value in enumerate(window[-1] if window else ()):
            moved = max(abs(value - each[joint]) for each in window)
            if moved >= stopped_velocity * VELOCITY_WINDOW_S:
                return f'{bounds.names[joint]} just now by {moved:.3g} {bounds.units[joint]}'
        return None

    def _step(self, now: float, passed: float | None) -> None:
        """Advance the controller's clock by a message."""
        if self._heard and now - self._heard > (1 + LATE_SLOTS) * self._clock.period:
            if self._calm >= CALM_MESSAGES:
                self._calm_until = self._heard
            self._calm = 0
        else:
            self._calm += 1
        self._heard = now
        gap = self._clock.gap
        shift = self._clock.step(now, passed)
        if shift and gap is not None and self._velocity.shift(gap, shift):
            self._measured += shift

    def _passed(self, told: float | None, longest: float) -> float | None:
        """Return the time between the last two joints by the controller's clock, if plausible.

        On the wire it has seven digits, and who knows its unit: too coarse, or too long for the
        time that has passed here, and slots are counted instead.
        """
        before, self._told = self._told, told
        if told is None or before is None or abs(told) * 2.0**-23 > MAX_TIME_RESOLUTION_S:
            return None
        passed = told - before
        return passed if self._clock.period / 10 <= passed <= longest else None

    def _possible(self, data: tuple[float, ...], longest: float) -> Values:
        """Return positions as ROS counts them. Raises ValueError if they cannot be true."""
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
        """Return velocities as ROS counts them. Raises ValueError if they cannot be true."""
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
