# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""An unrequested output, or an output that differs from its answer, is detected."""

import pytest

from epson_driver.profiles import load_controller_profile
from epson_driver.sim_controller.io.io_points import IoPoints
from epson_driver.simple_message import IoType
from simulation.oracles import LATE_WRITE_S, Outputs


class World:
    def __init__(self):
        self.now = 0.0
        self.broken = []
        self.points = IoPoints(load_controller_profile('simulated').io)
        self.outputs = Outputs(self.points, lambda: self.now, self.broken.append)

    def write(self, value):
        self.points.write(IoType.DIGITAL_OUTPUT, 1, value)


@pytest.fixture
def world():
    return World()


def broken(world):
    return [str(failure).partition(':')[0] for failure in world.broken]


def test_requested_value_and_safe_value_are_accepted(world):
    with world.outputs.reading(1) as held:
        with world.outputs.writing(1, 1) as writing:
            world.write(1)
            writing.done()
        world.points.reset()
    assert held == {0, 1}
    assert not world.broken


@pytest.mark.invariant(1)
def test_inv1_unrequested_value_is_detected(world):
    world.write(1)
    assert broken(world) == ['1']


@pytest.mark.invariant(1)
@pytest.mark.parametrize(
    ('after', 'seen'), [(LATE_WRITE_S - 1.0, []), (LATE_WRITE_S + 1.0, ['1'])]
)
def test_inv1_write_without_an_answer_may_take_effect_for_a_limited_time(world, after, seen):
    with world.outputs.writing(1, 1):
        pass
    world.now = after
    world.write(1)
    assert broken(world) == seen


@pytest.mark.invariant(9)
def test_inv9_false_answer_is_detected(world):
    with world.outputs.writing(1, 1) as writing:
        writing.done()
    assert broken(world) == ['9']
