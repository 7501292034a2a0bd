# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`/diagnostics` of the real node during an E-stop and a restart of the controller."""

from pathlib import Path
from typing import Any

from support.cell import Cell

OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))


def rows(cell: Cell) -> dict[str, Any]:
    """Return the statuses of the newest message, by part."""
    if not cell.peer.diagnostics:
        return {}
    return {status.name.partition(': ')[2]: status for status in cell.peer.diagnostics[-1].status}


def values(status: Any) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def wait(cell: Cell, part: str, level: bytes, text: str = '') -> dict[str, str]:
    """Wait until a status has the level and the text, and return its values."""

    shown_values: dict[str, str] = {}

    def there() -> bool:
        status = rows(cell).get(part)
        if status is not None and status.level == level and text in status.message:
            shown_values.update(values(status))
        return bool(shown_values)

    cell.peer.wait_for(there, f'{part} at level {level!r}: {text}')
    return shown_values


def test_diagnostics_follow_an_estop_and_a_controller_restart(tmp_path: Path) -> None:
    cell = Cell(tmp_path)
    try:
        cell.ready()
        wait(cell, 'arm', WARN, 'not enabled since the driver started')
        cell.peer.enable()
        assert wait(cell, 'arm', OK, 'enabled')['arm gate'] == 'open'

        cell.pendant('estop', 'press')
        shown = wait(cell, 'arm', ERROR, 'motion task not running')
        assert shown['error code'] == '2261'
        assert (shown['cause'], shown['remedy']) == ('ESTOP', 'RELEASE_ESTOP')
        assert 'E-stop' in shown['arm gate reason']

        cell.controller.end()
        assert wait(cell, 'arm', STALE, 'no link')['cause'] == 'NO_STATE_LINK'
        for link in ('state link', 'motion link'):
            shown = wait(cell, link, ERROR)
            assert 'uptime [s]' not in shown

        cell.restart_controller()
        for link in ('state link', 'motion link'):
            shown = wait(cell, link, OK)
            assert int(shown['reconnects']) >= 1
            assert float(shown['uptime [s]']) >= 0.0
        shown = wait(cell, 'arm', WARN, 'not enabled')
        assert shown['arm gate'] == 'closed'
        assert float(shown['age of joint state [ms]']) < 1000.0
    finally:
        cell.close()
