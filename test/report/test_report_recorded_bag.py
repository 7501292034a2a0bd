# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Bags of `ros2 bag record`: the driver's topics, and invalid messages."""

import math
from pathlib import Path

import numpy as np
import pytest

from epson_driver.error_texts import load_error_texts
from epson_driver.report.figures import figures
from epson_driver.report.page import page
from epson_driver.report.run import RunError
from epson_driver.robots import load_robot_model

rosbags = pytest.importorskip('rosbags', reason='the extra [report] is not installed')
from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: E402
from rosbags.typesys import get_types_from_msg  # noqa: E402

from epson_driver.report import bag_run  # noqa: E402
from epson_driver.report.bag_file import typestore  # noqa: E402
from epson_driver.report.bag_run import CONTROLLER_STATE, read_bag  # noqa: E402

MODEL = load_robot_model('c3_a601s')
TEXTS = load_error_texts()
NAMES = MODEL.joint_names
BEGAN = 10**18
DRIVER = '/left/epson_driver'
DEFINITION = (
    Path(__file__).parents[2] / 'interfaces/control_msgs/msg/JointTrajectoryControllerState.msg'
)
STORE = typestore()
STORE.register(get_types_from_msg(DEFINITION.read_text(encoding='utf-8'), CONTROLLER_STATE))
TYPES = STORE.types
NO_NUMBERS = np.array([], dtype=float)

STATE, STATES = 'sensor_msgs/msg/JointState', '/left/joint_states'
PLAN, PLANS = 'trajectory_msgs/msg/JointTrajectory', f'{DRIVER}/joint_trajectory'
FOLLOWED = f'{DRIVER}/controller_state'
LINK, LINKS = 'std_msgs/msg/String', f'{DRIVER}/link_state'


def header(seconds):
    stamp = TYPES['builtin_interfaces/msg/Time'](*divmod(BEGAN + round(seconds * 1e9), 10**9))
    return TYPES['std_msgs/msg/Header'](stamp, '')


def state(seconds, value, names=NAMES, velocities=None):
    positions = np.full(len(names), value, dtype=float)
    speeds = NO_NUMBERS if velocities is None else np.array(velocities, dtype=float)
    return TYPES[STATE](header(seconds), list(names), positions, speeds, NO_NUMBERS)


def point(seconds, positions):
    since = TYPES['builtin_interfaces/msg/Duration'](*divmod(round(seconds * 1e9), 10**9))
    kind = TYPES['trajectory_msgs/msg/JointTrajectoryPoint']
    return kind(np.array(positions, dtype=float), NO_NUMBERS, NO_NUMBERS, NO_NUMBERS, since)


def trajectory(*points, names=NAMES):
    return TYPES[PLAN](header(0.0), list(names), [point(*item) for item in points])


def followed(seconds, positions, names=NAMES):
    none = point(0.0, [])
    other = TYPES['trajectory_msgs/msg/MultiDOFJointTrajectoryPoint'](
        [], [], [], TYPES['builtin_interfaces/msg/Duration'](0, 0)
    )
    here = point(seconds, positions)
    return TYPES[CONTROLLER_STATE](
        header(0.0), list(names), here, none, none, none, [], other, other, other, other, 1.0
    )


def usual(*, count=20, step=0.01):
    """Return joint states that rise by 0.01 rad each, every `step` s."""
    return [(step * n, STATES, STATE, state(step * n, 0.01 * n)) for n in range(count)]


def recorded(folder, *entries):
    """Write a bag of entries: time, s, topic, type, and message or raw bytes."""
    with Writer(folder / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for seconds, topic, kind, message in sorted(entries, key=lambda entry: entry[0]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            raw = isinstance(message, bytes)
            data = message if raw else STORE.serialize_cdr(message, kind)
            writer.write(connections[topic], BEGAN + round(seconds * 1e9), data)
    return folder / 'bag'


def read(folder, *entries):
    return read_bag(recorded(folder, *entries), TEXTS)


def event_texts(run, level):
    return [event.text for event in run.events if event.level == level]


def test_goals_in_controller_state_become_plans_in_joint_order(tmp_path):
    turned = tuple(reversed(NAMES))
    references = [
        (0.05 * n + start, FOLLOWED, CONTROLLER_STATE, followed(0.05 * n, range(6), turned))
        for start, count in ((0.1, 4), (0.5, 3))
        for n in range(count)
    ]
    again = (0.66, FOLLOWED, CONTROLLER_STATE, followed(0.1, range(6), turned))
    run = read(tmp_path, *usual(count=100), *references, again)
    first, second = run.plans
    assert first.times == pytest.approx([0.0, 0.05, 0.1, 0.15])
    assert second.times == pytest.approx([0.0, 0.05, 0.1])  # a time that came twice counts once
    assert (first.sent, second.sent) == pytest.approx((0.1, 0.5))
    assert first.positions[0].tolist() == [5.0, 4.0, 3.0, 2.0, 1.0, 0.0]
    assert not any('no plan' in note for note in run.notes)
    assert figures(run).motions[0].points == 4


@pytest.mark.parametrize(
    'message',
    [
        followed(0.1, [0.0] * 5),
        followed(0.1, [0.0] * 5 + [math.nan]),
        followed(0.1, [0.0] * 5, NAMES[:5]),
    ],
    ids=['too few', 'no number', 'another arm'],
)
def test_invalid_controller_state_is_no_plan(tmp_path, message):
    run = read(tmp_path, *usual(), (0.1, FOLLOWED, CONTROLLER_STATE, message))
    assert run.plans == []
    assert any('no plan' in note for note in run.notes)


def test_trajectory_topic_is_a_plan_and_an_event(tmp_path):
    message = trajectory((0.5, [0.1] * 6), (1.5, [0.3] * 6))
    early = (-0.01, PLANS, PLAN, message)  # before the first joint state names the joints
    (plan,) = (run := read(tmp_path, *usual(), early, (0.1, PLANS, PLAN, message))).plans
    assert plan.times == pytest.approx([0.0, 1.0])
    assert plan.positions[:, 0] == pytest.approx([0.1, 0.3])
    assert event_texts(run, 'info') == [f'a trajectory of 2 points ({PLANS})']


@pytest.mark.invariant(7)
@pytest.mark.parametrize(
    ('points', 'reason'),
    [
        ([(0.0, [0.1] * 6), (1.0, [0.1] * 5)], 'point 1 has 5 positions for 6 joints'),
        ([(0.0, []), (1.0, [0.1] * 6)], 'point 0 has 0 positions for 6 joints'),
        ([(0.0, [math.inf] * 6)], 'point 0 has positions that are not finite'),
        ([(0.0, [0.1] * 6), (0.0, [0.2] * 6)], 'point 1 must be later than'),
    ],
    ids=['short', 'empty', 'no number', 'no time'],
)
def test_invalid_trajectory_is_a_warning_and_the_bag_is_read(tmp_path, points, reason):
    good = trajectory((0.0, [0.0] * 6), (0.05, [0.05] * 6))
    run = read(
        tmp_path, *usual(), (0.05, PLANS, PLAN, trajectory(*points)), (0.1, PLANS, PLAN, good)
    )
    (warning,) = [event for event in run.events if event.level == 'warning']
    assert reason in warning.text
    assert PLANS in warning.text
    assert warning.remedy
    assert len(run.plans) == 1
    assert page([(run, figures(run))], MODEL)  # json.dumps takes no NaN


def test_invalid_joint_states_are_skipped_with_one_warning(tmp_path):
    wrong = [
        (0.055, STATES, STATE, state(0.055, 0.9, NAMES[:4])),
        (0.056, STATES, STATE, state(0.056, math.nan)),
        (0.057, STATES, STATE, state(0.057, 0.9, velocities=[math.inf] * 6)),
    ]
    run = read(tmp_path, *usual(), *wrong)
    assert run.positions[:, 0] == pytest.approx(0.01 * np.arange(20))
    (warning,) = [event for event in run.events if event.level == 'warning']
    assert warning.text == 'joint states with values that are not finite'
    assert warning.time == pytest.approx(0.056)


def test_stamps_of_another_clock_are_replaced_by_bag_times(tmp_path):
    entries = [(0.01 * n, STATES, STATE, state(-1e6, 0.01 * n)) for n in range(10)]
    entries += [(0.1 + 1e-3 * n, STATES, STATE, state(0.1, 0.1)) for n in range(3)]
    run = read(tmp_path, *entries)
    assert run.times[:10] == pytest.approx(0.01 * np.arange(10))
    assert run.times[10:] == pytest.approx([0.1, 0.100001, 0.100002], abs=1e-9)
    assert np.all(np.diff(run.times) > 0.0)


def test_only_the_driver_log_becomes_events(tmp_path):
    kind = 'rcl_interfaces/msg/Log'

    def line(level, name, text):
        stamp = header(0.0).stamp
        return (0.05, '/rosout', kind, TYPES[kind](stamp, level, name, text, '', '', 0))

    run = read(
        tmp_path,
        *usual(),
        line(20, 'left.epson_driver', 'connected'),
        line(30, 'left.epson_driver', 'the link is slow'),
        line(40, 'left.epson_driver', 'error 2313'),
        line(40, 'camera', 'no picture'),
    )
    assert event_texts(run, 'info') == ['connected']
    assert event_texts(run, 'warning') == ['the link is slow']
    assert event_texts(run, 'error') == ['error 2313']


def test_link_states_are_events_and_a_loss_has_a_remedy(tmp_path):
    links = [
        (seconds, LINKS, LINK, TYPES[LINK](name))
        for seconds, name in ((0.0, 'connected'), (0.1, 'backing_off'), (0.15, 'connected'))
    ]
    other = (0.1, f'{DRIVER}/hello', LINK, TYPES[LINK]('an unrelated string'))
    run = read(tmp_path, *usual(), *links, other)
    assert [(pytest.approx(at), up) for at, _, up in run.links] == [
        (0.0, True),
        (0.1, False),
        (0.15, True),
    ]
    (lost,) = [event for event in run.events if event.level == 'warning']
    assert lost.text == 'link: backing_off'
    assert '~/enable' in lost.remedy
    assert event_texts(run, 'info') == ['link: connected'] * 2


@pytest.mark.invariant(7)
@pytest.mark.parametrize('damage', [b'', b'\0\1\0\0' + b'\xff' * 40], ids=['empty', 'length'])
def test_unreadable_message_ends_the_run(tmp_path, monkeypatch, damage):
    run = read(tmp_path, *usual(), (0.1001, STATES, STATE, damage))
    assert len(run.times) == 11
    assert any(note.startswith('the bag is truncated: ') for note in run.notes)
    assert event_texts(run, 'error') == ['the recording ends here']
    monkeypatch.setattr(bag_run, 'MAX_JOINT_STATES', 10)
    with pytest.raises(RunError, match='more than 10 joint states'):
        read_bag(tmp_path / 'bag', TEXTS)
