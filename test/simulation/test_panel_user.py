# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Motions of a panel user end with the page, and the simulation detects it if they do not."""

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
    """Return a world with a controller of this profile and a fast network."""
    worlds = (World(str(seed)) for seed in range(1000))
    return next(world for world in worlds if world.profile_name == profile and world.delay < 0.01)


def play(profile, *events):
    world = world_of(profile)
    world.play([*READY, *events, LATER])
    return '\n'.join(world.log)


@pytest.mark.invariant(3, 4)
def test_inv3_frozen_page_ends_its_goal():
    log = play('simulated', STEP, FREEZE)
    assert 'the armed window is frozen, hidden or disconnected' in log
    assert 'goal 1: canceled' in log


def test_goal_that_outlives_its_page_is_detected(monkeypatch):
    monkeypatch.setattr(Arming, 'watch', lambda self: None)
    with pytest.raises(BrokenError, match=r'3: the arm still moves|4: the arm moves'):
        play('simulated', STEP, FREEZE)


@pytest.mark.invariant(3, 4)
def test_inv3_button_pressed_in_a_frozen_page_moves_nothing():
    assert 'panel disarmed' in play('simulated', JOG, FREEZE)


def test_stream_that_outlives_its_sender_is_detected(monkeypatch):
    monkeypatch.setattr(Arming, 'watch', lambda self: None)  # it would end the stream
    init = Servo.__init__

    def patient(self, *arguments):
        init(self, *arguments)
        self.settings = ServoSettings(timeout=60.0)

    monkeypatch.setattr(Servo, '__init__', patient)
    with pytest.raises(BrokenError, match=r'3: the arm still moves|4: the arm moves'):
        play('simulated', JOG, FREEZE)


STALL = Event(0.5, 'panel_line_stalls', {'seconds': 4.0})


@pytest.mark.invariant(4)
def test_inv4_delayed_jog_messages_move_nothing():
    play('simulated', JOG, STALL)
