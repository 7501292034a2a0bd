# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver without ROS: links, robot state, arm gate and the running goal, in one event loop.

Everything here runs in the loop's thread. The ROS node calls in with `call_soon_threadsafe` and is
told what happened through `Events`.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from epson_driver.client.arm_gate import ArmGate, what_forbids_motion
from epson_driver.client.deliveries import delivery
from epson_driver.client.delivery import DeliveryRules
from epson_driver.client.execution import Execution, Settings, State
from epson_driver.client.goal import End, ErrorCode, Goal, GoalRefusedError, Outcome, check_start
from epson_driver.client.io_driver import IoDriver
from epson_driver.client.joint_mapping import JointMapping, unmapped
from epson_driver.client.robot_state import JointSample, RobotState
from epson_driver.client.smoothing import Smoothing
from epson_driver.client.smoothing_process import SmoothingError, SmoothingProcess
from epson_driver.client.speed_scaling import SpeedScaling
from epson_driver.error_texts import ErrorTexts
from epson_driver.link import Link, LinkState, Trace
from epson_driver.link.trace import END_TIMEOUT
from epson_driver.motion import JointLimits, Trajectory
from epson_driver.simple_message import (
    ByteOrder,
    CommType,
    Dialect,
    JointFeedback,
    JointPosition,
    Packet,
    ReplyCode,
    Status,
    ValidFields,
)

SHUT_DOWN_TIMEOUT = 0.5
"""How long the arm may take to stop before the process ends all the same, s."""

STATUS_TIMEOUT = 1.0
"""A status that is older says nothing any more, s. (The thesis' controller sends one in 55 ms.)"""

AS_IT_CAME = Smoothing()
BY_STREAMING = DeliveryRules()

WORST_FIRST = (
    LinkState.DISCONNECTED,
    LinkState.BACKING_OFF,
    LinkState.CONNECTING,
    LinkState.CONNECTED,
)
"""`~/link_state` is the worse of the two links' states."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Configuration:
    """Where the controller is and what it expects. An io or remote port of 0 is not used.

    `errors` says what its error numbers mean; None: they are EPSON's. `delivery` says how
    trajectories reach it, `mapping` how it counts joints; None: as ROS does. Where the
    byte order is not given, `usual_byte_order` holds until its messages show it.
    """

    host: str
    motion_port: int
    state_port: int
    remote_port: int
    byte_order: ByteOrder | None
    state_timeout: float
    limits: JointLimits
    smoothing: Smoothing = AS_IT_CAME
    errors: ErrorTexts | None = None
    delivery: DeliveryRules = BY_STREAMING
    mapping: JointMapping | None = None
    usual_byte_order: ByteOrder = ByteOrder.LITTLE
    io_port: int = 0
    io_timeout: float = 1.0


class Events(Protocol):
    """What the driver tells its owner, in the loop's thread."""

    def on_joints(self, sample: JointSample) -> None:
        """Joints came. Every state message is one call."""

    def on_status(self, status: Status) -> None:
        """A status came; also an all-unknown one when there is none to be had any more."""

    def on_link_state(self, name: str, why: str) -> None:
        """The state of the links together changed."""


@dataclass(eq=False)
class Ticket:
    """A goal handed in: `on_end` is given its outcome, once; `on_feedback` every sample."""

    goal: Goal
    on_end: Callable[[Outcome], None]
    on_feedback: Callable[[Execution, JointSample], None]
    execution: Execution | None = None
    outcome: Outcome | None = None
    preparation: asyncio.Task[None] | None = None


class Driver:
    """Drives one controller. `run` until cancelled; the other methods are called meanwhile.

    `execution_settings` and `start_tolerance` (rad) may be changed at any time; the former hold
    for the running goal too.
    """

    def __init__(
        self, configuration: Configuration, events: Events, execution_settings: Settings
    ) -> None:
        self.configuration = configuration
        self._execution_settings = execution_settings
        self.start_tolerance = 0.05
        self.gate = ArmGate()
        self.scaling = SpeedScaling()
        joints = len(configuration.limits.names)
        mapping = configuration.mapping or unmapped(joints)
        self.robot = RobotState(joints, configuration.errors, mapping)
        self._events = events
        order = configuration.byte_order
        self.state_link = Link(
            'state',
            configuration.host,
            configuration.state_port,
            on_packet=self._on_state_packet,
            on_state=self._on_state_link,
            receive_timeout=configuration.state_timeout,
            byte_order=order,
        )
        self.motion_link = Link(
            'motion',
            configuration.host,
            configuration.motion_port,
            on_packet=self._on_motion_packet,
            on_state=self._on_motion_link,
            byte_order=order,
        )
        self.io = IoDriver(
            configuration.host,
            configuration.io_port,
            byte_order=order,
            timeout=configuration.io_timeout,
        )
        self.trace = Trace((self.state_link, self.motion_link, self.io.link))
        if order is None:
            for link in (self.state_link, self.motion_link):
                link.dialect = Dialect(configuration.usual_byte_order)
        self.delivery = delivery(
            configuration.delivery, self.motion_link, configuration.limits, mapping
        )
        self._has_feedback = False
        self._link_state = LinkState.DISCONNECTED
        self._ticket: Ticket | None = None
        self._next: Ticket | None = None
        self._missed: set[str] = set()
        self._waiters: list[asyncio.Future[None]] = []
        self._smoother: SmoothingProcess | None = None
        if configuration.smoothing.wanted:
            self._smoother = SmoothingProcess(configuration.limits, configuration.smoothing)
        self._preparations: set[asyncio.Task[None]] = set()

    @property
    def execution_settings(self) -> Settings:
        """Tolerances and patience of executions."""
        return self._execution_settings

    @execution_settings.setter
    def execution_settings(self, settings: Settings) -> None:
        self._execution_settings = settings
        if self._ticket is not None and self._ticket.execution is not None:
            self._ticket.execution.settings = settings

    async def run(self) -> None:
        """Keep the links alive until cancelled. On the way out the arm is stopped."""
        if self._smoother is not None:
            self._smoother.make_ready()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self.state_link.run())
                tasks.create_task(self.motion_link.run())
                tasks.create_task(self.io.run())
                tasks.create_task(self._watch_status())
        finally:
            self.fault('the driver ended')
            await asyncio.gather(*self._preparations, return_exceptions=True)
            if self._smoother is not None:
                await self._smoother.close()
            self.trace.end('the driver ended', END_TIMEOUT)

    async def shut_down(self) -> None:
        """Stop the arm and end the running goal when it stands, or after half a second."""
        self.gate.close('the driver is shutting down')
        await self.stop_running('the driver was shut down', SHUT_DOWN_TIMEOUT)
        self.fault('the driver was shut down')

    def submit(self, ticket: Ticket) -> None:
        """Execute a checked goal; a running one is stopped first and ends as aborted."""
        try:
            self._check_ready()
        except GoalRefusedError as refusal:
            ticket.on_end(refusal.outcome)
            return
        if self._ticket is None:
            self._start(ticket)
            return
        if self._next is not None:
            self.end_waiting('replaced by a newer goal before it could start')
        self._next = ticket
        if self._ticket.execution is not None:
            self._ticket.execution.stop('replaced by a new goal', self._now())

    def cancel(self, ticket: Ticket) -> None:
        """Stop the goal's motion; it ends as canceled when the arm stands."""
        if ticket is self._next:
            self.end_waiting('canceled before it could start', End.CANCELED)
        elif ticket is self._ticket and ticket.execution is not None:
            ticket.execution.cancel(self._now())

    def _check_ready(self) -> JointSample:
        """Return where the arm is. Raises GoalRefusedError unless it may move now."""
        if self.gate.reason is not None:
            raise GoalRefusedError(
                ErrorCode.INVALID_GOAL,
                f'the arm is not enabled ({self.gate.reason}): call ~/enable',
            )
        if self.robot.sample is None:
            raise GoalRefusedError(ErrorCode.INVALID_GOAL, 'no joint state from the controller')
        return self.robot.sample

    def _standing_sample(self) -> JointSample:
        """Return where the arm stands. Raises GoalRefusedError if it may not move or moves now.

        Nothing of ours runs then: what still moves is braking after a fault, or moved by others.
        """
        sample = self._check_ready()
        fastest = int(np.argmax(np.abs(sample.velocities)))
        limits = self.configuration.limits
        if abs(sample.velocities[fastest]) >= self.execution_settings.stopped_velocity:
            raise GoalRefusedError(
                ErrorCode.INVALID_GOAL,
                f'the arm moves ({limits.names[fastest]} at {sample.velocities[fastest]:.3g} '
                f'{limits.units[fastest]}/s): wait until it stands',
            )
        return sample

    def _start(self, ticket: Ticket) -> None:
        trajectory = ticket.goal.trajectory
        try:
            sample = self._sample_at_start(trajectory)
        except GoalRefusedError as refusal:
            ticket.on_end(refusal.outcome)
            return
        self._ticket = ticket
        execution = ticket.execution = Execution(
            ticket.goal,
            self.execution_settings,
            self.delivery.post,
            lambda outcome: self._on_end(ticket, outcome),
            self._now(),
            self.scaling,
        )
        if self._smoother is None:
            self._execute(execution, trajectory, sample)
            return
        ticket.preparation = asyncio.create_task(self._prepare(self._smoother, execution, sample))
        self._preparations.add(ticket.preparation)
        ticket.preparation.add_done_callback(self._preparations.discard)

    def _sample_at_start(self, trajectory: Trajectory) -> JointSample:
        """Return where the arm stands. Raises GoalRefusedError unless it can begin there now."""
        sample = self._standing_sample()
        limits = self.configuration.limits
        check_start(trajectory, sample.positions, limits, self.start_tolerance)
        return sample

    async def _prepare(
        self, smoother: SmoothingProcess, execution: Execution, sample: JointSample
    ) -> None:
        """Have a goal's motion planned, then execute it, unless the goal was stopped meanwhile.

        The arm must stand then where the motion begins, as when the goal came.
        """
        planned: Trajectory | None = None
        refusal: GoalRefusedError | None = None
        try:
            planned = await smoother.prepared(execution.goal.trajectory, sample.positions)
            if execution.state is State.PREPARING:
                sample = self._sample_at_start(planned)
        except SmoothingError as error:
            refusal = GoalRefusedError(ErrorCode.INVALID_GOAL, str(error))
        except GoalRefusedError as error:
            refusal = error
        if execution.state is not State.PREPARING:
            return
        if refusal is not None:
            execution.fault(str(refusal), refusal.code)
        elif planned is not None:
            self._execute(execution, planned, sample)

    def _execute(self, execution: Execution, trajectory: Trajectory, sample: JointSample) -> None:
        try:
            prepared = self.delivery.prepare(trajectory, sample.positions)
        except GoalRefusedError as refusal:
            execution.fault(str(refusal), refusal.code)
            return
        execution.start(
            prepared.trajectory,
            prepared.messages,
            self._now(),
            sample.positions,
            prepared.delay,
        )

    def _on_end(self, ticket: Ticket, outcome: Outcome) -> None:
        self._ticket = None
        ticket.outcome = outcome
        if ticket.execution is not None and ticket.execution.broken_off:
            self._disable(outcome.text)
        if ticket.preparation is not None:
            ticket.preparation.cancel()
        self._wake()
        ticket.on_end(outcome)
        if ticket.execution is not None and not ticket.execution.at_rest:
            self.end_waiting(f'the goal before it did not bring the arm to rest: {outcome.text}')
        if self._next is not None:
            following, self._next = self._next, None
            self._start(following)

    def end_waiting(self, why: str, end: End = End.ABORTED) -> None:
        """End the goal that waits for the running one to stop."""
        ticket, self._next = self._next, None
        if ticket is not None:
            code = ErrorCode.SUCCESSFUL if end is End.CANCELED else ErrorCode.INVALID_GOAL
            ticket.on_end(Outcome(end, code, why))

    def fault(self, why: str) -> None:
        """Close the arm gate and end what runs or waits; the arm stays still until enabled."""
        self._disable(why)
        self.end_waiting(why)
        if self._ticket is not None and self._ticket.execution is not None:
            execution = self._ticket.execution
            execution.fault(f'{why} ({execution.where})')

    def _disable(self, why: str) -> None:
        if self.gate.close(why):
            _log.warning('arm disabled: %s', why)

    @property
    def busy(self) -> bool:
        """True while a goal runs."""
        return self._ticket is not None

    async def stop_running(self, why: str, timeout: float) -> Outcome | None:
        """Stop the running goal, if any. Returns its outcome; None if there is none in time."""
        ticket = self._ticket
        if ticket is None or ticket.execution is None:
            return None
        ticket.execution.stop(why, self._now())
        try:
            async with asyncio.timeout(timeout):
                while ticket.outcome is None:
                    await self.next_change()
        except TimeoutError:
            return None
        return ticket.outcome

    async def next_change(self) -> None:
        """Wait until a status came or a goal ended."""
        waiter = asyncio.get_running_loop().create_future()
        self._waiters.append(waiter)
        await waiter

    def _wake(self) -> None:
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            if not waiter.done():
                waiter.set_result(None)

    def _on_state_packet(self, packet: Packet) -> None:
        if packet.comm_type is not CommType.TOPIC:  # nothing was asked (REP-I0006)
            return
        now = self._now()
        self.motion_link.dialect = self.state_link.dialect
        self.io.follow(self.state_link.dialect)
        message = packet.message
        if isinstance(message, Status):
            self._take_status(message, now)
        elif isinstance(message, JointPosition):
            if not self._has_feedback:  # a controller that sends both says the same twice
                self._take_joints(message.joints, None, now)
        elif isinstance(message, JointFeedback) and message.valid_fields & ValidFields.POSITION:
            measured = message.valid_fields & ValidFields.VELOCITY
            self._has_feedback = True
            self._take_joints(message.positions, message.velocities if measured else None, now)

    def _take_joints(
        self, positions: tuple[float, ...], velocities: tuple[float, ...] | None, now: float
    ) -> None:
        try:
            sample = self.robot.on_joints(positions, now, velocities)
        except ValueError as error:
            self.state_link.statistics.bad_frames['joints'] += 1
            _log.warning('joint state dropped: %s', error)
            return
        self._events.on_joints(sample)
        if self._ticket is not None and self._ticket.execution is not None:
            ticket, execution = self._ticket, self._ticket.execution
            execution.on_state(self.robot, now)
            if not execution.ended:
                ticket.on_feedback(execution, sample)

    def _take_status(self, status: Status, now: float) -> None:
        self.robot.on_status(status, now)
        if (why := what_forbids_motion(status, self.robot.errors)) is not None:
            self.fault(why)
        elif self._ticket is not None and self._ticket.execution is not None:
            execution = self._ticket.execution
            was_paused = execution.paused
            execution.on_state(self.robot, now)
            self._tell_pause(execution, was_paused)
        self._events.on_status(status)
        self._wake()

    @staticmethod
    def _tell_pause(execution: Execution, was_paused: bool) -> None:
        if execution.paused and not was_paused:
            _log.info('the controller is paused: the goal waits %s', execution.where)
        elif was_paused and not execution.paused and not execution.ended:
            _log.info('the controller goes on: so does the goal, %s', execution.where)

    def _on_motion_packet(self, packet: Packet) -> None:
        """Take a topic, or a reply that nobody waits for: a late no is still a no."""
        ticket = self._ticket
        if packet.reply_code is ReplyCode.FAILURE and ticket is not None and ticket.execution:
            ticket.execution.on_unsolicited_failure(self._now())

    def _on_state_link(self, state: LinkState, why: str) -> None:
        if state is not LinkState.CONNECTED:
            self.robot.clear()
            self._has_feedback = False
        self._on_link(self.state_link, why)

    def _on_motion_link(self, _state: LinkState, why: str) -> None:
        self._on_link(self.motion_link, why)

    def _on_link(self, link: Link, why: str) -> None:
        if link.state is LinkState.BACKING_OFF and link.statistics.connections:
            self.fault(f'the {link.name} link was lost: {why}')
        self._tell_link(link, why)
        links = (self.state_link, self.motion_link)
        combined = min((each.state for each in links), key=WORST_FIRST.index)
        if combined is not self._link_state:
            self._link_state = combined
            self._events.on_link_state(combined.value, why)
            if not self.state_link.connected:
                self._events.on_status(Status())

    def _tell_link(self, link: Link, why: str) -> None:
        """Log that a link came or went, once: not every attempt to bring it back."""
        if link.connected:
            self._missed.discard(link.name)
            _log.info('%s link connected: %s', link.name, why)
        elif link.state is LinkState.BACKING_OFF and link.name not in self._missed:
            self._missed.add(link.name)
            _log.warning('no %s link: %s; trying again at least once a second', link.name, why)
        else:
            _log.debug('%s link %s: %s', link.name, link.state.value, why)

    async def _watch_status(self) -> None:
        """Once a second, drop what is too old, and say so while there is no status."""
        while True:
            await asyncio.sleep(STATUS_TIMEOUT)
            now = self._now()
            sample = self.robot.sample
            patience = max(STATUS_TIMEOUT, self.configuration.state_timeout)
            if sample is not None and now - sample.time >= patience:
                self.robot.sample = None
                self.fault(f'no joint state for {patience:g} s')
            if self.robot.status is not None and now - self.robot.status_time < STATUS_TIMEOUT:
                continue
            if self.robot.status is not None:
                self.robot.status = None
                self.fault(f'no STATUS for {STATUS_TIMEOUT:g} s')
            self._events.on_status(Status())

    @staticmethod
    def _now() -> float:
        return asyncio.get_running_loop().time()
