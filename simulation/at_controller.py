# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What happens at the controller: a person at its pendant, its faults, its network, strangers."""

import asyncio
import contextlib
import re
from collections.abc import Callable
from typing import Any, Protocol

from epson_driver.profiles.profile import ControllerProfile
from epson_driver.sim_controller.condition.states import (
    Door,
    EStop,
    Event,
    Mode,
    RejectedError,
    Tasks,
)
from epson_driver.sim_controller.faults.faults import ANSWER_TIME_S, FaultError, parse
from simulation.network import HOST, Network
from simulation.oracles import Arm, Wishes
from simulation.users import Users
from simulation.virtual_loop import VirtualLoop
from simulation.workers import Workers

CLOSING = ('ESTOP_PRESS', 'MOTORS_OFF', 'DOOR_OPEN', 'MODE_MANUAL')
"""What a person does at the controller after which the arm must be enabled again."""

SHUT = {
    'ESTOP_PRESS': 'E-stop',
    'ESTOP_RELEASE': 'E-stop',
    'DOOR_OPEN': 'door',
    'DOOR_CLOSE': 'door',
}
"""What each of these begins or ends."""

KNOWN_S = 3.0
"""By then a driver knows of it, s: from STATUS, or as the state is silent."""

ON_ANY_PORT = ('cut', 'half_open', 'delay', 'jitter', 'coalesce', 'one_byte')
"""Faults that can strike the remote port, too."""

UNSURE_S = 1.0
"""How long changed bits may be under way, s."""

STOP_S = 0.5
"""How long a STOP may take besides the network, s: the arm brakes."""

MOVES_S = 20.0
"""How long an arm may move that a person at the controller had go on, s."""


class Surroundings(Protocol):
    """The world, as far as the controller has to do with it."""

    arm: Arm
    loop: VirtualLoop
    network: Network
    delay: float
    wishes: Wishes
    users: Users
    profile: ControllerProfile
    statements: bool
    person: float
    controller: Any
    servers: Any
    ports: Any
    workers: Workers

    def say(self, text: str) -> None:
        """Write a line of the log."""


class AtController:
    """Methods are events of the world."""

    def __init__(self, world: Surroundings) -> None:
        self._world = world
        self._now: Callable[[], float] = world.loop.true_time
        self._unsure_until = self._read_from = 0.0
        self._closing = -world.person
        self._shut: dict[str, float] = {}
        """Since when the arm may not move, s, and for what."""
        self.links = ('remote',) if world.statements else ('motion', 'state')
        """Ports that the driver needs: without one the arm must be enabled again."""

    @property
    def unsure(self) -> bool:
        """Whether what is published may be wrong: bits were changed, and still arrive."""
        if self._world.controller.faults.active() or self._world.network.flips:
            self._doubt()
        return self._now() <= self._unsure_until

    def why_shut(self, since: float) -> str | None:
        """Return why the arm must be disabled, if a driver has not been held up `since`."""
        for why, begun in self._shut.items():
            if self._now() - max(begun, since, self._unsure_until) > KNOWN_S + self._world.person:
                return why
        return None

    def hung(self, seconds: float) -> None:
        """Take note that what comes now is read only after so long, s."""
        unsure, self._read_from = self.unsure, self._now() + seconds
        if unsure:
            self._doubt()

    def _doubt(self) -> None:
        """Take note that bits of what comes now may be wrong, until some time after it is read."""
        until = max(self._now(), self._read_from) + UNSURE_S
        self._unsure_until = max(until, self._unsure_until)

    def keeps_points(self) -> None:
        """Expect old points to be gone on with until a client that came has sent STOP."""
        world, came = self._world, self._world.controller.client_came

        def client_came() -> None:
            came()
            world.arm.client_came()
            world.loop.call_later(3.0 * world.delay + STOP_S, look, self._now())

        def look(since: float) -> None:
            held = world.network.stalled or world.loop.hanging or self.unsure
            if not held and not world.wishes.any(self._now()):
                world.arm.old_points_over(since)

        world.controller.client_came = client_came

    # --- a person ----------------------------------------------------------------------------

    async def pendant(self, event: str) -> None:
        """Let a person do something, who needs a while to take back what closes the gate."""
        if event in CLOSING:
            self._closing = self._now()
        elif (left := self._closing + self._world.person - self._now()) > 0.0:
            await asyncio.sleep(left)
        self._apply(event)

    def _apply(self, event: str) -> None:
        world, wishes, program = self._world, self._world.wishes, self._world.profile.program
        try:
            with world.servers.pacer.present():
                world.controller.apply(Event[event])
        except RejectedError as error:
            world.say(f'{event} is refused: {error}')
            return
        if event in ('ESTOP_PRESS', 'DOOR_OPEN'):
            self._shut.setdefault(SHUT[event], self._now())
        elif event in SHUT:
            self._shut.pop(SHUT[event], None)
        if event in CLOSING or (event == 'STOP' and program.motors == 'restart'):
            wishes.closed(self._now())
        if (event in ('STOP', 'RESET') and wishes.open) or (
            event == 'MOTORS_OFF' and program.kind == 'motoman'
        ):  # a goal that comes before the next STATUS switches a Motoman's motors on
            wishes.open, wishes.closed_meanwhile = None, True
        if event == 'CONTINUE':
            wishes.person, wishes.asked = True, self._now()
            world.loop.call_later(MOVES_S, setattr, wishes, 'person', False)

    def mend(self) -> None:
        """Do what helps, whatever is wrong there."""
        condition = self._world.controller.condition
        for wanted, event in (
            (condition.estop is EStop.PRESSED, 'ESTOP_RELEASE'),
            (condition.door is Door.OPEN, 'DOOR_CLOSE'),
            (condition.mode is Mode.MANUAL, 'MODE_AUTO'),
            (condition.paused or condition.tasks is Tasks.RECOVERING, 'STOP'),
            (True, 'RESET'),
            (True, 'START'),
            (not self._world.profile.ports.remote, 'MOTORS_ON'),
        ):
            if wanted:
                self._apply(event)

    # --- faults ------------------------------------------------------------------------------

    async def fault(self, text: str) -> None:
        """Let the controller or its connections fail."""
        world, name = self._world, text.split()[0]
        if world.statements and name in ON_ANY_PORT:
            text = f'{re.sub(" port=[a-z]+", "", text)} port=remote'
        with contextlib.suppress(FaultError), world.servers.pacer.present():  # there are many
            world.controller.faults.start(parse(text))
            self._doubt()
            if name == 'cut':  # of the remote port it begins a little later
                after = ANSWER_TIME_S if world.statements else 0.0
                world.loop.call_later(after, lambda: world.wishes.closed(self._now()))
        world.wishes.closed_meanwhile = True

    async def clear_faults(self) -> None:
        """End the faults."""
        with self._world.servers.pacer.present():
            self._world.controller.faults.clear()

    async def worker_dies(self, which: str) -> None:
        """Let a process that plans end."""
        self._world.wishes.closed_meanwhile = True
        if (worker := self._world.workers.last(which)) is not None:
            worker.end(1)

    async def worker_hangs(self, which: str) -> None:
        """Let it answer no more."""
        self._world.wishes.closed_meanwhile = True
        if (worker := self._world.workers.last(which)) is not None:
            worker.hangs = True

    # --- the network -------------------------------------------------------------------------

    def _number_of(self, port: str) -> int:
        number: int = getattr(self._world.ports, 'remote' if self._world.statements else port)
        return number

    async def network_stall(self, port: str, seconds: float) -> None:
        """Let nothing pass on a port for a while."""
        number = self._number_of(port)
        self._world.network.stall(number)
        self._world.users.held_up = self._now() + seconds
        self._world.loop.call_later(seconds, self._world.network.release, number)

    async def network_reset(self, port: str) -> None:
        """End the connections of a port."""
        self._world.network.reset(self._number_of(port))
        if port in self.links or self._world.statements:
            self._world.wishes.closed(self._now())

    async def network_half_close(self, port: str) -> None:
        """Let the controller see the end of what its clients send."""
        self._world.network.half_close(self._number_of(port))

    async def network_flip(self, port: str, byte: int, bit: int) -> None:
        """Change a bit of what the controller sends next on a port."""

        def flipped(data: bytes) -> bytes:
            at = byte % len(data)
            return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]

        self._world.network.flips[self._number_of(port)] = flipped
        self._doubt()

    async def second_client(self, port: str, seconds: float) -> None:
        """Let somebody else connect to a port, and leave again."""
        self._world.users.begin(self._stranger(port, seconds), 'a stranger')

    async def _stranger(self, port: str, seconds: float) -> None:
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(5.0):
                _, writer = await asyncio.open_connection(HOST, self._number_of(port))
            if self._number_of(port) == self._world.ports.remote:
                writer.write(b'$Login,\r\n')
            await asyncio.sleep(seconds)
            writer.close()
