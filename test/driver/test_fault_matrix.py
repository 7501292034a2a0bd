# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every fault with the controller of every profile, in every phase of a motion.

test/support/fault_play.py has the checks of each cell. The quick tests have every second fault in
the middle of a motion with each profile, the slow tests the others, and a twelfth of the other
phases and interfaces. `make faults` and `make soak-tests` run all.
"""

import pytest
from support.event_loop import run
from support.fault_cells import USUAL, Cell, cells
from support.fault_play import play

CELLS = list(cells())
QUICK = [cell for cell in CELLS if cell.phase == 'moving' and cell.interface == USUAL]
OTHERS = [cell for cell in CELLS if cell not in QUICK]
SLOW = 'spel'
"""A slow profile, of which `make test` runs two faults."""


def name(cell: Cell) -> str:
    return cell.name


@pytest.mark.invariant(2, 3, 4, 5, 6)
@pytest.mark.parametrize(
    'cell',
    [
        pytest.param(cell, marks=pytest.mark.slow)
        if index % 2 or (cell.profile in SLOW and cell.fault not in {'e_stop', 'cut'})
        else cell
        for index, cell in enumerate(QUICK)
    ],
    ids=name,
)
def test_invariants_hold_after_a_fault_in_the_middle_of_a_motion(
    record_property, cell: Cell
) -> None:
    record_property('fault and profile', (cell.fault, cell.profile))
    run(play(cell))


@pytest.mark.invariant(2, 3, 4, 5, 6)
@pytest.mark.parametrize(
    'cell',
    [
        pytest.param(cell, marks=pytest.mark.soak if index % 12 else pytest.mark.slow)
        for index, cell in enumerate(OTHERS)
    ],
    ids=name,
)
def test_invariants_hold_after_a_fault_in_another_phase_or_interface(cell: Cell) -> None:
    run(play(cell))
