# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The simulated controller against fuzzing clients, on its manual clock, without sockets."""

import struct
from functools import lru_cache
from typing import Any

import numpy as np

from benchmark.fuzz import messages
from benchmark.fuzz.cases import Case, FoundError, Step
from benchmark.fuzz.messages import Chance
from epson_driver.motion import Array
from epson_driver.motion.smoother import plan
from epson_driver.profiles import load_controller_profile
from epson_driver.profiles.profile import ControllerProfile
from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.sim_controller.assembly import (
    new_controller,
    profile_project,
    program_network,
)
from epson_driver.sim_controller.condition.states import Event
from epson_driver.sim_controller.remote.remote_commands import COMMANDS
from epson_driver.sim_controller.remote.sim_commands import SIM_COMMANDS
from epson_driver.sim_controller.spel_host.spel_program import SpelSource
from epson_driver.simple_message import FrameError
from epson_driver.spel import Program, build

INPUTS_PER_CASE = 200
STEP_S = 0.02
"""Maximum time step, s. The controller's own timers act within it."""

BRAKING_S = 10.0
"""Time in which the arm must come to rest after an E-stop, s."""

ANSWER_S = 3.0
"""Maximum time until a controller answers the next client, s."""

REOPENING_S = 4.0
"""Maximum time until a port accepts the next client, s. A SPEL+ program does not notice a client
that connects and leaves immediately. It reopens its ports after 2 s, checked after each wait of 1
s."""

MAX_TIMERS = 2_000
MAX_ANSWER_BYTES = 1_000_000
"""Maximum size of the data sent after one input, bytes."""

PUSH = b'disturb'
"""A person's push moves the arm on purpose, so lines with this word are omitted."""

NAMES = (*COMMANDS, *(f'Sim,{name}' for name in SIM_COMMANDS if name != PUSH.decode()), 'Nonsense')


class _Planner:
    """Plans synchronously, in the calling thread."""

    ready = True

    def ask(self, request: Any, limits: Any, answer: Any) -> None:
        answer(plan(request, limits))


class _Client:
    """The data received by a client, and whether it was disconnected."""

    local = True

    def __init__(self) -> None:
        self.got = bytearray()
        self.ended = False

    def send(self, data: bytes) -> None:
        if not self.ended:
            self.got += data

    def close(self) -> None:
        self.ended = True

    def abort(self) -> None:
        self.ended = True


@lru_cache
def _model() -> RobotModel:
    return load_robot_model('c3_a601s')


@lru_cache
def _program(profile_name: str) -> Program:
    return build(profile_project(load_controller_profile(profile_name), _model()))


class ControllerTarget:
    """A controller of one profile with fuzzing clients on the given ports.

    `armed`: its motors are on, so that valid points move the arm, within its limits. Otherwise
    nothing moves, unless a client switches the motors on through the protocol.
    """

    def __init__(
        self, profile: str, ports: tuple[str, ...], *, armed: bool, smooth: bool = False
    ) -> None:
        self.profile: ControllerProfile = load_controller_profile(profile)
        self.ports = ports
        self.armed = armed
        self.smooth = smooth
        power = 'motors on' if armed else 'motors off'
        self.name = f'controller {profile}{" smooth" * smooth}, {power}: {", ".join(ports)}'
        self._order = self.profile.byte_order.value

    def case(self, chance: Chance, corpus: list[bytes]) -> Case:
        """Return a new case from new messages and from earlier interesting ones."""
        steps: list[Step] = []
        sequence = 0
        while len(steps) < INPUTS_PER_CASE:
            port = chance.choice(self.ports)
            draw = chance.random()
            if port == 'remote':
                data = messages.command(chance, NAMES)
                if draw < 0.1:
                    data = b'$Login\r\n'
                elif draw < 0.3:
                    data = messages.mutated(chance, data)
            elif port == 'motion' and draw < 0.3:  # inputs must also meet a moving arm
                sequence = chance.choice((0, 0, sequence, sequence, -1, -2, -3, -4))
                data = self._point(chance, sequence)
                sequence = max(sequence + 1, 0)
            elif corpus and draw < 0.5:
                data = messages.mutated(chance, chance.choice(corpus))
            else:
                data = messages.message(chance, order=self._order)
            if draw > 0.4 and port != 'remote':
                data = messages.mutated(chance, data)
            steps.append(('send', port, data))
            if chance.random() < 0.15:
                steps.append(('wait', chance.choice((0.004, 0.02, 0.1, 0.5))))
            if chance.random() < 0.02:
                steps.append(('close', port))
        return Case(self.name, tuple(steps))

    def _point(self, chance: Chance, sequence: int) -> bytes:
        if self.profile.program.kind == 'motoman':
            if sequence < 0:
                command = chance.choice((200_101, 200_111, 200_112, 200_120, 200_121))
                body = struct.pack(self._order + '3i10f', 0, -1, command, *[0.0] * 10)
                return messages.frame(2001, messages.REQUEST, 0, body, self._order)
            return messages.full_point(chance, sequence, 0.5 * sequence, self._order)
        return messages.point(chance, sequence, self._order, duration=0.4)

    def run(self, case: Case) -> None:
        """Run the case. Raises FoundError, or any exception of the controller."""
        world = _World(self)
        for step in case.steps:
            world.take(step)
        world.end()


class _World:
    """One controller and its clients."""

    def __init__(self, target: ControllerTarget) -> None:
        profile = target.profile
        spel = None
        if profile.spel.project:
            spel = SpelSource(_program(profile.name), program_network(profile))
        self._profile = profile
        self._remote = 'remote' in target.ports
        self.controller = new_controller(
            _model(), profile, planner=_Planner() if target.smooth else None, spel=spel
        )
        self._clients: dict[str, tuple[Any, _Client]] = {}
        if spel is not None:
            self._step(0.5)
        if target.armed:
            self.controller.apply(Event.MOTORS_ON)
        self._powered = target.armed
        self._stood: Array = self.controller.servo.actual.copy()

    def take(self, step: Step) -> None:
        """Perform a step."""
        word, *rest = step
        if word == 'send':
            self._send(*rest)
        elif word == 'wait':
            self._step(*rest)
        elif word == 'close':
            self._close(*rest)

    def _send(self, port: str, data: bytes) -> None:
        if PUSH in data.lower():
            return
        if port in self._clients and self._clients[port][1].ended:
            self._close(port)
        if port not in self._clients:
            client = _Client()
            try:
                self._clients[port] = self.controller.connect(port, client), client
            except ConnectionRefusedError:
                self._step(STEP_S)
                return
        session, client = self._clients[port]
        try:
            session.receive(data)
        except FrameError:
            self._close(port)
        if len(client.got) > MAX_ANSWER_BYTES:
            raise FoundError(f'{len(client.got)} bytes were sent after one input')
        client.got.clear()
        if self.controller.clock.timers > MAX_TIMERS:
            raise FoundError(f'{self.controller.clock.timers} timers')
        self._look()

    def _close(self, port: str) -> None:
        if port in self._clients:
            session, _ = self._clients.pop(port)
            session.closed()

    def _step(self, seconds: float) -> None:
        """Advance the time and check the arm."""
        limits = self.controller.model.limits
        while seconds > 1e-9:
            part = min(seconds, STEP_S)
            seconds -= part
            before = self.controller.arm.commanded.copy()
            self.controller.step(part)
            after = self.controller.arm.commanded
            way = np.abs(after - before)
            if not np.all(way <= limits.velocity * part * (1.0 + 1e-6) + 1e-9):
                raise FoundError(f'{way / part} rad/s, the limits are {limits.velocity}')
            inside = (after >= limits.position_min - 1e-9) & (after <= limits.position_max + 1e-9)
            if not np.all(inside):
                raise FoundError(f'the arm is sent to {after}')
        for _, client in self._clients.values():
            if len(client.got) > MAX_ANSWER_BYTES:
                raise FoundError(f'{len(client.got)} bytes were sent at once')
            client.got.clear()

    def _look(self) -> None:
        """Check that an arm without power is at rest."""
        self._powered |= self.controller.condition.powered
        if self._powered:
            return
        if not np.array_equal(self.controller.servo.actual, self._stood):
            raise FoundError('an arm without power has moved')

    def end(self) -> None:
        """Check that it serves the next clients, and comes to rest after an E-stop."""
        self._step(0.1)
        self._look()
        for port in tuple(self._clients):
            self._close(port)
        controller = self.controller
        if self._remote:
            controller.faults.clear()
            controller.reboot(0.1)
        self._step(REOPENING_S)
        self._next('state', b'')
        self._next('motion', self._question())
        controller.apply(Event.ESTOP_PRESS)
        self._step(BRAKING_S)
        if controller.in_motion:
            raise FoundError(f'the arm still moves {BRAKING_S:g} s after the E-stop')

    def _question(self) -> bytes:
        """Return a request that the controller's motion port answers: STOP, or a PING."""
        order = self._profile.byte_order.value
        if self._profile.program.kind == 'motoman':
            return messages.frame(1, messages.REQUEST, 0, b'', order)
        stop = struct.pack(order + 'i12f', messages.STOP, *[0.0] * 12)
        return messages.frame(messages.POINT, messages.REQUEST, 0, stop, order)

    def _next(self, port: str, ask: bytes) -> None:
        """Check that the next client of a port receives data."""
        client = _Client()
        try:
            session = self.controller.connect(port, client)
        except ConnectionRefusedError as error:
            raise FoundError(f'the next {port} client is refused: {error}') from error
        waited = 0.0
        if ask:
            session.receive(ask)
        while not client.got:
            if waited > ANSWER_S:
                raise FoundError(f'the next {port} client hears nothing')
            self.controller.step(STEP_S)
            waited += STEP_S
        session.closed()
