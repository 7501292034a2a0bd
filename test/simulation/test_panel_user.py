# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a person at the panel has started ends with its page, and the simulation would see it."""

import pytest

from epson_driver.driver.servo.servo import Servo
from epson_driver.driver.servo.setpoint import ServoSettings
from epson_driver.panel.arming import Arming
from simulation.events import Event
from simulation.oracles import BrokenError
from simulation.world import World

HAND = {'axis': '1', 'frame': 'world', 'share': 0.5, 'arms': True}
READY = [Event(1.5, 'panel_arm', {}), Event(0.2, 'panel_enable', {}), Event(1.0, 'panel_arm', {})]
STEP = Event(0.1, 'panel_step', HAND | {'share': 0.05, 'size': 0.5})
JOG = Event(0.1, 'panel_jog', HAND | {'seconds': 20.0})
FREEZE = Event(0.5, 'panel_page_freezes', {'seconds': 30.0})
LATER = Event(6.0, 'goal', {'step': 1.0, 'offsets': [[0.0] * 6], 'from_here': True})


def world_of(profile):
    """Return a world with a controller of that profile and a quick network."""
    worlds = (World(str(seed)) for seed in range(1000))
    return next(each for each in worlds if each.profile_name == profile and each.delay < 0.01)


def play(profile, *events):
    world = world_of(profile)
    world.play([*READY, *events, LATER])
    return '\n'.join(world.log)


@pytest.mark.invariant(3, 4)
def test_a_page_that_freezes_takes_its_goal_with_it():
    log = play('rc700a', STEP, FREEZE)
    assert 'the armed window is frozen, hidden or cut off' in log
    assert 'goal 1: canceled' in log


def test_a_goal_that_outlives_its_page_is_seen(monkeypatch):
    monkeypatch.setattr(Arming, 'watch', lambda self: None)
    with pytest.raises(BrokenError, match=r'3: the arm still moves|4: the arm moves'):
        play('rc700a', STEP, FREEZE)


@pytest.mark.invariant(3, 4)
def test_a_button_that_is_held_in_a_frozen_page_moves_nothing():
    assert 'panel disarmed' in play('rc700a', JOG, FREEZE)


def test_a_stream_that_outlives_its_sender_is_seen(monkeypatch):
    monkeypatch.setattr(Arming, 'watch', lambda self: None)  # which would end it
    init = Servo.__init__

    def patient(self, *arguments):
        init(self, *arguments)
        self.settings = ServoSettings(timeout=60.0)

    monkeypatch.setattr(Servo, '__init__', patient)
    with pytest.raises(BrokenError, match=r'3: the arm still moves|4: the arm moves'):
        play('rc700a', JOG, FREEZE)


STALL = Event(0.5, 'panel_line_stalls', {'seconds': 4.0})


@pytest.mark.invariant(4)
def test_what_a_line_has_held_up_moves_nothing():
    play('rc700a', JOG, STALL)
