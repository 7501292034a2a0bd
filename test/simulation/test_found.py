# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Failures found by seeds, reduced to the fewest events."""

import pytest

from simulation.events import Event
from simulation.world import World


def world_of(profile):
    worlds = (World(str(seed)) for seed in range(1000))
    return next(world for world in worlds if world.profile_name == profile and not world.in_python)


@pytest.mark.invariant(9)
def test_inv9_output_read_while_the_link_ends_does_not_block_the_next_link():
    reset = Event(1.0, 'network_reset', {'port': 'motion'})
    world_of('remote').play([reset, Event(0.0, 'read_output', {'index': 0})])


@pytest.mark.invariant(4)
def test_inv4_first_message_delayed_in_a_page_counts_as_late():
    hand = {'axis': 'X', 'frame': 'world', 'share': 0.25, 'arms': True, 'seconds': 0.8}
    World('1100000018').play(
        [
            Event(0.01, 'panel_line_stalls', {'seconds': 1.7}),
            Event(0.28, 'panel_jog', hand),
            Event(0.27, 'panel_page_freezes', {'seconds': 3.0}),
            Event(2.5, 'stop', {}),
        ]
    )


@pytest.mark.invariant(4)
def test_inv4_goal_ends_when_a_user_stops_the_program():
    """Its points are delayed until the program runs again."""
    World('832062190').play(
        [
            Event(1.4664, 'goal', {'step': 0.1, 'offsets': [[0.004] * 6] * 2, 'from_here': True}),
            Event(0.0003, 'pendant', {'event': 'STOP'}),
            Event(0.0103, 'network_stall', {'port': 'motion', 'seconds': 0.681}),
            Event(0.0003, 'mend', {}),
        ]
    )


@pytest.mark.invariant(5, 9)
def test_inv9_goal_ends_if_a_motoman_can_no_longer_plan():
    """It had answered all points, so the goal waited forever, like during a pause."""
    World('20').play([Event(4.5819, 'worker_hangs', {'which': 'planner'})])


NOWHERE = {'offsets': [[0.0] * 6], 'from_here': True}
FAR = {'step': 0.05, 'offsets': [[0.2] * 6, [-0.2] * 6] * 3, 'from_here': False}


@pytest.mark.parametrize(
    ('seed', 'events'),
    [
        ('3400000025', [Event(0.2, 'goal', FAR), Event(0.15, 'stop', {})]),
        (
            '3400000007',
            [
                *(Event(0.7, 'mend', {}) for _ in range(8)),
                Event(1.0, 'pendant', {'event': 'MOTORS_OFF'}),
                Event(0.15, 'pendant', {'event': 'MOTORS_ON'}),
                Event(0.9, 'goal', FAR),
            ],
        ),
        (
            '4709',
            [
                Event(0.0, 'goal', FAR | {'step': 1.0}),
                Event(0.01, 'driver_hangs', {'seconds': 2.0}),
                Event(1.34, 'driver_leaves', {'seconds': 0.7, 'lost': True}),
            ],
        ),
        (
            '23357',
            [
                Event(6.4935, 'driver_hangs', {'seconds': 2.0}),
                Event(0.0003, 'fault', {'text': 'bit_errors rate=0.2 for=0.3'}),
                Event(0.2052, 'cancel', {}),
            ],
        ),
        (
            '529',
            [
                Event(2.215, 'goal', NOWHERE | {'step': 0.05}),
                Event(0.01, 'goal', NOWHERE | {'step': 0.1, 'offsets': [[1e-4] * 6]}),
                Event(0.084, 'enable', {}),
            ],
        ),
    ],
    ids=[
        'braking after a new client',
        'a rare STATUS',
        'a stalled driver ends a goal later',
        'bit errors during a stall',
        'a goal at its end before it starts',
    ],
)
def test_correct_behaviour_is_not_reported_as_a_failure(seed, events):
    World(seed).play(events)
