# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The command `epson_driver doctor`, its checks of this machine and MoveIt, and `ros2 doctor`."""

import json
import os
import subprocess
import sys
import types
from pathlib import Path

import pytest
from rich.console import Console
from support.api_harness import NO_ROS
from support.sim_process import started

from epson_driver.cli import doctor as command
from epson_driver.doctor import environment
from epson_driver.doctor.environment import check_environment
from epson_driver.doctor.findings import Findings, Level
from epson_driver.doctor.ros_graph import joints_of
from epson_driver.processes import processes
from epson_driver.robots import load_robot_model
from epson_driver.robots.urdf import urdf


def doctor(*words, **environment):
    return subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', 'doctor', *words],
        capture_output=True,
        text=True,
        timeout=550,
        check=False,
        env=processes.ros_environment(processes.free_ros_domain()) | environment,
    )


def checked(**changes):
    """Return the findings on this machine, by level and name, with changed variables."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith('ROS_')} | changes
    findings = Findings(lambda finding: None)
    check_environment(findings, environment)
    return {(item.level, item.about): item for item in findings.all}


def test_correct_environment_has_no_errors():
    result = checked(ROS_DOMAIN_ID='42', ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    assert not [key for key in result if key[0] is Level.WRONG]
    assert result[Level.OK, 'middleware'].text == 'rmw_fastrtps_cpp'
    assert result[Level.OK, 'domain'].text == '42'


@pytest.mark.parametrize(
    ('changes', 'key', 'message'),
    [
        ({'ROS_DOMAIN_ID': 'five'}, (Level.WRONG, 'domain'), "'five': must be a number"),
        ({'ROS_DOMAIN_ID': '150'}, (Level.NOTE, 'domain'), 'other programs may use its ports'),
        ({}, (Level.NOTE, 'domain'), 'the default of all machines'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, (Level.WRONG, 'discovery range'), 'OFF'),
        (
            {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'MARS'},
            (Level.WRONG, 'discovery range'),
            'is invalid',
        ),
        ({'ROS_LOCALHOST_ONLY': '1'}, (Level.NOTE, 'discovery range'), 'overrides'),
        ({'RMW_IMPLEMENTATION': 'rmw_none'}, (Level.WRONG, 'ROS'), 'rmw_none'),
    ],
)
def test_wrong_environment_variable_is_reported_with_remedy(changes, key, message):
    result = checked(**changes)
    assert message in result[key].text
    assert result[key].remedy


def test_removed_or_foreign_shared_memory_is_reported(monkeypatch, tmp_path):
    for name in ('SHARED', 'PROCESSES', 'LOGIND'):
        monkeypatch.setattr(environment, name, tmp_path / name)
    monkeypatch.setattr(os, 'geteuid', lambda: os.getuid() + 1)
    files = {
        'SHARED/fastrtps_1': '',
        'PROCESSES/7/maps': f'0-1 rw-s 0 0 {tmp_path}/SHARED/fastrtps_0 (deleted)\n',
        'PROCESSES/8/maps': '',
        'PROCESSES/9/maps': f'0-1 rw-s 0 0 {tmp_path}/SHARED/fastrtps_0 (deleted)\n',
        'LOGIND': '#RemoveIPC=no\n',
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / 'PROCESSES/8/maps').write_bytes(b'0-1 r--s 0 0 /ros\xe9\n')
    for process, mounts in (('self', 1), ('7', 1), ('8', 1), ('9', 2)):  # 9 runs in a container
        (tmp_path / 'PROCESSES' / process / 'ns').mkdir(parents=True)
        (tmp_path / 'PROCESSES' / process / 'ns/mnt').symlink_to(f'mnt:[{mounts}]')
    (tmp_path / 'SHARED/fastrtps_2').symlink_to('gone')
    findings = Findings(lambda finding: None)
    environment._check_shared_memory(findings)
    lost, foreign, logout = (item.text for item in findings.all)
    assert 'process 7 were removed' in lost
    assert f'user {os.getuid()} uses shared memory' in foreign
    assert 'at logout' in logout
    (tmp_path / 'LOGIND').write_text('RemoveIPC=no\n')
    environment._check_shared_memory(findings)
    assert len(findings.all) == 5


def test_message_of_another_package_is_reported(tmp_path):
    package = tmp_path / 'industrial_msgs'
    package.mkdir()
    (package / '__init__.py').touch()
    (package / 'msg.py').write_text(
        'class RobotStatus:\n'
        '    @staticmethod\n'
        '    def get_fields_and_field_types():\n'
        '        return {"header": 1, "mode": 1}\n'
    )
    result = checked(PYTHONPATH=str(tmp_path))
    finding = result[Level.WRONG, 'industrial_msgs/msg/RobotStatus']
    assert 'lacks e_stopped' in finding.text
    assert str(package) in finding.text
    assert 'PYTHONPATH' in finding.remedy


def test_other_ros_distribution_is_an_error():
    assert 'jazzy' in checked(ROS_DISTRO='humble')[Level.WRONG, 'ROS'].text


def test_shell_in_which_ros_cannot_start_is_an_error():
    finding = checked(HOME='')[Level.WRONG, 'log']
    assert finding.text == 'HOME is not set'
    assert 'ROS_LOG_DIR' in finding.remedy


def test_missing_packages_are_reported_with_remedy(tmp_path):
    for name in ('rclpy', 'epson_msgs'):
        (tmp_path / name).mkdir()
        text = f'raise ImportError("{name} was made for this test")\n'
        (tmp_path / name / '__init__.py').write_text(text)
    result = checked(PYTHONPATH=str(tmp_path), ROS_DISTRO='jazzy', AMENT_PREFIX_PATH='/opt/here')
    assert result[Level.OK, 'ROS'].text == 'jazzy (/opt/here)'
    for about in ('rclpy', 'epson_msgs/msg/IoPoint'):
        name = about.partition('/')[0]
        assert result[Level.WRONG, about].text == f'ImportError: {name} was made for this test'
        assert 'colcon build' in result[Level.WRONG, about].remedy


def test_old_python_and_hanging_import_are_errors(monkeypatch):
    monkeypatch.setattr(environment, 'MIN_PYTHON', (99, 0))
    monkeypatch.setattr(environment, 'ASK_TIMEOUT_S', 1e-3)
    result = checked(ROS_DOMAIN_ID='42')
    assert 'is too old' in result[Level.WRONG, 'Python'].text
    assert result[Level.WRONG, 'ROS'].text == 'importing rclpy took more than 0.001 s'
    assert (Level.OK, 'domain') in result  # the other checks still run


@pytest.fixture
def called(monkeypatch, capsys):
    """Return a function that runs the command without the checks of this machine."""
    monkeypatch.setattr(command, 'check_environment', lambda findings: True)

    def call(*words, graph=None, moveit=None, drivers=()):
        """`graph`: output of the ROS graph process, by default with `moveit` and `drivers`."""
        result = json.dumps({'moveit': moveit, 'drivers': drivers})
        output = graph or f'a line of the middleware\n{result}'
        printed = [sys.executable, '-c', f'print({output!r})']
        monkeypatch.setattr(command, 'module_command', lambda *_: printed)
        monkeypatch.setattr(sys, 'argv', ['epson_driver doctor', *words])
        code = command.main()
        return code, capsys.readouterr().out

    return call


NAMES = list(load_robot_model('c3_a601s').joint_names)


@pytest.mark.parametrize(
    ('joints', 'code', 'message'),
    [
        (None, 0, 'skipped MoveIt: no move_group runs in this domain'),
        ([*NAMES, 'gripper'], 0, f'ok      MoveIt: knows {", ".join(NAMES)}'),
        (NAMES[1:], 1, f'wrong   MoveIt: its robot lacks joint_1 (it has {", ".join(NAMES[1:])})'),
        ([], 1, '(it has none)'),
    ],
)
def test_joints_of_moveit_are_compared_with_the_model(called, joints, code, message):
    result, output = called('--all', moveit=joints)
    assert result == code
    assert message in output


CLOSED = {
    'name': '/left/epson_driver',
    'host': '127.0.0.1',
    'text': 'the arm is not enabled (not enabled since the driver started)',
    'cause': 'NOT_ENABLED',
    'remedy': 'ENABLE',
}


def test_closed_arm_gate_is_reported(called):
    code, output = called(drivers=[CLOSED])
    assert code == 0
    assert f'note    driver /left/epson_driver (127.0.0.1): {CLOSED["text"]}' in output
    assert '→ enable the arm (ROS: ~/enable, ' in output
    assert output.splitlines()[-1] == f'the arm cannot move yet: {CLOSED["text"]}'
    assert 'nothing is wrong' not in output


@pytest.mark.slow
def test_controller_is_examined_and_the_report_saved(tmp_path):
    process, ports = started()
    try:
        text = tmp_path / 'doctor.txt'
        words = ['127.0.0.1', '--seconds', '2', '--save', str(text)]
        words += [f'--{name}-port={port}' for name, port in ports.items()]
        run = doctor(*words)
    finally:
        process.terminate()
        process.wait()
    assert 'Traceback' not in run.stderr
    assert 'controller: profile simulated, because' in run.stdout
    assert 'also in order: state port, byte order' in run.stdout
    saved = text.read_text(encoding='utf-8')
    assert 'ok      byte order: little-endian, FLOAT32' in saved
    assert 'skipped motion, I/O, remote port: not queried' in saved


@pytest.mark.slow
def test_controller_with_nothing_loaded_is_fine_without_ros():
    process, ports = started('--controller=remote', '--robot=t6_602s')
    words = [f'--{name}-port={ports[name]}' for name in ('state', 'remote')]
    try:
        run = doctor('127.0.0.1', *words, PYTHONPATH=str(NO_ROS))
        every = doctor('127.0.0.1', '--all', *words, PYTHONPATH=str(NO_ROS))
    finally:
        process.terminate()
        process.wait()
    assert (run.returncode, run.stderr) == (0, '')
    note, remedy, skipped, controller, fine, verdict = run.stdout.splitlines()
    assert note.startswith('note    Remote Ethernet alone: joint moves, lines and arcs')
    assert remedy == '        → load the controller program for more'
    assert skipped == 'skipped ROS: not installed. The Python API does not need it'
    assert controller.startswith('ok      controller: profile remote, because')
    assert f'port {ports["remote"]}: Remote Ethernet: remote, t6_602s' in controller
    assert fine == 'ok      also in order: remote port, joints, the arm, Python'
    assert verdict == 'nothing is wrong'
    assert 'ok      joints: within the limits of a t6_602s: ' in every.stdout


def test_worst_findings_come_first(capsys):
    findings = Findings(lambda finding: None)
    findings.ok('a', 'fine')
    findings.ok('b', 'fine')
    findings.skipped('c', 'skipped')
    findings.inhibit('d', 'at MANUAL', 'turn it')
    findings.wrong('e', 'broken', 'mend it')
    command._show(Console(highlight=False), findings, everything=False)
    assert [line.strip() for line in capsys.readouterr().out.splitlines()] == [
        'wrong   e: broken',
        '→ mend it',
        'inhibit d: at MANUAL',
        '→ turn it',
        'skipped c: skipped',
        'ok      a: fine',
        'ok      also in order: b',
    ]


@pytest.mark.slow
def test_learned_profile_works_in_the_simulated_controller(tmp_path):
    process, ports = started('--controller', 'fanuc')
    learned = tmp_path / 'ours.yaml'
    try:
        words = ['127.0.0.1', '--controller=fanuc', '--ask', f'--learn={learned}']
        run = doctor(*words, *[f'--{name}-port={port}' for name, port in ports.items()])
    finally:
        process.terminate()
        process.wait()
    assert learned.is_file(), run.stdout + run.stderr
    process, _ = started('--controller', str(learned))
    process.terminate()
    assert process.wait() == 0


@pytest.mark.slow
def test_closed_state_port_is_an_error_with_exit_code_1(tmp_path):
    learned = tmp_path / 'x.yaml'
    words = ('--controller=simulated', '--state-port', '1', '--learn', str(learned))
    run = doctor('127.0.0.1', *words)
    assert run.returncode == 1
    message = 'state port: 127.0.0.1:1: the machine replies, but nothing listens at this port'
    assert run.stdout.startswith(f'wrong   {message} (Connection refused)')
    assert '→ start the program on the controller' in run.stdout
    assert 'no profile is written' in run.stdout
    assert not learned.exists()


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('--ask',), 'need the address'),
        (('not a host',), 'must be an IP address'),
        (('127.0.0.1', '--controller', 'mars'), 'no controller profile mars'),
        (('127.0.0.1', '--robot', 'mars'), 'no robot model mars'),
        (('127.0.0.1', '--learn', 'x.txt'), 'must end in .yaml'),
        (('127.0.0.1', '--seconds', '0'), 'must be a number from 1 to 600'),
    ],
)
def test_invalid_argument_is_reported(monkeypatch, capsys, words, message):
    monkeypatch.setattr(sys, 'argv', ['epson_driver doctor', *words])
    with pytest.raises(SystemExit, match='2'):
        command.main()
    assert message in capsys.readouterr().err


def test_existing_profile_is_not_overwritten(tmp_path, monkeypatch, capsys):
    path = tmp_path / 'mine.yaml'
    path.write_text('precious')
    monkeypatch.setattr(sys, 'argv', ['epson_driver doctor', '127.0.0.1', '--learn', str(path)])
    with pytest.raises(SystemExit, match='2'):
        command.main()
    assert 'must be a new file' in capsys.readouterr().err
    assert path.read_text() == 'precious'


def test_joint_names_are_read_from_the_urdf():
    assert joints_of(urdf('c3_a601s')) == list(load_robot_model('c3_a601s').joint_names)
    assert joints_of('<robot') == []


MOVE_GROUP = """
import rclpy, sys
rclpy.init()
node = rclpy.create_node('move_group')
node.declare_parameter('robot_description', sys.argv[1])
print('ready', flush=True)
rclpy.spin(node)
"""


@pytest.mark.slow
def test_joints_of_a_running_move_group_are_read():
    domain = processes.free_ros_domain()
    environment = processes.ros_environment(domain)
    node = subprocess.Popen(
        [sys.executable, '-c', MOVE_GROUP, urdf('c3_a601s')],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert node.stdout is not None
        assert node.stdout.readline() == 'ready\n'
        asked = subprocess.run(
            [sys.executable, '-m', 'epson_driver.doctor.ros_graph', '10'],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        )
    finally:
        node.kill()
        node.wait()
    assert json.loads(asked.stdout)['moveit'] == list(load_robot_model('c3_a601s').joint_names)


def test_ros2_doctor_counts_the_errors(monkeypatch):
    """ros2doctor cannot be installed with pip: two modules replace it."""
    messages = []

    class Result:
        def __init__(self):
            self.errors = self.warnings = 0

        def add_error(self):
            self.errors += 1

        def add_warning(self):
            self.warnings += 1

    api = types.ModuleType('ros2doctor.api')
    api.DoctorCheck, api.Result = object, Result
    words = types.ModuleType('ros2doctor.api.format')
    words.doctor_error = words.doctor_warn = messages.append
    for name, module in (
        ('ros2doctor', types.ModuleType('ros2doctor')),
        ('ros2doctor.api', api),
        ('ros2doctor.api.format', words),
    ):
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setenv('ROS_DOMAIN_ID', 'five')
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE', raising=False)
    monkeypatch.delitem(sys.modules, 'epson_driver.cli.ros2_doctor', raising=False)
    from epson_driver.cli.ros2_doctor import EpsonDriverCheck

    check = EpsonDriverCheck()
    assert check.category() == 'epson_driver'
    result = check.check()
    assert result.errors == 1 + any('rclpy' in message for message in messages)
    assert result.errors + result.warnings == len(messages)
    assert any(
        'every machine on this network can move the robot' in message for message in messages
    )
    assert any('ROS_DOMAIN_ID' in message for message in messages)
    text = (Path(__file__).parents[2] / 'setup.py').read_text(encoding='utf-8')
    assert 'cli.ros2_doctor:EpsonDriverCheck' in text
