# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A host without robot or network: bits that stay as they are set, motions that are over at once.

For testing functions of a program, and the interpreter itself.
"""

from collections.abc import Callable, Sequence

from epson_driver.spel.errors import ErrorNumber, SpelError, TaskError
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.host import (
    Caller,
    Completion,
    Memory,
    MotionRequest,
)
from epson_driver.spel.loopback import Loopback
from epson_driver.spel.values import Array, Point, Value, nearest

MOTORS_OFF = 4031
_MOST_BITS = 65_536
_SETTINGS = {'speed': 5, 'accel': 5, 'speeds': 50, 'accels': 200, 'speedfactor': 100,
    'tool': 0, 'limz': 0, 'cp': 0, 'arm': 0, 'robot': 1,
}  # fmt: skip


OF_A_ROBOT = frozenset(
    {'agl', 'pls', 'realpls', 'ppls', 'pagl', 'jrange', 'ptptime', 'where', 'joint'}
)


class BareHost(Loopback):
    """Keeps what a program sets, and what it prints."""

    def __init__(self, show: Callable[[str], None] | None = None) -> None:
        super().__init__()
        self.printed: list[str] = []
        self.failures: list[TaskError] = []
        self.moves: list[MotionRequest] = []
        self.typed: list[str] = []
        self.answer = 2
        """What a person presses in a MsgBox: Cancel."""
        self.bits: dict[Memory, dict[int, int]] = {memory: {} for memory in Memory}
        self.states: dict[str, int] = {}
        """What EStopOn, SafetyOn, CtrlInfo and others return; 0 if they are not in it."""
        self.motors = False
        self.power = False
        self.settings: dict[str, tuple[float, ...]] = {}
        self.here = Point('xy', (0.0,) * 6)
        self.tools: dict[int, Point] = {}
        self._show = show
        self.terminal = self.network = self

    # Terminal

    def write(self, _caller: Caller, text: str) -> None:
        """Keep and show a text."""
        self.printed.append(text)
        if self._show is not None:
            self._show(text)

    def read_line(self) -> str | None:
        """Return what was put into `typed`."""
        return self.typed.pop(0) if self.typed else None

    def message_box(self, caller: Caller, text: str, _buttons: int, title: str) -> int | None:
        """Show the text and return `answer`."""
        self.write(caller, f'{title}: {text}\n')
        return self.answer

    # Network: the program's own ports are each other's peers

    def orphan_net(self, _port: int) -> None:
        """Take note of nothing."""

    # Bits

    def read_bits(self, memory: Memory, index: int, width: int) -> int:
        """Return what was written."""
        first = self._first(index, width)
        bits = self.bits[memory]
        return sum(bits.get(first + each, 0) << each for each in range(width))

    def write_bits(self, memory: Memory, index: int, width: int, value: int) -> None:
        """Keep a value."""
        first = self._first(index, width)
        for each in range(width):
            self.bits[memory][first + each] = value >> each & 1

    def _first(self, index: int, width: int) -> int:
        if not 0 <= index * width <= _MOST_BITS - width:
            raise SpelError(ErrorNumber.ARGUMENT, f'there is no bit or port {index}')
        return index * width

    # The robot

    def value(self, name: str, arguments: Sequence[int | float | Point]) -> float | Point | str:
        """Return what was set, or 0."""
        if name in ('here', 'curpos', 'realpos', 'findpos'):
            return self.here
        if name == 'ljm':
            return arguments[0]
        if name in ('cx', 'cy', 'cz', 'cu', 'cv', 'cw'):
            point = arguments[0]
            axis = 'xyzuvw'.index(name[1])
            if not isinstance(point, Point) or point.kind != 'xy':
                raise SpelError(ErrorNumber.ARGUMENT, f'{name.upper()}: no place in space')
            return point.values[axis]
        if name in ('motor', 'power'):
            return int(self.motors if name == 'motor' else self.power)
        if name == 'tlset':
            return self.tools.get(int(arguments[0]), Point('xy', (0.0,) * 6))  # type: ignore[arg-type]
        if name == 'tldef':
            return -(arguments[0] in self.tools)
        if name in _SETTINGS:
            values = self.settings.get(name) or (_SETTINGS[name],)
            which = arguments[0] if arguments else 1
            return values[min(int(which), len(values)) - 1]  # type: ignore[arg-type]
        if name == 'targetok':
            return self.states.get(name, -1)
        if name in OF_A_ROBOT - self.states.keys():
            word = FUNCTIONS[name].name if name in FUNCTIONS else name.capitalize()
            text = f'{word} needs the joints of a robot: run it on a simulated controller'
            raise SpelError(ErrorNumber.NOT_SIMULATED, text)
        return self.states.get(name, '' if name.endswith('$') else 0)

    def command(
        self, name: str, arguments: Sequence[Value | Point | None], words: tuple[str, ...]
    ) -> Completion | None:
        """Keep a setting."""
        if name == 'motor':
            self.motors = 'on' in words
        elif name == 'power':
            self.power = 'high' in words
        elif name == 'cp':
            self.settings[name] = (float('on' in words),)
            return None
        if name == 'tlset':
            number, tool = arguments
            assert isinstance(tool, Point)  # noqa: S101 - its form says so
            self.tools[nearest(number)] = tool  # type: ignore[arg-type]
        self.settings[name] = tuple(
            float(each) for each in arguments if isinstance(each, int | float)
        )
        return None

    def move(self, request: MotionRequest) -> Completion:
        """Be there at once."""
        if not self.motors:
            raise SpelError(MOTORS_OFF, 'motion attempted with the motors off')
        self.moves.append(request)
        self.here = request.points[-1]
        return Done()

    def stored_point(self, point: Point) -> Point:
        """Return the point unchanged, as no robot gives it a posture."""
        return point

    # Tasks

    def call_library(
        self, library: str, name: str, _arguments: Sequence[Value | Array]
    ) -> int | float:
        """Refuse: there is no DLL."""
        raise SpelError(ErrorNumber.NO_LIBRARY, f'{name} of {library}')

    def task_failed(self, error: TaskError) -> None:
        """Keep the error."""
        self.failures.append(error)

    def paused(self, _on: bool) -> bool:
        """Let the tasks go on at once."""
        return True


class Done:
    """Something that is over."""

    done = True
    error = None
    share = 1.0
