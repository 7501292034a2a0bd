# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ statements through $Execute, and the functions that can be printed."""

import numpy as np
import pytest
from support.controller_harness import PROFILE, Harness, point
from support.remote_harness import Remote

from epson_driver.sim_controller.condition.spel_settings import SETTINGS
from epson_driver.sim_controller.condition.states import Motors, Power
from epson_driver.sim_controller.remote.spel_functions import FUNCTIONS
from epson_driver.sim_controller.remote.spel_statements import MOTION_STATEMENTS, STATEMENTS
from epson_driver.simple_message import IoType


@pytest.fixture
def remote():
    return Remote()


@pytest.fixture
def execute(remote):
    return lambda statement: remote(f'Execute,"{statement}"')


def test_motors(execute, remote):
    assert execute('Motor On') == '#Execute,0'
    assert remote.controller.condition.motors is Motors.ON
    assert execute('Print Motor') == '#Execute,"1"'
    assert execute('MOTOR   off') == '#Execute,0'
    assert remote.controller.condition.motors is Motors.OFF
    assert execute('Motor') == '!Execute,15'
    assert execute('Motor Maybe') == '!Execute,15'


def test_power(execute, remote):
    assert execute('Power High') == '!Execute,20'
    assert execute('Motor On') == '#Execute,0'
    assert execute('Power High') == '#Execute,0'
    assert remote.controller.condition.power is Power.HIGH
    assert execute('Print Power') == '#Execute,"1"'
    assert execute('Power Low') == '#Execute,0'
    assert remote.controller.condition.power is Power.HELD_LOW
    assert execute('Power Medium') == '!Execute,15'


def test_reset_and_reset_if(execute):
    assert execute('Reset') == '#Execute,0'
    assert execute('If Error On Then Reset') == '#Execute,0'
    assert execute('if  error  on then reset') == '#Execute,0'
    assert execute('If Sw(1) = On Then Reset') == '!Execute,15'
    assert execute('Reset Error') == '!Execute,12'


def test_in_an_error_nothing_is_executed(execute, remote):
    remote.harness.send(point(0))
    assert execute('If Error On Then Reset') == '!Execute,20'
    assert remote('Sim,why') == (
        '#Sim,there is error 4031 (motion attempted with the motors off): reset first'
    )
    assert remote('Sim,print,Err,ErrorOn') == '#Sim,4031 -1'


def test_outputs(execute, remote):
    io = remote.controller.io
    assert execute('On 3') == '#Execute,0'
    assert io.read(IoType.DIGITAL_OUTPUT, 3) == 1
    assert execute('Off 3') == '#Execute,0'
    assert io.read(IoType.DIGITAL_OUTPUT, 3) == 0
    assert execute('Out 1, 129') == '#Execute,0'
    assert execute('Print Out(0), Out(1), Oport(8), Oport(9)') == '#Execute,"0 129 1 0"'
    for wrong, number in (
        ('On', 12),
        ('On x', 15),
        ('On 16', 15),
        ('On -1', 15),
        ('On 3, 0.5', 12),
        ('Out 1', 12),
        ('Out 0, 256', 15),
        ('Out 2, 1', 15),
    ):
        assert execute(wrong) == f'!Execute,{number}'


def test_memory_io(execute):
    assert execute('MemOn 7') == '#Execute,0'
    assert execute('Print MemSw(7), MemIn(0), MemInW(0)') == '#Execute,"1 128 128"'
    assert execute('MemOff 7') == '#Execute,0'
    assert execute('MemOut 1, 255') == '#Execute,0'
    assert execute('Print MemSw(7),MemInW(0)') == f'#Execute,"0 {0xFF00}"'


@pytest.mark.parametrize('name', MOTION_STATEMENTS)
def test_statements_that_would_move_the_arm_are_refused(execute, remote, name):
    remote.harness.do('motors on')
    assert execute(f'{name} P1') == '!Execute,20'
    assert remote('Sim,why') == f'#Sim,{name}: only the motion port moves this arm'
    assert not remote.controller.moving


@pytest.mark.parametrize('statement', ['', '   ', '1', '=', '(On 1)', '"', 'On 1 : Off 1'])
def test_what_is_no_statement(execute, statement):
    assert execute(statement) in ('!Execute,12', '!Execute,15')


@pytest.mark.parametrize('statement', ['Quit All', 'Xqt main', 'SFree 1', 'P1 = Here', 'Onn 3'])
def test_other_statements_are_unknown(execute, statement):
    assert execute(statement) == '!Execute,15'


@pytest.mark.parametrize('name', SETTINGS)
def test_ranges_of_settings(execute, remote, name):
    setting = SETTINGS[name]
    for value in (setting.low, setting.high):
        numbers = ','.join([f'{value:g}'] * setting.least)
        assert execute(f'{name} {numbers}') == '#Execute,0'
        assert execute(f'Print {name}') == f'#Execute,"{value:g}"'
    for value in (setting.low - 0.1, setting.high * 1.001):
        assert execute(f'{name} {",".join([str(value)] * setting.least)}') == '!Execute,15'
        assert f'must be a number from {setting.low:g} to {setting.high:g}' in remote('Sim,why')
    for wrong in ('', 'fast', 'nan', 'inf', '1e999', '1_0'):
        numbers = ','.join([wrong] * setting.least)
        assert execute(f'{name} {numbers}') in ('!Execute,12', '!Execute,15')
    assert execute(f'{name} ' + ','.join(['1'] * (setting.most + 1))) == '!Execute,12'
    assert execute(f'Print {name}') == f'#Execute,"{setting.high:g}"'


def test_speed_and_accel_act_on_the_arm_until_motors_on_reset_or_stop(execute, remote):
    arm, motion = remote.controller.arm.executor, PROFILE.motion
    for back in ('SetMotorsOn', 'Reset', 'Stop'):
        assert execute('Speed 20') == '#Execute,0'
        assert execute('Accel 30, 40') == '#Execute,0'
        assert (arm.speed, arm.accel) == (pytest.approx(0.2), pytest.approx(0.3))
        assert execute('SpeedFactor 50') == '#Execute,0'
        assert arm.speed == pytest.approx(0.1)
        assert execute('Print Speed, Accel(1), Accel(2), SpeedFactor') == '#Execute,"20 30 40 50"'
        assert execute('Print Accel(3)') == '!Execute,15'
        assert remote(back) == f'#{back},0'
        assert (arm.speed, arm.accel) == (motion.speed, motion.accel)
        assert execute('Print SpeedFactor, SpeedS') == '#Execute,"100 50"'


def test_a_slower_speed_is_a_slower_arm():
    def duration(*statements):
        harness = Harness()
        remote = Remote(harness)
        for statement in ('Power High', *statements):
            assert remote(f'Execute,"{statement}"') == '#Execute,0'
        harness.send(point(0, (1.0,)))
        return harness.rest()

    assert duration('Speed 10') > 2.0 * duration('Speed 50')


def test_home_position(execute, remote):
    assert execute('HomeSet 0,0,0,0,0,-1000') == '#Execute,0'
    assert remote.controller.spel.home == (0, 0, 0, 0, 0, -1000)
    assert execute('HomeSet 0,0,0') == '!Execute,12'
    assert execute('HomeSet 0,0,0,0,0,0.5') == '!Execute,15'
    limit = int(np.degrees(remote.controller.model.limits.position_max[0]) * 29127.11)
    assert execute(f'HomeSet {limit},0,0,0,0,0') == '#Execute,0'
    assert execute(f'HomeSet {limit + 10},0,0,0,0,0') == '!Execute,15'
    assert 'HomeSet joint 1' in remote('Sim,why')
    assert remote.controller.spel.home == (limit, 0, 0, 0, 0, 0)


def test_joints_are_printed_in_degrees_and_pulses():
    remote = Remote(Harness([0.5, -0.25, 0.0, 0.0, 0.0, 1.0], motors=False))
    angles = remote('Sim,print,Agl(1),Agl(2),Agl(6)').removeprefix('#Sim,').split()
    assert [float(angle) for angle in angles] == pytest.approx([28.648, -14.324, 57.296], abs=2e-3)
    pulses = int(remote('Sim,print,Pls(1)').removeprefix('#Sim,'))
    assert pulses == pytest.approx(np.degrees(0.5) * 29127.11, abs=1.0)
    assert remote('Sim,print,Agl(7)') == '!Sim,15'
    assert remote('Sim,print,Agl(0)') == '!Sim,15'


PRINTED = {
    'CtrlInfo(1)': '1',
    'CtrlInfo(5)': '26',
    'CtrlInfo(6)': '1',
    'CtrlInfo(7)': '1',
    'RobotInfo(0)': str(0x100),
    'Stat(0)': str(0x7 | 0x200000 | 0x400000),
    'Stat(1)': '0',
    'TaskState(1)': '1',
    'TaskState(9)': '0',
    'TaskInfo(2,2)': '2',
    'Err': '0',
    'Err(1)': '0',
    'ErrMsg$(2902)': 'network error: the client is lost',
    'ErrorOn': '0',
    'EStopOn': '0',
    'SafetyOn': '0',
    'PauseOn': '0',
    'Motor': '0',
    'Power': '0',
    'Robot': '1',
    'Agl(1)': '0.000',
    'Pls(1)': '0',
    'Speed': '50',
    'Accel(2)': '50',
    'SpeedFactor': '100',
    'SpeedS': '50',
    'AccelS': '200',
    'Weight': '1',
    'Sw(0)': '0',
    'In(0)': '0',
    'InW(0)': '0',
    'Oport(0)': '0',
    'Out(0)': '0',
    'OutW(0)': '0',
    'MemSw(0)': '0',
    'MemIn(0)': '0',
    'MemInW(0)': '0',
}


@pytest.mark.parametrize('function', PRINTED)
def test_a_function_after_booting(remote, function):
    assert remote(f'Sim,print,{function}') == f'#Sim,{PRINTED[function]}'
    assert remote(f'Execute,"Print {function.lower()}"') == f'#Execute,"{PRINTED[function]}"'


def test_every_function_is_tested():
    without_default = {'SpeedR', 'AccelR', 'Inertia'}
    assert {text.partition('(')[0] for text in PRINTED} | without_default == set(FUNCTIONS)
    assert not any(SETTINGS[name].default for name in without_default)
    assert set(STATEMENTS) > set(SETTINGS)


def test_functions_in_an_estop(remote):
    remote.harness.do('E-stop press', 'door open')
    assert remote('Sim,print,EStopOn,SafetyOn,ErrorOn,PauseOn,Err,Err(1),Err(2),TaskState(1)') == (
        '#Sim,-1 -1 -1 0 2261 2261 0 5'
    )
    assert remote('Execute,"Print EStopOn"') == '!Execute,20'


@pytest.mark.parametrize(
    ('text', 'number'),
    [
        ('', 12),
        (',', 12),
        ('Err,', 12),
        ('Err Err', 12),
        ('Agl(1', 12),
        ('Agl(Agl(1))', 12),
        ('"text"', 12),
        ('1 + 1', 12),
        ('Agl', 12),
        ('Agl()', 12),
        ('Agl(1,2)', 12),
        ('Agl(x)', 15),
        ('Nothing(1)', 15),
        ('CtrlInfo(3)', 15),
        ('TaskState(0)', 15),
        ('TaskInfo(1,1)', 15),
        ('TaskInfo(4,2)', 15),
        ('Sw(24)', 15),
        ('In(3)', 15),
        ('SpeedR', 15),
    ],
)
def test_what_cannot_be_printed(remote, text, number):
    assert remote(f'Sim,print,{text}') == f'!Sim,{number}'
    assert remote(f'Execute,"Print {text}"') == f'!Execute,{number}'


def test_reset_if_resets_an_error(remote):
    """$Execute is refused in an error: only a program's own statement gets so far."""
    remote.controller.raise_error(8123)
    STATEMENTS['If'].run(remote.controller, 'Error On Then Reset')
    assert remote.controller.error_number == 0
