# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver without ROS: links, robot state, arm gate, goals and setpoint streams.

All of this code runs in the thread of one event loop. The driver's owner, for example the ROS
node, calls it with `call_soon_threadsafe`, and is notified through `DriverEvents`.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Protocol

from epson_driver.driver.channel import make_channel
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.delivery.real_time import RealTimeDelivery
from epson_driver.driver.delivery.statements import StatementDelivery
from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.inhibit import Cause, Inhibit, Purpose, second_driver, seen_inhibit
from epson_driver.driver.outcome import Outcome
from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.driver.stopping.arm_gate import DISABLED, ArmGate
from epson_driver.driver.stopping.heartbeat import Heartbeat
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.driver.tasks import Notification, run_task_group
from epson_driver.driver.why_not import STATUS_TIMEOUT_S, InhibitTable
from epson_driver.link import Link, LinkState
from epson_driver.link.connection import ReceiveTimeout, wait_for_silence
from epson_driver.link.link import DIALECT_MESSAGES
from epson_driver.link.link_reports import LinkReports
from epson_driver.log_lines import LogThrottle
from epson_driver.processes.worker import until_done
from epson_driver.simple_message import (
    CommType,
    JointFeedback,
    JointPosition,
    MessageType,
    Packet,
    ReplyCode,
    Status,
    TriState,
    ValidFields,
)
from epson_driver.trace import Trace
from epson_driver.trace.trace import END_TIMEOUT_S

SHUT_DOWN_TIMEOUT_S = 0.5  # maximum time for stopping the arm before the driver ends, s

MAX_MIXED_POSITIONS = 2
"""Maximum number of JOINT_POSITION messages that are ignored between two JOINT_FEEDBACK messages.
A controller that sends both types repeats the same positions. Further messages are used."""

WORST_FIRST = (
    LinkState.DISCONNECTED,
    LinkState.BACKING_OFF,
    LinkState.CONNECTING,
    LinkState.CONNECTED,
)
"""Link states, the worst state first. The combined state of all links is their worst state."""

SetsLoad = StatementDelivery | RealTimeDelivery

_log = logging.getLogger(__name__)


class DriverEvents(Protocol):
    def on_joints(self, sample: JointSample) -> None:
        """Called with each new joint state."""

    def on_status(self, status: Status) -> None:
        """Called with each new status. If no STATUS arrives, the status is unknown."""

    def on_link_state(self, name: str, why: str) -> None:
        """Called with each new combined state of the links (`name`) and the reason (`why`)."""


class Driver:
    def __init__(
        self, configuration: Configuration, events: DriverEvents, settings: GoalSettings
    ) -> None:
        self.configuration, self._events = configuration, events
        limits, timeout = configuration.limits, configuration.state_timeout
        self.gate = ArmGate()
        self.changed = changed = Notification()
        """Notified when a status or a reply to STOP has arrived, or a goal or stop has ended."""
        self.second_driver: Callable[[], str] = str
        """Describes other processes with the same ROS names, which receive the same requests."""
        self.second_driver_known = 0.0
        """Loop time at which all such processes are known, s. The arm is not enabled earlier."""
        self.stop_due = False  # STOP must be the first message of the new motion connection
        channel = make_channel(
            configuration,
            self._on_state_packet,
            self._on_motion_packet,
            self._on_link,
            self._before_motion_link,
        )
        self.state_link, self.motion_link = state, motion = channel.state_link, channel.motion_link
        self.links, self.motors, self.io = channel.links, channel.motors, channel.io
        delivery = channel.delivery
        self.statements = delivery if isinstance(delivery, StatementDelivery) else None
        """Sends motions as SPEL+ statements. None if the controller receives points instead."""
        self.set_load = delivery.set_load if isinstance(delivery, SetsLoad) else None
        """Sets the payload for each motion. None if the controller's program sets it."""
        self.trace = Trace(channel.all_links)
        rules, mapping = configuration.state_rules, configuration.joint_mapping
        self.robot = robot = RobotState(
            len(limits.names), configuration.errors, mapping, rules, lambda: state.joints_withheld
        )
        self.heartbeat = Heartbeat(
            motion, state, configuration.client_timeout, self._has_points, self.fault
        )
        beat = self.heartbeat.before_point
        self.stopper = stopper = Stopper(
            delivery, robot, changed, self.motors, self._on_alarm, self._on_rest, beat
        )
        self.why_not = ask = InhibitTable(
            channel, robot, self.gate, stopper, timeout, self._connects_later
        )
        ask.goals = self.goal_queue = goals = GoalQueue(
            configuration, robot, ask, stopper, settings, changed, self._on_broken_off
        )
        ask.servo = self.servo = Servo(limits, robot, ask, stopper, goals, self._on_broken_off)
        self._joints_missing = ReceiveTimeout(max(STATUS_TIMEOUT_S, timeout))
        self._status_missing = ReceiveTimeout(STATUS_TIMEOUT_S)
        self._feedback_leads = False
        self._positions_since_feedback = 0
        self._dropped_throttle = LogThrottle()
        self._pending_log: asyncio.TimerHandle | None = None
        self._condition: Inhibit | None = None
        self._condition_throttle = LogThrottle(burst=6)
        self._reported_state = LinkState.DISCONNECTED
        kind = configuration.configured_as
        self._reports = {link.name: LinkReports(link, kind) for link in self.links}
        self._dialect_known = asyncio.Event()
        if configuration.knows_byte_order:
            self._dialect_known.set()

    async def run(self) -> None:
        """Run the links and all other parts. Stop the arm if a part fails, or on cancellation."""
        try:
            self.goal_queue.make_ready()
            await run_task_group(
                {
                    **{f'the {link.name} link': link.run for link in self.links},
                    'the I/O': self.io.run,
                    'following setpoints': self.servo.run,
                    'watching the status': self._watch_status,
                    'watching the joints': self._watch_joints,
                    'the heartbeat': self.heartbeat.run,
                },
                self.shut_down,
            )
        finally:
            self.fault('the driver ended')
            await until_done(asyncio.create_task(self._close()))
            self.trace.end('the driver ended', END_TIMEOUT_S)

    async def _close(self) -> None:
        try:
            await self.stopper.close()
            await self.motors.close()
        finally:
            await self.goal_queue.close()

    async def shut_down(self) -> None:
        """Stop the arm within SHUT_DOWN_TIMEOUT_S, or else switch the motors off."""
        self.gate.close('the driver is shutting down')
        deadline = self._now() + SHUT_DOWN_TIMEOUT_S
        try:
            await self.goal_queue.stop('the driver was shut down', SHUT_DOWN_TIMEOUT_S)
        finally:
            self.fault('the driver was shut down')
        if not await self.stopper.wait(max(deadline - self._now(), 0.0)):
            _log.error('the driver ends: %s, %s', self.stopper.doubt, self.stopper.arm_state)
            await self.stopper.motors_off(SHUT_DOWN_TIMEOUT_S)

    def fault(self, why: str, *, motors_off: bool = False) -> None:
        """Close the arm gate and end all goals and streams. `motors_off`: see ArmGate.close."""
        self.disable(why, motors_off=motors_off)
        self.goal_queue.fault(why)

    @property
    def busy(self) -> bool:
        return self.goal_queue.busy or self.servo.active

    @property
    def link_state(self) -> LinkState:
        return min((link.state for link in self.links), key=WORST_FIRST.index)

    def check_second_driver(self) -> None:
        """Disable the arm if another process with the same ROS names exists."""
        names, before = self.second_driver(), self.why_not.second
        inhibit = self.why_not.second = second_driver(names) if names else None
        if inhibit is not None:
            self.fault(inhibit.text)
        if inhibit != before:
            _log.warning('%s', 'the second driver has ended' if inhibit is None else inhibit.text)

    def _has_points(self) -> bool:
        return self.stopper.ours

    def _on_rest(self) -> None:
        self.goal_queue.on_rest()

    def _on_broken_off(self, outcome: Outcome, unanswered: bool) -> None:
        self.disable(outcome.text, unexplained=outcome.unexplained)
        if unanswered:  # a late reply must not be mistaken for the reply to a newer request
            self.motion_link.reconnect('a reply is missing')

    def _on_alarm(self, why: str, unanswered: bool) -> None:
        _log.error('the arm did not stop as requested: %s, %s', why, self.stopper.arm_state)
        self.disable(why)
        self.goal_queue.end_waiting(why)
        if unanswered and not self.goal_queue.busy:  # a running goal reconnects when it breaks off
            self.motion_link.reconnect('no reply to STOP')

    def disable(self, why: str, *, motors_off: bool = False, unexplained: bool = False) -> None:
        """Close the arm gate, and end the stream and the goals that are being planned.

        The running goal continues. `unexplained`: the log entry waits for the status that contains
        the cause.
        """
        was_open = self.gate.close(why, motors_off=motors_off, unexplained=unexplained)
        if was_open and unexplained:
            timeout = self.goal_queue.settings.cause_timeout
            loop = asyncio.get_running_loop()
            self._pending_log = loop.call_later(timeout, self._log_disabled)
        elif was_open or self._pending_log is not None:
            self._log_disabled()
        self.goal_queue.plans.end(f'{why}, while the motion was planned')
        if was_open or self.servo.active:
            self.servo.stop(why)

    def _log_disabled(self) -> None:
        if self._pending_log is not None:
            self._pending_log.cancel()
            self._pending_log = None
        if self.gate.reason is not None:
            _log.warning('arm disabled: %s', self.gate.reason)

    def _on_state_packet(self, packet: Packet) -> None:
        if packet.comm_type is not CommType.TOPIC:  # an unexpected reply (REP-I0006)
            return
        # Use one arrival time for the whole batch: decoding it may be delayed.
        arrival = self.state_link.last_received
        message = packet.message
        if isinstance(message, DIALECT_MESSAGES):
            self._dialect_known.set()
            self.motion_link.follow(self.state_link.dialect)
            self._stop_first()
            self.io.follow(self.state_link.dialect)
            self.heartbeat.request_version()
        if isinstance(message, Status):
            self._handle_status(message, arrival)
        elif isinstance(message, JointPosition):
            self._positions_since_feedback += 1
            self._feedback_leads &= self._positions_since_feedback <= MAX_MIXED_POSITIONS
            if not self._feedback_leads:
                self._handle_joints(message.joints, arrival)
        elif isinstance(message, JointFeedback) and message.valid_fields & ValidFields.POSITION:
            self._feedback_leads = self._positions_since_feedback <= MAX_MIXED_POSITIONS
            self._positions_since_feedback = 0
            valid = message.valid_fields
            self._handle_joints(
                message.positions,
                arrival,
                message.velocities if valid & ValidFields.VELOCITY else None,
                message.time if valid & ValidFields.TIME else None,
            )

    def _handle_joints(
        self,
        positions: tuple[float, ...],
        arrival: float,
        velocities: tuple[float, ...] | None = None,
        time_stamp: float | None = None,
    ) -> None:
        """Process a joint state. If it is implausible, drop it and disable the arm."""
        now = self._now()
        try:
            sample = self.robot.on_joints(positions, arrival, velocities, time_stamp)
        except ValueError as error:
            self.state_link.statistics.bad_frames['joints'] += 1
            line = self._dropped_throttle.line(str(error), now)
            if line is not None:
                _log.warning('joint state dropped: %s', line)
            self.fault(f'implausible joint state: {error}')
            return
        self._joints_missing.restart(now)
        if (joint := self.robot.moved_beyond_model(positions)) is not None:
            _log.warning(
                'joint %d of the controller moves, but the model (%s) lacks it: it is neither '
                'published nor checked',
                joint,
                self.configuration.configured_as,
            )
        if sample is None:
            return
        self._events.on_joints(sample)
        self.stopper.update(now)
        self.goal_queue.on_joints(sample, now)
        self.servo.on_joints(sample, now)

    def _handle_status(self, status: Status, arrival: float) -> None:
        now, before = self._now(), self.robot.status
        self.robot.on_status(status, arrival)
        self._status_missing.restart(now)
        if self.robot.joints_unavailable:
            self._joints_missing.restart(now)
        if status.drives_powered == TriState.TRUE:
            self.gate.see_motors_on()
        self.stopper.update(now)
        quiet = self.gate.reason is not None and self._pending_log is None  # `fault` logs nothing
        inhibit = self.why_not(Purpose.RUN, now)
        if inhibit is not None and inhibit.cause is not Cause.PAUSED:
            self.disable(inhibit.reason, motors_off=inhibit.cause is Cause.MOTORS_OFF)
            self.goal_queue.fault(inhibit.text)
        else:
            self.goal_queue.on_status(now)
        self._log_condition(status, before, now, quiet=quiet)
        self._events.on_status(status)
        self.changed.notify_all()

    def _log_condition(
        self, status: Status, before: Status | None, now: float, *, quiet: bool
    ) -> None:
        """Log a condition that prevents enabling the arm, and the end of the condition.

        `quiet`: the arm was already disabled, so no other log line has reported the condition.
        """
        result, known = seen_inhibit(status, self.robot.errors), self._condition
        if result is not None and result.cause is Cause.NOT_POSSIBLE and known is None:
            opened = before is not None and before.motion_possible == TriState.TRUE
            result = result if opened else None  # otherwise main has not started yet
        off = result is not None and result.cause is Cause.MOTORS_OFF
        self._condition = None if off else result
        if self._condition is None and known is not None:
            level, text = logging.INFO, f'cleared: {known.text}'
        elif (
            result is not None
            and quiet
            and (
                self._went_off(before) if off else known is None or known.cause is not result.cause
            )
        ):
            level, text = logging.WARNING, result.text
        else:
            return
        if (line := self._condition_throttle.line(text, now)) is not None:
            _log.log(level, '%s', line)

    def _went_off(self, before: Status | None) -> bool:
        """Return whether motors that were on in status `before` went off without a command."""
        powered = before is not None and before.drives_powered == TriState.TRUE
        return powered and not self.motors.busy and self.gate.reason != DISABLED

    def _on_motion_packet(self, packet: Packet) -> None:
        """Process an unexpected FAILURE: a withdrawn point, or a heartbeat timeout."""
        if packet.reply_code is not ReplyCode.FAILURE:
            return
        timeout = self.configuration.client_timeout
        if packet.msg_type == MessageType.PING and timeout:
            if self.heartbeat.check_stall(stopped=True) is None:
                self.fault(
                    'the controller stopped the arm because it received nothing from this driver '
                    f'for {timeout:g} s: the driver or the network was delayed'
                )
        else:
            self.goal_queue.withdraw()
            self.servo.withdraw()

    def _on_link(self, name: str, state: LinkState, why: str) -> None:
        """Handle a new state of a link. `name`: state, motion, or remote (one link for both)."""
        if name != 'motion' and state is not LinkState.CONNECTED:
            self.robot.clear()
            self.heartbeat.reset()
            if not self.configuration.knows_byte_order:
                self._dialect_known.clear()
            self._feedback_leads = False
            self._positions_since_feedback = 0
        if name != 'state' and state is LinkState.CONNECTED:
            self.stop_due = self.stopper.may_resume
            self._stop_first()
        elif name != 'state':
            self.stopper.link_lost()
        self._report_link(self.state_link if name == 'state' else self.motion_link, why)

    async def _before_motion_link(self) -> None:
        """Wait until the byte order is known, if STOP must be sent first on the motion link."""
        if self._connects_later():
            await self._dialect_known.wait()

    def _connects_later(self) -> bool:
        return self.stopper.delivery.keeps_points and not self._dialect_known.is_set()

    def _stop_first(self) -> None:
        """Send STOP on a new motion connection if it is due and the byte order is known.

        If the byte order is unknown, STOP waits for the first joint state, which shows it. Goals
        need a joint state, so they wait, too. If a later joint state shows another byte order, the
        connection is reopened (Link.follow).
        """
        if not self._dialect_known.is_set():
            return
        if self.stop_due:
            self.stop_due = False
            self.stopper.stop()

    def _report_link(self, link: Link, why: str) -> None:
        """Log a link's new state, and notify the owner. If the link was lost, end all motion."""
        if link.state is LinkState.BACKING_OFF and link.statistics.connections:
            self.fault(f'the {link.name} link was lost: {why}')
        self._reports[link.name].log_state(why)
        combined = self.link_state
        if combined is not self._reported_state:
            self._reported_state = combined
            self._events.on_link_state(combined.value, why)
            if not self.state_link.connected:
                self._events.on_status(Status())

    async def _watch_status(self) -> None:
        """Discard a stale status. Report an unknown status each second until a new one arrives."""
        while True:
            await wait_for_silence(self._status_missing)
            if self.robot.status is not None:
                self.robot.status = None
                self.fault(f'no STATUS for {STATUS_TIMEOUT_S:g} s')
            self._events.on_status(Status())

    async def _watch_joints(self) -> None:
        while True:
            await wait_for_silence(self._joints_missing)
            if self.robot.sample is not None:
                self.robot.sample = None
                self.fault(f'no joint state for {self._joints_missing.timeout:g} s')

    @staticmethod
    def _now() -> float:
        return asyncio.get_running_loop().time()
