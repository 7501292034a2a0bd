# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Written bags are read with equal numbers by mcap, rosbags and the report."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.recorded_run import Recorder, position, usual_run

from epson_driver.error_texts import load_error_texts
from epson_driver.report.figures import figures
from epson_driver.report.run import FLAGS, RunError
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import JointPosition, joint_data

rosbags = pytest.importorskip('rosbags', reason='the extra [report] is not installed')
from rosbags.highlevel import AnyReader  # noqa: E402
from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: E402

from epson_driver.report.bag_file import (  # noqa: E402
    INDUSTRIAL_MSGS,
    typestore,
    write_bag,
)
from epson_driver.report.bag_run import read_bag  # noqa: E402

NAMES = tuple(f'joint_{number}' for number in range(1, 7))
LIMITS = load_robot_model('c3_a601s').limits
TEXTS = load_error_texts()
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    path = usual_run(estop=2.5).write(tmp_path_factory.mktemp('trace') / 'run.pcap')
    return read_trace(path, LIMITS, TEXTS)


@pytest.fixture(scope='module')
def bag(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags') / 'run'
    write_bag(run, figures(run), folder)
    return folder


def test_message_types_in_the_bag_equal_industrial_msgs():
    for name, definition in INDUSTRIAL_MSGS.items():
        text = (
            ROOT / 'interfaces/industrial_msgs/msg' / f'{name.rpartition("/")[2]}.msg'
        ).read_text()
        lines = [re.sub(r'\s*#.*', '', line).strip() for line in text.splitlines()]
        plain = [re.sub(r'\s*=\s*', '=', re.sub(r'\s+', ' ', line)) for line in lines if line]
        ours = [
            line.replace('std_msgs/', '').replace('industrial_msgs/', '')
            for line in definition.splitlines()
        ]
        plain = [line.replace('std_msgs/', '').replace('industrial_msgs/', '') for line in plain]
        assert plain == ours


def test_rosbags_reads_equal_numbers_from_the_bag(run, bag):
    positions, velocities, stamps, statuses = [], [], [], []
    with AnyReader([bag]) as reader:  # with the definitions in the bag
        for connection, at, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == '/joint_states':
                positions.append(message.position)
                velocities.append(message.velocity)
                stamps.append(at)
                assert at == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            elif connection.topic == '/robot_status':
                statuses.append(message)
    assert np.array_equal(np.array(positions), run.positions)
    assert np.array_equal(np.array(velocities), figures(run).velocities)
    assert stamps == [run.nanoseconds(t) for t in run.times.tolist()]
    seen = [tuple(getattr(m, name).val for name in FLAGS) for m in statuses]
    assert seen == [condition.flags for condition in run.conditions]
    assert [tuple(m.error_codes) for m in statuses] == [c.error_codes for c in run.conditions]


def test_report_of_the_bag_equals_that_of_the_trace(run, bag):
    read = read_bag(bag, TEXTS)
    assert read.began == run.began
    assert read.times == pytest.approx(run.times, abs=2e-9)
    assert [(e.level, e.text, e.remedy) for e in read.events] == [
        (e.level, e.text, e.remedy) for e in run.events
    ]
    ours, theirs = figures(run), figures(read)
    (first,), (second,) = ours.motions, theirs.motions
    assert second.dead_time == pytest.approx(first.dead_time, abs=1e-8)
    assert second.moved == pytest.approx(first.moved, abs=1e-8)
    assert (second.stops, second.points) == (first.stops, first.points)
    assert second.waypoint_deviation == first.waypoint_deviation
    assert second.top_velocity == first.top_velocity
    assert ours.joint_states.rate == pytest.approx(theirs.joint_states.rate, rel=1e-6)


@pytest.mark.invariant(8)
def test_bursts_in_a_bag_do_not_change_accelerations(tmp_path):
    """A bag has arrival times. With them as sending times, an arm would jump in a burst."""
    recorder = Recorder()
    recorder.connect(0.0, 11002)
    for slot in range(800):
        time = 0.01 + slot * 0.005
        burst = 0.01 + (slot // 30 * 30 + 29) * 0.005 + slot % 30 * 1e-5
        arrived = burst if 300 <= slot < 420 else time
        recorder.controller_sends(
            arrived, 11002, JointPosition(0, joint_data(position(time).tolist()))
        )
    trace = read_trace(recorder.write(tmp_path / 'run.pcap'), LIMITS, TEXTS)
    write_bag(trace, figures(trace), tmp_path / 'bag')
    ours, theirs = figures(trace), figures(read_bag(tmp_path / 'bag', TEXTS))
    highest = np.abs(ours.accelerations).max(axis=0)
    assert np.abs(theirs.accelerations - ours.accelerations).max() < 0.01 * highest.max()
    assert highest[0] < 10.0


@pytest.mark.invariant(1)
def test_bag_has_no_command_topics_of_the_driver(bag):
    with AnyReader([bag]) as reader:
        topics = {connection.topic for connection in reader.connections}
    assert topics == {
        '/joint_states',
        '/robot_status',
        '/report/plan',
        '/report/events',
        '/report/reply_latency',
    }


def other_bag(folder, *names, messages=True, status=False, storage=StoragePlugin.MCAP):
    """Write a bag like a user's recording, with the joint states of any number of robots."""
    store = typestore()
    kind = 'sensor_msgs/msg/JointState'
    state, header = store.types[kind], store.types['std_msgs/msg/Header']
    time = store.types['builtin_interfaces/msg/Time']
    empty = np.array([], dtype=float)
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        connections = [writer.add_connection(name, kind, typestore=store) for name in names]
        if status:
            log = 'std_msgs/msg/String'
            writer.add_connection('/chatter', log, typestore=store)
        for connection in connections if messages else []:
            for number in range(40):
                stamp = 10**18 + number * 10_000_000
                message = state(
                    header(time(*divmod(stamp, 10**9)), ''),
                    list(NAMES),
                    np.full(6, 0.01 * number),
                    empty,
                    empty,
                )
                writer.write(connection, stamp, store.serialize_cdr(message, kind))
    return folder


@pytest.mark.parametrize(
    ('names', 'options', 'message'),
    [
        (
            (),
            {'status': True},
            r'it contains no joint states \(topics: /chatter\): record joint_states',
        ),
        (('/joint_states',), {'messages': False}, 'has no message with positions'),
        (
            ('/a/joint_states', '/b/joint_states'),
            {},
            'several robots .* choose one with --namespace',
        ),
    ],
)
def test_incomplete_bag_is_refused_with_the_reason(tmp_path, names, options, message):
    with pytest.raises(RunError, match=message):
        read_bag(other_bag(tmp_path / 'bag', *names, **options), TEXTS)


def test_bag_of_all_topics_of_one_robot_needs_no_namespace(tmp_path):
    bag = other_bag(tmp_path / 'bag', '/joint_states', '/epson_driver/joint_commands')
    assert len(read_bag(bag, TEXTS).times) == 40


def test_namespace_chooses_one_of_several_robots(tmp_path):
    bag = other_bag(tmp_path / 'bag', '/a/joint_states', '/b/joint_states')
    run = read_bag(bag, TEXTS, 'b')
    assert len(run.times) == 40
    assert any('no robot_status' in note for note in run.notes)
    assert any('no plan' in note for note in run.notes)
    with pytest.raises(RunError, match=r'it contains no /c/joint_states .*/a/joint_states'):
        read_bag(bag, TEXTS, 'c')


@pytest.mark.parametrize(
    'storage', [StoragePlugin.SQLITE3, pytest.param(StoragePlugin.MCAP, marks=pytest.mark.slow)]
)
def test_bag_is_read_from_its_folder_or_file(tmp_path, storage):
    bag = other_bag(tmp_path / 'bag', '/left/joint_states', storage=storage)
    (file,) = {*bag.iterdir()} - {bag / 'metadata.yaml'}
    for path in (bag, file):
        run = read_bag(path, TEXTS)
        assert run.positions[:, 0] == pytest.approx(0.01 * np.arange(40))
        assert figures(run).velocities[20] == pytest.approx(np.ones(6), rel=1e-3)


@pytest.mark.parametrize('missing', ['footer', 'summary and index', 'half of the last record'])
@pytest.mark.parametrize('killed', [False, True], ids=['file', 'folder without metadata'])
def test_truncated_bag_is_read_up_to_the_damage(tmp_path, missing, killed):
    bag = other_bag(tmp_path / 'bag', '/joint_states')
    (file,) = bag.glob('*.mcap')
    content = file.read_bytes()
    footer = len(content) - 37
    summary = int.from_bytes(content[footer + 9 : footer + 17], 'little')
    kept = {'footer': footer, 'summary and index': summary, 'half of the last record': summary - 5}
    file.write_bytes(content[: kept[missing]])
    (bag / 'metadata.yaml').unlink()
    run = read_bag(bag if killed else file, TEXTS)
    assert len(run.times) == 40
    assert any('truncated' in note for note in run.notes)
    assert any('ends here' in event.text for event in run.events)


@pytest.mark.parametrize('share', [0.0, 0.01, 0.3])
def test_bag_without_a_complete_message_is_refused_by_name(tmp_path, bag, share):
    (file,) = bag.glob('*.mcap')
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(file.read_bytes()[: int(file.stat().st_size * share)])
    with pytest.raises(RunError, match=re.escape(str(cut))) as refused:
        read_bag(cut, TEXTS)
    assert 'record joint_states' not in str(refused.value)  # it was recorded


def test_existing_folder_is_not_changed(tmp_path, run):
    with pytest.raises(RunError, match='must be a new folder'):
        write_bag(run, figures(run), tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.invariant(7)
def test_bag_with_an_invalid_definition_is_refused(tmp_path):
    (file,) = other_bag(tmp_path / 'bag', '/joint_states').glob('*.mcap')
    content = file.read_bytes()
    assert b'std_msgs/Header header' in content
    file.write_bytes(
        content.replace(b'std_msgs/Header header', b'std_msgs/\xff\xff\xff\xff\xff\xff header')
    )
    with pytest.raises(RunError, match=re.escape(f'{file}: cannot be read as a bag')):
        read_bag(file, TEXTS)
