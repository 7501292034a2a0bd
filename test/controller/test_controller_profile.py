# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
import pytest
import yaml

from epson_driver.controller.profile import ControllerProfileError, load_controller_profile
from epson_driver.share import share_file
from epson_driver.simple_message import ByteOrder, Mode


def test_the_rc620_is_as_the_thesis_measured_it():
    profile = load_controller_profile('rc620')
    assert profile.name == 'rc620'
    assert profile.byte_order is ByteOrder.LITTLE
    assert profile.mode is Mode.AUTO
    assert (profile.speed, profile.accel) == (0.5, 0.5)
    assert (profile.state_period, profile.joint_positions_per_status) == (0.005, 10)
    assert profile.cycle_period == 0.004
    assert profile.pending_limit == 1000
    assert (profile.look_ahead, profile.look_ahead_points) == (1.0, 1000)


def test_an_unknown_profile_lists_the_ones_there_are():
    with pytest.raises(FileNotFoundError, match=r'no rc1\.yaml .*rc620'):
        load_controller_profile('rc1')


@pytest.mark.parametrize(
    ('key', 'value', 'text'),
    [
        ('name', 5, 'must be a text'),
        ('byte_order', 'middle', "byte_order = 'middle': must be little or big"),
        ('byte_order', [], 'must be little or big'),
        ('mode', 'test', 'must be auto or manual'),
        ('motion.speed_percent', 0, 'must be a number from 1 to 100'),
        ('motion.speed_percent', 101, 'must be a number from 1 to 100'),
        ('motion.speed_percent', 'fast', 'must be a number'),
        ('motion.accel_percent', float('nan'), 'must be a number'),
        ('motion.cycle_period', 0, 'must be a number from 0.0005'),
        ('motion.pending_limit', 2.5, 'must be a whole number from 1'),
        ('motion.pending_limit', True, 'must be a whole number'),
        ('motion.look_ahead', 0, 'must be a number from 0.01 to 60'),
        ('motion.look_ahead', 61, 'must be a number from 0.01 to 60'),
        ('motion.look_ahead_points', 0, 'must be a whole number from 1 to 100000'),
        ('state.period', -1, 'must be a number'),
        ('state.joint_positions_per_status', 0, 'must be a whole number from 1'),
        ('state.speed', 1, 'is not a key'),
        ('state', 7, 'state is not a key'),
        ('motion.accel_percent', None, 'must be a number'),
    ],
)
def test_a_wrong_value_is_named_with_file_key_and_rule(tmp_path, key, value, text):
    data = yaml.safe_load(share_file('config', 'controllers', 'rc620.yaml').read_text())
    block, _, inner = key.rpartition('.')
    (data[block] if block else data)[inner] = value
    path = tmp_path / 'mine.yaml'
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(ControllerProfileError) as caught:
        load_controller_profile(str(path))
    assert str(path) in str(caught.value)
    assert key in str(caught.value)
    assert text in str(caught.value)


@pytest.mark.parametrize('text', ['', 'rc620', '[1, 2]', '{', 'name: rc620'])
def test_a_file_that_is_no_profile(tmp_path, text):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(ControllerProfileError, match=r'mine\.yaml: '):
        load_controller_profile(str(path))
