# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""controller_program/ on a simple robot, with clients controlled by the test.

Only `RobotHarness.run` advances the controller's clock, in steps of 5 ms. The same calls give the
same bytes.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    Framer,
    JointTrajPt,
    Packet,
    decode,
    encode,
    joint_data,
    request,
    topic,
)
from epson_driver.spel import (
    ErrorNumber,
    Machine,
    MotionRequest,
    NetSettings,
    Point,
    SpelError,
    TaskType,
    Timing,
    Value,
    build,
    read_project,
)
from support.spel_harness import ScriptedHost

FOLDER = Path(__file__).parents[2] / 'controller_program'
FILES = read_project(FOLDER)

STATE_PORT, MOTION_PORT, IO_PORT = 201, 202, 203
PULSES = (29127.11, 29127.11, 25486.22, 23616.58, 23616.58, 18204.44)
"""Pulses per degree of each joint."""
LOWEST = (-170.0, -160.0, -51.0, -200.0, -135.0, -360.0)
HIGHEST = (170.0, 65.0, 225.0, 200.0, 135.0, 360.0)
FASTEST = (450.0, 450.0, 514.0, 553.0, 553.0, 720.0)
"""Degrees, degrees/s."""
BRAKING_S = 0.05
"""Time for which the arm decelerates after a stop, s."""
OUT_OF_RANGE, TASK_GONE = 4001, 2261
STEP_S = 0.005

_machines: list[Machine] | None = None


class Move:
    """A motion along a line in joint space at constant speed."""

    def __init__(
        self, start: Sequence[float], end: Sequence[float], begins: float, duration: float
    ) -> None:
        self.start, self.end, self.begins = tuple(start), tuple(end), begins
        self.duration = duration
        self.request: MotionRequest | None = None
        self.over = False
        self.error: SpelError | None = None

    @property
    def done(self) -> bool:
        """Whether the statement has ended."""
        return self.over

    @property
    def fraction(self) -> float:
        """1 after the end, else 0."""
        return float(self.over)

    def at(self, now: float) -> tuple[float, ...]:
        """Return the joints at a time, degrees."""
        fraction = min((now - self.begins) / self.duration, 1.0) if self.duration > 0.0 else 1.0
        return tuple(a + fraction * (b - a) for a, b in zip(self.start, self.end, strict=True))


class Rest:
    """The condition of WaitPos."""

    error = None

    def __init__(self, robot: 'SimpleRobot') -> None:
        self._robot = robot

    @property
    def done(self) -> bool:
        """Whether the arm is at rest."""
        return self._robot.move_now is None

    @property
    def fraction(self) -> float:
        """1 after the end, else 0."""
        return float(self.done)


class Socket:
    """A port opened by the program, and its client."""

    def __init__(self, settings: NetSettings) -> None:
        self.settings = settings
        self.connected = False
        self.incoming = b''
        self.sent = b''
        self.closed_by_program = False


class SimpleRobot(ScriptedHost):
    """An arm with six joints, motors and conditions on the machine's clock."""

    def __init__(self) -> None:
        super().__init__()
        self.sockets: dict[int, Socket] = {}
        self.joints: tuple[float, ...] = (0.0, -10.0, 20.0, 0.0, 30.0, 0.0)
        self.move_now: Move | None = None
        self.gone_to: list[tuple[tuple[float, ...], float, float, bool]] = []
        """Targets of Go with Speed, Accel and whether it had CP."""
        self.times: list[float] = []
        """Start time of each of them, s."""
        self.path: list[tuple[float, tuple[float, ...]]] = []
        self.fails_with = 0
        self.states.update(ctrlinfo=1)
        self.till_works = True
        self.sends = True
        self.sign = 1
        """-1: pulses count down as degrees go up."""
        self.till_on = 0

    @property
    def now(self) -> float:
        """Return the controller's time, s."""
        assert self.machine is not None
        return self.machine.time

    @property
    def position(self) -> tuple[float, ...]:
        """Return the joints, degrees."""
        return self.joints if self.move_now is None else self.move_now.at(self.now)

    def tick(self) -> None:
        """Move the arm to its current position, and evaluate Till."""
        self.path.append((self.now, self.position))
        move = self.move_now
        if move is None:
            return
        if self.now >= move.begins + move.duration:
            self._rest(move)
            return
        if move.request is None or move.request.till is None or not self.till_works:
            return
        try:
            stops = move.request.till()
        except SpelError as error:
            move.error = error
            self._rest(move)
            return
        if stops:
            self._brake(move)

    def _rest(self, move: Move) -> None:
        self.joints = move.at(self.now)
        self.move_now = None
        move.over = True

    def _brake(self, move: Move) -> None:
        """Continue along the line for the braking time, then end."""
        self.till_on = -1
        here = move.at(self.now)
        further = move.at(self.now + BRAKING_S / 2)
        move.start, move.end = here, further
        move.begins, move.duration = self.now, BRAKING_S
        move.request = None

    def halt(self) -> None:
        """Stop immediately with motors off, as an E-stop does."""
        move = self.move_now
        self.joints = self.position
        self.motors = self.power = False
        self.move_now = None
        if move is not None:
            move.over = True

    # The program's side

    def value(self, name: str, arguments: Sequence[int | float | Point]) -> float | Point | str:
        first = arguments[0] if arguments else 0
        if name in ('agl', 'realpls', 'pls'):
            index = int(first) - 1  # type: ignore[arg-type]
            angle = self.position[index]
            return angle if name == 'agl' else round(angle * PULSES[index] * self.sign)
        if name == 'ppls':
            assert isinstance(first, Point)
            assert first.kind == 'angles'
            index = int(arguments[1]) - 1  # type: ignore[arg-type]
            return round(first.values[index] * PULSES[index] * self.sign)
        if name == 'jrange':
            index = int(first) - 1  # type: ignore[arg-type]
            ends = [item[index] * PULSES[index] * self.sign for item in (LOWEST, HIGHEST)]
            return round(sorted(ends)[int(arguments[1]) - 1])  # type: ignore[arg-type]
        if name == 'robotinfo':
            return 0x200 if self.move_now is not None else 0
        if name == 'tillon':
            return self.till_on
        if name == 'inpos':
            return int(self.move_now is None)
        return super().value(name, arguments)

    def command(
        self, name: str, arguments: Sequence[Value | Point | None], words: tuple[str, ...]
    ) -> Rest | None:
        super().command(name, arguments, words)
        if name == 'motor':
            self.power = False
        return Rest(self) if name == 'waitpos' else None

    def move(self, request: MotionRequest) -> Move:
        super().move(request)
        if self.fails_with:
            number, self.fails_with = self.fails_with, 0
            raise SpelError(number)
        target = request.points[0].values
        for value, low, high in zip(target, LOWEST, HIGHEST, strict=True):
            if not low <= value <= high:
                raise SpelError(OUT_OF_RANGE)
        speed = self.settings['speed'][0] if self.power else 5.0
        asked, accel = self.settings['speed'][0], self.settings['accel'][0]
        self.gone_to.append((target, asked, accel, request.cp))
        self.times.append(self.now)
        start = self.position
        self.till_on = 0
        way = max(abs(b - a) / most for a, b, most in zip(start, target, FASTEST, strict=True))
        move = Move(start, target, self.now, way / speed * 100.0)
        move.request = request
        self.move_now = move
        if request.till is not None and self.till_works and request.till():
            move.end, move.duration = move.start, 0.0
        return move

    # Ports

    def open_net(self, port: int, settings: NetSettings, server: bool) -> None:
        assert server
        self.sockets[port] = Socket(settings)

    def close_net(self, port: int) -> None:
        socket = self.sockets.pop(port)
        socket.closed_by_program = True
        socket.connected = False

    def connected(self, port: int) -> bool:
        return port in self.sockets and self.sockets[port].connected

    def received(self, port: int) -> bytes:
        return self.sockets[port].incoming if port in self.sockets else b''

    def take(self, port: int, count: int) -> bytes:
        socket = self.sockets[port]
        taken, socket.incoming = socket.incoming[:count], socket.incoming[count:]
        return taken

    def send(self, port: int, data: bytes) -> None:
        if not self.connected(port) or not self.sends:
            raise SpelError(ErrorNumber.NETWORK)
        self.sockets[port].sent += data


class Client:
    """A client of one port."""

    def __init__(self, socket: Socket) -> None:
        self.socket = socket
        self._taken = 0
        self._framer = Framer(LITTLE_ENDIAN.byte_order)
        socket.connected = True

    @property
    def open(self) -> bool:
        """Whether the program has kept the connection."""
        return not self.socket.closed_by_program

    def send(self, *packets: Packet) -> None:
        """Send messages."""
        self.send_bytes(b''.join(encode(packet, LITTLE_ENDIAN) for packet in packets))

    def send_bytes(self, data: bytes) -> None:
        """Send bytes."""
        self.socket.incoming += data

    def raw(self) -> bytes:
        """Return the bytes received since the last call."""
        data = self.socket.sent[self._taken :]
        self._taken = len(self.socket.sent)
        return data

    def packets(self) -> list[Packet]:
        """Return the messages received since the last call."""
        self._framer.receive_data(self.raw())
        result = []
        while (frame := self._framer.next_frame()) is not None:
            result.append(decode(frame))
        return result

    def replies(self) -> list[tuple[int, int]]:
        """Return sequence and reply code of the replies since the last call."""
        result: list[Any] = self.packets()
        return [(item.message.sequence, int(item.reply_code)) for item in result]

    def leave(self) -> None:
        """Disconnect."""
        self.socket.connected = False


class RobotHarness:
    """The program on the robot. `ready`: motors on and main running, as after an enable.

    changes: other values in config.inc. FULL_POWER is on by default.
    """

    def __init__(self, ready: bool = True, sign: int = 1, **changes: str) -> None:
        self.robot = SimpleRobot()
        self.robot.sign = sign
        program = build(changed(**{**SET_UP, **changes})) if changes else _PROGRAM
        self.machine = Machine(program, self.robot, Timing())
        self.robot.machine = self.machine
        if _machines is not None:
            _machines.append(self.machine)
        self._next = 0.0
        if 'bgmain' in program.by_name:
            self.machine.start_background()
        if ready:
            self.robot.motors = True
            self.start_main()
        self.run(0.3)

    def start_main(self) -> None:
        """Start main without clearing global variables, like Start."""
        self.machine.start('main', clear=False)

    def run(self, seconds: float) -> None:
        """Advance the time."""
        end = self.machine.time + seconds
        while self.machine.time < end:
            self._next += STEP_S
            self.machine.advance(self._next)
            self.robot.tick()

    def run_until(self, done, seconds: float = 20.0) -> None:
        """Advance the time until a condition holds. Fail after `seconds`."""
        end = self.machine.time + seconds
        while not done():
            assert self.machine.time < end, 'the condition did not become true'
            self.run(STEP_S)

    def client(self, port: int = MOTION_PORT) -> Client:
        """Connect."""
        self.run_until(lambda: port in self.robot.sockets)
        client = Client(self.robot.sockets[port])
        self.run(0.2)
        return client

    def stream(self, client: Client, points: Sequence[JointTrajPt]) -> list[tuple[int, int]]:
        """Send points, each after the reply to the previous one, and return the replies."""
        answers: list[tuple[int, int]] = []
        for point in points:
            client.send(request(point))
            got: list[tuple[int, int]] = []

            def answered(got: list[tuple[int, int]] = got) -> bool:
                got.extend(client.replies())
                return bool(got)

            self.run_until(answered)
            answers.extend(got)
        return answers

    def rest(self) -> None:
        """Advance the time until the arm is at rest without points."""
        self.run(0.3)
        self.run_until(
            lambda: self.robot.move_now is None and self.shared('g_head') == self.shared('g_tail')
        )

    def shared(self, name: str) -> object:
        """Return a variable of the program."""
        names = [variable.name.lower() for variable in self.machine.world.program.variables]
        return self.machine.world.g[names.index(name.lower())]

    def task(self, number: int) -> bool:
        """Return whether a task is running."""
        return number in self.machine.world.tasks

    def press_estop(self) -> None:
        """Press the E-stop."""
        self.robot.states['estopon'] = -1
        self.robot.halt()
        self.machine.emergency_stop()

    def enable(self) -> None:
        """Release the E-stop, reset, switch motors on and start main."""
        self.robot.states['estopon'] = 0
        self.robot.states['erroron'] = 0
        self.machine.stop()
        self.machine.clear_errors()
        self.robot.motors = True
        self.start_main()
        self.run(0.3)


@contextmanager
def executed_lines() -> Iterator[dict[str, dict[int, bool]]]:
    """Yield a dict, filled at the end: by file and line, whether a machine has executed it."""
    global _machines
    _machines = []
    result: dict[str, dict[int, bool]] = {}
    try:
        yield result
    finally:
        for machine in _machines:
            for file, lines in machine.lines().items():
                merged = result.setdefault(file, {})
                for number, executed in lines.items():
                    merged[number] = merged.get(number, False) or executed
        _machines = None


def changed(**values: str) -> dict[str, str]:
    """Return the files with other values in config.inc ('' disables a switch, '1' enables it)."""
    lines = []
    left = dict(values)
    for line in FILES['config.inc'].split('\n'):
        words = line.lstrip("'").split(maxsplit=2)
        if len(words) == 3 and words[0] == '#define' and words[1] in left:
            value = left.pop(words[1])
            lines.append(f'#define {words[1]} {value}' if value else "'")
        else:
            lines.append(line)
    assert not left, f'config.inc has no {left}'
    return {**FILES, 'config.inc': '\n'.join(lines)}


SET_UP = {'FULL_POWER': '1', 'IO_FIRST_OUTPUT_BYTE': '0'}
"""As after the first run, without remote outputs."""

_PROGRAM = build(changed(**SET_UP))


def point(
    sequence: int, degrees: Sequence[float], duration: float = 0.2, velocity: float = 0.0
) -> JointTrajPt:
    """Return a point, joints in degrees."""
    radians = [value * 0.017453292519943295 for value in degrees]
    return JointTrajPt(sequence, joint_data(radians), velocity, duration)


def moved(start: Sequence[float], **joints: float) -> tuple[float, ...]:
    """Return joints, degrees, with some of them moved: j1=5."""
    values = list(start)
    for name, value in joints.items():
        values[int(name[1]) - 1] += value
    return tuple(values)


__all__ = [
    'FILES',
    'IO_PORT',
    'MOTION_PORT',
    'STATE_PORT',
    'TaskType',
    'changed',
    'moved',
    'point',
    'request',
    'topic',
]
