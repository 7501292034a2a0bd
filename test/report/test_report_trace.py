# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs read from synthetic traces with known content, and from damaged traces."""

import struct
from pathlib import Path

import numpy as np
import pytest
from support.recorded_run import (
    DEAD_TIME,
    MOVED,
    PERIOD,
    POINTS,
    SENT,
    START,
    Recorder,
    position,
    usual_run,
)

from epson_driver.error_texts import load_error_texts
from epson_driver.report.figures import STANDSTILL_RAD, derivatives, figures
from epson_driver.report.page import page
from epson_driver.report.run import (
    NO,
    UNKNOWN,
    YES,
    Condition,
    RunError,
    condition_events,
)
from epson_driver.report.trace_run import read_trace
from epson_driver.robots import load_robot_model
from epson_driver.simple_message import (
    LITTLE_ENDIAN,
    JointFeedback,
    JointPosition,
    JointTrajPt,
    JointTrajPtFull,
    MotionCtrl,
    MotionReply,
    Ping,
    ReplyCode,
    Status,
    ValidFields,
    encode,
    reply,
)
from epson_driver.simple_message.motoman import Command, Result

LIMITS = load_robot_model('c3_a601s').limits
TEXTS = load_error_texts()


def read(recorder: Recorder, folder: Path, **options):
    return read_trace(recorder.write(folder / 'run.pcap'), LIMITS, TEXTS, **options)


def texts(run, level=None):
    return [event.text for event in run.events if level in (None, event.level)]


@pytest.mark.invariant(8)
def test_joints_equal_the_wire_exactly(tmp_path):
    run = read(usual_run(), tmp_path)
    slots = [slot for slot in range(800) if slot % 11 != 10]
    held = np.array([position(0.01 + slot * PERIOD) for slot in slots])
    expected = held.astype(np.float32).astype(float)
    assert len(run.times) == len(slots)
    assert np.array_equal(run.positions, expected)
    assert run.began == START * 10**9
    assert run.velocities is None


def test_plan_and_figures_of_a_motion_are_found(tmp_path):
    run = read(usual_run(), tmp_path)
    (plan,) = run.plans
    assert plan.sent == pytest.approx(SENT, abs=1e-6)
    assert plan.times == pytest.approx([0.0, 1.0, 2.0])
    assert np.array_equal(plan.positions, POINTS.astype(np.float32).astype(float))
    (motion,) = figures(run).motions
    # motion is detected when a joint has moved by the bound: t³ · 2π²/3 of the distance
    seen = MOVED * (STANDSTILL_RAD * 3 / (2 * np.pi**2)) ** (1 / 3)
    assert motion.dead_time == pytest.approx(DEAD_TIME + seen, abs=0.011)
    assert motion.moved == pytest.approx(MOVED - 2 * seen, abs=0.022)
    assert motion.stops == 0
    assert motion.waypoint_deviation < 1e-3
    assert motion.end_deviation < 1e-6
    assert motion.top_velocity[0] == pytest.approx(1.0, rel=0.01)  # 2 · distance / time
    assert motion.top_acceleration[0] == pytest.approx(2 * np.pi / MOVED**2, rel=0.05)


def test_replies_rates_and_gaps_equal_the_wire(tmp_path):
    run = read(usual_run(), tmp_path)
    numbers = figures(run)
    ((name, replies),) = numbers.replies
    assert (name, replies.count) == ('JOINT_TRAJ_PT', 3)
    assert replies.longest == pytest.approx(0.004, abs=2e-6)
    assert numbers.joint_states.longest == pytest.approx(0.01, abs=2e-6)
    assert numbers.joint_states.median == pytest.approx(0.005, abs=2e-6)
    counts = {(item.name, item.sender): len(item.times) for item in run.traffic}
    assert counts['JOINT_TRAJ_PT', 'driver'] == counts['JOINT_POSITION reply', 'controller'] == 3
    assert counts['STATUS', 'controller'] == 72


def test_estop_is_an_event_with_error_and_remedy(tmp_path):
    run = read(usual_run(estop=2.0), tmp_path)
    errors = [event for event in run.events if event.level == 'error']
    assert errors[0].text == 'E-stop pressed'
    assert any('2313' in event.text and event.remedy for event in errors)
    assert all(event.remedy for event in errors)
    assert 'STOP sent' in texts(run, 'warning')
    assert {'motors off'} <= set(texts(run, 'warning'))
    assert run.conditions[-1].flag('e_stopped') == YES
    assert run.conditions[-1].flag('drives_powered') == NO


def test_each_trajectory_is_a_separate_plan(tmp_path):
    recorder = usual_run(4.0)
    for number in (0, 1):
        point = JointTrajPt(number, (0.5,) * 10, 0.5, 0.5)
        recorder.driver_sends(4.1 + number, 11000, point)
    first, second = read(recorder, tmp_path).plans
    assert (len(first.times), len(second.times)) == (3, 2)
    assert second.sent == pytest.approx(4.1, abs=1e-6)


def test_refused_point_lost_link_and_invalid_bytes_are_events(tmp_path):
    recorder = usual_run()
    recorder.driver_sends(4.2, 11000, JointTrajPt(3))
    recorder.controller_refuses(4.21, 11000, JointPosition(3))
    recorder.driver_sends(4.3, 11000, JointTrajPt(4))
    recorder.raw(4.4, 11002, b'\xff' * 40)
    recorder.lose(4.5, 11002)
    run = read(recorder, tmp_path)
    errors = texts(run, 'error')
    assert 'the controller refused JOINT_TRAJ_PT 3' in errors
    assert 'state port: 40 bytes that are no message' in errors
    assert 'state port closed by the controller' in errors
    assert '1 requests without a reply' in texts(run, 'warning')
    assert run.links[-1][1:] == ('state', False)


def test_damaged_trace_is_read_up_to_the_damage(tmp_path):
    whole = usual_run().content()
    position = 24
    while position < len(whole) // 2:
        position += 16 + struct.unpack_from('<I', whole, position + 8)[0]
    damaged = bytearray(whole)
    damaged[position + 11] = 0x7F  # the length of this packet
    path = tmp_path / 'damaged.pcap'
    path.write_bytes(damaged)
    run = read_trace(path, LIMITS, TEXTS)
    full = read(usual_run(), tmp_path)
    assert 0 < len(run.times) < len(full.times)
    assert np.array_equal(run.positions, full.positions[: len(run.times)])
    assert f'damaged at byte {position}' in run.notes[0]
    assert 'the data after it is missing' in run.notes[0]


def test_report_notes_a_missing_packet(tmp_path):
    whole, records, position = usual_run().content(), [], 24
    while position < len(whole):
        end = position + 16 + struct.unpack_from('<I', whole, position + 8)[0]
        records.append(whole[position:end])
        position = end
    lost = next(n for n in range(len(records) // 2, len(records)) if len(records[n]) > 100)
    path = tmp_path / 'lacking.pcap'
    path.write_bytes(whole[:24] + b''.join(records[:lost] + records[lost + 1 :]))
    run, full = read_trace(path, LIMITS, TEXTS), read(usual_run(), tmp_path)
    assert 0 < len(run.times) < len(full.times)
    assert 'is missing, with it' in run.notes[0]
    assert not any('is missing' in note for note in full.notes)


def test_estimated_sending_times_remove_the_arrival_jitter(tmp_path):
    jitter = np.random.default_rng(3).exponential(0.004, 4000)
    recorder = Recorder()
    recorder.connect(0.0, 11002)
    arrived = 0.0
    for slot in range(800):
        time = 0.01 + slot * 0.005
        arrived = max(time + jitter[slot], arrived + 2e-6)
        recorder.controller_sends(arrived, 11002, JointPosition(0, (0.4 * time,) * 10))
    run = read(recorder, tmp_path)
    numbers = figures(run)
    settled = (run.times > 1.0) & (run.times < 3.5)
    bare, _ = derivatives(run.times, run.positions)
    error = np.abs(numbers.velocities[settled, 0] - 0.4).mean()
    assert error < 0.25 * np.abs(bare[settled, 0] - 0.4).mean()
    assert error < 0.01
    assert np.all(run.sent <= run.times + 1e-5)


@pytest.mark.invariant(7)
def test_unordered_points_give_a_plan_with_increasing_times(tmp_path):
    recorder = usual_run()
    for number, duration in enumerate((0.0, 2.0, -1.5, 0.5, 4.0)):
        point = JointTrajPt(number, (0.1 * number,) * 10, 0.5, duration)
        recorder.driver_sends(4.2 + 0.1 * number, 11000, point)
    plan = read(recorder, tmp_path).plans[-1]
    assert np.all(np.diff(plan.times) > 0.0)
    assert len(plan.times) == len(plan.positions) == 3


@pytest.mark.invariant(7)
@pytest.mark.parametrize('wrong', [float('nan'), float('inf'), 3e38, 2.5])
def test_implausible_joints_are_an_event_and_not_in_the_figures(tmp_path, wrong):
    recorder = usual_run()
    recorder.controller_sends(4.004, 11002, JointPosition(0, (wrong,) * 10))
    recorder.controller_sends(4.006, 11002, JointPosition(0, (wrong,) * 10))
    recorder.driver_sends(4.007, 11000, JointTrajPt(0, (wrong,) * 10))
    run = read(recorder, tmp_path)
    warnings = [text for text in texts(run, 'warning') if 'implausible' in text]
    assert len(warnings) == 1
    numbers = figures(run)
    assert np.isfinite(numbers.velocities).all()
    assert np.abs(numbers.velocities).max() < 1.1
    assert len(run.sent) == len(run.times)
    assert page([(run, numbers)], load_robot_model('c3_a601s'))  # json.dumps takes no NaN


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'', 'not a capture'),
        (b'\0' * 100, 'not a capture'),
        (usual_run().content()[:24], 'no connection to a controller'),
    ],
)
def test_file_without_a_run_is_refused_with_the_reason(tmp_path, content, message):
    path = tmp_path / 'bad.pcap'
    path.write_bytes(content)
    with pytest.raises(RunError, match=message) as error:
        read_trace(path, LIMITS, TEXTS)
    assert str(path) in str(error.value)


def test_trace_without_joint_states_is_refused(tmp_path):
    recorder = Recorder()
    recorder.connect(0.0, 11002)
    recorder.controller_sends(0.1, 11002, Status())
    with pytest.raises(RunError, match='no joint states'):
        read(recorder, tmp_path)


def answered(recorder: Recorder, time: float, message, result: Result) -> None:
    """Record a Motoman request, and its answer 4 ms later."""
    recorder.driver_sends(time, 11000, message)
    number = message.command if isinstance(message, MotionCtrl) else 14
    reply = MotionReply(0, message.sequence, number, result)
    recorder.controller_sends(time + 0.004, 11000, reply, answers=True)


def test_points_repeated_for_a_busy_controller_are_one_plan(tmp_path):
    recorder = usual_run()
    attempts = [
        (0, Result.BUSY),
        (0, Result.SUCCESS),
        (1, Result.BUSY),
        (1, Result.SUCCESS),
        (2, Result.SUCCESS),
    ]
    for step, (number, result) in enumerate(attempts):
        point = JointTrajPtFull(0, number, 7, 0.5 * number, (0.1 * number,) * 10)
        answered(recorder, 4.1 + 0.05 * step, point, result)
    run = read(recorder, tmp_path)
    plan = run.plans[-1]
    assert plan.sent == pytest.approx(4.1, abs=1e-6)
    assert plan.times == pytest.approx([0.0, 0.5, 1.0])
    assert plan.positions[:, 0] == pytest.approx([0.0, 0.1, 0.2])
    assert len(run.plans) == 2
    assert not any('refused' in text for text in texts(run))


def test_motoman_commands_and_refusals_are_events(tmp_path):
    recorder = usual_run()
    answered(recorder, 4.1, MotionCtrl(0, 1, Command.START_SERVOS), Result.SUCCESS)
    answered(recorder, 4.2, MotionCtrl(0, 2, Command.STOP_MOTION), Result.ALARM)
    answered(recorder, 4.3, MotionCtrl(0, 3, 200199), Result.INVALID)
    run = read(recorder, tmp_path)
    assert 'motors on requested' in texts(run, 'info')
    assert 'STOP sent' in texts(run, 'warning')
    assert texts(run, 'error') == [
        'the controller refused STOP_MOTION 2',
        'the controller refused command 200199 3',
    ]


def test_failed_ping_is_reported_as_a_stalled_driver(tmp_path):
    recorder = usual_run()
    recorder.raw(4.1, 11000, encode(reply(Ping(), ReplyCode.FAILURE), LITTLE_ENDIAN))
    run = read(recorder, tmp_path)
    (error,) = [event for event in run.events if event.level == 'error']
    assert error.text == 'the controller stopped the arm: it received nothing from the driver'


@pytest.mark.invariant(8)
def test_time_stamps_of_the_controller_give_sending_times(tmp_path):
    recorder = Recorder()
    recorder.connect(0.0, 11002)
    late = np.random.default_rng(5).exponential(0.004, 400)
    fields = ValidFields.TIME | ValidFields.POSITION
    arrived = 0.0
    for slot in range(400):
        stamp = 7.0 + 0.01 * slot
        arrived = max(0.01 + 0.01 * slot + late[slot], arrived + 2e-6)
        recorder.controller_sends(
            arrived, 11002, JointFeedback(0, fields, stamp, (0.4 * stamp,) * 10)
        )
    run = read(recorder, tmp_path)
    assert np.diff(run.sent)[100:] == pytest.approx(0.01, abs=2e-4)
    assert np.diff(run.times)[100:].max() > 0.015
    assert np.all(run.sent <= run.times + 1e-5)


def test_mode_and_errors_without_a_number_are_events():
    def condition(time, in_error, mode):
        return Condition(time, (YES, NO, in_error, NO, YES), mode)

    seen = list(
        condition_events(
            [
                condition(0.0, NO, UNKNOWN),
                condition(1.0, YES, 1),
                condition(2.0, YES, 1),
                condition(3.0, NO, 2),
                condition(4.0, NO, UNKNOWN),
            ],
            TEXTS,
        )
    )
    assert [(event.time, event.level, event.text) for event in seen] == [
        (1.0, 'error', 'error without a number'),
        (1.0, 'warning', 'key switch: manual'),
        (3.0, 'info', 'error cleared'),
        (3.0, 'info', 'key switch: automatic'),
    ]
    assert all(event.remedy for event in seen if event.level != 'info')


MODEL = load_robot_model('gx8_c652s')
NAMES = MODEL.joint_names
