# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Buttons, inputs and faults of a simulated controller, and traces."""

import pytest
from support.api_patience import be_patient
from support.sim_process import wait_for

from epson_driver import GripperWiring, MotionError, Robot, RobotError, Settings

WIRING = GripperWiring(open_output=0, close_output=1, opened_input=0, closed_input=1)


@pytest.fixture(autouse=True)
def _timeout(monkeypatch):
    be_patient(monkeypatch.setattr)


def test_simulated_buttons_inputs_and_faults_act_and_trigger_callbacks():
    pressed, links = [], []
    with Robot.simulated(settings=Settings(gripper=WIRING)) as robot:
        robot.on_estop(pressed.append)
        robot.on_link(lambda name, _why: links.append(name))
        robot.enable()
        motion = robot.move_joints([1.0] + [0.0] * 5, speed=0.02, wait=False)
        robot.simulation.estop()
        with pytest.raises(MotionError, match='E-stop'):
            motion.wait(60.0)
        wait_for(lambda: pressed)
        robot.simulation.estop(pressed=False)
        robot.reset()
        robot.simulation.door()
        with pytest.raises(RobotError):
            robot.enable()
        robot.simulation.door(is_open=False)
        robot.simulation.go_on()
        robot.simulation.input(3)
        robot.simulation.input(0, True)
        assert robot.io.read('DI', 3) == 1
        assert robot.gripper.open().opened
        robot.simulation.fault('cut for=0.3')
        wait_for(lambda: 'backing_off' in links)


def test_simulation_works_for_a_remote_ethernet_controller():
    links = []
    with Robot.simulated(controller='remote') as robot:
        robot.on_link(lambda name, _why: links.append(name))
        robot.enable()
        with pytest.raises(RobotError, match=r'^nothing is paused'):
            robot.simulation.go_on()
        with pytest.raises(RobotError, match='half_open: port = remote needs for'):
            robot.simulation.fault('half_open')
        robot.simulation.fault('cut for=0.3')
        wait_for(lambda: not robot.status.enabled)
        wait_for(lambda: 'backing_off' in links)


def test_invalid_fault_or_input_is_rejected():
    with Robot.simulated(controller='rc90') as robot:
        with pytest.raises(RobotError, match=r'nonsense.*must be one of'):
            robot.simulation.fault('nonsense')
        with pytest.raises(ValueError, match="kind = 'DO': must be DI or AI"):
            robot.simulation.input(3, kind='DO')
        with pytest.raises(RobotError, match='65535'):
            robot.simulation.input(65_535)
    with pytest.raises(RobotError, match='no connection'):
        robot.simulation.estop()


@pytest.mark.slow
def test_simulation_of_a_real_robot_is_rejected(ports):
    robot = Robot(**{f'{name}_port': ports[name] for name in ports})
    with (
        robot,
        pytest.raises(RobotError, match='did not start its controller'),
    ):
        robot.simulation.estop()


@pytest.mark.slow
def test_trace_file_covers_the_whole_connection(tmp_path):
    file = tmp_path / 'runs' / 'today.pcap'
    robot = Robot.simulated(settings=Settings(trace_file=str(file)))
    with robot:
        robot.enable()
    assert file.read_bytes()[:4] in (b'\xd4\xc3\xb2\xa1', b'\x4d\x3c\xb2\xa1')  # pcap: µs, ns
    assert file.stat().st_size > 10_000
    with pytest.raises(RobotError, match='exists'):
        robot.connect()
