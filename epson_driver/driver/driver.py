# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver without ROS: links, robot state, arm gate and the running goal, in one event loop.

Everything here runs in the loop's thread. The ROS node calls in with `call_soon_threadsafe` and is
told what happened through `DriverEvents`.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Protocol

from epson_driver.driver.channel import make_channel
from epson_driver.driver.configuration import Configuration
from epson_driver.driver.goal.goal import GoalSettings
from epson_driver.driver.goal.goal_queue import GoalQueue
from epson_driver.driver.inhibit import Cause, Inhibit, Purpose, second_driver
from epson_driver.driver.outcome import Outcome
from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.state.robot_state import JointSample, RobotState
from epson_driver.driver.stopping.arm_gate import ArmGate
from epson_driver.driver.stopping.heartbeat import Heartbeat
from epson_driver.driver.stopping.stopper import Stopper
from epson_driver.driver.tasks import Notification, run_task_group
from epson_driver.driver.why_not import STATUS_TIMEOUT_S, WhyNot
from epson_driver.link import Link, LinkState
from epson_driver.link.link import DIALECT_MESSAGES
from epson_driver.link.link_reports import LinkReports
from epson_driver.link.receive_timeout import ReceiveTimeout, silent
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

SHUT_DOWN_TIMEOUT_S = 0.5
"""How long the arm may take to stop before the process ends all the same, s."""

MAX_MIXED_POSITIONS = 2
"""At most this many JOINT_POSITIONs come between two JOINT_FEEDBACKs of a controller that sends
both at once; they say the same then. With more, they are what tells where the arm is."""

WORST_FIRST = (
    LinkState.DISCONNECTED,
    LinkState.BACKING_OFF,
    LinkState.CONNECTING,
    LinkState.CONNECTED,
)
"""The state of the links together is the worse of the two."""

_log = logging.getLogger(__name__)


class DriverEvents(Protocol):
    """Callbacks to the driver's owner, in the loop's thread."""

    def on_joints(self, sample: JointSample) -> None:
        """A state message with joints came: one call for each."""

    def on_status(self, status: Status) -> None:
        """A status came, which is all unknown once none can be had any more."""

    def on_link_state(self, name: str, why: str) -> None:
        """The state of the links together changed."""


class Driver:
    """Drives one controller while `run` runs."""

    def __init__(
        self, configuration: Configuration, events: DriverEvents, settings: GoalSettings
    ) -> None:
        self.configuration = configuration
        limits, timeout = configuration.limits, configuration.state_timeout
        self.gate = ArmGate()
        self.changed = changed = Notification()
        """Notified when a status came, a goal or a stop ended, or STOP was answered."""
        self.namesakes: Callable[[], str] = str
        """Returns the other processes that take this driver's requests as a clause, or ''."""
        self.namesakes_known = 0.0
        """Until then, in the loop's time, some may not be found yet: no enable."""
        self.stop_due = False
        """STOP waits for the byte order, on a motion connection that needs it first."""
        channel = make_channel(
            configuration,
            self._on_state_packet,
            self._on_motion_packet,
            self._on_link,
            self._before_motion_link,
        )
        self.state_link, self.motion_link = state, motion = channel.state_link, channel.motion_link
        self.links, self.motors, self.io = channel.links, channel.motors, channel.io
        self.moves = channel.moves
        self.trace = Trace(channel.all_links)
        rules, mapping = configuration.state_rules, configuration.joint_mapping
        self.robot = robot = RobotState(
            len(limits.names), configuration.errors, mapping, rules, channel.joints_withheld
        )
        self.heartbeat = Heartbeat(
            motion, state, configuration.client_timeout, self._has_points, self.fault
        )
        beat = self.heartbeat.before_point
        self.stopper = stopper = Stopper(
            channel.delivery, robot, changed, self.motors, self._on_alarm, self._on_rest, beat
        )
        ask, end = self.why_not, self._on_broken_off
        self.goal_queue = goals = GoalQueue(
            configuration, robot, ask, stopper, settings, changed, end
        )
        self.servo = Servo(limits, robot, ask, stopper, goals, end)
        self._why_not = WhyNot(
            channel, robot, self.gate, stopper, goals, self.servo, timeout, self._connects_later
        )
        self._joints_missing = ReceiveTimeout(max(STATUS_TIMEOUT_S, timeout))
        self._status_missing = ReceiveTimeout(STATUS_TIMEOUT_S)
        self._events = events
        self._feedback_leads = False
        self._positions_since_feedback = 0
        self._dropped_throttle = LogThrottle()
        self._unsaid: asyncio.TimerHandle | None = None
        self._link_state = LinkState.DISCONNECTED
        self._dialect_known = asyncio.Event()
        if configuration.knows_byte_order:
            self._dialect_known.set()
        kind = configuration.configured_as
        self._reports = {link.name: LinkReports(link, kind) for link in self.links}

    async def run(self) -> None:
        """Keep the links alive until cancelled. On the way out the arm is stopped.

        Raises what a part of it raised, after the arm was stopped over the links that are left.
        """
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
        """Stop the arm and end the running goal when it stands, or after half a second.

        An arm that moves on then has its motors switched off, where there is a way to.
        """
        self.gate.close('the driver is shutting down')
        ends = self._now() + SHUT_DOWN_TIMEOUT_S
        try:
            await self.goal_queue.stop('the driver was shut down', SHUT_DOWN_TIMEOUT_S)
        finally:
            self.fault('the driver was shut down')
        if not await self.stopper.wait(max(ends - self._now(), 0.0)):
            _log.error('the driver ends; %s, %s', self.stopper.doubt, self.stopper.stands)
            await self.stopper.motors_off(SHUT_DOWN_TIMEOUT_S)

    def fault(self, why: str, *, motors_off: bool = False) -> None:
        """Close the arm gate and end every goal and stream.

        `motors_off`: only that the motors are off is wrong.
        """
        self.disable(why, motors_off=motors_off)
        self.goal_queue.fault(why)

    @property
    def busy(self) -> bool:
        """True while a goal runs or a stream of setpoints is followed."""
        return self.goal_queue.busy or self.servo.active

    def why_not(self, purpose: Purpose, now: float) -> Inhibit | None:
        """Return what forbids a purpose at `now`, s: the first fact to deal with, or None."""
        return self._why_not(purpose, now)

    def look_for_namesakes(self) -> None:
        """Stop and disable the arm while another process takes this driver's requests, too."""
        who, before = self.namesakes(), self._why_not.second
        found = self._why_not.second = second_driver(who) if who else None
        if found is not None:
            self.fault(found.text)
        if found != before:
            _log.warning('%s', 'no second driver any more' if found is None else found.text)

    def _has_points(self) -> bool:
        return self.stopper.ours

    def _on_rest(self) -> None:
        self.goal_queue.on_rest()

    def _on_broken_off(self, outcome: Outcome, unanswered: bool) -> None:
        self.disable(outcome.text, unexplained=outcome.unexplained)
        if unanswered:  # what comes late now must not be taken for the answer to something newer
            self.motion_link.reconnect('a reply is missing')

    def _on_alarm(self, why: str, unanswered: bool) -> None:
        """Disable the arm, as STOP does not work."""
        _log.error('the arm was not stopped as asked: %s; %s', why, self.stopper.stands)
        self.disable(why)
        self.goal_queue.end_waiting(why)
        if unanswered and not self.goal_queue.busy:  # a goal that runs does so when it breaks off
            self.motion_link.reconnect('no reply to STOP')

    def disable(self, why: str, *, motors_off: bool = False, unexplained: bool = False) -> None:
        """Close the arm gate without ending a goal. `motors_off` is as in `fault`.

        A stream of setpoints ends. `unexplained`: the controller has not said why so far; the log
        waits for the status that does.
        """
        was_open = self.gate.close(why, motors_off=motors_off, unexplained=unexplained)
        if was_open and unexplained:
            patience = self.goal_queue.settings.cause_timeout
            self._unsaid = asyncio.get_running_loop().call_later(patience, self._say_disabled)
        elif was_open or self._unsaid is not None:
            self._say_disabled()
        self.goal_queue.plans.end(f'{why}, while the motion was planned')
        if was_open or self.servo.active:
            self.servo.stop(why)

    def _say_disabled(self) -> None:
        if self._unsaid is not None:
            self._unsaid.cancel()
            self._unsaid = None
        if self.gate.reason is not None:
            _log.warning('arm disabled: %s', self.gate.reason)

    def _on_state_packet(self, packet: Packet) -> None:
        if packet.comm_type is not CommType.TOPIC:  # nobody waits for it (REP-I0006)
            return
        # What was read at once came at once: this process may be held up while it goes through it.
        came = self.state_link.last_received
        message = packet.message
        if isinstance(message, DIALECT_MESSAGES):
            self._dialect_known.set()
            self.motion_link.follow(self.state_link.dialect)
            self._stop_first()
            self.io.follow(self.state_link.dialect)
            self.heartbeat.ask()
        if isinstance(message, Status):
            self._take_status(message, came)
        elif isinstance(message, JointPosition):
            self._positions_since_feedback += 1
            self._feedback_leads &= self._positions_since_feedback <= MAX_MIXED_POSITIONS
            if not self._feedback_leads:
                self._take_joints(message.joints, came)
        elif isinstance(message, JointFeedback) and message.valid_fields & ValidFields.POSITION:
            self._feedback_leads = self._positions_since_feedback <= MAX_MIXED_POSITIONS
            self._positions_since_feedback = 0
            given = message.valid_fields
            self._take_joints(
                message.positions,
                came,
                message.velocities if given & ValidFields.VELOCITY else None,
                message.time if given & ValidFields.TIME else None,
            )

    def _take_joints(
        self,
        positions: tuple[float, ...],
        came: float,
        velocities: tuple[float, ...] | None = None,
        told: float | None = None,
    ) -> None:
        """Process a joint state, or drop an implausible one and disable the arm."""
        now = self._now()
        try:
            sample = self.robot.on_joints(positions, came, velocities, told)
        except ValueError as error:
            self.state_link.statistics.bad_frames['joints'] += 1
            line = self._dropped_throttle.line(str(error), now)
            if line is not None:
                _log.warning('joint state dropped: %s', line)
            self.fault(f'the joint state cannot be true: {error}')
            return
        self._joints_missing.heard(now)
        if sample is None:
            return
        self._events.on_joints(sample)
        self.stopper.see(now)
        self.goal_queue.on_joints(sample, now)
        self.servo.on_joints(sample, now)

    def _take_status(self, status: Status, came: float) -> None:
        now = self._now()
        self.robot.on_status(status, came)
        self._status_missing.heard(now)
        if self.state_link.joints_withheld:
            self._joints_missing.heard(now)
        if status.drives_powered == TriState.TRUE:
            self.gate.see_motors_on()
        self.stopper.see(now)
        found = self.why_not(Purpose.RUN, now)
        if found is not None and found.cause is not Cause.PAUSED:
            self.fault(found.text, motors_off=found.cause is Cause.MOTORS_OFF)
        else:
            self.goal_queue.on_status(now)
        self._events.on_status(status)
        self.changed.notify_all()

    def _on_motion_packet(self, packet: Packet) -> None:
        """Process an unexpected reply: a late FAILURE withdraws the acknowledged point."""
        if packet.reply_code is not ReplyCode.FAILURE:
            return
        timeout = self.configuration.client_timeout
        if packet.msg_type == MessageType.PING and timeout:
            if self.heartbeat.look(stopped=True) is None:
                self.fault(
                    'the controller stopped the arm, as it heard nothing from this driver for '
                    f'{timeout:g} s: the driver or the network was held up'
                )
        else:
            self.goal_queue.withdraw()
            self.servo.withdraw()

    def _on_link(self, name: str, state: LinkState, why: str) -> None:
        """Process that a link has come or gone: of state, of motion, or the one that is both."""
        if name != 'motion' and state is not LinkState.CONNECTED:
            self.robot.clear()
            self.heartbeat.forget()
            if not self.configuration.knows_byte_order:
                self._dialect_known.clear()
            self._feedback_leads = False
            self._positions_since_feedback = 0
        if name != 'state' and state is LinkState.CONNECTED:
            self.stop_due = self.stopper.goes_on
            self._stop_first()
        elif name != 'state':
            self.stopper.link_lost()
        self._tell_link(self.state_link if name == 'state' else self.motion_link, why)

    async def _before_motion_link(self) -> None:
        """Wait until STOP can leave at once, if the arm may go on as soon as a client connects."""
        if self._connects_later():
            await self._dialect_known.wait()

    def _connects_later(self) -> bool:
        return self.stopper.delivery.keeps_points and not self._dialect_known.is_set()

    def _stop_first(self) -> None:
        """Send STOP on a new motion connection, before anything else, if the arm may go on.

        Before the byte order is known, what a message says is not: STOP waits for the first joints
        then, which show it. So does all else, as nothing is sent to a controller without a state.
        If the joints show another one later, the connection is opened again (Link.follow).
        """
        if not self._dialect_known.is_set():
            return
        if self.stop_due:
            self.stop_due = False
            self.stopper.stop()

    def _tell_link(self, link: Link, why: str) -> None:
        """End all motion if a link was lost, and tell people and the owner."""
        if link.state is LinkState.BACKING_OFF and link.statistics.connections:
            self.fault(f'the {link.name} link was lost: {why}')
        self._reports[link.name].tell(why)
        combined = min((each.state for each in self.links), key=WORST_FIRST.index)
        if combined is not self._link_state:
            self._link_state = combined
            self._events.on_link_state(combined.value, why)
            if not self.state_link.connected:
                self._events.on_status(Status())

    async def _watch_status(self) -> None:
        """Drop a status that is too old, and report it once a second while there is none."""
        while True:
            await silent(self._status_missing)
            if self.robot.status is not None:
                self.robot.status = None
                self.fault(f'no STATUS for {STATUS_TIMEOUT_S:g} s')
            self._events.on_status(Status())

    async def _watch_joints(self) -> None:
        """Drop joints that are too old: the link may be up and the STATUS go on without them."""
        while True:
            await silent(self._joints_missing)
            if self.robot.sample is not None:
                self.robot.sample = None
                self.fault(f'no joint state for {self._joints_missing.patience:g} s')

    @staticmethod
    def _now() -> float:
        return asyncio.get_running_loop().time()
