# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Events at the controller: a person at its pendant, faults, network failures, other clients."""

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
from epson_driver.sim_controller.faults.fault_kinds import FaultError, parse
from epson_driver.sim_controller.faults.faults import ANSWER_TIME_S
from simulation.network import HOST, Network
from simulation.oracles import Arm, Wishes
from simulation.users import Users
from simulation.virtual_loop import VirtualLoop
from simulation.workers import Workers

CLOSING = ('ESTOP_PRESS', 'MOTORS_OFF', 'DOOR_OPEN', 'MODE_MANUAL')
"""Pendant events after which the arm must be enabled again."""

SHUT = {
    'ESTOP_PRESS': 'E-stop',
    'ESTOP_RELEASE': 'E-stop',
    'DOOR_OPEN': 'door',
    'DOOR_CLOSE': 'door',
}
"""Pendant event → the cause of a closed gate that it sets or clears."""

KNOWN_S = 3.0
"""Time within which a driver detects such a cause, s, by STATUS or by a silent state port."""

LINKS = {'statements': ('remote',), 'rtmc': ('motion',)}
"""Interface of the driver → the only port that it uses. Other interfaces use motion and state."""

ON_ANY_PORT = ('cut', 'half_open', 'delay', 'jitter', 'coalesce', 'one_byte')
"""Faults that can affect the remote port, too."""

UNSURE_S = 1.0
"""Maximum time for which flipped bits may be in transit, s."""

STOP_S = 0.5
"""Maximum time from the arrival of a STOP to the standstill of the arm, s."""

MOVES_S = 20.0
"""Maximum time for which the arm may move after a person's `continue`, s."""


class WorldInterface(Protocol):
    """The parts of the world that AtController uses."""

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

    def say(self, text: str) -> None: ...


class AtController:
    """The controller's side of a world. Public methods are events of the world."""

    def __init__(self, world: WorldInterface) -> None:
        self._world = world
        self._now: Callable[[], float] = world.loop.true_time
        self._unsure_until = self._read_from = 0.0
        self._closing = -world.person
        self._shut: dict[str, float] = {}
        """Cause that forbids motion → its start time, s."""
        self.links = LINKS.get(world.profile.program.interface, ('motion', 'state'))
        """Ports that the driver needs. After the loss of one, the arm must be enabled again."""

    @property
    def unsure(self) -> bool:
        """Whether published values may be wrong, because flipped bits are still in transit."""
        if self._world.controller.faults.active() or self._world.network.flips:
            self._doubt()
        return self._now() <= self._unsure_until

    def why_shut(self, since: float) -> str | None:
        """Return why the arm must be disabled, for a driver that has run since `since`."""
        for why, started in self._shut.items():
            if (
                self._now() - max(started, since, self._unsure_until)
                > KNOWN_S + self._world.person
            ):
                return why
        return None

    def hung(self, seconds: float) -> None:
        """Record that the driver reads new data only after `seconds`."""
        unsure, self._read_from = self.unsure, self._now() + seconds
        if unsure:
            self._doubt()

    def _doubt(self) -> None:
        """Record that new data may contain flipped bits until UNSURE_S after it is read."""
        until = max(self._now(), self._read_from) + UNSURE_S
        self._unsure_until = max(until, self._unsure_until)

    def keeps_points(self) -> None:
        """Expect old points to be executed until a new client has sent STOP."""
        world, came = self._world, self._world.controller.client_connected

        def client_connected() -> None:
            came()
            world.arm.client_connected()
            world.loop.call_later(3.0 * world.delay + STOP_S, look, self._now())

        def look(since: float) -> None:
            held = world.network.stalled or world.loop.hanging or self.unsure
            if not held and not world.wishes.any(self._now()):
                world.arm.old_points_over(since)

        world.controller.client_connected = client_connected

    # --- a person ----------------------------------------------------------------------------

    async def pendant(self, event: str) -> None:
        """Perform an operator's event. If it undoes another, a reaction time passes before it."""
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
        world, name = self._world, text.split()[0]
        if world.statements and name in ON_ANY_PORT:
            text = f'{re.sub(" port=[a-z]+", "", text)} port=remote'
        with contextlib.suppress(FaultError), world.servers.pacer.present():  # there are many
            world.controller.faults.start(parse(text))
            self._doubt()
            if name == 'cut':  # the remote port fails a little later
                after = ANSWER_TIME_S if world.statements else 0.0
                world.loop.call_later(after, lambda: world.wishes.closed(self._now()))
        world.wishes.closed_meanwhile = True

    async def clear_faults(self) -> None:
        with self._world.servers.pacer.present():
            self._world.controller.faults.clear()

    async def worker_dies(self, which: str) -> None:
        self._world.wishes.closed_meanwhile = True
        if (worker := self._world.workers.last(which)) is not None:
            worker.end(1)

    async def worker_hangs(self, which: str) -> None:
        self._world.wishes.closed_meanwhile = True
        if (worker := self._world.workers.last(which)) is not None:
            worker.hangs = True

    # --- the network -------------------------------------------------------------------------

    def _number_of(self, port: str) -> int:
        number: int = getattr(self._world.ports, port if len(self.links) > 1 else self.links[0])
        return number

    async def network_stall(self, port: str, seconds: float) -> None:
        number = self._number_of(port)
        self._world.network.stall(number)
        self._world.users.held_up = self._now() + seconds
        self._world.loop.call_later(seconds, self._world.network.release, number)

    async def network_reset(self, port: str) -> None:
        self._world.network.reset(self._number_of(port))
        if self._world.controller.real_time:
            return  # DDS has no connections
        if port in self.links or self._world.statements:
            self._world.wishes.closed(self._now())

    async def network_half_close(self, port: str) -> None:
        """Half-close the connections of a port: the controller receives EOF from its clients."""
        self._world.network.half_close(self._number_of(port))

    async def network_flip(self, port: str, byte: int, bit: int) -> None:
        """Flip a bit of the controller's next data on a port."""

        def flipped(data: bytes) -> bytes:
            at = byte % len(data)
            return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]

        self._world.network.flips[self._number_of(port)] = flipped
        self._doubt()

    async def second_client(self, port: str, seconds: float) -> None:
        self._world.users.begin(self._stranger(port, seconds), 'a stranger')

    async def _stranger(self, port: str, seconds: float) -> None:
        with contextlib.suppress(OSError, TimeoutError):
            async with asyncio.timeout(5.0):
                _, writer = await asyncio.open_connection(HOST, self._number_of(port))
            if self._number_of(port) == self._world.ports.remote:
                writer.write(b'$Login,\r\n')
            await asyncio.sleep(seconds)
            writer.close()
