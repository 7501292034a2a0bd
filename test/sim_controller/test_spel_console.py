# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The terminal of `epson_driver spel run`."""

import pytest

from epson_driver.sim_controller.spel_run import Console
from epson_driver.spel import Caller

MAIN = Caller(1, 'main', 'main.prg', 3)


def test_message_box_is_printed_and_cancelled(
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer = Console().message_box(MAIN, 'Is the cell empty?', 4, 'Cell 4')
    assert capsys.readouterr().out == 'MsgBox Cell 4: Is the cell empty? (answered with Cancel)\n'
    assert answer == 2


def test_typed_lines_are_read_in_order() -> None:
    console = Console()
    assert console.read_line() is None
    console.typed('1')
    console.typed('2')
    assert [console.read_line() for _ in range(3)] == ['1', '2', None]
