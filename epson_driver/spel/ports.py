# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Statements of the network ports, and Print and Input for ports, files and the terminal.

A port belongs to the task that opened it until the task ends (SPEL+ manual p194).
"""

from collections.abc import Callable

from epson_driver.spel import file_access
from epson_driver.spel.actions import (
    fill,
    input_terminal,
    print_terminal,
    seconds,
    within,
)
from epson_driver.spel.errors import ErrorNumber, SpelError, bad
from epson_driver.spel.file_access import is_file
from epson_driver.spel.host import NetSettings
from epson_driver.spel.library import text_of
from epson_driver.spel.ranges import PORTS
from epson_driver.spel.task import Port, Reference, Task
from epson_driver.spel.values import LONGEST_STRING, TYPES, Array, Point, Value, nearest, store

_DISPLAYS = (0, 20, 21, 24)
"""Numbers of devices that display printed text, like the run window."""
_MAX_BYTES = 1_023
_LONGEST_LINE = 1_024
_TERMINATORS = {'cr': '\r', 'lf': '\n', 'crlf': '\r\n'}


def port_of(task: Task, name: str, number: float) -> Port:
    index = within(name, nearest(number), *PORTS)
    return task.world.ports.setdefault(index, Port())


def _taken(task: Task, port: Port) -> bool:
    return port.owner not in (0, task.number) and port.owner in task.world.tasks


def _usable(task: Task, name: str, number: float) -> Port:
    """Return a port. Raises SpelError if another task has opened it."""
    port = port_of(task, name, number)
    if _taken(task, port):
        text = f'{name}: port {nearest(number)} was opened by task {port.owner}'
        text += ': one task opens, uses and closes a port'
        raise SpelError(ErrorNumber.PORT_IN_USE, text)
    return port


def _opened(task: Task, name: str, number: int) -> Port:
    port = _usable(task, name, number)
    if port.owner == 0:
        raise SpelError(ErrorNumber.PORT_NOT_OPEN, f'{name}: port {number} is not open')
    return port


def set_net(
    task: Task,
    number: float,
    host: str,
    tcp_port: float | None,
    timeout: float | None = None,
    words: tuple[str, ...] = ('crlf', 'tcp'),
) -> None:
    """Execute `SetNet`. Without a TCP port, the port keeps the one that it has (p726)."""
    port = port_of(task, 'SetNet', number)
    wait = 0.0 if timeout is None else float(timeout)
    within('SetNet', nearest(wait), 0, 1_000_000)
    known = port.settings.tcp_port if tcp_port is None else nearest(tcp_port)
    tcp = within('SetNet', known, 1, 65_535)
    port.settings = NetSettings(host, tcp, _TERMINATORS[words[0]], wait)


def open_net(task: Task, number: float, words: tuple[str, ...] = ()) -> None:
    port = _usable(task, 'OpenNet', number)
    network = task.world.host.network
    if port.owner:
        network.close_net(nearest(number))
    network.open_net(nearest(number), port.settings, 'server' in words)
    port.owner = task.number


def close_net(task: Task, number: float | None) -> None:
    """Execute `CloseNet #n|All`. `All` excludes the ports of other running tasks."""
    ports = task.world.ports
    free = [item for item, port in ports.items() if not _taken(task, port)]
    for item in free if number is None else [nearest(number)]:
        port = _usable(task, 'CloseNet', item)
        if port.owner:
            task.world.host.network.close_net(item)
            port.owner = 0


def wait_net(task: Task, number: float, time: float | None = None) -> None:
    index = nearest(number)
    _opened(task, 'WaitNet', index)
    network = task.world.host.network
    limit = None if time is None else seconds(task, time)
    task.wait_or_time_out(limit, lambda: network.connected(index))


def check_net(task: Task, number: int) -> int:
    """Return the result of `ChkNet`.

    The result is the number of received bytes, -1 (no peer), -2 (another task's port) or -3
    (closed).
    """
    task.since_wait = 0  # a loop that reads inputs is not endless
    port = port_of(task, 'ChkNet', number)
    if port.owner == 0:
        return -3
    if _taken(task, port):
        return -2
    network = task.world.host.network
    return len(network.received(number)) if network.connected(number) else -1


def _receive(
    task: Task,
    name: str,
    number: int,
    ready: Callable[[bytes], int],
    use: Callable[[bytes], None],
    file_bytes: int = 1,
) -> None:
    """Wait until `ready` returns n > 0, then call `use` with the first n received bytes."""
    if is_file(number):
        use(file_access.read(task, name, number, file_bytes))
        return
    port = _opened(task, name, number)
    network = task.world.host.network

    def test() -> bool:
        return ready(network.received(number)) > 0 or not network.connected(number)

    def after(timed_out: bool) -> None:
        count = ready(network.received(number))
        if count > 0:
            use(network.take(number, count))
        elif timed_out:
            raise SpelError(ErrorNumber.READ_TIMEOUT, f'{name}: port {number} timed out')
        else:
            raise SpelError(ErrorNumber.NETWORK, f'{name}: port {number} has no peer')

    task.wait(port.settings.timeout or None, test, after)


def _send(task: Task, name: str, number: int, data: bytes) -> None:
    if is_file(number):
        file_access.write(task, name, number, data)
        return
    _opened(task, name, number)
    network = task.world.host.network
    if not network.connected(number):
        raise SpelError(ErrorNumber.NETWORK, f'{name}: port {number} has no peer')
    task.since_wait = 0
    network.send(number, data)


def _count(name: str, count: int | None, array: Array) -> int:
    maximum = min(len(array.d), _MAX_BYTES)
    if len(array.bounds) != 1:
        raise bad(name, 'needs an array of one dimension')
    return within(name, maximum if count is None else count, 1, maximum)


def _byte(value: int, type_name: str) -> Value:
    kind = TYPES[type_name]
    if kind.most < 255 and value > kind.most:
        value -= 256
    return store(value, type_name)


def read_bin(task: Task, number: int, into: Array | Reference, count: int | None) -> None:
    if isinstance(into, Array):
        size = _count('ReadBin', count, into)
        container, start, type_name = into.d, 0, into.type
    else:
        size = 1
        container, start, type_name = into

    def use(data: bytes) -> None:
        for place, value in enumerate(data, start):
            container[place] = _byte(value, type_name)

    _receive(task, 'ReadBin', number, lambda b: size if len(b) >= size else 0, use, size)


def write_bin(task: Task, number: int, what: Array | int, count: int | None) -> None:
    if isinstance(what, Array):
        values = what.d[: _count('WriteBin', count, what)]
        data = bytes(int(value) & 0xFF for value in values)
    else:
        data = bytes([what & 0xFF])
    _send(task, 'WriteBin', number, data)


def read(task: Task, number: int, into: Reference, count: int | None) -> None:
    """Execute `Read #n, s$[, count]`. A zero byte ends the string."""
    size = within('Read', 1 if count is None else count, 1, LONGEST_STRING)
    container, index, type_name = into

    def use(data: bytes) -> None:
        text = data.decode('latin-1').split('\0')[0]
        container[index] = store(text, type_name)

    _receive(task, 'Read', number, lambda b: size if len(b) >= size else 0, use, size)


def write(task: Task, number: int, text: str, _count: int | None = None) -> None:
    _send(task, 'Write', number, _encoded(text))


def _encoded(text: str) -> bytes:
    return text.encode('latin-1', 'replace')


def _line_end(data: bytes, terminator: bytes) -> int:
    """Return the length of the first line, including its end, or 0 if the line is incomplete."""
    at = data.find(terminator)
    if at >= 0:
        return at + len(terminator)
    return _LONGEST_LINE if len(data) >= _LONGEST_LINE else 0


def print_to(
    task: Task, number: int | None, items: tuple[tuple[Value | Point, str], ...], line: bool
) -> None:
    """Execute `Print [#n,] a, b[,]`. `line`: whether to print a line end."""
    text = ' '.join(text_of(value, kind) for value, kind in items)
    if number is None or number in _DISPLAYS:
        print_terminal(task, text + ('\n' if line else ' '))
        return
    if is_file(number):
        file_access.write(task, 'Print', number, _encoded(text + ('\r\n' if line else '')))
        return
    port = _opened(task, 'Print', number)
    _send(task, 'Print', number, _encoded(text + (port.settings.terminator if line else '')))


def input_from(
    task: Task, number: int | None, targets: tuple[Reference, ...], whole: bool
) -> None:
    """Execute `Input [#n,] a, b`, or `Line Input [#n,] s$` (`whole`).

    Without #n, read from the terminal.
    """
    if number is None:
        input_terminal(task, targets, whole)
        return
    name = 'Line Input' if whole else 'Input'
    if is_file(number):
        text = file_access.read(task, name, number, None).decode('latin-1')
        fill(name, text, targets, whole)
        return
    end = _opened(task, name, number).settings.terminator.encode()

    def use(data: bytes) -> None:
        fill(name, data.removesuffix(end).decode('latin-1'), targets, whole)

    _receive(task, name, number, lambda data: _line_end(data, end), use)


def lines_waiting(task: Task, number: int) -> int:
    """Return the result of `Lof`: the number of complete lines that were received."""
    port = port_of(task, 'Lof', number)
    if port.owner == 0:
        return 0
    return task.world.host.network.received(number).count(port.settings.terminator.encode())


NET_STATEMENTS: dict[str, Callable[..., None]] = {
    'setnet': set_net,
    'opennet': open_net,
    'closenet': close_net,
    'waitnet': wait_net,
    'readbin': read_bin,
    'writebin': write_bin,
    'read': read,
    'write': write,
    'print': print_to,
    'input': input_from,
}
