# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The controller's side of Real-time Motion Control: messages of one client, and their answers.

Messages of other participants are not answered while a client is connected. EPSON does not
document this. It does not document either which error follows an empty buffer or a target beyond
the limits, and whether the motors are switched off when the client is lost.
"""

import logging
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from epson_driver.motion import Array
from epson_driver.rtmc import messages
from epson_driver.rtmc.conditions import CONDITIONS, Detail, Refusal, refusal, required
from epson_driver.rtmc.messages import (
    OperationMode,
    Request,
    RtmcError,
    RtmcMessage,
    RtmcStatus,
    decode,
    encode_text,
)
from epson_driver.sim_controller.arm.low_power import low_power_caps
from epson_driver.sim_controller.arm.target_motion import TargetMotion
from epson_driver.sim_controller.clock import Timer
from epson_driver.sim_controller.condition.errors import ErrorNumber
from epson_driver.sim_controller.condition.states import (
    Door,
    Event,
    Fault,
    Mode,
    Motors,
    Power,
    RejectedError,
)
from epson_driver.sim_controller.core import Controller
from epson_driver.sim_controller.faults.fault_kinds import REAL_TIME_PORT
from epson_driver.sim_controller.faults.faults import FaultyTransport
from epson_driver.sim_controller.io.io_points import IoError
from epson_driver.simple_message import IoType

NOTICE_PERIOD_S = 0.1
"""Period of the status notice, s. It is also sent after each change."""

MAX_WAITS = 50
"""Maximum number of cycles for which a late simulation waits for the client to fill the buffer. A
client that sends nothing must not delay it longer."""

BUSY_S = 0.1
"""Time after a delay of the simulation during which the machine counts as busy, s."""

MAX_TEXT_CHARACTERS = 200
MM_PER_M = 1000.0

NOTICES = (Request.STATUS_NOTICE, Request.JOINTS_NOTICE)

_WIDTHS = {0: 1, 1: 8, 2: 16}  # range of an I/O request → bits

_log = logging.getLogger(__name__)


class RefusedError(Exception):
    """A refused request, with the reason. An EXECUTION error also has a detail."""

    def __init__(self, reason: Refusal = Refusal.EXECUTION, detail: int = 0) -> None:
        super().__init__(reason, detail)
        self.low = reason | detail << 8


class RtmcPort:
    """Real-time Motion Control of one controller. `send` sends a message to the client.

    `poll(quiet)` passes the messages that have arrived to `receive`. If `quiet`, later messages
    may wait for its next call.
    """

    def __init__(
        self,
        controller: Controller,
        send: Callable[[bytes], object],
        poll: Callable[[bool], object] = lambda _quiet: None,
    ) -> None:
        self._controller = controller
        self._send = send
        self._poll = poll
        profile = controller.profile.rtmc
        model = controller.model
        self._password = profile.password.encode()
        self._cycle_period = profile.cycle
        caps = low_power_caps(model.reach)
        self.motion = TargetMotion(model.limits, controller.arm.commanded, caps, profile.cycle)
        self._units = np.where(np.array(model.limits.units) == 'm', MM_PER_M, 1.0)
        self._model = model.sales_name
        self._client: int | None = None
        self._transport: FaultyTransport | None = None  # to the client
        self._pending: Array | None = None  # a target that waits for room in the buffer
        self.weight, self.inertia, self.eccentricity = 0.0, 0.0, 0
        self._notices: Timer | None = None
        self._cycles: Timer | None = None
        self._waits, self._waiting, self._busy_until = 0, False, 0.0
        self._status = b''  # data of the last status notice
        self.boot()
        controller.real_time = self

    def boot(self) -> None:
        """Disconnect the client, and reset the values that a controller loses without power."""
        self._disconnect()
        self._checked = False
        self._formats = [0, 0]
        self._buffer_size = messages.BUFFER_SIZES[-1]

    @property
    def enabled(self) -> bool:
        """Whether the motion mode is enabled."""
        return self.motion.active

    # Arrivals.

    def receive(self, sender: int, data: bytes | None) -> None:
        """Answer a message. If `data` is None, react to the loss of the sender."""
        if data is None:
            if sender == self._client:
                self._lose_client()
            return
        controller = self._controller
        if controller.clients.boots or controller.faults.rejects(REAL_TIME_PORT):
            return
        if self._transport is not None and sender == self._client:
            data = self._transport.receive(data)
            if not data:
                return
        try:
            request = decode(data)
        except RtmcError as error:
            _log.warning('real-time motion: message not answered: %s', error)
            return
        connects = request.number == Request.CONNECT and self._client is None
        if sender != self._client and not connects:
            why = 'no client' if self._client is None else 'another client'
            _log.warning(
                'real-time motion: message %d not answered: %s is connected', request.number, why
            )
            return
        try:
            reply = self._answer(request, sender)
        except (RtmcError, RejectedError, IoError) as error:
            _log.warning('real-time motion: message %d: %s', request.number, error)
            reply = RtmcMessage(request.number, Refusal.EXECUTION)
        except RefusedError as error:
            reply = RtmcMessage(request.number, error.low)
        if reply is not None:
            self._transmit(reply)
        self.react()

    def _transmit(self, message: RtmcMessage) -> None:
        send = self._send if self._transport is None else self._transport.send
        send(message.encode())

    def _lose_client(self) -> None:
        _log.warning('real-time motion: the client is lost')
        self._disconnect()
        if self.enabled:
            self._controller.apply(Event.CLIENT_LOST)

    def _disconnect(self) -> None:
        if self._transport is not None:
            self._transport.close()
            self._transport = None
        self._client = self._pending = None
        if self._notices is not None:
            self._notices.cancel()

    def _answer(self, request: RtmcMessage, sender: int) -> RtmcMessage | None:
        """Execute a request, and return the reply. Return None if the reply is sent later."""
        number = request.number
        conditions = required(number, request.low)
        if conditions is None:
            raise RtmcError('unknown')
        why = refusal(conditions, self.status(), checked=self._checked, mode=self.enabled)
        if why is not None:
            raise RefusedError(why)
        if number == Request.CONNECT:
            self._connect(request, sender)
        elif number == Request.MOVE:
            return self._accept_target(request)
        elif (change := self._CHANGES.get(number)) is not None:
            change(self, request)
        low, data = self._value(request)
        return RtmcMessage(number, low, 1, data)

    def _connect(self, request: RtmcMessage, sender: int) -> None:
        if not request.low:
            self._disconnect()
            return
        if request.data.rstrip(b'\0') != self._password:
            raise RefusedError(detail=Detail.PASSWORD)
        self._disconnect()
        self._client, self._status = sender, b''
        self._transport = FaultyTransport(
            REAL_TIME_PORT,
            self._controller.clock,
            self._controller.faults,
            self._send,
            self._lose_client,
            lambda data: decode(data).number not in NOTICES,
        )
        self._notices = self._controller.clock.every(NOTICE_PERIOD_S, self._notify)

    # Requests that change a value.

    def _check_model(self, request: RtmcMessage) -> None:
        self._checked = request.data.rstrip(b'\0').decode(errors='replace') == self._model

    def _set_format(self, request: RtmcMessage) -> None:
        self._formats[request.number == Request.SET_RECEIVE_FORMAT] = _one_of((0, 1), request.low)

    def _set_motors(self, request: RtmcMessage) -> None:
        self._controller.apply(Event.MOTORS_ON if request.low else Event.MOTORS_OFF)

    def _set_power(self, request: RtmcMessage) -> None:
        self._controller.apply(Event.POWER_HIGH if request.low else Event.POWER_LOW)

    def _set_mode(self, request: RtmcMessage) -> None:
        controller = self._controller
        if not request.low:
            self._end()
            controller.arm.restore_executor()
        elif not self.enabled:
            if controller.condition.motors is not Motors.ON:
                raise RefusedError(detail=Detail.MOTORS_OFF)
            if controller.moving or controller.command_window.executes:
                raise RefusedError(detail=Detail.DECELERATING)
            controller.arm.switch_executor(self.motion)
            self.motion.active = True
            self._waits, self._waiting = MAX_WAITS, True
            period = self._cycle_period
            self._cycles = controller.clock.every(period, self._cycle, period, self._buffer_size)

    def _reset(self, _request: RtmcMessage) -> None:
        try:
            self._controller.apply(Event.RESET)
        except RejectedError as error:  # EPSON's table has no conditions: the status shows why
            _log.warning('real-time motion: reset without effect: %s', error)

    def _set_buffer(self, request: RtmcMessage) -> None:
        self._buffer_size = _one_of(messages.BUFFER_SIZES, request.low)

    def _set_outputs(self, request: RtmcMessage) -> None:
        value = int.from_bytes(request.data[:2], 'little')
        port, width = request.low & 0xFF, _WIDTHS[_one_of(_WIDTHS, request.low >> 8)]
        self._controller.io.write_port(IoType.DIGITAL_OUTPUT, port, width, value)

    def _set_weight(self, request: RtmcMessage) -> None:
        (self.weight,) = _positive(request.values(messages.WEIGHT_DATA))

    def _set_inertia(self, request: RtmcMessage) -> None:
        layout = messages.ECCENTRIC_DATA if request.low else messages.WEIGHT_DATA
        self.inertia, *rest = _positive(request.values(layout))
        self.eccentricity = int(rest[0]) if rest else 0

    _CHANGES: ClassVar[dict[int, Callable[['RtmcPort', RtmcMessage], None]]] = {
        Request.CHECK_MODEL: _check_model,
        Request.SET_SEND_FORMAT: _set_format,
        Request.SET_RECEIVE_FORMAT: _set_format,
        Request.SET_MOTORS: _set_motors,
        Request.SET_POWER: _set_power,
        Request.SET_MODE: _set_mode,
        Request.RESET: _reset,
        Request.SET_BUFFER: _set_buffer,
        Request.SET_OUTPUTS: _set_outputs,
        Request.SET_WEIGHT: _set_weight,
        Request.SET_INERTIA: _set_inertia,
    }

    def _value(self, request: RtmcMessage) -> tuple[int, bytes]:
        """Return the low word and the data of the reply to an executed request."""
        number, controller, none = request.number, self._controller, b'\0'
        condition = controller.condition
        words = {
            Request.CHECK_MODEL: self._checked,
            Request.MODEL_CHECKED: self._checked,
            Request.SEND_FORMAT: self._formats[0],
            Request.RECEIVE_FORMAT: self._formats[1],
            Request.MOTORS: condition.motors is Motors.ON,
            Request.POWER: condition.power is Power.HIGH,
            Request.MODE: self.enabled,
            Request.BUFFER: self._buffer_size,
        }
        if number in words:
            return int(words[Request(number)]), none
        if number == Request.STATUS:
            return 0, self.status().encode()
        if number in (Request.JOINTS, Request.JOINTS_AT_REST):
            return 0, messages.JOINTS_DATA.pack(*self._joints())
        if number == Request.FORMATS:
            return 0, messages.FORMATS_DATA.pack(*self._formats)
        if number == Request.MODEL:
            return 0, self._model.encode() + b'\0'
        if number == Request.MESSAGES:
            text = controller.error_text(request.low)[:MAX_TEXT_CHARACTERS] if request.low else ''
            return 0, encode_text(text)
        if number in (Request.OUTPUTS, Request.INPUTS):
            outputs = number == Request.OUTPUTS
            kind = IoType.DIGITAL_OUTPUT if outputs else IoType.DIGITAL_INPUT
            width = _WIDTHS[_one_of(_WIDTHS, request.low >> 8)]
            value = controller.io.read_port(kind, request.low & 0xFF, width)
            return 0, messages.NUMBER_DATA.pack(value)
        if number == Request.WEIGHT:
            return 0, messages.WEIGHT_DATA.pack(self.weight)
        if number == Request.INERTIA and request.low:
            return 0, messages.ECCENTRIC_REPLY_DATA.pack(self.inertia, self.eccentricity)
        if number == Request.INERTIA:
            return 0, messages.WEIGHT_DATA.pack(self.inertia)
        return request.low, none

    # Targets.

    def _accept_target(self, request: RtmcMessage) -> RtmcMessage | None:
        *joints, outputs = request.values(messages.TARGET_DATA)
        target = np.array(joints[: len(self._units)]) / self._units
        if self._pending is not None:
            raise RtmcError('the previous target is not answered yet')
        if not np.isfinite(target).all():
            self._controller.raise_error(ErrorNumber.OUT_OF_RANGE)
            raise RefusedError(Refusal.ERROR)
        if self._formats[0]:
            self._controller.io.write_port(IoType.DIGITAL_OUTPUT, 0, 16, outputs)
        if len(self.motion.targets) < self._buffer_size:
            self.motion.targets.append(target)
            return self._moved(full=False)
        self._pending = target
        return None

    def _moved(self, full: bool) -> RtmcMessage:
        inputs = 0
        if self._formats[1]:
            io = self._controller.io
            low, high = (io.read_port(IoType.DIGITAL_INPUT, *port) for port in ((0, 16), (2, 8)))
            inputs = low | high << 16
        data = messages.MOVED_DATA.pack(full, *self._joints(), inputs)
        return RtmcMessage(Request.MOVE, 0, 1, data)

    def _cycle(self) -> None:
        """Execute one control cycle.

        A late simulation makes up for its missed cycles, with at most half of the buffer, because
        the client could not fill it during the delay. Then the simulation waits for a full buffer.
        It also waits at the start, and if the buffer runs empty soon after a delay, because a
        client on a busy machine is late, too.
        """
        clock = self._controller.clock
        self._poll(len(self.motion.targets) >= self._buffer_size)
        waiting = len(self.motion.targets)
        late = clock.until - clock.now >= self._cycle_period
        if late:
            self._busy_until = clock.now + BUSY_S
        busy = clock.now < self._busy_until
        if waiting >= self._buffer_size:
            self._waits, self._waiting = MAX_WAITS, False
        elif (late and waiting <= self._buffer_size // 2) or (busy and not waiting):
            self._waiting = True
        if not self.enabled:  # the arm was stopped
            self.react()
        elif self._waiting and self._waits:
            self._waits -= 1
            return
        elif (problem := self.motion.take_target()) is not None:
            _log.error('real-time motion: %s', problem)
            self._controller.raise_error(ErrorNumber.SERVO_ERROR)
        elif self._pending is not None:
            self.motion.targets.append(self._pending)
            self._pending = None
            self._transmit(self._moved(full=True))

    def _end(self) -> None:
        if self._cycles is not None:
            self._cycles.cancel()
            self._cycles = None
        self.motion.stop()
        self._poll(False)

    # State.

    def react(self) -> None:
        """End the motion if the controller's condition now forbids it, and send the new status."""
        condition = self._controller.condition
        allowed = condition.mode is Mode.AUTO and condition.door is Door.CLOSED
        on = allowed and condition.motors is Motors.ON
        if self._cycles is not None and not (on and self.enabled):
            self._end()
            if self._pending is not None:
                self._pending = None
                why = refusal(CONDITIONS[Request.MOVE], self.status(), checked=True, mode=True)
                self._transmit(RtmcMessage(Request.MOVE, why or Refusal.MOTION_MODE))
        if self._client is not None and self.status().encode() != self._status:
            self._notify()

    def status(self) -> RtmcStatus:
        controller = self._controller
        condition = controller.condition
        return RtmcStatus(
            condition.door is Door.OPEN,
            condition.estopped,
            OperationMode.AUTO if condition.mode is Mode.AUTO else OperationMode.TEACH,
            0 if condition.fault is Fault.NONE else controller.error_number,
        )

    def _notify(self) -> None:
        status = self.status()
        self._status = status.encode()
        self._transmit(RtmcMessage(Request.STATUS_NOTICE, 0, 1, self._status))
        if status.mode is not OperationMode.AUTO:
            joints = messages.JOINTS_DATA.pack(*self._joints())
            self._transmit(RtmcMessage(Request.JOINTS_NOTICE, 0, 1, joints))

    def _joints(self) -> list[float]:
        values: list[float] = (self._controller.servo.position * self._units).tolist()
        return values + [0.0] * (messages.JOINTS - len(values))


def _one_of(values: 'tuple[int, ...] | dict[int, int]', value: int) -> int:
    if value not in values:
        raise RtmcError(f'value {value}: must be one of {", ".join(map(str, values))}')
    return value


def _positive(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(0.0 <= value < np.inf for value in values):
        raise RtmcError(f'{values}: must be finite and not negative')
    return values
