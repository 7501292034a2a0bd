# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
import dataclasses
import math
import re
import typing

import pytest
import yaml

from epson_driver.inputs import InputError
from epson_driver.profiles.profile import (
    ControllerProfile,
    load_controller_profile,
)
from epson_driver.profiles.profile_rules import RULES
from epson_driver.share import share_path
from epson_driver.simple_message import ByteOrder, Mode

FOLDER = share_path('config', 'controllers', 'simulated.yaml').parent
NAMES = sorted(path.stem for path in FOLDER.glob('*.yaml'))


def keys_of(section, place=''):
    """Yield the keys of a profile's dataclass, with their sections."""
    hints = typing.get_type_hints(section)
    for field in dataclasses.fields(section):
        inner = hints[field.name]
        if dataclasses.is_dataclass(inner) and field.name != 'io':
            yield from keys_of(inner, f'{place}{field.name}.')
        else:
            yield place + field.name


def test_every_key_has_a_rule_and_every_rule_a_key():
    assert sorted(keys_of(ControllerProfile)) == sorted(RULES)


@pytest.mark.parametrize('name', ['RC700-A', 'rc90', 'RC90-B', 'rc800', 'T', 'vt'])
def test_alias_loads_the_shared_profile(name):
    assert load_controller_profile(name) == load_controller_profile('spel')


def test_old_name_of_the_simulation_is_a_deprecated_alias(caplog):
    assert load_controller_profile('RC620') == load_controller_profile('simulated')
    (message,) = caplog.messages
    assert message.startswith('profile rc620 is now named simulated')
    assert 'spel' in message


def test_simulated_rates_equal_those_of_the_thesis():
    profile = load_controller_profile('simulated')
    assert profile.byte_order is ByteOrder.LITTLE
    assert profile.mode is Mode.AUTO
    assert dataclasses.astuple(profile.ports) == (11000, 11002, 11003, 0)
    motion, program, state = profile.motion, profile.program, profile.state
    assert (motion.speed, motion.accel, motion.power) == (0.5, 0.5, 'high')
    assert (motion.cp, motion.statement_overhead) == (False, 0.012)
    assert (motion.look_ahead, motion.look_ahead_points) == (1.0, 1000)
    assert motion.pending_limit == 1000
    assert (state.period, state.joint_positions_per_status) == (0.005, 10)
    assert state.message == 'joint_position'
    assert (program.kind, program.reply, program.uses) == ('points', 'sequence', 'both')
    assert dataclasses.astuple(program.download) == (1000, 'refuse', 0.0115)
    assert (profile.remote.session_timeout, profile.remote.password) == (60.0, '')
    assert (profile.servo.lag, profile.servo.encoder) == (0.008, True)
    assert profile.io.digital_inputs == 24


def test_profiles_have_their_documented_differences():
    spel, fanuc, abb, motoman = map(load_controller_profile, ('spel', 'fanuc', 'abb', 'motoman'))
    assert spel.ports.remote == 5000
    assert fanuc.byte_order is ByteOrder.BIG
    assert (fanuc.state.period, fanuc.state.joint_positions_per_status) == (0.024, 11)
    together = (fanuc, abb, motoman)
    assert [profile.state.status_with_joints for profile in together] == [True] * 3
    assert [profile.server.lost_client for profile in (spel, *together)] == [
        'brake',
        'finish',
        'finish',
        'keep',
    ]
    accepts = [profile.program.accepts for profile in together]
    assert accepts == ['any', 'longer', 'exact']
    assert (fanuc.program.check_sequence, fanuc.program.special_sequences) == (False, 'stop')
    assert (fanuc.program.acknowledge, fanuc.program.late_failure) == ('taken', True)
    assert (fanuc.motion.speed, fanuc.motion.look_ahead_points) == (0.2, 2)
    assert (abb.program.reply, abb.program.uses) == ('header', 'duration')
    assert dataclasses.astuple(abb.program.download) == (100, 'drop', 0.0)
    assert (abb.state.period, abb.state.joint_positions_per_status) == (0.1, 1)
    assert abb.program.skip_first == pytest.approx(math.radians(0.1), rel=1e-4)
    assert abb.program.check_limits is False
    assert (motoman.program.kind, motoman.state.message) == ('motoman', 'joint_feedback')
    assert dataclasses.astuple(motoman.ports)[:3] == (50240, 50241, 50242)
    server = motoman.server
    assert (server.full, server.state_clients, server.io_clients) == ('replace', 4, 1)
    assert (motoman.motion.look_ahead, motoman.motion.pending_limit) == (200 * 0.004, 1)
    assert (motoman.state.period, motoman.state.errors) == (0.025, 'alarms')


WRONG = [
    ('name', 5, 'must be a string'),
    ('approximate', 'all of it', 'must be a list of sentences'),
    ('approximate', [1], 'must be a list of sentences'),
    ('byte_order', 'middle', "byte_order = 'middle': must be little or big"),
    ('byte_order', [], 'must be little or big'),
    ('mode', 'test', 'must be auto or manual'),
    ('ports.motion', 0, 'must be a whole number from 1 to 65535'),
    ('ports.remote', 65536, 'must be a whole number from 0 to 65535'),
    ('motion.speed', 0, 'must be a number from 0.01 to 1'),
    ('motion.speed', 50, 'must be a number from 0.01 to 1'),
    ('motion.speed', 'fast', 'must be a number'),
    ('motion.speed', 10**400, 'must be a number'),
    ('motion.accel', float('nan'), 'must be a number'),
    ('motion.accel', None, 'must be a number'),
    ('motion.power', 'medium', 'must be high or low'),
    ('motion.cp', 1, 'must be true or false'),
    ('motion.pending_limit', 2.5, 'must be a whole number from 1'),
    ('motion.pending_limit', True, 'must be a whole number'),
    ('motion.look_ahead', 0, 'must be a number from 0.01 to 60'),
    ('motion.look_ahead', 61, 'must be a number from 0.01 to 60'),
    ('motion.look_ahead_points', 0, 'must be a whole number from 1 to 100000'),
    ('motion.speed_percent', 50, 'is not a key'),
    ('servo.lag', -0.1, 'must be a number from 0 to 1'),
    ('program.reply', 'nothing', 'must be sequence or header'),
    ('program.download', 5, 'is not a key'),
    ('program.download.buffer', 0, 'must be a whole number from 1'),
    ('program.download.overflow', 'wrap', 'must be refuse or drop'),
    ('program.download.size', 5, 'is not a key'),
    ('state.period', -1, 'must be a number'),
    ('state.joint_positions_per_status', 0, 'must be a whole number from 1'),
    ('state.speed', 1, 'is not a key'),
    ('state', 7, 'state is not a key'),
    ('server.full', 'queue', 'must be refuse or replace'),
    ('io', [], 'must be a mapping'),
    ('io.digital_inputs', -1, 'must be a whole number'),
    ('io.lamps', 1, 'is not a key'),
    ('remote.password', 1234, 'must be a string'),
    ('description', 'x' * 10_001, 'must be a string'),
    ('spel.config', {'FAST': True}, 'must be a mapping of names to texts or numbers'),
    ('spel.config', {'FAST': [1]}, 'must be a mapping of names to texts or numbers'),
]


def written(tmp_path, data, name='mine.yaml'):
    path = tmp_path / name
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize(('key', 'value', 'text'), WRONG)
@pytest.mark.parametrize('like', [False, True])
def test_invalid_value_is_reported_with_file_key_and_rule(tmp_path, key, value, text, like):
    if like:
        data = {'like': 'simulated', 'name': 'mine', 'description': 'my own'}
    else:
        data = yaml.safe_load((FOLDER / 'simulated.yaml').read_text())
    inner, *sections = data, *key.split('.')
    *sections, last = sections
    for section in sections:
        inner = inner.setdefault(section, {})
    inner[last] = value
    path = written(tmp_path, data)
    with pytest.raises(InputError) as caught:
        load_controller_profile(str(path))
    assert str(path) in str(caught.value)
    assert key in str(caught.value)
    assert text in str(caught.value)


@pytest.mark.parametrize('key', sorted(RULES))
def test_missing_key_is_reported(tmp_path, key):
    data = yaml.safe_load((FOLDER / 'simulated.yaml').read_text())
    inner = data
    *sections, last = key.split('.')
    for section in sections:
        inner = inner[section]
    del inner[last]
    with pytest.raises(InputError, match=re.escape(f'{key} is missing')):
        load_controller_profile(str(written(tmp_path, data)))


@pytest.mark.parametrize(
    'text', ['', 'simulated', '[1, 2]', '{', 'name: simulated', '\0', '- like']
)
def test_file_that_is_no_profile_is_refused(tmp_path, text):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(InputError, match=r'mine\.yaml: '):
        load_controller_profile(str(path))


# ---- like


def test_profile_with_like_needs_only_the_differences(tmp_path):
    path = written(
        tmp_path,
        {
            'like': 'fanuc',
            'name': 'mine',
            'description': 'my own',
            'motion': {'speed': 0.3},
            'program': {'download': {'buffer': 7}},
            'io': {'safe': {'DO1': 1}},
        },
    )
    mine, fanuc = load_controller_profile(str(path)), load_controller_profile('fanuc')
    assert mine.motion == dataclasses.replace(fanuc.motion, speed=0.3)
    download = dataclasses.replace(fanuc.program.download, buffer=7)
    assert mine.program == dataclasses.replace(fanuc.program, download=download)
    assert mine.io.digital_inputs == fanuc.io.digital_inputs
    assert list(mine.io.safe.values()) == [1]
    assert mine.approximate == fanuc.approximate
    assert (mine.name, mine.description) == ('mine', 'my own')


def test_like_accepts_a_file_in_the_same_folder(tmp_path):
    base = {'like': 'simulated', 'name': 'base', 'description': '', 'error_texts': 'none'}
    written(tmp_path, base, 'base.yaml')
    path = written(tmp_path, {'like': 'base.yaml', 'name': 'mine', 'description': ''})
    assert load_controller_profile(str(path)).error_texts == 'none'


def test_circular_like_is_an_error(tmp_path):
    own = {'name': 'x', 'description': 'x'}
    written(tmp_path, {'like': 'b.yaml', **own}, 'a.yaml')
    path = written(tmp_path, {'like': 'a.yaml', **own}, 'b.yaml')
    with pytest.raises(InputError, match='must not refer back to this file'):
        load_controller_profile(str(path))


def test_rc620_has_every_key():
    """docs/controllers.md refers to it as the complete example."""
    data = yaml.safe_load((FOLDER / 'simulated.yaml').read_text(encoding='utf-8'))
    written = {'.'.join(path) for path in paths(data)}
    assert all(any(f'{item}.'.startswith(f'{key}.') for item in written) for key in RULES)


def paths(data, before=()):
    for key, value in data.items():
        yield (*before, key)
        if isinstance(value, dict):
            yield from paths(value, (*before, key))
