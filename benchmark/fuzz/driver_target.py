# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The driver against a fuzzing controller, in virtual time and without sockets.

The controller has a minimal arm: its position is the last point received, its state messages
report that, and it answers points unless the case changes this. The case's data is inserted in
between.
"""

import asyncio
import logging
import struct
from functools import partial
from typing import Any

from support.driver_harness import Harness, pose
from support.streams import positions

from benchmark.fuzz import messages
from benchmark.fuzz.cases import Case, FoundError, Step
from benchmark.fuzz.memory_server import ServedEnd, listen, new_loop
from benchmark.fuzz.messages import Chance
from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.delivery.delivery import delivery_rules
from epson_driver.driver.io.points import IoUnavailableError
from epson_driver.driver.stopping.arm_gate import ArmGate
from epson_driver.profiles import load_controller_profile
from epson_driver.setup.setup import profile_defaults
from epson_driver.sim_controller.network.servers import Ports
from epson_driver.simple_message import (
    CommType,
    Framer,
    IoAddress,
    IoType,
    JointTraj,
    JointTrajPt,
    JointTrajPtFull,
    MotionCtrl,
    SimpleMessageError,
    SpecialSequence,
    decode,
)
from simulation.virtual_loop import VirtualLoop

PORTS = Ports(1, 2, 3, 4)
NUMBERS = {'motion': 1, 'state': 2, 'io': 3, 'remote': 4}

INPUTS_PER_CASE = 150
STATE_PERIOD_S = 0.02
RECOVERY_S = 30.0
"""Time for the driver to recover once the controller works again, s."""

BURST_LINES, LINES_PER_S = 60, 20.0
"""Maximum number of log lines: a burst, and a rate."""

MAX_HELD_BYTES = 70_000

MOVING = (JointTrajPt, JointTrajPtFull, JointTraj)


class DriverTarget:
    """A driver with a profile. `used`: with a user who enables and sends goals."""

    def __init__(self, profile: str, *, used: bool) -> None:
        self.profile = load_controller_profile(profile)
        self.used = used
        self.name = f'driver for {profile}, {"used" if used else "nobody commands it"}'

    def case(self, chance: Chance, corpus: list[bytes]) -> Case:
        """Return a new case."""
        steps: list[Step] = [('wait', 0.1)]
        order = self.profile.byte_order.value
        inputs = 0
        while inputs < INPUTS_PER_CASE:
            draw = chance.random()
            if draw < 0.12:
                steps.append(('wait', chance.choice((0.0, 0.005, 0.05, 0.5, 2.0))))
                continue
            if draw < 0.22:
                words = CONTROLLER + (USER if self.used else ())
                steps.append(('do', chance.choice(words)))
                continue
            port = chance.choice(('state', 'state', 'state', 'motion', 'motion', 'io', 'remote'))
            inputs += 1
            if port == 'remote':
                data = messages.answer(chance, chance.choice((b'$Login,', b'$SetMotorsOn,1')))
            elif corpus and draw < 0.4:
                data = messages.mutated(chance, chance.choice(corpus))
            else:
                kinds = messages.STATES if port == 'state' and chance.random() < 0.8 else ()
                data = messages.message(chance, kinds, order)
            if chance.random() < 0.5:
                data = messages.mutated(chance, data)
            steps.append(('send', port, data))
        return Case(self.name, tuple(steps))

    def run(self, case: Case) -> None:
        """Run the case. Raises FoundError, or an exception of a part of the driver."""
        loop = new_loop()
        world = _World(self, loop)
        try:
            loop.run_until_complete(world.run(case))
        finally:
            loop.bury()
        world.check_log()


CONTROLLER = (
    'answer', 'answer', 'refuse', 'fall silent', 'state on', 'state on', 'state off', 'hang up',
    'reset', 'take nobody', 'take anybody', 'take anybody',
)  # fmt: skip
USER = (
    'enable', 'enable', 'enable', 'goal', 'goal', 'goal', 'cancel', 'stop', 'disable',
    'reset_error', 'setpoint', 'read',
)  # fmt: skip


class _Lines(logging.Handler):
    """Counts log records."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        record.getMessage()  # its text can be formatted
        self.count += 1


class _World:
    """One driver with its controller and its user."""

    def __init__(self, target: DriverTarget, loop: VirtualLoop) -> None:
        self._target = target
        self._loop = loop
        self._serve(True)
        loop.set_exception_handler(self._on_exception)
        self._ends: dict[str, ServedEnd] = {}
        self._joints = [0.0] * 10
        self._shows = True
        self._answers: int | None = 1
        self._commanded = False
        self._gate: ArmGate | None = None
        self._found: list[str] = []
        self._goals: list[Any] = []
        self._actions: set[asyncio.Task[None]] = set()
        self._lines = _Lines()
        self._began = loop.now

    async def run(self, case: Case) -> None:
        """Perform the steps of a case, and check that the driver works after them."""
        log = logging.getLogger('epson_driver')
        log.addHandler(self._lines)
        try:
            async with Harness(PORTS, **self._options()) as harness:
                self._gate = harness.driver.gate
                state = asyncio.create_task(self._state())
                for step in case.steps:
                    await self._take(step, harness)
                    self._check(harness)
                await self._recovers(harness)
                state.cancel()
            self._check(harness, running=False)
        finally:
            log.removeHandler(self._lines)
        for goal in self._goals:
            if len(goal.outcomes) != 1:
                raise FoundError(f'a goal ended {len(goal.outcomes)} times: {goal.outcomes}')
        for action in self._actions:
            action.cancel()
        await asyncio.gather(*self._actions, return_exceptions=True)
        await asyncio.sleep(0.0)
        left = asyncio.all_tasks() - {asyncio.current_task(), state}
        if left:
            raise FoundError(f'tasks are left: {left}')

    def check_log(self) -> None:
        """Check that the log was paced."""
        seconds = self._loop.now - self._began
        if self._lines.count > BURST_LINES + LINES_PER_S * seconds:
            raise FoundError(f'{self._lines.count} lines in {seconds:.1f} s')

    def _options(self) -> dict[str, Any]:
        profile = self._target.profile
        defaults = profile_defaults(profile)
        options = {
            'delivery': delivery_rules(profile, defaults['interface'], defaults['point_message']),
            'usual_byte_order': profile.byte_order,
            'io_port': PORTS.io,
            'io': profile.io,
        }
        if profile.program.motors == 'motoman':
            options['motors'] = 'motoman'
        return options

    # --- the case's actions ---

    async def _take(self, step: Step, harness: Any) -> None:
        word, *rest = step
        if word == 'wait':
            await asyncio.sleep(rest[0])
        elif word == 'send':
            port, data = rest
            if port in self._ends:
                self._ends[port].feed(data)
            await asyncio.sleep(0)
        elif word == 'do':
            self._do(rest[0], harness)
            await asyncio.sleep(0)

    def _do(self, what: str, harness: Any) -> None:
        if what in ('answer', 'refuse', 'fall silent'):
            self._answers = {'answer': 1, 'refuse': 2, 'fall silent': None}[what]
        elif what in ('state on', 'state off'):
            self._shows = what == 'state on'
        elif what in ('take nobody', 'take anybody'):
            self._serve(what == 'take anybody')
        elif what in ('hang up', 'reset'):
            for end in tuple(self._ends.values()):
                end.hang_up(reset=what == 'reset')
        elif what == 'goal':
            self._goal(harness)
        elif what == 'cancel':
            if self._goals:
                harness.driver.goal_queue.cancel(self._goals[-1].handle)
        elif what == 'setpoint':
            self._commanded = True
            harness.driver.servo.take(positions(pose(0.05)))
        else:
            task = asyncio.create_task(self._ask(what, harness))
            self._actions.add(task)
            task.add_done_callback(self._actions.discard)

    def _goal(self, harness: Any) -> None:
        if harness.driver.robot.sample is None:
            return
        self._commanded = True
        at = harness.at
        self._goals.append(harness.submit(at + pose(0.05), at + pose(0.1), step=0.2))

    async def _ask(self, what: str, harness: Any) -> None:
        try:
            if what == 'read':
                await harness.driver.io.read([IoAddress(IoType.DIGITAL_INPUT, 0)])
            else:
                await getattr(harness.commands, what)()
        except (CommandError, IoUnavailableError):
            return
        except Exception as error:  # noqa: BLE001 - this is the failure searched for
            self._found.append(f'{what}: {type(error).__name__}: {error}')

    # --- the controller ---

    def _serve(self, takes: bool) -> None:
        """Listen on all ports, or refuse new connections."""
        listeners = self._loop.network.listeners
        for port, number in NUMBERS.items():
            if takes and number not in listeners:
                listen(self._loop, number, partial(self._accept, port))
            elif not takes and number in listeners:
                listeners[number].close()

    def _accept(self, port: str, end: ServedEnd) -> None:
        self._ends[port] = end
        end.on_end = lambda: self._gone(port, end)
        if port == 'motion':
            end.on_bytes = lambda data: self._motion(data, end)
        elif port == 'remote':
            end.on_bytes = lambda data: self._remote(data, end)

    def _gone(self, port: str, end: ServedEnd) -> None:
        if self._ends.get(port) is end:
            del self._ends[port]

    def _motion(self, data: bytes, end: ServedEnd) -> None:
        """Process the driver's data on the motion port, and answer like a controller.

        Each message is decoded separately. The answer is in the byte order of the request, and a
        case sends requests in either.
        """
        framer = Framer()
        framer.receive_data(data)
        while (frame := framer.next_frame()) is not None:
            try:
                packet = decode(frame)
            except SimpleMessageError as error:
                self._found.append(f'the driver sent what cannot be read: {error}')
                continue
            message, sequence = packet.message, 0
            if isinstance(message, MOVING):
                sequence = getattr(message, 'sequence', 0)
                stop = sequence == SpecialSequence.STOP_TRAJECTORY
                if not stop and not self._commanded:
                    self._found.append(f'nobody commanded it, and the driver sent {message}')
                if not stop and self._gate is not None and self._gate.reason is not None:
                    why = self._gate.reason
                    self._found.append(f'the gate is closed ({why}), and it sent {message}')
                if not stop and not isinstance(message, JointTraj):
                    given = getattr(message, 'joints', None) or getattr(message, 'positions', ())
                    self._joints = list(given or ())
            if self._answers is None or packet.comm_type is not CommType.SERVICE_REQUEST:
                continue
            order = frame.byte_order.value
            if isinstance(message, MotionCtrl | JointTrajPtFull):
                command = getattr(message, 'command', messages.POINT_FULL)
                result = 0 if self._answers == 1 else 3
                body = struct.pack(order + '5i10f', 0, sequence, command, result, 0, *[0.0] * 10)
                answer = messages.frame(2002, messages.REPLY, self._answers, body, order)
            else:
                body = struct.pack(order + 'i10f', sequence, *[0.0] * 10)
                answer = messages.frame(10, messages.REPLY, self._answers, body, order)
            self._loop.call_later(0.01, end.feed, answer)
        if framer.unread:
            self._found.append(f'the driver sent a piece of a message: {framer.unread.hex()}')

    def _remote(self, data: bytes, end: ServedEnd) -> None:
        if self._answers is not None:
            name = data.removeprefix(b'$').split(b',')[0].strip()
            value = b'00100000001,0000' if name == b'GetStatus' else b'0'
            mark = b'#' if self._answers == 1 else b'!'
            self._loop.call_soon(end.feed, mark + name + b',' + value + b'\r\n')

    async def _state(self) -> None:
        order = self._target.profile.byte_order.value
        while True:
            await asyncio.sleep(STATE_PERIOD_S)
            if self._shows and 'state' in self._ends:
                joints = struct.pack(order + 'i10f', 0, *self._joints)
                status = struct.pack(order + '7i', 1, 0, 0, 0, 0, 2, 1)
                self._ends['state'].feed(
                    messages.frame(10, messages.TOPIC, 0, joints, order)
                    + messages.frame(13, messages.TOPIC, 0, status, order)
                )

    # --- checks ---

    def _on_exception(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        self._found.append(f'{context["message"]}: {context.get("exception")!r}')

    def _check(self, harness: Any, *, running: bool = True) -> None:
        if self._found:
            raise FoundError(self._found[0])
        if running and not harness.running:
            raise FoundError('the driver has ended')
        for link in (harness.driver.state_link, harness.driver.motion_link):
            if len(link.unread) > MAX_HELD_BYTES:
                raise FoundError(f'the {link.name} link holds {len(link.unread)} bytes')
        for goal in self._goals:
            if len(goal.outcomes) > 1:
                raise FoundError(f'a goal ended twice: {goal.outcomes}')

    async def _recovers(self, harness: Any) -> None:
        """Check that the driver works with a controller that has recovered."""
        self._serve(True)
        self._shows = True
        self._answers = 1
        self._joints = [
            min(max(joint, -1.0), 1.0) if joint == joint else 0.0 for joint in self._joints
        ]
        for end in tuple(self._ends.values()):
            end.hang_up()
        driver, ends = harness.driver, self._loop.now + RECOVERY_S
        await asyncio.sleep(3.0)
        while not (
            driver.state_link.connected
            and driver.motion_link.connected
            and driver.robot.sample is not None
            and driver.robot.status is not None
        ):
            if self._loop.now > ends:
                raise FoundError(
                    f'{RECOVERY_S:g} s after the controller is good again: state link '
                    f'{driver.state_link.state.value}, motion link '
                    f'{driver.motion_link.state.value}, joints {driver.robot.sample}'
                )
            await asyncio.sleep(0.05)
        self._check(harness)
