# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Arcs, relative motions, Jump3, Pass, tools, locals, Sense, Find, parallel processing."""

import numpy as np
import pytest
from support.spel_program_harness import SpelProgramHarness

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.sim_controller.spel_host.robot_points import RobotPoints
from epson_driver.spel import Point

BENT = np.radians([0.0, -10.0, 20.0, 0.0, -60.0, 0.0])
SCARA = load_robot_model('gx4_c251s')
FOLDED = np.array([0.3, 0.9, -0.05, 0.0])


def run_main(caplog, body, more='', **options):
    """Return a harness in which a main with these statements has printed "there"."""
    source = f'Function main\n  Motor On; Power High\n{body}\n  Print "there"\nFend\n{more}'
    harness = SpelProgramHarness(source, caplog, **{'start': BENT, **options})
    harness.until(lambda: 'there' in harness.printed or harness.controller.error_number)
    assert harness.controller.error_number == 0, caplog.text
    harness.assert_within_limits()
    return harness


def scara(caplog, body):
    return run_main(caplog, body, start=FOLDED, model=SCARA)


@pytest.mark.parametrize('name', ['gx8_c652s', 'rs4_c351s', 'n2_a450sr'])
def test_zero_is_printed_without_a_sign(caplog, name):
    """At 0 pulses (p890) Z of a SCARA is 0 instead of -5e-14, and no value is -0.000."""
    model = load_robot_model(name)
    values = RobotPoints(model).place(np.zeros(len(model.joint_names))).values
    assert not any(0.0 < abs(value) < 1e-9 or str(value) == '-0.0' for value in values)
    assert len(model.joint_names) == 6 or values[2] == 0.0


@pytest.mark.invariant(2)
def test_inv2_arc3_passes_its_point_on_a_circle(caplog):
    harness = run_main(
        caplog,
        '  SpeedS 200; AccelS 1000; P1 = Here\n  Arc3 P1 +X(40) +Z(40), P1 +X(80)\n'
        '  Print Int(CX(Here) - CX(P1) + 0.5), Int(CZ(Here) - CZ(P1) + 0.5)',
    )
    assert harness.printed[0] == '80 0'
    arm = Kinematics(harness.controller.model)
    places = np.array(
        [arm.in_base(arm.forward(position))[:3, 3] for position in harness.positions]
    )
    center = places[0] + [0.04, 0.0, 0.0]
    assert np.abs(np.linalg.norm(places - center, axis=1) - 0.04).max() < 2e-5
    assert places[:, 2].max() - places[0, 2] == pytest.approx(0.04, abs=1e-4)


@pytest.mark.invariant(2)
def test_inv2_arc_is_circular_in_the_plane_with_linear_height(caplog):
    """SPEL+ reference, p. 106: the height of the intermediate point is ignored."""
    harness = run_main(
        caplog,
        '  SpeedS 200; AccelS 1000; P1 = Here\n  Arc P1 +X(40) +Y(40) +Z(90), P1 +X(80) +Z(20)',
    )
    arm = Kinematics(harness.controller.model)
    places = np.array(
        [arm.in_base(arm.forward(position))[:3, 3] for position in harness.positions]
    )
    away = places - places[0]
    assert np.abs(np.linalg.norm(away[:, :2] - [0.04, 0.0], axis=1) - 0.04).max() < 2e-5
    turned = np.abs(np.arctan2(away[:, 1], 0.04 - away[:, 0])) / np.pi
    assert np.abs(away[1:, 2] - 0.02 * turned[1:]).max() < 2e-4
    assert away[-1] == pytest.approx([0.08, 0.0, 0.02], abs=1e-5)


def test_step_in_a_local_follows_its_axes(caplog):
    """The example of p164, with its places made smaller for the arm."""
    harness = scara(
        caplog,
        '  P1 = XY(100, 150, -20, 0) /L; Local 1, XY(7, 8, 0, 45)\n  Go P1; Print Here\n'
        '  BGo XY(0, 30, 0, 0); Print Here\n  BGo XY(0, 30, 0, 0) /1; Print Here\n'
        '  Go P1; BMove XY(0, 20, 0, 0) /1; Print Here',
    )
    places = [tuple(float(line.split()[at]) for at in (1, 3, 7)) for line in harness.printed[:4]]
    assert places == [(100, 150, 0), (100, 180, 0), (78.787, 201.213, 0), (85.858, 164.142, 0)]
    assert all(line.endswith('/L /0') for line in harness.printed[:4])


@pytest.mark.parametrize(
    ('statement', 'shown'),
    [
        ('Go P1', '/R /A /NF /J6F0 /J4F0 /0'),
        ('Go P1 /F', '/R /A /F /J6F0 /J4F0 /0'),
        ('Go P1 /J6F1 :U(CU(P1) + 30)', '/R /A /NF /J6F1 /J4F0 /0'),
        ('Go LJM(P1 /F)', '/R /A /NF /J6F0 /J4F0 /0'),
        ('Go P1 /F LJM', '/R /A /NF /J6F0 /J4F0 /0'),
        ('Pass P1 /F, P1 /F LJM', '/R /A /NF /J6F0 /J4F0 /0'),
        ('Go P1 /F; BGo XY(0, 0, 5, 0, 0, 0)', '/R /A /F /J6F0 /J4F0 /0'),
    ],
)
def test_point_is_reached_in_its_posture(caplog, statement, shown):
    """SPEL+ reference, p. 592: an omitted flag is the default. LJM selects the nearest posture."""
    harness = run_main(caplog, f'  P1 = Here\n  Go P1 +Z(10)\n  {statement}\n  Print Here')
    assert harness.printed[0].endswith(shown)


@pytest.mark.parametrize(
    'name',
    ['c4_a601s', 'c8_a701s', 'vt6_a901s', 'n2_a450s', 'gx4_c251s', 't3_401s', 'rs4_551s'],
)
def test_place_and_posture_give_the_taught_joints(name):
    model = load_robot_model(name)
    points, limits = RobotPoints(model), model.limits
    random = np.random.default_rng(1)
    wide = 2.0 * np.pi - 0.01
    for _ in range(60):
        joints, near = random.uniform(
            np.maximum(limits.position_min, -wide),
            np.minimum(limits.position_max, wide),
            (2, len(model.joint_names)),
        )
        assert np.allclose(points.joints(points.place(joints), near), joints, atol=1e-6)


def test_relative_motions_move_in_tool_and_base_frames(caplog):
    """TMove and TGo in the tool frame, BMove and BGo in the base frame (p827, p163)."""
    harness = run_main(
        caplog,
        '  P1 = Here\n  TMove XY(0, 0, 20, 0, 0, 0)\n  Print Dist(Here, P1 +TLZ(20)) < 0.01\n'
        '  TGo XY(0, 0, -20, 0, 0, 0)\n  Print Dist(Here, P1) < 0.01\n'
        '  BMove XY(10, 0, 0, 0, 0, 0)\n  Print Dist(Here, P1 +X(10)) < 0.01\n'
        '  BGo XY(0, 0, 10, 0, 0, 0)\n  Print Dist(Here, P1 +X(10) +Z(10)) < 0.01\n'
        '  Move P1 -TLX(15)\n  Print Dist(Here, P1 -TLX(15)) < 0.01',
    )
    assert harness.printed[:5] == ['-1'] * 5


@pytest.mark.invariant(2)
@pytest.mark.parametrize(
    ('arc', 'sweep', 'center'),
    [  # p104 to p109: the end is 80 along X, plus is counterclockwise from above
        ('P2, 180', 180, (40, 0)),
        ('P2, -90', -90, (40, -40)),
        ('P2, 270', 270, (40, -40)),
        ('P2, 50, ARC_SHORT, ARC_MINUS', -106.26, (40, -30)),
        ('P2, 50, ARC_LONG, ARC_PLUS', 253.74, (40, -30)),
        ('P2, P1 +X(40) +Y(30) +Z(50), ARC_SHORT', 106.26, (40, 30)),
        ('P2, P1 +X(25) +Y(30), ARC_LONG', -253.74, (40, 30)),
        ('P2, P1 +X(40), ARC_SHORT', 180, (40, 0)),
        ('P2, P1 +X(40), ARC_LONG', -180, (40, 0)),
    ],
)
def test_inv2_arc_is_executed_from_an_angle_a_radius_or_a_centre(caplog, arc, sweep, center):
    harness = run_main(
        caplog,
        f'  SpeedS 300; AccelS 2000; P1 = Here; P2 = P1 +X(80)\n  Arc {arc}\n'
        '  Print Dist(Here, P2) < 0.01',
    )
    assert harness.printed[0] == '-1'
    arm = Kinematics(harness.controller.model)
    places = np.array(
        [arm.in_base(arm.forward(position))[:3, 3] for position in harness.positions]
    )
    about = (places - places[0])[:, :2] * 1000.0 - center
    assert np.ptp(np.linalg.norm(about, axis=1)) < 0.05
    angles = np.degrees(np.unwrap(np.arctan2(about[:, 1], about[:, 0])))
    assert angles[-1] - angles[0] == pytest.approx(sweep, abs=0.05)
    assert np.ptp(places[:, 2]) < 5e-5


@pytest.mark.parametrize(
    ('arc', 'text'),
    [
        ('Arc P2, 39, ARC_SHORT, ARC_PLUS', 'the radius at least 40.000'),
        ('Arc P2, 40, 2, ARC_PLUS', 'ARC_SHORT or ARC_LONG'),
        ('Arc P2, 50, ARC_SHORT, 0', 'ARC_PLUS or ARC_MINUS'),
        ('Arc P2, 0', 'cannot have 0 degrees'),
        ('Arc P2, 360', 'cannot have 360 degrees'),
        ('Arc P1, 90', 'no arc from'),
        ('Arc P2 /L, 90', 'has another hand'),
        ('Arc3 P1 +Z(9) /L, P2', 'has another hand'),
        (
            'Arc3 P2, P1 +X(40), ARC_SHORT',
            'a half circle needs a via point that determines its plane',
        ),
        ('Arc3 P1 +X(40) +Y(40), P2 ECP', 'ECP is not simulated'),
        ('Go P1 SYNC', 'SYNC is not simulated'),
        ('JumpTLZ P1, -20', 'is not of the N series'),
    ],
)
def test_invalid_arc_is_refused_before_motion(caplog, arc, text):
    source = f'Function main\n  Motor On; P1 = Here; P2 = P1 +X(80)\n  {arc}\nFend'
    harness = SpelProgramHarness(source, caplog, start=BENT)
    harness.until(lambda: harness.controller.error_number)
    assert text in caplog.text
    assert np.ptp(harness.positions, axis=0).max() < 1e-9


def numbered(model, seed):
    """Return the points of a model, a reachable place and start joints."""
    points, limits = RobotPoints(model), model.limits
    random = np.random.default_rng(seed)
    joints, near = random.uniform(limits.position_min * 0.9, limits.position_max * 0.9, (2, 6))
    return points, points.place(joints), near


@pytest.mark.parametrize('number', [1, 2, 3, 4])
@pytest.mark.parametrize('seed', range(5))
def test_ljm_of_six_axes_moves_one_joint_the_least(number, seed):
    """SPEL+ reference, p. 508: 2 keeps the wrist. 1, 3 and 4 move joints 4, 5 and 6 least."""
    model = load_robot_model('c4_a601s')
    points, place, near = numbered(model, seed)
    kept = {'r', 'l', 'a', 'b'} & {*points.place(near).flags}
    result = points.least_motion(place, near, number)
    assert kept <= {*result.flags}
    assert number != 2 or ('f' in result.flags) == ('f' in points.place(near).flags)
    joints = points.joints(result, near)
    assert points.place(joints).values == pytest.approx(place.values, abs=1e-6)
    if number != 2:
        joint, arm = {1: 3, 3: 4, 4: 5}[number], Kinematics(model)
        ways = arm.inverse(arm.forward(joints), near)
        steps = [abs(way - near)[joint] for way in ways if kept <= {*points.place(way).flags}]
        assert abs(joints - near)[joint] == pytest.approx(min(steps), abs=1e-5)


@pytest.mark.parametrize(
    ('number', 'hand', 'elbow'),
    [(1, '', 'a'), (2, '', 'a'), (3, '=', '='), (4, '=', '='), (5, '!', 'a'), (6, '!', 'a'),
     (7, '', 'b'), (8, '', 'b')],
)  # fmt: skip
@pytest.mark.parametrize('seed', range(3))
def test_ljm_of_an_n_series_arm_may_change_hand_and_elbow(number, hand, elbow, seed):
    points, place, near = numbered(load_robot_model('n2_a450s'), seed)
    here = points.place(near)
    result = points.least_motion(place, near, number)
    joints = points.joints(result, near)
    assert points.place(joints).values == pytest.approx(place.values, abs=1e-6)
    same = ('r' in result.flags) == ('r' in here.flags)
    assert hand in ('', '=' if same else '!')
    kept = 'a' if 'a' in here.flags else 'b'
    assert (kept if elbow == '=' else elbow) in result.flags


FOLDING = load_robot_model('n2_a450s')


def test_jump_tlz_moves_along_the_tool_axis_and_across(caplog):
    harness = run_main(
        caplog,
        '  P1 = Here; P2 = P1 +TLX(40) +TLY(10) +TLZ(5)\n  JumpTLZ P2, -30\n'
        '  Print Dist(Here, P2) < 0.01',
        start=np.radians([10.0, 30.0, 60.0, 0.0, 60.0, 20.0]),
        model=FOLDING,
    )
    assert harness.printed[0] == '-1'
    arm = Kinematics(FOLDING)
    first = np.linalg.inv(arm.forward(harness.positions[0]))
    along = (
        np.array([(first @ arm.forward(position))[:3, 3] for position in harness.positions]) * 1000
    )
    assert along[:, 2].min() == pytest.approx(-30.0, abs=0.5)
    risen = np.argmax(along[:, 2] < -29.99)
    assert np.abs(along[:risen, :2]).max() < 0.05
    down = len(along) - np.argmax(along[::-1, 2] < -29.99)
    assert np.abs(along[down:, :2] - [40.0, 10.0]).max() < 0.05


def test_hanging_n_series_arm_jumps_below_its_base(caplog):
    """Like EPSON's N2_sample, in the default posture. Joint 1 does not move."""
    harness = run_main(
        caplog,
        '  P1 = XY(190, 190, -560, 135, -45, 90); P2 = XY(-190, -190, -590, 90, 0, 180)\n'
        '  Go P1; Print Agl(1); JumpTLZ P2, -30; Print Agl(1), Dist(Here, P2) < 0.01',
        start=np.radians([10.0, 30.0, 60.0, 0.0, 60.0, 20.0]),
        model=load_robot_model('n2_a450sr'),
    )
    assert harness.printed[:2] == ['45', '45 -1']


def test_point_of_an_n_series_arm_stores_its_undetermined_angle():
    """J4Angle of a straight wrist (p455), which Here stores."""
    points = RobotPoints(FOLDING)
    joints = np.radians([10.0, 30.0, 60.0, 25.0, 0.0, 20.0])
    place = points.place(joints)
    assert 'j4a25.000' in place.flags
    assert np.allclose(points.joints(place, np.zeros(6)), joints, atol=1e-6)
    turned = points.joints(place.flagged('j4a5'), np.zeros(6))
    assert np.degrees(turned[[3, 5]]) == pytest.approx([5.0, 40.0])


@pytest.mark.parametrize(
    ('name', 'over'),
    [
        ('n2_a450s', (0.0, 0.0, 620.0, 90.0, 0.0, 0.0)),
        ('rs4_551s', (0.0, 0.0, -20.0, 50.0, 0.0, 0.0)),
    ],
)
def test_point_on_the_axis_of_joint_1_stores_its_angle(name, over):
    """J1Angle of N and RS (p449), 0 by default."""
    model = load_robot_model(name)
    points = RobotPoints(model)
    near = np.zeros(len(model.joint_names))
    for flags, angle in (((), 0.0), (('j1a30',), 30.0), (('j1a-45',), -45.0)):
        joints = points.joints(Point('xy', over, flags), near)
        assert np.degrees(joints[0]) == pytest.approx(angle)
        place = points.place(joints)
        assert place.values == pytest.approx(over, abs=1e-6)
        assert np.allclose(points.joints(place, near), joints, atol=1e-6)


def test_jump3_moves_up_across_and_down(caplog):
    harness = run_main(
        caplog,
        '  P1 = Here; P2 = P1 +Y(60)\n  Jump3 P1 +Z(30), P2 +Z(30), P2\n'
        '  Print Dist(Here, P2) < 0.01\n  Jump3CP P2 +Z(20), P1 +Z(20), P1\n'
        '  Print Dist(Here, P1) < 0.01',
    )
    assert harness.printed[:2] == ['-1', '-1']


NEAR_THREE = (
    'Pass P1 +X(20), P1 +Y(20), P1',
    'Pass P1 +X(20); Pass P1 +Y(20); Pass P1',
    'P3 = P1; P2 = P1 +Y(20); P4 = P1 +X(20)\n  Pass P4, On 1, P(2:3)',
)


@pytest.mark.parametrize('motions', NEAR_THREE)
def test_pass_moves_near_its_points_without_a_stop(caplog, motions):
    harness = run_main(caplog, f'  Speed 30; Accel 30, 30; P1 = Here\n  {motions}')
    steps = np.linalg.norm(np.diff(harness.positions, axis=0), axis=1)
    fast = np.flatnonzero(steps > 0.05 * steps.max())
    assert np.all(np.diff(fast) == 1)


def test_next_motion_starts_at_the_end_of_pass(caplog):
    """SPEL+ reference, p. 604: the program continues before Pass ends, without Fine."""
    joints = ', '.join(f'PAgl(P2, {joint})' for joint in range(1, 7))
    harness = run_main(
        caplog,
        f'  Speed 30; Accel 30, 30; P1 = Here; P2 = P1 +X(20)\n  Print {joints}\n  Pass P2\n'
        '  Print Dist(RealPos, P2) > 0.1\n  Go P1 +Y(20)',
    )
    assert harness.printed[1] == '-1'
    there = np.radians([float(item) for item in harness.printed[0].split()])
    assert np.abs(harness.positions - there).max(axis=1).min() < 1e-5


def test_tool_is_the_reference_of_places_and_lines(caplog):
    harness = run_main(
        caplog,
        '  P1 = Here\n  TLSet 1, XY(0, 0, 100, 0)\n  Tool 1\n'
        '  Print Dist(Here, P1 +TLZ(100)) < 0.01, Tool, CZ(TLSet(1)), TLDef(2)\n'
        '  P2 = Here\n  Move P2 +X(30)\n  Print Dist(Here, P2 +X(30)) < 0.01\n'
        '  TLClr 1\n  Print Tool, Dist(Here, P1 +X(30)) < 0.01\n'
        '  OnErr GoTo failed\n  Tool 2\nfailed:\n  Print Err',
    )
    assert harness.printed[:4] == ['-1 1 100 0', '-1', '0 -1', '9993']


def test_point_of_a_local_is_transformed(caplog):
    harness = run_main(
        caplog,
        '  P1 = Here\n  Local 2, P1\n  Go XY(0, 0, 15, 0, 0, 0) /2\n'
        '  Print Dist(Here, P1 +TLZ(15)) < 0.01, Int(CZ(Here @2) + 0.5)\n'
        '  Print Int(PAgl(XY(0, 0, 15, 0, 0, 0) /2, 1) - Agl(1) + 0.5)',
    )
    assert harness.printed[:2] == ['-1 15', '0']


def test_jump_respects_limz_and_evaluates_sense_above_its_target(caplog):
    harness = scara(
        caplog,
        '  LimZ 0; P1 = Here; P2 = P1 +U(20)\n  Jump P2 LimZ -30\n'
        '  Jump P1 LimZ -30 Sense Sw(3) = Off\n  Print JS, Int(CZ(Here) - CZ(P1) + 0.5), LimZ\n'
        '  Jump P2 LimZ -30 Sense Sw(3) = On\n  Print JS, Dist(Here, P2) < 0.01',
    )
    assert harness.printed[:2] == ['-1 20 0', '0 -1']
    assert max(np.array(harness.positions)[:, 2]) == pytest.approx(-0.03, abs=1e-6)


def test_find_stores_the_position_at_the_condition(caplog):
    harness = run_main(
        caplog,
        '  Speed 5; P1 = Here\n  Xqt switch\n  Go P1 -Y(100) Find MemSw(1) = On\n'
        '  Print PosFound, CY(FindPos) < CY(P1) - 1, CY(FindPos) > CY(Here) + 1\n'
        '  Go P1 Find MemSw(2) = On\n  Print PosFound',
        'Function switch\n  Wait 0.5\n  MemOn 1\nFend\n',
    )
    assert harness.printed[:2] == ['-1 -1 -1', '0']


def test_parallel_outputs_switch_at_their_fraction_of_the_path(caplog):
    """!…! (p56): the statement ends with both the motion and the parallel statements."""
    harness = run_main(
        caplog,
        '  Speed 20; P1 = Here; TmReset 0\n'
        '  Go P1 -Y(120) ! D0; On 1; D50; On 2; Wait 0.05; Off 1; D100; On 3 !\n'
        '  Print Oport(1), Oport(2), Oport(3)\n'
        '  Xqt watch\n  Go P1 ! D50; MemOn 1 !\n  Wait 0.1',
        'Function watch\n  Wait MemSw(1) = On\n'
        '  Print CY(CurPos) < CY(P1) - 40 And CY(CurPos) > CY(P1) - 80\nFend\n',
    )
    assert harness.printed[:2] == ['0 1 1', '-1']


def test_error_of_a_parallel_statement_belongs_to_its_task(caplog):
    harness = run_main(
        caplog,
        '  OnErr GoTo failed\n  P1 = Here\n  Go P1 +Y(10) ! D50; Error 8123 !\n  Print "no"\n'
        'failed:\n  Print Err, Dist(Here, P1 +Y(10)) < 0.01',
    )
    assert harness.printed[0] == '8123 -1'
