# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The core of the simulated controller: its condition, and how it affects arm and program.

Operator actions (`apply`), client bytes (`connect` and its sessions) and time (`step`) are
function calls. Replies are passed to the clients' `send` functions. The same calls with the same
seed produce the same bytes. `assembly.new_controller` adds arm, program and clients.
"""

import copy
import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np

from epson_driver.motion import Array
from epson_driver.profiles.profile import ControllerProfile
from epson_driver.robots import RobotModel
from epson_driver.sim_controller.arm.simulated_arm import Servo, SimulatedArm
from epson_driver.sim_controller.arm.streaming import DeadlineCounters, Planner
from epson_driver.sim_controller.arm.target_motion import TargetMotion
from epson_driver.sim_controller.clock import Clock
from epson_driver.sim_controller.condition.errors import (
    TEXTS,
    ErrorNumber,
    ErrorRegister,
    Rejection,
    angles_rejection,
    clipped,
    condition_rejection,
)
from epson_driver.sim_controller.condition.spel_settings import DEFAULTS_AFTER, SpelSettings
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
    Tables,
    Tasks,
    after,
)
from epson_driver.sim_controller.condition.tasks import TaskRow, rows
from epson_driver.sim_controller.faults.faults import Faults
from epson_driver.sim_controller.io.io_points import IoPoints
from epson_driver.sim_controller.ports import (
    VERSION,
    WITHOUT_WATCHDOG,
    Client,
    CommandWindow,
    Program,
    Send,
    Session,
)
from epson_driver.simple_message import (
    Dialect,
    GetVersion,
    JointFeedback,
    JointPosition,
    Packet,
    Status,
    TriState,
    ValidFields,
    encode,
    joint_data,
)
from epson_driver.simple_message import Mode as StatusMode

_log = logging.getLogger(__name__)

_NO_PLANNER = Rejection(
    ErrorNumber.PLANNER_FAILED, 'the motion planner is restarting: try again in a second'
)

_BORROWED = Rejection(ErrorNumber.MOTION_ABORTED, 'a command of $Execute moves the arm')

CYCLE_PERIOD_S = 0.004

MAX_PUSH = {'rad': np.radians(1.0), 'm': 0.001}
"""Unit of a joint → the largest push that causes no servo error, rad or m."""


class Clients(Protocol):
    """The clients of all ports, as used by the core. `ClientConnections` implements it."""

    @property
    def boots(self) -> bool: ...

    def connect(self, port: str, client: Client) -> Session: ...

    def hang_up(self, *ports: str) -> None: ...

    def disconnect_after_flush(self, port: str) -> None: ...

    def has_client(self, port: str) -> bool: ...

    def make_room(self, port: str) -> None: ...

    def check_login(self) -> None: ...

    def dismiss_remote(self, why: str) -> None: ...

    def boot(self, seconds: float) -> None: ...


class RealTime(Protocol):
    """Real-time Motion Control, as used by the core. `RtmcPort` implements it."""

    motion: TargetMotion

    @property
    def enabled(self) -> bool:
        """Whether Real-time Motion Control controls the arm."""

    def react(self) -> None:
        """End the motion if the controller's condition now forbids it, and send the new status."""

    def boot(self) -> None:
        """Restart after a power cycle of the controller."""


class Controller:
    """One controller, independent of sockets and real time. Create with `new_controller`.

    * `start`: initial arm position, shape (n,), rad.
    * `planner`: planner of smooth motion (None: only point-to-point motion).
    * `state_period`: time between two messages on the state port, s.
    * `seed`: seed of the random faults.
    """

    arm: SimulatedArm
    program: Program
    clients: Clients
    new_command_window: Callable[['Controller'], CommandWindow]
    """Function that creates an empty SPEL+ program for the statements of $Execute."""

    tables: Tables = REGIONS
    real_time: RealTime | None = None

    def __init__(
        self,
        model: RobotModel,
        profile: ControllerProfile,
        start: Array,
        dialect: Dialect,
        planner: Planner | None,
        state_period: float,
        seed: int,
    ) -> None:
        self.model = model
        self.profile = profile
        self.dialect = dialect
        self.state_period = state_period
        self.clock = Clock()
        mode = Mode.AUTO if profile.mode is StatusMode.AUTO else Mode.MANUAL
        self.condition: Condition = Condition(mode=mode)
        self.timing = DeadlineCounters()
        self._reported = DeadlineCounters()
        self.io = IoPoints(profile.io)
        self.faults = Faults(
            self.clock,
            seed,
            self,
            len(model.joint_names),
            link={'statements': 'remote', 'rtmc': 'rtmc'}.get(profile.program.interface, ''),
        )
        self.spel = SpelSettings(profile.motion.speed, profile.motion.accel)
        self._command_window: CommandWindow | None = None  # created when first used
        self.errors = ErrorRegister()
        self._planner = planner
        servo = profile.servo
        self.servo = Servo(start, model.pulses_per_unit, servo.lag, servo.encoder)
        self.reply: Send | None = None  # sends replies of the motion program
        self._error: int = ErrorNumber.NONE  # error of the controller itself, until a reset
        self._error_text = ''  # message of the program for this error, or empty
        self._reported_points = 0  # number of started points reported to the faults
        self._slowing = False  # whether the arm brakes and then resumes at low power
        self._unattended = False  # whether the arm is paused until the next motion client

    # Actions of operators and clients.

    def apply(self, event: Event) -> None:
        """Apply an event and its effects. Raises RejectedError if it is not allowed now."""
        before = self.condition
        off = before.motors is Motors.OFF
        if self.in_motion and (event is Event.RESET or (event is Event.MOTORS_ON and off)):
            activity = 'braking' if off else 'moving'
            raise RejectedError(f'the arm is still {activity}: try again when it has stopped')
        self.condition = after(before, event, self.tables)
        if self.condition is not before:
            _log.info('%s: %s', event.value, _difference(before, self.condition))
        if event is Event.RESET:
            self.errors.clear()
            self._clear_error()
            self.io.reset()
        elif event is Event.MOTORS_ON:
            self.errors.clear(ErrorNumber.MOTORS_OFF)
        elif event is Event.START:
            self.errors.clear(ErrorNumber.TASK_ABORTED)
        elif event is Event.BOOT:
            self.io.boot()
            self.errors.clear()
            self._clear_error()
            for program in self._programs():
                program.boot()
            if self.real_time is not None:
                self.real_time.boot()
        if event in DEFAULTS_AFTER:
            self.reset_settings()
        self._react(before)
        self.apply_power()
        if self.real_time is not None:
            self.real_time.react()
        self._handle_standstill()
        if event in (Event.RESET, Event.BOOT):
            self._reapply_buttons()

    def _reapply_buttons(self) -> None:
        if self.condition.estop is EStop.PRESSED:
            self.apply(Event.ESTOP_PRESS)
        if self.condition.door is Door.OPEN:
            self.apply(Event.DOOR_OPEN)

    def connect(self, port: str, client: Client) -> Session:
        """Start to serve a client of `port`. Raises ConnectionRefusedError if it is refused."""
        return self.clients.connect(port, client)

    @property
    def command_window(self) -> CommandWindow:
        """The SPEL+ program that executes `$Execute`: `program`, or else an empty one."""
        if self._command_window is None:
            own = self.program
            self._command_window = (
                own if isinstance(own, CommandWindow) else self.new_command_window(self)
            )
        return self._command_window

    def _programs(self) -> Iterable[Program]:
        yield self.program
        if self._command_window is not None and self._command_window is not self.program:
            yield self._command_window

    def client_connected(self) -> None:
        """Abort a command of `$Execute`, because a client of the motion port connected.

        An arm that was waiting for such a client resumes its motion.
        """
        self._end_command('a client of the motion port connected')
        if self.profile.server.lost_client == 'brake':
            self.program.restart()
        if self._unattended:
            self._unattended = False
            if self.condition.tasks is Tasks.RUNNING and not self._slowing:
                self.arm.executor.resume()

    def _end_command(self, why: str) -> None:
        if self._command_window is not None:
            self._command_window.abort_command(f'the command was aborted: {why}')

    def client_lost(self) -> None:
        lost = self.profile.server.lost_client
        if lost == 'brake':
            self.apply(Event.CLIENT_LOST)
            return
        self.program.detach()
        if lost == 'keep':
            self._unattended = True
            self.arm.executor.hold()

    def raise_error(self, number: int, critical: bool = False, text: str = '') -> None:
        """Set an error, which cuts the motor power and aborts the tasks.

        The error lasts until a reset, or until a boot if it is `critical`. `text`: the error
        message of a SPEL+ program, which is already logged (empty: the text of `number` is
        logged).
        """
        if self.condition.fault is not Fault.CRITICAL:
            self._error, self._error_text = number, text
        if not text:
            _log.error('error %d: %s', number, self.error_text(number))
        self.apply(Event.CRITICAL_ERROR if critical else Event.ERROR)

    def _clear_error(self) -> None:
        self._error, self._error_text = ErrorNumber.NONE, ''

    def reboot(self, seconds: float) -> None:
        """Power-cycle the controller. E-stop button, door and key switch keep their positions."""
        self.clients.boot(seconds)
        self.apply(Event.BOOT)

    def disturb(self, joint: int, push: float) -> None:
        """Push one joint (index from 0) by `push` rad or m, like a person leaning on the arm.

        Without power the arm stays where it is pushed. With power the servo pushes back, and a
        push above `MAX_PUSH` causes a servo error. Raises RejectedError if the joint would exceed
        its limits, or if an arm without power is still braking.
        """
        pushed = self.servo.actual.copy()
        pushed[joint] += push
        limits = self.model.limits
        rejection = angles_rejection(pushed, limits)
        if rejection is not None:
            raise RejectedError(rejection.sentence)
        powered = self.condition.powered
        small = MAX_PUSH[limits.units[joint]]
        if powered and abs(pushed - self.arm.commanded)[joint] > small:
            self.raise_error(ErrorNumber.SERVO_ERROR)
            return
        if not powered and self.in_motion:
            raise RejectedError('the arm is still braking: try again when it has stopped')
        self.arm.push(clipped(pushed, limits), powered)
        self._handle_standstill()

    def freeze(self, joint: int | None) -> None:
        self.servo.freeze(joint)

    def servo_error(self, joint: int, critical: bool = False) -> None:
        _log.error('servo error of %s', self.model.joint_names[joint])
        self.raise_error(ErrorNumber.SERVO_ERROR, critical)

    def press_estop(self) -> None:
        self.apply(Event.ESTOP_PRESS)

    def planner_failed(self, reason: str) -> None:
        """Brake and end the trajectory because smooth motion has failed.

        If STATUS shows only alarms in this profile and the arm was moving, also raise an error.
        Otherwise the client would not notice the loss of its acknowledged points.
        """
        self.timing.planner_failures += 1
        alarm = self.moving and self.profile.state.errors == 'alarms'
        self.errors.enter(Rejection(ErrorNumber.PLANNER_FAILED, f'the motion planner: {reason}'))
        self.program.restart()
        if alarm:
            self.raise_error(ErrorNumber.PLANNER_FAILED)

    def tasks(self) -> Iterable[TaskRow]:
        tasks = self.program.tasks()
        if tasks is None:
            return rows(self.condition) if self.profile.program.loaded else ()
        return tasks

    # Time.

    def step(self, dt: float) -> None:
        """Advance the controller by `dt` ≥ 0 s.

        The clock proceeds from one timer to the next. Before each timer the arm advances to the
        timer's due time (`_move`). `SimulatedArm.step` calls `Program.step`, which steps the
        executor. If the arm completes a point within this time, the program supplies the next one.
        Finally the servos follow the commanded motion.
        """
        self.clock.advance(self.clock.now + dt, self._move)

    @property
    def in_motion(self) -> bool:
        return self.arm.in_motion

    @property
    def moving(self) -> bool:
        return self.arm.moving

    def _move(self, dt: float) -> None:
        if self.in_motion:
            self.arm.step(dt, self._execute)
            self._handle_standstill()
        while self._reported_points < self.arm.program_executor.started_points:
            self._reported_points += 1
            self.faults.point_started()

    def _execute(self, dt: float) -> None:
        if self.arm.executor is self.arm.program_executor:
            self.program.step(dt)
        elif self.real_time is not None and self.arm.executor is self.real_time.motion:
            self.real_time.motion.step(dt)
        else:
            self.command_window.step(dt)

    # State.

    def change_setting(self, name: str, numbers: tuple[float, ...]) -> None:
        self.spel.change(name, numbers)
        self._apply_settings()

    def reset_settings(self) -> None:
        self.spel.reset()
        self._apply_settings()

    def _apply_settings(self) -> None:
        self.arm.executor.speed = self.spel.speed
        self.arm.executor.accel = self.spel.accel

    @property
    def error_number(self) -> int:
        """The error number shown. During an E-stop, a loaded program shows TASK_ABORTED."""
        if self.condition.estopped and self.profile.program.loaded:
            return ErrorNumber.TASK_ABORTED
        return self._error or self.errors.number

    def error_text(self, number: int) -> str:
        """Return the text of an error number.

        For the current error of a SPEL+ program, this is the program's message.
        """
        message = self._error_text if number == self.error_number == self._error else ''
        return message or TEXTS.get(number, 'see the manual')

    def joint_position(self) -> JointPosition:
        return JointPosition(0, joint_data(self.servo.position.tolist()))

    def joint_feedback(self) -> JointFeedback:
        fields, now = ValidFields.POSITION | ValidFields.VELOCITY, 0.0
        if self.profile.state.feedback_time:
            fields, now = fields | ValidFields.TIME, self.clock.now
        values = (self.servo.position, self.servo.velocity)
        return JointFeedback(0, fields, now, *(joint_data(item.tolist()) for item in values))

    def status(self) -> Status:
        alarms = self.profile.state.errors == 'alarms'
        error = self._error if alarms else self.error_number
        condition = self.condition
        accepts = self.program.ready and self.motion_rejection() is None
        possible = condition.tasks is Tasks.RUNNING and error == ErrorNumber.NONE and accepts
        return Status(
            drives_powered=TriState(condition.powered),
            e_stopped=TriState(condition.estopped),
            error_code=error,
            in_error=TriState(error != ErrorNumber.NONE),
            in_motion=TriState(self.in_motion or (self._unattended and self.moving)),
            mode=StatusMode.AUTO if condition.mode is Mode.AUTO else StatusMode.MANUAL,
            motion_possible=TriState(possible),
        )

    def version(self) -> GetVersion:
        watches = self.profile.server.client_timeout > 0.0
        return GetVersion(VERSION if watches else WITHOUT_WATCHDOG)

    # Effects of a change of the condition.

    def _react(self, before: Condition) -> None:
        now = self.condition
        if now.door is Door.OPEN and before.door is not Door.OPEN:
            self._end_command('the safeguard door was opened')
        if now.tasks in ENDED and before.tasks not in ENDED:
            for program in self._programs():
                program.restart()
        elif now.motors in (Motors.OFF, Motors.BRAKING) and before.motors is not now.motors:
            for program in self._programs():
                program.abort()
        if now.tasks is before.tasks:
            return
        if now.tasks is Tasks.RECOVERING:
            if now.motors is Motors.ON and self.arm.executor.moving:
                self.arm.start_recovery()
        elif now.tasks in (Tasks.PAUSED, Tasks.INTERRUPTED, Tasks.WAIT_RECOVER):
            for program in self._programs():
                program.pause()
            self.arm.hold()
        else:
            self._resume_arm()
            for program in self._programs():
                program.resume()

    def _resume_arm(self) -> None:
        if not self._unattended:
            self.arm.executor.resume()

    def _handle_standstill(self) -> None:
        if self.in_motion:
            return
        self._log_failures()
        if self._slowing:
            self._slowing = False
            if not self.condition.paused:
                self._resume_arm()
        if self.condition.tasks is Tasks.RECOVERING:
            self.arm.end_recovery()
            self.apply(Event.RECOVERED)
            if self.arm.executor.moving:
                self.trajectory_starts()  # the trajectory resumes at its own power
            return
        self.arm.restore_executor()
        if self.condition.motors in (Motors.BRAKING, Motors.HOLDING):
            self.apply(Event.STANDSTILL)

    def apply_power(self) -> None:
        """Apply low or high power. A moving arm brakes before it resumes at low power."""
        arm, low = self.arm.executor, self.condition.power is not Power.HIGH
        continues = self.condition.motors is Motors.ON and self.condition.tasks is Tasks.RUNNING
        if low and not arm.low_power and continues and not arm.at_rest:
            self._slowing = True
            arm.hold()
        arm.low_power = low

    def trajectory_starts(self) -> None:
        """Select high power for a trajectory that starts now, if the profile specifies it."""
        if self.profile.motion.power == 'high':
            self.apply(Event.PROGRAM_POWER_HIGH)

    def motion_rejection(self) -> Rejection | None:
        rejection = condition_rejection(self.condition)
        if rejection is None and self.arm.executor is not self.arm.program_executor:
            return _BORROWED
        if rejection is None and self._planner is not None and not self._planner.ready:
            return _NO_PLANNER
        return rejection

    def command_rejection(self) -> Rejection | None:
        """Return why a statement of $Execute may not move the arm, or None.

        Unlike `motion_rejection`, this does not require running tasks.
        """
        return condition_rejection(replace(self.condition, tasks=Tasks.RUNNING))

    def _log_failures(self) -> None:
        sentence = self.timing.since(self._reported)
        if sentence:
            _log.warning('in this motion: %s', sentence)
            self._reported = copy.copy(self.timing)

    def send_reply(self, packet: Packet) -> None:
        if self.reply is not None:
            self.reply(encode(packet, self.dialect))


def _difference(before: Condition, after: Condition) -> str:
    changes = (
        (region, getattr(before, region).value, getattr(after, region).value) for region in REGIONS
    )
    return ', '.join(f'{name} {old} → {new}' for name, old, new in changes if old != new)
