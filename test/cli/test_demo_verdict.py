# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A run on a machine that is too busy is neither right nor wrong, and has its own exit code."""

import pytest

from epson_driver.cli import processes
from epson_driver.cli.demo_verdict import MAX_GAP_S, TOO_BUSY, deadlines_missed, verdict

FAULT = 'smooth: the arm stopped once on the way'


@pytest.mark.parametrize(
    ('faults', 'missed', 'gap', 'code', 'words'),
    [
        ([], 0, 0.01, 0, 'the arm did what was planned'),
        ([], 900, 3.0, 0, 'the arm did what was planned'),
        ([FAULT], 0, 0.01, 1, f'the motion was not as planned: {FAULT}'),
        ([FAULT], 0, MAX_GAP_S, 1, f'the motion was not as planned: {FAULT}'),
        (
            [FAULT],
            1,
            0.01,
            TOO_BUSY,
            'too busy to judge the motion: the simulated controller missed 1',
        ),
        ([FAULT], 0, 0.25, TOO_BUSY, 'joint states were up to 250 ms apart'),
    ],
)
def test_the_controllers_own_clock_tells_a_busy_machine(faults, missed, gap, code, words):
    found, sentence = verdict(faults, missed, gap)
    assert found == code
    assert words in sentence
    assert '\n' not in sentence


def test_the_simulated_controller_tells_what_it_missed(tmp_path):
    controller = processes.sim_controller(tmp_path / 'log', start=[0.0] * 6)
    with processes.ended_at_exit(controller):
        assert deadlines_missed(controller.ports().remote) >= 0
