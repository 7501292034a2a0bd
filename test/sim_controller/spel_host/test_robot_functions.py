# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Robot functions of a SPEL+ program: values and errors."""

import numpy as np
import pytest
from support.controller_harness import MODEL
from support.longer_arm import arm_model
from support.spel_program_harness import SpelProgramHarness

from epson_driver.robots import load_robot_model
from epson_driver.spel.commands import COMMANDS
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.lint import check
from epson_driver.spel.lint_rules import SIMULATED

SCARA = load_robot_model('gx4_c251s')
BENT = np.radians([0.0, -10.0, 20.0, 0.0, -60.0, 0.0])


def run_main(caplog, body, seconds=0.5, **options):
    """Run the statements of a main. Line n is line n + 2 of main.prg."""
    harness = SpelProgramHarness(f'\nFunction main\n{body}\nFend\n', caplog, **options)
    harness.step(seconds)
    return harness


def refusal(caplog, body, **options):
    """Return number and sentence of the error that ends main in its last line."""
    harness = run_main(caplog, body, **options)
    place = f'main.prg:{body.count(chr(10)) + 3}: '
    (text,) = (message for message in caplog.messages if message.startswith(place))
    assert not np.any(np.diff(harness.positions, axis=0))
    assert not harness.controller.condition.powered
    return harness.controller.error_number, text.partition(' (task 1): ')[2]


@pytest.mark.parametrize(
    ('statement', 'text'),
    [
        ('Print Agl(7)', 'Agl: joint 7 is not in 1..6'),
        ('Print Pls(0)', 'Pls: joint 0 is not in 1..6'),
        ('Print PAgl(Here, 8)', 'PAgl: joint 8 is not in 1..6'),
        ('Print CtrlInfo(2)', 'CtrlInfo(2) is not simulated, only 1, 5, 6, 7'),
        ('Print RobotInfo(1)', 'RobotInfo(1) is not simulated, only 0'),
        ('Print Stat(2)', 'Stat(2) is not simulated, only 0, 1'),
        ('Print Accel(7)', 'Accel: 7 is not in 1..6'),
        ('Print JRange(1, 3)', 'JRange: 3 is not 1 or 2'),
        ('Speed 101', 'Speed: 101 is not in 1..100'),
        ('Accel 50, 0', 'Accel: 0 is not in 1..32767'),
        ('SpeedS 2001', 'SpeedS: 2001 is not in 0.1..2000'),
        ('AccelS 0', 'AccelS: 0 is not in 0.1..25000'),
        ('Tool 1', 'Tool: 1 is not defined: use TLSet, or add `1:'),
        ('Print Sw(9999)', 'DI port 9999 of 1 bits: there are 24 points'),
        (
            'Till Sw(9999) = On\nMotor On\nGo JA(1, 0, 0, 0, 0, 0) Till',
            'DI port 9999 of 1 bits: there are 24 points',
        ),
        ('Motor On\nGo JA(1, 2, 3, 4)', '4 values for 6 joints'),
        ('Motor On\nGo JA(1, 2, 3, 4, 5, 6, 7)', '7 values for 6 joints'),
    ],
)
def test_error_names_the_value_and_its_range(caplog, statement, text):
    number, sentence = refusal(caplog, statement, start=BENT)
    assert number == 9993
    assert text in sentence


@pytest.mark.parametrize('name', SIMULATED)
def test_check_warns_of_statements_that_are_not_simulated(caplog, name):
    known = SIMULATED[name]
    form = 'Print {}({})' if name in FUNCTIONS and name not in COMMANDS else '{} {}'
    *good, bad = (form.format(name, item) for item in (*known, max(known) + 1))
    source = 'Function main\n{}\nFend'
    assert check({'main.prg': source.format('\n'.join(good))}) == []
    (problem,) = check({'main.prg': source.format(bad)})
    assert (problem.rule, problem.warning) == ('not-simulated', True)
    assert refusal(caplog, '\n'.join((*good, bad)), start=BENT)[0] == 9993


def test_dll_call_is_an_error(caplog):
    source = (
        'Declare conv, "numbers.dll"(a As Long) As Long\nFunction main\n  Print conv(3)\nFend\n'
    )
    harness = SpelProgramHarness(source, caplog)
    harness.step(0.1)
    assert harness.controller.error_number == 2473
    assert 'main.prg:3: error 2473' in caplog.text
    assert 'conv of numbers.dll' in caplog.text


def test_values_beyond_the_joints_of_a_scara_must_be_0(caplog):
    harness = run_main(caplog, 'Motor On\nGo JA(10, 20, -30, 40, 0, 0)', 5.0, model=SCARA)
    assert harness.controller.error_number == 0
    expected = [*np.radians([10.0, 20.0]), -0.03, np.radians(40.0)]
    assert np.allclose(harness.position, expected, atol=1e-9)
    caplog.clear()
    number, sentence = refusal(caplog, 'Motor On\nGo JA(10, 20, -30, 40, 0, 1)', model=SCARA)
    assert number == 9993
    assert '6 values for 4 joints' in sentence


@pytest.mark.parametrize(
    ('model', 'point', 'listed'),
    [
        (SCARA, 'XY(200, 0, -20, 0)', ' ) /R /0'),
        (SCARA, 'XY(200, 0, -20, 0) /1 /L', ' ) /L /1'),
        (MODEL, 'XY(200, 0, -20, 0) /F /J6F1', ',    0.000,    0.000 ) /R /A /F /J6F1 /J4F0 /0'),
    ],
)
def test_printed_point_has_its_posture(caplog, model, point, listed):
    """Omitted values are defaults, which PList shows (p632)."""
    harness = run_main(caplog, f'  P1 = {point}\n  PList', model=model)
    assert harness.printed == ['P1 = XY( 200.000,    0.000,  -20.000,    0.000' + listed]


def test_point_of_a_file_has_its_posture(caplog):
    """RC+ writes no J6Flag of 0 as such, and 1 for /A and /NF."""
    body = '  P1 = XY(0, 400, 400, 0, -90, -90)\n  SavePoints "a.pts"\n  LoadPoints "a.pts"'
    (listed,) = run_main(caplog, f'{body}\n  PList').printed
    assert listed.endswith(',    0.000,  -90.000,  -90.000 ) /R /A /NF /J6F0 /J4F0 /0')


def test_go_pulse_reaches_the_encoder_pulses(caplog):
    per_degree = MODEL.pulses_per_unit * np.pi / 180.0
    pulses = ', '.join(f'{round(item)}' for item in per_degree * [4.0, -3.0, 2.0, 0.0, 1.0, -1.0])
    body = f'Motor On\nGo Pulse({pulses})\nWait 0.1\nPrint Pls(1), PPls(Pulse({pulses}), 3)'
    harness = run_main(caplog, body, 3.0)
    assert np.allclose(np.degrees(harness.position), [4.0, -3.0, 2.0, 0.0, 1.0, -1.0], atol=1e-4)
    assert harness.printed == [f'{round(per_degree[0] * 4.0)} {round(per_degree[2] * 2.0)}']


def test_angles_of_points_are_in_degrees_and_millimetres(caplog):
    body = 'Print PAgl(JA(1, 2, 3, 4, 5, 6), 6), Int(PAgl(Here, 5) + 0.5)'
    assert run_main(caplog, body, start=BENT).printed == ['6 -60']
    harness = run_main(caplog, 'Print PAgl(JA(1, 2, -30, 4), 3)', model=SCARA)
    assert harness.printed[-1] == '-30'


def test_targetok_and_ptptime_evaluate_a_target(caplog):
    body = """
      P1 = Here
      Print TargetOK(P1), TargetOK(P1 +Z(2000)), TargetOK(JA(500, 0, 0, 0, 0, 0))
      Print PTPTime(JA(0, -10, 20, 0, -60, 0), 0, 0) < 0.001, PTPTime(P1 +Z(2000), 0, 0)
      Speed 50; Accel 50, 50
      Print PTPTime(JA(60, -10, 20, 0, -60, 0), 0, 0) > PTPTime(JA(5, -10, 20, 0, -60, 0), 0, 0)
    """
    harness = run_main(caplog, body, start=BENT)
    assert harness.printed == ['-1 0 0', '-1 0', '-1']


def test_state_words_show_motors_motion_and_till(caplog):
    body = """
      Print Stat(1) And &H12, Stat(0) And &H100000, RobotInfo(0) And &H4008
      Motor On
      Print Stat(1) And &H12, RobotInfo(0) And &H4008
      Go JA(20, 0, 0, 0, 0, 0) Till MemSw(1) = Off
      Print Stat(1) And &H12, RobotInfo(0) And &H4008, TillOn
    """
    harness = run_main(caplog, body)
    assert harness.printed == ['0 0 0', f'{0x10} {0x8}', f'{0x12} {0x4008} -1']
    harness.do('E-stop press')
    assert harness.controller.condition.estopped


def test_athome_compares_with_homeset(caplog):
    harness = run_main(caplog, 'Print AtHome\nWait 1\nPrint AtHome\nWait 1\nPrint AtHome')
    pulses = np.rint(harness.controller.servo.position * MODEL.pulses_per_unit)
    harness.controller.spel.home = (int(pulses[0]) + 1, *map(int, pulses[1:]))
    harness.step(1.0)
    harness.controller.spel.home = tuple(map(int, pulses))
    harness.step(1.0)
    assert harness.printed == ['0', '0', '-1']


def test_statements_without_effect_are_accepted(caplog):
    body = 'Fine 10, 10, 10, 10\nArch 0, 10, 20\nPTPBoost 50\nQP Off\nTool 0\nPrint "taken"'
    harness = run_main(caplog, body)
    assert harness.printed == ['taken']
    assert harness.controller.error_number == 0


def test_cp_on_blends_motions_without_cp(caplog):
    slowest = {}
    for cp in ('On', 'Off'):
        body = f"""
          Motor On; Power High; Speed 50; Accel 50, 50
          CP {cp}
          Go AglToPls(20, 0, 0, 0, 0, 0)
          Go AglToPls(40, 0, 0, 0, 0, 0)
        """
        harness = run_main(caplog, body, 4.0)
        places = np.array(harness.positions)[:, 0]
        assert places[-1] == pytest.approx(np.radians(40.0), abs=1e-9)
        speeds = np.diff(places)[(places[:-1] > 0.2) & (places[:-1] < 0.6)]
        slowest[cp] = speeds.min()
        harness.assert_within_limits()
    assert slowest['On'] > 1e-4 > 1e-6 > slowest['Off']


def test_arm_without_closed_form_moves_by_angles_only(caplog, tmp_path):
    model = arm_model(tmp_path, 7)
    body = 'Motor On\nGo JA(5, 0, 0, 0, 0, 0, 3)\nPrint Int(Agl(7) + 0.5)'
    harness = run_main(caplog, body, 3.0, model=model)
    assert harness.printed == ['3']
    number, sentence = refusal(caplog, 'Motor On\nGo XY(300, 0, 300, 0, 90, 0)', model=model)
    assert number == 9993
    assert 'xy(300.000, 0.000, 300.000, 0.000, 90.000, 0.000): ' in sentence


def test_unknown_pulses_are_assumed_with_one_warning(caplog):
    body = 'Print Pls(1), Pls(3), JRange(3, 1)\nPrint PPls(JA(0, 0, -20, 0), 3)'
    start = np.array([0.1, 0.0, -0.01, 0.0])
    harness = run_main(caplog, body, model=load_robot_model('t6_602s'), start=start)
    known = round(0.1 * 3640.89 * 180.0 / np.pi)
    assert [message for message in caplog.messages if 'pulses' in message] == [
        'the encoder pulses of joint_3, joint_4 of the t6_602s are unknown, '
        'assuming 10000 per degree or mm'
    ]
    assert harness.printed == [f'{known} -100000 -2000000', '-200000']
