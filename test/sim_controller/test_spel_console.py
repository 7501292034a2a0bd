# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The terminal of `epson_driver spel run`: what it shows, and what it answers."""

import pytest

from epson_driver.sim_controller.spel_run import Console
from epson_driver.spel import Caller

MAIN = Caller(1, 'main', 'main.prg', 3)


def test_a_message_box_is_shown_and_nobody_presses_ok(capsys: pytest.CaptureFixture[str]) -> None:
    answer = Console().message_box(MAIN, 'Is the cell empty?', 4, 'Cell 4')
    assert capsys.readouterr().out == 'MsgBox Cell 4: Is the cell empty? (answered with Cancel)\n'
    assert answer == 2


def test_typed_lines_come_one_after_the_other() -> None:
    console = Console()
    assert console.read_line() is None
    console.typed('1')
    console.typed('2')
    assert [console.read_line() for _ in range(3)] == ['1', '2', None]
