# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Remote Ethernet lines against the controller, without sockets: commands and rejections."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.controller_harness import Harness, Remote, point
from support.examples import examples

from epson_driver.profiles import load_controller_profile
from epson_driver.robots import load_robot_model
from epson_driver.sim_controller.assembly import new_controller
from epson_driver.sim_controller.condition.states import Mode, Motors, Power, Tasks
from epson_driver.sim_controller.remote.remote_commands import COMMANDS
from epson_driver.sim_controller.remote.sim_commands import SIM_COMMANDS

FAR = (1.0, 0.5, -0.5)


@pytest.fixture
def remote():
    return Remote()


def moving():
    """Return a remote client of a controller whose arm moves."""
    harness = Harness()
    harness.send(point(0, FAR, 0.1))
    harness.step(0.2)
    assert harness.controller.in_motion
    return Remote(harness)


@pytest.mark.parametrize(
    ('line', 'answer'),
    [
        ('GetStatus', '!GetStatus,10'),
        ('#GetStatus', '!#GetStatus,10'),
        ('$', '!,11'),
        ('$Dance', '!Dance,11'),
        ('$Dance,1,2', '!Dance,11'),
        ('$SetMotorsOn,2', '!SetMotorsOn,15'),
        ('$SetMotorsOn,one', '!SetMotorsOn,15'),
        ('$Start', '!Start,12'),
        ('$Start,1', '!Start,15'),
        ('$Start,64', '!Start,15'),
        ('$Start,x', '!Start,15'),
        ('$SetCurRobot', '!SetCurRobot,12'),
        ('$SetCurRobot,2', '!SetCurRobot,15'),
        ('$GetIO', '!GetIO,12'),
        ('$GetIO,x', '!GetIO,15'),
        ('$GetIO,-1', '!GetIO,15'),
        ('$GetIO,24', '!GetIO,15'),
        ('$GetIOByte,3', '!GetIOByte,15'),
        ('$GetIOWord,2', '!GetIOWord,15'),
        ('$GetMemIO,512', '!GetMemIO,15'),
        ('$SetIO,0', '!SetIO,12'),
        ('$SetIO,0,2', '!SetIO,15'),
        ('$SetIO,16,1', '!SetIO,15'),
        ('$SetIOByte,0,100', '!SetIOByte,15'),
        ('$SetIOByte,0,0x1', '!SetIOByte,15'),
        ('$SetIOByte,2,1', '!SetIOByte,15'),
        ('$SetMemIOWord,0,10000', '!SetMemIOWord,15'),
        ('$GetIO,' + '9' * 200, '!GetIO,15'),
        ('$GetVariable', '!GetVariable,12'),
        ('$GetVariable,g_speed', '!GetVariable,15'),
        ('$SetVariable,g_speed', '!SetVariable,12'),
        ('$SetVariable,g_speed,1', '!SetVariable,15'),
        ('$Execute', '!Execute,12'),
        ('$Execute,Motor On', '!Execute,12'),
        ('$Execute,"Motor On', '!Execute,12'),
        ('$Execute,"', '!Execute,12'),
        ('$Execute,"Dance"', '!Execute,15'),
        ('$Home', '!Home,99'),
        ('$GetErrMsg,x', '!GetErrMsg,15'),
        ('$GetErrMsg,4031,9', '!GetErrMsg,15'),
        ('$Sim', '!Sim,15'),
        ('$Sim,estop', '!Sim,15'),
        ('$Sim,estop,kick', '!Sim,15'),
        ('$Sim,estop,press,twice', '!Sim,15'),
        ('$Sim,dance', '!Sim,15'),
        ('$Sim,io,DI', '!Sim,12'),
        ('$Sim,io,XX,1', '!Sim,15'),
        ('$Sim,io,DI,24', '!Sim,15'),
        ('$Sim,io,DI,1,2', '!Sim,15'),
        ('$Sim,disturb,1', '!Sim,12'),
        ('$Sim,disturb,7,1', '!Sim,15'),
        ('$Sim,disturb,1,nan', '!Sim,15'),
        ('$Sim,disturb,1,1e9', '!Sim,15'),
        ('$Sim,fault,dance', '!Sim,15'),
        ('$Sim,fault,clear,dance', '!Sim,15'),
        ('$Sim,fault,list,1', '!Sim,12'),
        ('$Sim,reboot,0', '!Sim,15'),
        ('$Sim,timing,1', '!Sim,12'),
        ('$Sim,print,Dance(1)', '!Sim,15'),
    ],
)
def test_invalid_command_gets_its_error_number(remote, line, answer):
    assert remote.answers(line.encode() + b'\r\n') == [answer]
    assert remote('Sim,why') != '#Sim,'
    assert remote.controller.condition.motors is Motors.OFF
    assert remote('SetMotorsOn,1') == '#SetMotorsOn,0'


@pytest.mark.parametrize('robot', ['', ',1', ',0', ', 1'])
def test_robot_number_of_motor_commands_is_optional(remote, robot):
    assert remote('SetMotorsOn' + robot) == '#SetMotorsOn,0'
    assert remote.controller.condition.motors is Motors.ON
    assert remote('GetMotor,0') == '#GetMotor,1,1,0'
    assert remote('SetMotorsOff' + robot) == '#SetMotorsOff,0'
    assert remote.controller.condition.motors is Motors.OFF
    assert remote('GetMotor,0') == '#GetMotor,1,0,0'


@pytest.mark.parametrize(
    'line',
    ['SetCurRobot,0', 'GetStatus,0', 'Reset,0', 'Stop,0', 'SetMotorsOn,1,CLRF', 'Logout,0'],
)
def test_surplus_parameters_of_clients_in_production_are_ignored(remote, line):
    name = line.partition(',')[0]
    assert remote(line).startswith(f'#{name},')


def test_estop_requires_release_and_reset_before_motors_on(remote):
    assert remote('SetMotorsOn,1') == '#SetMotorsOn,0'
    assert remote('Sim,estop,press') == '#Sim,0'
    assert remote('GetStatus') == '#GetStatus,00100011001,2261'
    assert remote('SetMotorsOn,1') == '!SetMotorsOn,20'
    assert remote('Sim,why') == ('#Sim,the E-stop is pressed: release the E-stop, then reset')
    assert remote('Reset') == '!Reset,20'
    assert remote('Sim,estop,release') == '#Sim,0'
    assert remote('SetMotorsOn,1') == '!SetMotorsOn,20'
    assert remote('Reset') == '#Reset,0'
    assert remote('GetStatus') == '#GetStatus,00100000001,0000'
    assert remote('GetMotor,0') == '#GetMotor,1,0,0'
    assert remote('SetMotorsOn,1') == '#SetMotorsOn,0'


def test_pause_continue_stop_and_start_control_the_tasks():
    remote = moving()
    assert remote('Pause') == '#Pause,0'
    assert remote('GetStatus') == '#GetStatus,00100000100,0000'
    assert remote('Pause') == '!Pause,20'
    assert remote('Continue') == '#Continue,0'
    assert remote('Continue') == '!Continue,20'
    assert remote('Sim,why') == '#Sim,nothing is paused'
    assert remote('Stop') == '#Stop,0'
    assert remote.controller.condition.tasks is Tasks.STOPPED
    assert remote('Start,0') == '!Start,20'
    assert remote('Sim,why') == '#Sim,the arm is still moving: try again when it has stopped'
    remote.harness.rest()
    assert remote('Pause') == '!Pause,20'
    assert remote('Start,0') == '#Start,0'
    assert remote.controller.condition.tasks is Tasks.RUNNING


VIOLATIONS = {
    'Auto': ('mode manual', 'the key switch is at MANUAL: turn it to AUTO first'),
    'Ready': ('pause', 'the tasks are paused: continue, or stop, first'),
    'no EStop': ('E-stop press', 'the E-stop is pressed: release the E-stop, then reset'),
    'no Safeguard': ('door open', 'the safeguard door is open: close it first'),
    'no Error': (
        'refused',
        'error 4031 (motion attempted with the motors off): reset first',
    ),
    'no SPEL+ program': ('spel', 'the program runs: stop first'),
    'tasks run': ('stop', 'the tasks are stopped: nothing to pause'),
    'Paused': ('nothing', 'nothing is paused'),
}
"""Event that violates each requirement, and the text of the rejection."""

PARAMETERS = {
    'Start': ',0',
    'SetCurRobot': ',1',
    'Execute': ',"Print Err"',
    'SetVariable': ',g_speed,1',
    **{f'Set{space}{size}': ',0,0' for space in ('IO', 'MemIO') for size in ('', 'Byte', 'Word')},
}


@pytest.mark.parametrize(
    ('name', 'need'),
    [(name, need.text) for name in COMMANDS for need in COMMANDS[name].requirements],
)
def test_unmet_requirement_refuses_the_command(name, need, monkeypatch):
    remote = Remote()
    event, sentence = VIOLATIONS[need]
    if event == 'refused':
        remote.harness.send(point(0, FAR))
        assert remote.controller.error_number == 4031
    elif event == 'spel':
        monkeypatch.setattr(type(remote.controller.program), 'runs', True)
    elif event != 'nothing':
        remote.harness.do(event)
    before = remote.controller.condition
    assert remote(name + PARAMETERS.get(name, '')) == f'!{name},20'
    assert remote.controller.condition == before
    why = remote('Sim,why')
    assert why == f'#Sim,{sentence}'


@pytest.mark.parametrize('name', [name for name in COMMANDS if COMMANDS[name].requirements])
def test_commands_that_require_ready_are_refused_in_motion(name):
    remote = moving()
    answer = remote(name + PARAMETERS.get(name, ''))
    needs = [need.text for need in COMMANDS[name].requirements]
    if 'Ready' in needs:
        assert answer == f'!{name},20'
        assert remote('Sim,why') == '#Sim,the arm is still moving: try again when it has stopped'
        assert remote.controller.in_motion
    elif name == 'Continue':
        assert answer == '!Continue,20'
    else:
        assert answer == f'#{name},0'


def test_io_is_read_and_written_as_bits_bytes_and_words(remote):
    io = remote.controller.io
    assert remote('SetIO,3,1') == '#SetIO,0'
    assert io.read(2, 3) == 1
    assert remote('SetIOByte,1,a5') == '#SetIOByte,0'
    assert remote('Sim,print,Out(0),Out(1),OutW(0),Oport(3),Oport(4)') == (
        f'#Sim,8 {0xA5} {0xA508} 1 0'
    )
    assert remote('SetIOWord,0,00FF') == '#SetIOWord,0'
    assert remote('Sim,print,OutW(0)') == '#Sim,255'
    assert remote('GetIO,3') == '#GetIO,0'  # an input
    io.set_input(1, 3, 1)
    io.set_input(1, 17, 1)
    assert remote('GetIO,3') == '#GetIO,1'
    assert remote('GetIOByte,0') == '#GetIOByte,08'
    assert remote('GetIOByte,2') == '#GetIOByte,02'
    assert remote('GetIOWord,0') == '#GetIOWord,0008'
    assert remote('GetIOWord,1') == '#GetIOWord,0002'  # only eight of its bits exist


def test_memory_io_is_read_and_written(remote):
    assert remote('SetMemIO,511,1') == '#SetMemIO,0'
    assert remote('GetMemIO,511') == '#GetMemIO,1'
    assert remote('GetMemIOByte,63') == '#GetMemIOByte,80'
    assert remote('SetMemIOWord,31,BEEF') == '#SetMemIOWord,0'
    assert remote('GetMemIOWord,31') == '#GetMemIOWord,BEEF'
    assert remote('SetMemIOByte,62,00') == '#SetMemIOByte,0'
    assert remote('GetMemIOWord,31') == '#GetMemIOWord,BE00'
    assert remote('GetIO,0') == '#GetIO,0'


def test_commands_of_epsons_node_red_client_are_answered(remote):
    answers = {
        'GetContName': '0',
        'GetContNo': 'simulated',
        'GetContVer': 'simulated',
        'GetContType': 'SIMULATED',
        'GetRobotInfo': '1,5,C3-A601S',
        'GetRobotName,0': '1,c3_a601s',
        'GetRobotSerial,0': '1,simulated',
        'GetCurRobot': '1',
        'GetContDev': '26',
        'GetContSettings': '00000000100000000000001',
        'GetContMacAdd': '00-00-00-00-00-00',
        'GetSubnetMask': '255.255.255.0',
        'GetDefaultGateway': '0.0.0.0',
        'GetCpuLoad': '0',
        'GetHofs,1': '0,0,0,0,0,0',
        'GetHealthCont': '-1',
        'GetHealthRB,1,2,3': '-1',
        'GetPartWarning,1': '0,0,0,0,0,0',
        'GetPrjName': 'epson_driver',
        'GetStatus': '00100000001,0000',
        'GetMotor,0': '1,0,0',
        'GetErrMsg,4031,0': 'motion attempted with the motors off',
        'GetErrFunc,4031': '0',
        'SetCurRobot,1': '0',
        'Abort': '0',
    }
    for command, value in answers.items():
        assert remote(command) == f'#{command.partition(",")[0]},{value}'


def test_commands_of_the_python_package_epsonrc_are_answered(remote):
    """The lines that its `begin()` sends. Motion is tested in test_execute.py."""
    statements = (
        'Speed 50',
        'SpeedS 1000',
        'Accel 60,60',
        'AccelS 200',
        'Weight 0',
        'Inertia 0',
        'SpeedFactor 50',
        'Power Low',
        'HomeSet 0,0,0,0,0,0',
    )
    assert remote('Login') == '#Login,0'
    assert remote('SetMotorsOn,0') == '#SetMotorsOn,0'
    for statement in statements:
        assert remote(f'Execute,"{statement}"') == '#Execute,0'
    assert remote.controller.arm.executor.speed == pytest.approx(0.25)
    assert remote.controller.arm.executor.accel == pytest.approx(0.6)
    assert remote.controller.condition.power is Power.LOW
    assert remote('Execute,"If Error On Then Reset"') == '!Execute,12'  # SPEL+ reference, p. 937


def test_get_status_shows_motion_and_after_a_wrong_point_the_error():
    remote = moving()
    assert remote('GetStatus') == '#GetStatus,00100000010,0000'
    remote.harness.send(point(9))
    remote.harness.rest()
    assert remote('GetStatus') == '#GetStatus,00100001001,8000'


# ---- commands of the simulation


def test_sim_commands_operate_door_key_switch_and_power(remote):
    assert remote('Sim,power,high') == '!Sim,20'  # the motors are off
    assert remote('SetMotorsOn,1') == '#SetMotorsOn,0'
    assert remote('Sim,power,high') == '#Sim,0'
    assert remote.controller.condition.power is Power.HIGH
    assert remote('Sim,mode,manual') == '#Sim,0'
    assert remote.controller.condition.mode is Mode.MANUAL
    assert remote('Sim,power,high') == '!Sim,20'
    assert remote('Sim,mode,auto') == '#Sim,0'
    assert remote('Sim,power,low') == '#Sim,0'
    assert remote('Sim,door,open') == '#Sim,0'
    assert remote('Sim,condition') == (
        '#Sim,motors=off;estop=not active;door=open;tasks=paused by the door;fault=none;'
        'mode=AUTO;power=low by choice'
    )
    assert remote('Sim,door,close') == '#Sim,0'
    assert remote('Continue') == '#Continue,0'


def test_io_points_are_listed_read_and_set(remote):
    assert remote('Sim,io') == '#Sim,DI=24:;DO=16:;AI=2:0 0;AO=2:0 0;flag=512:'
    assert remote('Sim,io,di,3,1') == '#Sim,0'
    assert remote('Sim,io,DO,0,1') == '#Sim,0'
    assert remote('Sim,io,AI,1,-2500') == '#Sim,0'
    assert remote('Sim,io,flag,7,1') == '#Sim,0'
    assert remote('Sim,io,AI,1') == '#Sim,-2500'
    assert remote('Sim,io,DI,3') == '#Sim,1'
    assert remote('Sim,io') == '#Sim,DI=24:3;DO=16:0;AI=2:0 -2500;AO=2:0 0;flag=512:7'
    assert remote('Sim,io,AO,0,99999') == '!Sim,15'
    assert 'must be -10000 to 10000 mV' in remote('Sim,why')


def test_sim_disturb_moves_a_joint(remote):
    assert remote('Sim,disturb,2,-1.5') == '#Sim,0'
    assert remote('Sim,joints').startswith('#Sim,0.00000 -1.50000 0.00000 ')
    assert remote('Sim,disturb,3,300') == '!Sim,20'


def test_controller_without_a_program_has_no_tasks_that_an_estop_aborts():
    model, profile = load_robot_model('t6_602s'), load_controller_profile('remote')
    remote = Remote(SimpleNamespace(controller=new_controller(model, profile, np.zeros(4))))
    assert remote('Sim,tasks') == '#Sim,'
    assert remote('Sim,estop,press') == '#Sim,0'
    assert remote('GetStatus') == '#GetStatus,00100010001,0000'


def test_sim_tasks_lists_type_and_state(remote):
    assert remote('Sim,tasks') == (
        '#Sim,1=motion server,Normal,runs;2=state server,NoEmgAbort,runs;3=I/O server,Normal,runs'
    )
    remote.harness.do('E-stop press')
    assert '1=motion server,Normal,aborted (2261);2=state server,NoEmgAbort,runs' in remote(
        'Sim,tasks'
    )


def test_sim_timing_returns_the_counters(remote):
    assert remote('Sim,timing') == '#Sim,0,0,0,0'
    timing = remote.controller.timing
    timing.deadline_misses, timing.late_plans, timing.planner_failures = 7, 2, 1
    timing.violations = 3
    assert remote('Sim,timing') == '#Sim,7,2,1,3'


def test_sim_identity_names_controller_and_robot(remote):
    assert remote('Sim,identity') == '#Sim,controller=simulated;robot=c3_a601s'
    assert remote('Sim,identity,1') == '!Sim,12'


def test_faults_are_started_listed_and_cleared(remote):
    assert remote('Sim,fault') == '#Sim,'
    assert remote('Sim,fault,delay,seconds=0.2,port=state') == '#Sim,0'
    assert remote('Sim,fault,lost_reply') == '#Sim,0'
    assert remote('Sim,fault,list').startswith('#Sim,delay seconds=0.2 port=state;lost_reply')
    assert remote('Sim,fault,clear,delay') == '#Sim,1'
    assert remote('Sim,fault,clear,delay') == '!Sim,15'
    assert remote('Sim,fault,delay,seconds=900') == '!Sim,15'
    assert 'seconds = ' in remote('Sim,why')
    assert remote('Sim,fault,clear') == '#Sim,1'
    assert remote('Sim,fault,list') == '#Sim,'


def test_reboot_is_answered_before_the_connection_closes():
    remote = moving()
    assert remote('Sim,reboot,2') == '#Sim,0'
    remote.harness.step(0.2)
    assert remote.peer.ended
    assert remote.controller.condition.motors is Motors.OFF
    with pytest.raises(ConnectionRefusedError):
        Remote(remote.harness)
    remote.harness.step(2.1)
    assert Remote(remote.harness)('GetMotor,1') == '#GetMotor,1,0,0'


# ---- any bytes


@pytest.mark.invariant(7)
@settings(max_examples=examples(200))
@given(st.lists(st.binary(max_size=300), max_size=5))
def test_inv7_any_bytes_get_valid_answers(pieces):
    remote = Remote()
    for piece in pieces:
        for answer in remote.answers(piece):
            assert re.match(r'[#!][^\r\n]*,\d', answer)
    assert remote.controller.condition.motors is Motors.OFF


WORDS = st.sampled_from(
    ['', '0', '1', '-1', '99999', 'on', '1e400', 'NaN', '"', '"Go P1"', 'DI', 'clear', '=', '²']
)


@pytest.mark.invariant(1)
@settings(max_examples=examples(300))
@given(
    st.sampled_from([*COMMANDS, *(f'Sim,{name}' for name in SIM_COMMANDS)]),
    st.lists(WORDS, max_size=4),
)
def test_inv1_no_command_moves_the_arm(name, parameters):
    remote = Remote()
    assert remote('SetMotorsOn') == '#SetMotorsOn,0'
    answer = remote(','.join([name, *parameters]))
    assert re.match(r'[#!]\w+,', answer)
    if not name.startswith('Sim,disturb'):
        assert not remote.controller.moving


@pytest.mark.parametrize(
    ('name', 'number'),
    [('c8_c901s', 5), ('t6_602s', 3), ('gx8_c652sr', 3), ('rs6_c552s', 6), ('n2_a450s', 7)],
)
def test_remote_ethernet_and_spel_return_the_same_robot_type(name: str, number: int) -> None:
    model = load_robot_model(name)
    start = np.zeros(len(model.joint_names))
    controller = new_controller(model, load_controller_profile('simulated'), start)
    remote = Remote(SimpleNamespace(controller=controller))
    assert remote('GetRobotInfo') == f'#GetRobotInfo,1,{number},{name.upper().replace("_", "-")}'
    assert remote('Sim,print,RobotType') == f'#Sim,{number}'
