# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller without its sockets and its real time.

What people do (`apply`), what clients send (`connect` and the sessions it opens) and time (`step`)
come in as calls; bytes go out to the functions that were given. The same calls and the same seed
give the same bytes.
"""

import copy
import logging

import numpy as np

from epson_driver.motion import Array
from epson_driver.profiles.profile import ControllerProfile
from epson_driver.robots import RobotModel
from epson_driver.sim_controller.arm.servo import Servo
from epson_driver.sim_controller.arm.streaming import Planner
from epson_driver.sim_controller.arm.timing import Timing
from epson_driver.sim_controller.assembly import new_arm, new_program
from epson_driver.sim_controller.client_connections import ClientConnections
from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.condition.errors import (
    TEXTS,
    ErrorNumber,
    ErrorRegister,
    Rejection,
)
from epson_driver.sim_controller.condition.states import (
    ENDED,
    REGIONS,
    Condition,
    Door,
    EStop,
    Event,
    Fault,
    Mode,
    Motors,
    Power,
    RejectedError,
    Tasks,
    after,
)
from epson_driver.sim_controller.condition.tasks import Task, TaskState
from epson_driver.sim_controller.faults.faults import Faults
from epson_driver.sim_controller.io.io_points import IoPoints
from epson_driver.sim_controller.ports.session import Client, Send, Session
from epson_driver.sim_controller.programs.points import angles_rejection, clipped
from epson_driver.sim_controller.remote.spel_memory import SpelMemory
from epson_driver.sim_controller.remote.spel_settings import DEFAULTS_AFTER, defaults
from epson_driver.sim_controller.state import state_messages
from epson_driver.simple_message import (
    Dialect,
    JointFeedback,
    JointPosition,
    Packet,
    Status,
    encode,
)
from epson_driver.simple_message import Mode as StatusMode

_log = logging.getLogger(__name__)

_NO_PLANNER = Rejection(
    ErrorNumber.PLANNER_FAILED, 'the motion planner starts again: try again in a second'
)

SMALL_PUSH = {'rad': np.radians(1.0), 'm': 0.001}
"""What the servo of a joint pushes back; more is a position error. By the joint's unit."""


class Controller:
    """Everything that one controller is, but for sockets and real time.

    `start` is where the arm stands at first, shape (n,), rad: zeros by default, or the nearest
    within the limits. With a `planner` the arm moves smoothly, without one point to point.
    `timing` counts what came too late. Raises ValueError for a start outside the limits.
    """

    def __init__(
        self,
        model: RobotModel,
        profile: ControllerProfile,
        start: Array | None = None,
        dialect: Dialect | None = None,
        planner: Planner | None = None,
        state_period: float | None = None,
        seed: int = 0,
    ) -> None:
        limits = model.limits
        if start is None:
            start = clipped(np.zeros(len(limits.names)), limits)
        self.model = model
        self.profile = profile
        self.dialect = dialect or Dialect(profile.byte_order)
        self.state_period = profile.state.period if state_period is None else state_period
        self.clock = Clock()
        mode = Mode.AUTO if profile.mode is StatusMode.AUTO else Mode.MANUAL
        self.condition: Condition = Condition(mode=mode)
        self.timing = Timing()
        self._told = Timing()
        self.io = IoPoints(profile.io)
        self.faults = Faults(self.clock, seed, self, len(limits.names))
        self.clients = ClientConnections(self)
        self.spel = SpelMemory()
        self._errors = ErrorRegister()
        self._planner = planner
        servo = profile.servo
        self.servo = Servo(start, model.pulses_per_unit, servo.lag, servo.encoder)
        self._arm = new_arm(self, start, planner)
        self.reply: Send | None = None  # where replies of the motion program go
        self.program = new_program(self, self._arm.executor, self._errors)
        self._error = ErrorNumber.NONE  # of the controller itself, until it is reset
        self._begun = 0  # points that the faults know of
        self._slowing = False  # whether it brakes to go on at low power
        self._set_power()

    # What people and clients do.

    def apply(self, event: Event) -> None:
        """Let something happen to the controller. Raises RejectedError: why, and what to do."""
        before = self.condition
        off = before.motors is Motors.OFF
        if self.in_motion and (event is Event.RESET or (event is Event.MOTORS_ON and off)):
            does = 'brakes' if off else 'moves'
            raise RejectedError(f'the arm still {does}: try again when it stands')
        self.condition = after(before, event)
        if self.condition is not before:
            _log.info('%s: %s', event.value, _difference(before, self.condition))
        if event is Event.RESET:
            self._errors.clear()
            self._error = ErrorNumber.NONE
            self.io.reset()
        elif event is Event.MOTORS_ON:
            self._errors.clear(ErrorNumber.MOTORS_OFF)
        elif event is Event.START:
            self._errors.clear(ErrorNumber.TASK_ABORTED)
            self.clients.start()
        elif event is Event.BOOT:
            self.io.boot()
            self._errors.clear()
            self._error = ErrorNumber.NONE
        if event in DEFAULTS_AFTER:
            defaults(self)
        self._react(before)
        self._set_power()
        self._settle()
        if event in (Event.RESET, Event.BOOT):
            self._look_at_buttons()

    def _look_at_buttons(self) -> None:
        """Let a door that is still open and an E-stop that is still pressed count again."""
        if self.condition.estop is EStop.PRESSED:
            self.apply(Event.ESTOP_PRESS)
        if self.condition.door is Door.OPEN:
            self.apply(Event.DOOR_OPEN)

    def connect(self, port: str, client: Client) -> Session:
        """Serve a client, as `ClientConnections.connect` does."""
        return self.clients.connect(port, client)

    def raise_error(self, number: ErrorNumber, critical: bool = False) -> None:
        """Let the controller itself fail: no power, tasks aborted, until a reset (or a boot)."""
        if self.condition.fault is not Fault.CRITICAL:
            self._error = number
        _log.error('error %d: %s', number, TEXTS[number])
        self.apply(Event.CRITICAL_ERROR if critical else Event.ERROR)

    def reboot(self, seconds: float) -> None:
        """Switch off and on again; it takes `seconds`. Buttons, door and key stay as they are."""
        self.clients.boot(seconds)
        self.apply(Event.BOOT)

    def disturb(self, joint: int, push: float) -> None:
        """Push one joint (index from 0) by some rad or m, as somebody who leans on the arm.

        Without power the arm stays where it is pushed to. With power its servo pushes back; more
        than `SMALL_PUSH` does not get through, but is a position error. Raises RejectedError for a
        push out of the limits or while an arm without power still brakes.
        """
        pushed = self.servo.actual.copy()
        pushed[joint] += push
        limits = self.model.limits
        rejection = angles_rejection(pushed, limits)
        if rejection is not None:
            raise RejectedError(rejection.sentence)
        powered = self.condition.powered
        small = SMALL_PUSH[limits.units[joint]]
        if powered and abs(pushed - self._arm.commanded)[joint] > small:
            self.raise_error(ErrorNumber.SERVO_ERROR)
            return
        if not powered and self.in_motion:
            raise RejectedError('the arm still brakes: try again when it stands')
        self._arm.push(clipped(pushed, limits), powered)
        self._settle()

    def freeze(self, joint: int | None) -> None:
        """Let the encoder of one joint (index from 0) report its last value; None: of none."""
        self.servo.freeze(joint)

    def servo_error(self, joint: int, critical: bool = False) -> None:
        """Let the servo of one joint (index from 0) fail."""
        _log.error('servo error of %s', self.model.joint_names[joint])
        self.raise_error(ErrorNumber.SERVO_ERROR, critical)

    def press_estop(self) -> None:
        """Press the E-stop."""
        self.apply(Event.ESTOP_PRESS)

    def show(self, rejection: Rejection) -> None:
        """Show in STATUS why something was refused."""
        self._errors.enter(rejection)

    def planner_failed(self, reason: str) -> None:
        """Take note that nobody plans: brake and end the trajectory, without a planner's help."""
        self.timing.planner_failures += 1
        self.show(Rejection(ErrorNumber.PLANNER_FAILED, f'the motion planner: {reason}'))
        self.program.restart()

    def task_state(self, task: Task) -> TaskState:
        """Return what a task is doing; one whose port nobody serves any more does not run."""
        return TaskState.NOT_RUNNING if self.clients.dead(task) else task.state(self.condition)

    # Time.

    def step(self, dt: float) -> None:
        """Let `dt` ≥ 0 s pass."""
        self.clock.advance(self.clock.now + dt, self._move)

    @property
    def in_motion(self) -> bool:
        """Whether the arm moves, or is about to."""
        return self._arm.in_motion

    @property
    def moving(self) -> bool:
        """Whether the arm moves or has somewhere to go, be it after a pause."""
        return self._arm.moving

    def _move(self, dt: float) -> None:
        if self.in_motion:
            self._arm.step(dt, self.program.step)
            self._settle()
        while self._begun < self._arm.executor.begun:
            self._begun += 1
            self.faults.point_begun()

    # State.

    @property
    def speed(self) -> float:
        """SPEL+ Speed, a fraction (0, 1] of the joints' speed, for point-to-point motion."""
        return self._arm.executor.speed

    @speed.setter
    def speed(self, value: float) -> None:
        self._arm.executor.speed = value

    @property
    def accel(self) -> float:
        """SPEL+ Accel, a fraction (0, 1] of the acceleration, for point-to-point motion."""
        return self._arm.executor.accel

    @accel.setter
    def accel(self, value: float) -> None:
        self._arm.executor.accel = value

    @property
    def error_number(self) -> ErrorNumber:
        """The error shown in STATUS; through an E-stop, that the motion task is aborted."""
        if self.condition.estopped:
            return ErrorNumber.TASK_ABORTED
        return self._error or self._errors.number

    def joint_position(self) -> JointPosition:
        """Return where the encoders say that the joints are."""
        return state_messages.joint_position(self)

    def joint_feedback(self) -> JointFeedback:
        """Return where the joints are and how fast, with the controller's time."""
        return state_messages.joint_feedback(self)

    def status(self) -> Status:
        """Return what STATUS says now."""
        return state_messages.status(self)

    # What follows from a change of the condition.

    def _react(self, before: Condition) -> None:
        now = self.condition
        if now.tasks in ENDED and before.tasks not in ENDED:
            self.program.restart()
            self.clients.tasks_ended()
        elif now.motors in (Motors.OFF, Motors.BRAKING) and before.motors is not now.motors:
            self.program.abort()
        if now.tasks is before.tasks:
            return
        if before.tasks in ENDED and now.tasks not in ENDED:
            self.clients.tasks_begin()
        if now.tasks is Tasks.RECOVERING:
            self._recover()
        elif now.tasks in (Tasks.PAUSED, Tasks.INTERRUPTED, Tasks.WAIT_RECOVER):
            self.program.pause()
            self._arm.hold()
        else:
            self._arm.executor.resume()
            self.program.resume()

    def _recover(self) -> None:
        """Go back slowly to where the arm was interrupted, if it has power and a way to go on."""
        if self.condition.motors is Motors.ON and self._arm.executor.moving:
            self._arm.go_back()

    def _settle(self) -> None:
        """Draw the conclusions from a standstill, if it is one."""
        if self.in_motion:
            return
        self._tell_timing()
        if self._slowing:
            self._slowing = False
            if not self.condition.paused:
                self._arm.executor.resume()
        if self.condition.tasks is Tasks.RECOVERING:
            self._arm.went_back()
            self.apply(Event.RECOVERED)
            if self._arm.executor.moving:
                self.trajectory_begins()  # it goes on, at its power
            return
        self._arm.rest()
        if self.condition.motors in (Motors.BRAKING, Motors.HOLDING):
            self.apply(Event.STANDSTILL)

    def _set_power(self) -> None:
        """Let the arm keep to its power; one that moves brakes on its path and goes on slowly."""
        arm, low = self._arm.executor, self.condition.power is not Power.HIGH
        goes_on = self.condition.motors is Motors.ON and self.condition.tasks is Tasks.RUNNING
        if low and not arm.low_power and goes_on and not arm.still:
            self._slowing = True
            arm.hold()
        arm.low_power = low

    def trajectory_begins(self) -> None:
        """Take note that a trajectory begins: the program sets its power."""
        if self.profile.motion.power == 'high':
            self.apply(Event.PROGRAM_POWER_HIGH)

    def motion_rejection(self) -> Rejection | None:
        """Return why a point is refused in this condition, or None."""
        rejection = state_messages.motion_rejection(self)
        if rejection is None and self._planner is not None and not self._planner.ready:
            return _NO_PLANNER
        return rejection

    def _tell_timing(self) -> None:
        """Log what came too late in the motion that has ended."""
        sentence = self.timing.since(self._told)
        if sentence:
            _log.warning('in this motion: %s', sentence)
            self._told = copy.copy(self.timing)

    def send_reply(self, packet: Packet) -> None:
        """Send a reply to the motion client, if there is one."""
        if self.reply is not None:
            self.reply(encode(packet, self.dialect))


def _difference(before: Condition, after: Condition) -> str:
    changes = (
        (region, getattr(before, region).value, getattr(after, region).value) for region in REGIONS
    )
    return ', '.join(f'{name} {old} → {new}' for name, old, new in changes if old != new)
