# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The keys of `epson_driver jog`."""

import pytest

from epson_driver.cli.jog_keys import MAX_SPEED, MIN_SPEED, RELEASE_S, JogKeys


def test_a_held_key_moves_its_joint_and_released_it_stops():
    keys = JogKeys(6, 0.1)
    assert keys.velocity(0.0) is None
    for count in range(10):
        keys.press('3', 0.03 * count)
        assert keys.velocity(0.03 * count) == (2, 0.1)
    assert keys.velocity(0.27 + 0.9 * RELEASE_S) == (2, 0.1)
    assert keys.velocity(0.27 + RELEASE_S) is None


def test_the_keys_below_move_back():
    keys = JogKeys(6, 0.1)
    keys.press('e', 0.0)
    assert keys.velocity(0.0) == (2, -0.1)


@pytest.mark.parametrize('key', [' ', '7', 'u', 'Q', '\n', 'é', '+'])
def test_any_other_key_stops(key):
    keys = JogKeys(6, 0.1)
    keys.press('1', 0.0)
    keys.press(key, 0.01)
    assert keys.velocity(0.01) is None
    assert not keys.ended


@pytest.mark.parametrize('key', ['x', '\x1b', '\x03', '\x04', ''])
def test_it_ends_at_rest(key):
    keys = JogKeys(6, 0.1)
    keys.press('1', 0.0)
    keys.press(key, 0.01)
    assert keys.ended
    assert keys.velocity(0.01) is None


def test_the_speed_changes_within_bounds():
    keys = JogKeys(6, 0.1)
    keys.press('+', 0.0)
    assert keys.speed == pytest.approx(0.15)
    for _ in range(50):
        keys.press('+', 0.0)
    assert keys.speed == MAX_SPEED
    for _ in range(50):
        keys.press('-', 0.0)
    assert keys.speed == MIN_SPEED
