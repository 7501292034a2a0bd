# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Move, Jump, Pallet and places in space, by the kinematics of six-axis arms and SCARAs."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from support.examples import one_in
from support.spel_program_harness import STEP_S, SpelProgramHarness

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.sim_controller.arm.low_power import LOW_POWER
from epson_driver.sim_controller.spel_host.motion_statements import points_of
from epson_driver.sim_controller.spel_host.robot_motion import RobotMotion
from epson_driver.sim_controller.spel_host.robot_points import RobotPoints
from epson_driver.sim_controller.spel_host.robot_values import RobotContext
from epson_driver.spel import MotionRequest
from epson_driver.spel.frames import changed

BENT = np.radians([0.0, -10.0, 20.0, 0.0, -60.0, 0.0])
SCARA = load_robot_model('gx4_c251s')
MOVE = """
Function main
  Motor On
  Power High
  SpeedS 200; AccelS 1000
  P1 = Here
  P2 = P1 +X(120) -Z(60)
  Print "goes"
  Move P2{more}
  Print "there", Int(CX(Here) - CX(P1) + 0.5), Int(CZ(Here) - CZ(P1) + 0.5)
Fend
"""


def six_axis(caplog, source, **options):
    return SpelProgramHarness(source, caplog, start=BENT, **options)


def tool_places(harness):
    """Return the position of Tool 0 in each motion cycle, shape (k, 3), m."""
    arm = Kinematics(harness.controller.model)
    return np.array([arm.forward(joints)[:3, 3] for joints in harness.positions])


def assert_straight(harness):
    """Assert that Tool 0 has moved along the line from P1 to P2."""
    places = tool_places(harness)
    direction = np.array([0.12, 0.0, -0.06]) / np.hypot(0.12, 0.06)
    gone = (places - places[0]) @ Kinematics(harness.controller.model).from_base(np.eye(4))[:3, :3]
    assert np.abs(gone - (gone @ direction)[:, None] * direction).max() < 2e-5
    assert 0.005 < gone[-1] @ direction < 0.135


@pytest.mark.invariant(2)
def test_inv2_move_is_straight_and_reaches_the_programmed_speed(caplog):
    harness = six_axis(caplog, MOVE.format(more=''))
    harness.until(lambda: len(harness.printed) == 2)
    assert harness.printed[-1] == 'there 120 -60'
    assert_straight(harness)
    speeds = np.linalg.norm(np.diff(tool_places(harness), axis=0), axis=1) / STEP_S
    assert speeds.max() == pytest.approx(0.2, rel=0.01)
    harness.assert_within_limits()


def test_line_stays_straight_after_a_pause(caplog):
    harness = six_axis(caplog, MOVE.format(more=''))
    harness.until(lambda: 'goes' in harness.printed)
    harness.step(0.3)
    harness.do('pause')
    harness.step(1.0)
    held = harness.position
    assert not np.array_equal(held, BENT)
    harness.step(0.5)
    assert np.array_equal(harness.position, held)
    harness.do('continue')
    harness.until(lambda: 'there 120 -60' in harness.printed)
    assert_straight(harness)
    harness.assert_within_limits()


@pytest.mark.invariant(3)
def test_inv3_till_stops_a_line(caplog):
    source = MOVE.format(more=' Till MemSw(7) = On').replace('  Print "goes"', '  Xqt 2, stopper')
    harness = six_axis(caplog, source + 'Function stopper\n  Wait 0.4\n  MemOn 7\nFend\n')
    harness.until(lambda: len(harness.printed) == 1)
    assert harness.printed != ['there 120 -60']
    harness.step(0.5)
    assert not np.any(harness.velocity)
    assert_straight(harness)
    harness.assert_within_limits()


@pytest.mark.invariant(3)
def test_inv3_estop_stops_a_line_within_the_limits(caplog):
    harness = six_axis(caplog, MOVE.format(more=''))
    harness.until(lambda: 'goes' in harness.printed)
    harness.step(0.4)
    harness.do('E-stop press')
    harness.step(1.0)
    assert not np.any(harness.velocity)
    assert harness.tasks == []
    assert_straight(harness)
    harness.assert_within_limits()


@pytest.mark.parametrize(
    ('statement', 'number', 'text'),
    [
        ('Move P1 +Z(900)', 4007, 'out of reach at '),
        ('Move P1 +U(20)', 9993, 'only the orientation changes'),
        ('Jump P1', 9993, 'is not a SCARA'),
        ('Move AglToPls(500, 0, 0, 0, 0, 0)', 4001, 'joint_1'),
    ],
)
def test_impossible_path_is_refused_before_motion(caplog, statement, number, text):
    source = f'\nFunction main\n  Motor On\n  P1 = Here\n  {statement}\nFend\n'
    harness = six_axis(caplog, source)
    harness.step(0.5)
    assert harness.controller.error_number == number
    assert f'main.prg:5: error {number} in main' in caplog.text
    assert text in caplog.text
    assert not np.any(np.diff(harness.positions, axis=0))


def test_rot_turns_only_the_orientation(caplog):
    source = """
    Function main
      Motor On
      Power High
      P1 = Here
      Move P1 +U(20) ROT
      Print "there", Int(CU(Here) - CU(P1) + 0.5)
    Fend
    """
    harness = six_axis(caplog, source)
    harness.until(lambda: harness.printed == ['there 20'])
    places = tool_places(harness)
    assert np.abs(places - places[0]).max() < 2e-5
    harness.assert_within_limits()


@pytest.mark.parametrize('power', ['High', 'Low'])
def test_rot_selects_speedr_for_a_line(caplog, power):
    """SpeedS has no effect (p105), and low power still limits the tool speed."""
    source = f"""
    Function main
      Motor On
      Power {power}
      SpeedS 1; SpeedR 20; AccelR 100
      P1 = Here
      TmReset 1
      Move P1 +X(20) +U(20) ROT
      Print Dist(Here, P1 +X(20)) < 0.01, Tmr(1) > 1, Tmr(1) < 2
    Fend
    """
    harness = six_axis(caplog, source)
    harness.until(lambda: harness.printed)
    assert harness.printed[0].split()[:2] == ['-1', '-1']
    assert power == 'Low' or harness.printed[0].endswith('-1')
    speeds = np.linalg.norm(np.diff(tool_places(harness), axis=0), axis=1) / STEP_S
    assert power == 'High' or speeds.max() <= 0.0501
    harness.assert_within_limits()


JUMP = """
Function main
  Integer i
  Motor On
  Power High
  Speed 50; Accel 50, 50
  Go XY(100, 180, {deep}, 0)
  LimZ {high}
  Print "stands"
  Pallet 1, XY(100, 180, {deep}, 0), XY(160, 180, {deep}, 0), XY(100, 140, {deep}, 0), 2, 2
  For i = 2 To 4
    Jump Pallet(1, i)
    Print Int(CX(Here) + 0.5), Int(CY(Here) + 0.5), Int(Agl(3) + 0.5)
  Next
Fend
"""


def test_scara_jumps_over_a_pallet(caplog):
    harness = SpelProgramHarness(JUMP.format(deep=-80, high=-20), caplog, model=SCARA)
    harness.until(lambda: harness.printed == ['stands'])
    start = len(harness.positions)
    harness.until(lambda: len(harness.printed) == 4)
    assert harness.printed[1:] == ['160 180 -80', '100 140 -80', '160 140 -80']
    positions = np.array(harness.positions[start:])
    heights = positions[:, 2] * 1000.0
    sideways = np.abs(np.diff(positions[:, :2], axis=0)).max(axis=1) > 1e-9
    assert np.count_nonzero(sideways) > 30
    assert np.all(heights[:-1][sideways] > -20.001)
    assert heights.max() < -19.999
    harness.assert_within_limits()


ARCH = """
Function main
  Motor On{power}
  Speed 50; Accel 50, 50
  Go XY(100, 180, -60, 0)
  LimZ 0
  Arch 1, 15, 25
  Print "stands"
  Jump XY(180, 60, -80, 0){more}
  Print Int(CX(Here) + 0.5), Int(CY(Here) + 0.5), Int(Agl(3) + 0.5)
Fend
"""
HIGH = '; Power High'


def jump_profile(caplog, more, power=HIGH):
    """Return height, mm, and joints 1, 2 and 4 in each motion cycle of the Jump."""
    source = ARCH.format(power=power, more=more)
    harness = SpelProgramHarness(source, caplog, model=SCARA)
    harness.until(lambda: harness.printed == ['stands'])
    start = len(harness.positions) - 1
    harness.until(lambda: len(harness.printed) == 2)
    assert harness.printed[1] == '180 60 -80'
    harness.assert_within_limits()
    positions = np.array(harness.positions[start:])
    return positions[:, 2] * 1000.0, positions[:, [0, 1, 3]]


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('more', 'power', 'rise', 'fall'),
    [
        (' C1', HIGH, 15.0, 25.0),
        (' C0', HIGH, 30.0, 30.0),
        (' C1 Sense MemSw(1) = On', HIGH, 15.0, 80.0),
        (' C7', HIGH, 60.0, 80.0),
        ('', HIGH, 60.0, 80.0),
        (' C4', HIGH, 60.0, 80.0),  # 70 mm: more than there is to rise
        (' C1', '', 15.0, 25.0),
    ],
)
def test_inv2_jump_rounds_the_corners_of_its_arch(caplog, more, power, rise, fall):
    """SPEL+ reference, p. 110: the arch heights are where the crossing starts and ends."""
    heights, sideways = jump_profile(caplog, more, power)
    across = np.any(np.abs(sideways - sideways[0]) > 1e-9, axis=1)
    arrived = np.all(np.abs(sideways - sideways[-1]) < 1e-9, axis=1)
    cycle = np.abs(np.diff(heights)).max() + 0.01
    assert heights[np.argmax(across)] - heights[0] == pytest.approx(rise, abs=cycle)
    assert heights[np.argmax(arrived)] - heights[-1] == pytest.approx(fall, abs=cycle)
    assert heights.max() == pytest.approx(0.0, abs=0.01)


JUMP3 = """
Function main
  Motor On{power}
  Speed 20; Accel 20, 20; SpeedS 400; AccelS 2000
  Go Here -Z(80)
  P1 = Here
  P2 = P1 +X(120)
  Arch 1, 15, 25
  Print "stands"
  {statement} P1 +Z(60) -Y(10), P2 +Z(70), P2 {more}
  Print Dist(Here, P2) < 0.01
Fend
"""


def jump3_path(caplog, statement, more, power=HIGH):
    """Return the tool's positions relative to the start, mm, in P1's axes."""
    source = JUMP3.format(power=power, statement=statement, more=more)
    harness = six_axis(caplog, source)
    harness.until(lambda: 'stands' in harness.printed)
    start = len(harness.positions) - 1
    harness.until(lambda: len(harness.printed) > 1)
    base = Kinematics(harness.controller.model).from_base(np.eye(4))[:3, :3]
    places = tool_places(harness)[start:]
    return harness, (places - places[0]) @ base * 1000.0


def distances_from_line(places, begin, end):
    """Return the distances of places from the line through two others, mm."""
    direction = np.subtract(end, begin) / np.linalg.norm(np.subtract(end, begin))
    away = places - begin
    return np.linalg.norm(away - (away @ direction)[:, None] * direction, axis=1)


@pytest.mark.invariant(2)
@pytest.mark.parametrize('statement', one_in(2, ['Jump3', 'Jump3CP']))
@pytest.mark.parametrize(
    ('more', 'rise', 'fall'),
    [('C1', 15.0, 25.0), ('C0', 30.0, 30.0), ('C7', 60.83, 70.0), ('', 60.83, 70.0),
     ('C4', 60.83, 70.0)],
)  # fmt: skip
def test_inv2_jump3_rounds_the_corners_of_its_arch(caplog, statement, more, rise, fall):
    """SPEL+ reference, p. 477: the path leaves and joins the lines at the arch's distances."""
    harness, places = jump3_path(caplog, statement, more)
    assert harness.printed[1] == '-1'
    harness.assert_within_limits()
    arched = more in ('C1', 'C0')
    up = distances_from_line(places, (0, 0, 0), (0, -10, 60)) < 0.01
    down = distances_from_line(places, (120, 0, 0), (120, 0, 70)) < 0.01
    heights = np.linalg.norm(places, axis=1), np.linalg.norm(places - (120, 0, 0), axis=1)
    left, joined = int(np.argmin(up)), len(down) - int(np.argmin(down[::-1]))
    assert heights[0][left] > rise - 0.1
    assert heights[1][joined] > fall - 0.1
    speeds = np.abs(np.diff(harness.positions[-len(places) :], axis=0)).max(axis=1)
    assert (speeds[left - 5 : joined].min() > 1e-5) == arched


def crossing_and_height(caplog, statement, power):
    """Return the crossing, 0 to 1, and the height of an arch, mm, in each motion cycle."""
    caplog.clear()
    if statement == 'Jump':
        heights, sideways = jump_profile(caplog, ' C1', power)
        gone = sideways[:, 0] - sideways[0, 0]
    else:
        harness, places = jump3_path(caplog, statement, 'C1', power)
        gone, heights = places[:, 0], places[:, 2]
        speeds = np.linalg.norm(np.diff(tool_places(harness), axis=0), axis=1) / STEP_S
        assert power == HIGH or speeds.max() < 0.25
    return gone / gone[-1], heights


@pytest.mark.parametrize('statement', one_in(3, ['Jump', 'Jump3', 'Jump3CP']))
def test_arch_of_a_jump_is_lower_at_low_power(caplog, statement):
    """SPEL+ reference, p. 474, p. 479: "When speed is lower, the trajectory will be lower"."""
    fast, slow = (crossing_and_height(caplog, statement, power) for power in (HIGH, ''))
    for fraction in (0.05, 0.15, 0.85, 0.95):
        assert np.interp(fraction, *slow) < np.interp(fraction, *fast) - 5.0


@pytest.mark.parametrize('after', [0.1, 0.3, 0.5, 0.7])
def test_jump3_continues_after_a_pause_in_any_phase(caplog, after):
    source = JUMP3.format(power=HIGH, statement='Jump3', more='C1')
    harness = six_axis(caplog, source)
    harness.until(lambda: 'stands' in harness.printed)
    harness.step(after)
    harness.do('pause')
    harness.step(1.0)
    assert not np.any(harness.velocity)
    harness.do('continue')
    harness.until(lambda: len(harness.printed) > 1)
    assert harness.printed[1] == '-1'
    assert 'from joint to joint' not in caplog.text
    harness.assert_within_limits()


def arch_of(caplog, name, low_power):
    """Return a robot, and the motion of a Jump3 with an arch of 15 and 25 mm from BENT."""
    controller = six_axis(caplog, 'Function main\nFend\n').controller
    for setting, values in (('SpeedS', (800.0,)), ('AccelS', (8000.0, 8000.0))):
        controller.change_setting(setting, values)
    motion = RobotMotion(controller.arm.executor, controller.clock, lambda: None, 0.01)
    robot = RobotContext(controller, motion, RobotPoints(controller.model))
    here = robot.points.place(BENT)
    there = changed(changed(here, '+', 'x', 150.0), '+', 'z', -60.0)
    low = changed(there, '+', 'z', -70.0)
    ends = changed(here, '+', 'z', -60.0), there, low
    numbers = {'depart': 15.0, 'approach': 25.0}
    (point,) = points_of(robot, MotionRequest(name, ends, numbers=numbers))
    return robot, point.path(BENT, low_power)


@pytest.mark.slow
@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('name', 'low_power'),
    one_in(
        4,
        [('jump3', False), ('jump3', True), ('jump3cp', True), ('jump3cp', False)],
        several=True,
    ),
)
def test_inv2_arch_and_a_stop_on_it_respect_every_limit(caplog, name, low_power):
    """At full speed, where two motions of the same joints overlap (p479)."""
    robot, motion = arch_of(caplog, name, low_power)
    limits = robot.controller.model.limits
    if low_power:
        limits = replace(limits, velocity=LOW_POWER * limits.velocity)
    stops = [motion.stop(time) for time in np.linspace(0.0, motion.duration, 60).tolist()]
    for item in (motion, *stops):
        states = [item.at(time) for time in np.linspace(0.0, item.duration, 300).tolist()]
        positions, velocities, accelerations = (
            np.array(part) for part in zip(*states, strict=True)
        )
        assert np.all((positions >= limits.position_min) & (positions <= limits.position_max))
        assert np.max(np.abs(velocities) / limits.velocity) <= 1.0 + 1e-9
        assert np.max(np.abs(accelerations) / limits.acceleration) <= 1.0 + 1e-9
        assert np.abs(velocities[-1]).max() < 1e-9
    assert motion.stop(0.4 * motion.duration).duration < 0.6 * motion.duration


@pytest.mark.parametrize(
    ('go', 'number', 'text'),
    [(-10, 4005, 'the arm, at -10, is above'), (-40, 4006, 'the target, at -10, is above')],
)
def test_jump_below_limz_is_refused(caplog, go, number, text):
    """SPEL+ reference, p. 474."""
    source = f'Function main\n  Motor On\n  Go XY(100, 180, {go}, 0)\n  LimZ -20\n'
    source += '  Jump XY(150, 150, -10, 0)\nFend\n'
    harness = SpelProgramHarness(source, caplog, model=SCARA)
    harness.until(lambda: harness.controller.error_number == number)
    assert text in caplog.text


@pytest.mark.parametrize('arch', ['C0', ''])
def test_parallel_statements_of_a_jump_start_with_the_crossing(caplog, arch):
    """P57: D0 at the end of the rise, D50 at half of the crossing."""
    source = ARCH.format(power=HIGH, more=f' {arch} !D0; Print Agl(3); D50; Print Agl(1)!')
    harness = SpelProgramHarness(source, caplog, model=SCARA)
    harness.until(lambda: harness.printed == ['stands'])
    start = np.degrees(harness.position[0])
    harness.until(lambda: len(harness.printed) == 4)
    _, height, half, _ = harness.printed
    end = np.degrees(harness.position[0])
    assert -31.0 < float(height) < -28.0 if arch else float(height) > -0.1
    assert (float(half) - start) / (end - start) == pytest.approx(0.5, abs=0.1)


@pytest.mark.invariant(3)
def test_inv3_till_ends_a_jump_and_its_remaining_phases(caplog):
    source = (
        JUMP.format(deep=-84, high=0)
        .replace('Pallet(1, i)', 'Pallet(1, i) Till MemSw(1) = On')
        .replace('  For i', '  Xqt 2, stopper\n  For i')
    )
    source = source.replace('To 4', 'To 2') + 'Function stopper\n  Wait 0.05\n  MemOn 1\nFend\n'
    harness = SpelProgramHarness(source, caplog, model=SCARA)
    harness.until(lambda: len(harness.printed) == 2)
    rest = harness.position
    assert harness.printed[1] != '160 180 -84'
    harness.step(1.0)
    assert np.array_equal(harness.position, rest)
    harness.assert_within_limits()


def test_line_with_half_a_turn_is_executed(caplog):
    source = """
    Function main
      Motor On
      P1 = Here
      Move P1 +X(20) :U(CU(P1) + 180) :V(CV(P1)) :W(CW(P1))
    Fend
    """
    start = np.radians([0.0, 0.0, 0.0, 0.0, -90.0, 0.0])  # Tool 0 looks down
    harness = SpelProgramHarness(source, caplog, start=start)
    harness.step(12.0)
    assert harness.controller.error_number == 0
    turned = harness.positions[-1] - start
    assert abs(turned[5]) == pytest.approx(np.pi - abs(turned[0]), abs=1e-3)


def test_blocked_line_is_resumed_slowly_in_joint_space(caplog):
    harness = six_axis(caplog, 'Function main\nFend\n')
    controller = harness.controller
    motion = RobotMotion(controller.arm.executor, controller.clock, lambda: None, 0.01)
    robot = RobotContext(controller, motion, RobotPoints(controller.model))
    place = robot.points.place(BENT)
    target = changed(place, '+', 'x', 50.0)
    (point,) = points_of(robot, MotionRequest('move', (target,)))
    assert point.path is not None
    straight = point.path(BENT, False)
    assert np.allclose(straight.end, point.target, atol=1e-9)
    assert caplog.text.count('from joint to joint') == 0
    elsewhere = BENT + np.radians([160.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # through the base
    slow = point.path(elsewhere, False)
    assert np.allclose(slow.end, point.target, atol=1e-9)
    assert 'continues in joint space: ' in caplog.text
    limits = controller.model.limits
    fraction = LOW_POWER
    times = np.linspace(0.0, slow.duration, 200)
    speeds = np.array([slow.at(time)[1] for time in times])
    assert np.max(np.abs(speeds) / limits.velocity) <= fraction * 1.001


@pytest.mark.invariant(2)
def test_inv2_line_past_a_singularity_is_refused(caplog):
    """A real arm would leave the line (p157), in a way that is not known."""
    caplog.set_level(logging.INFO)
    harness = SpelProgramHarness(
        'Function main\n  Motor On; Power High; P1 = Here +Z(100)\n  Move P1\nFend\n',
        caplog,
        start=np.radians([0.0, -10.0, 20.0, 5.0, 12.0, 0.0]),
    )
    harness.until(lambda: harness.controller.error_number)
    assert harness.controller.error_number == 4007
    assert 'a singularity at ' in caplog.text
    assert 'AvoidSingularity is not simulated' in caplog.text
    assert np.ptp(harness.positions, axis=0).max() < 1e-9
