# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver connect`, and the commands that accept its robot.yaml."""

import contextlib
import os
import subprocess
import sys

import pytest
from support.sim_process import started, vacant_port

from epson_driver import Robot
from epson_driver.api.errors import ArgumentError
from epson_driver.bringup import client_parameters, controller_arguments, launch_arguments
from epson_driver.bringup.client import INTERFACE
from epson_driver.cli import connect
from epson_driver.inputs import InputError
from epson_driver.rtmc.transport import Transport
from epson_driver.setup.robot_file import KEYS, is_robot_file, robot_settings, robot_text

T6 = {'robot_ip': '127.0.0.1', 'controller': 'remote', 'robot_model': 't6_602s'}


def command(*words, cwd=None):
    return subprocess.run(
        [sys.executable, '-m', 'epson_driver.cli', *words],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        stdin=subprocess.DEVNULL,
        cwd=cwd,
        env=os.environ | {'COLUMNS': '200'},
    )


@pytest.fixture
def file(tmp_path):
    """Return a robot's file."""
    path = tmp_path / 'robot.yaml'
    path.write_text(robot_text(T6 | {'remote_port': 5001}, 'made by a test'))
    return path


@contextlib.contextmanager
def controller(*words):
    process, ports = started(*words)
    try:
        yield ports
    finally:
        process.terminate()
        process.wait()


@pytest.mark.slow
def test_password_of_a_variable_is_used_by_all_commands_and_never_written(tmp_path, monkeypatch):
    monkeypatch.setenv('CELL_PASSWORD', 'open sesame')
    name = '--password-variable=CELL_PASSWORD'
    with controller('--controller=remote', '--robot=t6_602s', name) as ports:
        words = ('connect', '127.0.0.1', f'--remote-port={ports["remote"]}')
        refused = command(*words, cwd=tmp_path)
        assert (refused.returncode, '--password-variable' in refused.stdout) == (1, True)
        made = command(*words, name, cwd=tmp_path)
        assert made.returncode == 0, made.stdout + made.stderr
        path = tmp_path / 'robot.yaml'
        assert robot_settings(str(path))['password_variable'] == 'CELL_PASSWORD'
        assert 'sesame' not in path.read_text()
        doctor = command('doctor', 'robot.yaml', '--all', '--seconds=2', cwd=tmp_path)
        assert not [line for line in doctor.stdout.splitlines() if line.startswith('wrong')]
        pendant = command('pendant', '--host=robot.yaml', 'reset', cwd=tmp_path)
        assert pendant.returncode == 0, pendant.stderr
        with Robot(str(path), enable=True) as robot:
            assert robot.move_joints([0.01, 0.0, 0.0, 0.0]).done
        monkeypatch.delenv('CELL_PASSWORD')
        for unset in (('doctor', 'robot.yaml'), ('pendant', '--host=robot.yaml', 'status')):
            ended = command(*unset, cwd=tmp_path)
            assert (ended.returncode, 'export CELL_PASSWORD=' in ended.stderr) == (2, True)
        with pytest.raises(ArgumentError, match='CELL_PASSWORD: this environment variable is not'):
            Robot(str(path))


@pytest.mark.slow
@pytest.mark.parametrize('profile', ['remote', 'spel', 'simulated'])
def test_file_of_connect_is_accepted_by_doctor_pendant_and_python(tmp_path, profile):
    with controller(f'--controller={profile}', '--robot=t6_602s') as ports:
        words = [f'--{name}-port={port}' for name, port in ports.items()]
        made = command('connect', '127.0.0.1', *words, cwd=tmp_path)
        assert made.returncode == 0, made.stdout + made.stderr
        settings = robot_settings(str(tmp_path / 'robot.yaml'))
        assert settings == T6 | {'controller': profile} | {
            f'{name}_port': port for name, port in ports.items()
        }
        assert f'written: robot.yaml, t6_602s with the profile {profile}' in made.stdout
        doctor = command('doctor', 'robot.yaml', '--all', '--seconds=2', cwd=tmp_path)
        assert 'within the limits of a t6_602s' in doctor.stdout, doctor.stderr
        assert not [line for line in doctor.stdout.splitlines() if line.startswith('wrong')]
        pendant = command('pendant', '--host=robot.yaml', 'status', cwd=tmp_path)
        assert 't6_602s' in pendant.stdout, pendant.stderr
        with Robot(str(tmp_path / 'robot.yaml')) as robot:
            assert robot.model.name == 't6_602s'
            assert len(robot.joints) == 4
    again = command('connect', '127.0.0.1', cwd=tmp_path)
    assert (again.returncode, 'robot.yaml exists' in again.stderr) == (2, True)


@pytest.mark.slow
def test_real_time_motion_is_found_without_a_message_to_the_controller(tmp_path):
    port, silent = vacant_port(), f'--state-port={vacant_port()}'
    words = ('connect', '127.0.0.1', '--remote-port=0', silent, f'--motion-port={port}')
    with contextlib.closing(Transport('127.0.0.1', port)) as rc800:
        made = command(*words, '--robot=c8_c901s', cwd=tmp_path)
        assert made.returncode == 0, made.stdout + made.stderr
        assert 'whether the option is enabled is unknown' in made.stdout
        settings = robot_settings(str(tmp_path / 'robot.yaml'))
        assert (settings['controller'], settings['motion_port']) == ('rtmc', port)
        asked = command('doctor', 'robot.yaml', '--all', '--ask', cwd=tmp_path)
        assert f'UDP port {port}: the controller is discovered' in asked.stdout, asked.stdout
        unasked = command('doctor', 'robot.yaml', '--all', cwd=tmp_path)
        assert 'stop the driver, then permit it with --ask' in unasked.stdout, unasked.stdout
        assert all(arrival.data is None for arrival in iter(rc800.take, None))
    asked = command('doctor', 'robot.yaml', '--all', '--ask', cwd=tmp_path)
    assert 'no controller is discovered' in asked.stdout, asked.stdout


@pytest.mark.slow
def test_connect_without_a_controller_writes_nothing(tmp_path):
    port = vacant_port()
    words = ('connect', '127.0.0.1', f'--remote-port={port}', f'--state-port={port}')
    run = command(*words, cwd=tmp_path)
    assert run.returncode == 1
    assert run.stdout.startswith('wrong   controller: 127.0.0.1: no controller answers (')
    assert '→ in RC+ set the control device to Remote Ethernet' in run.stdout
    assert not list(tmp_path.iterdir())
    assert 'Traceback' not in run.stderr


@pytest.mark.slow
def test_connect_without_a_reported_model_asks_for_it(tmp_path):
    with controller('--controller=fanuc') as ports:
        words = ('connect', '127.0.0.1', '--remote-port=0', f'--state-port={ports["state"]}')
        run = command(*words, cwd=tmp_path)
        assert run.returncode == 1
        assert 'give it: --robot MODEL' in run.stdout
        run = command(*words, '--robot=LS6-602S', '--file=cell.yaml', cwd=tmp_path)
    assert run.returncode == 0
    settings = robot_settings(str(tmp_path / 'cell.yaml'))
    assert (settings['controller'], settings['robot_model']) == ('fanuc', 'ls6_602s')


def test_existing_file_is_not_overwritten(file, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['connect', '127.0.0.1', '--file', str(file)])
    with pytest.raises(SystemExit, match='2'):
        connect.main()
    assert 'exists: delete it, or choose another --file' in capsys.readouterr().err


def test_connect_without_an_address_explains_how_to_find_it(monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['connect'])
    assert connect.main() == 2
    error = capsys.readouterr().err
    assert 'ip neigh' in error
    assert 'epson_driver connect ADDRESS' in error


def test_sim_controller_takes_a_robot_file_that_options_override(file, monkeypatch, capsys):
    from epson_driver.cli.arguments import parsed
    from epson_driver.cli.sim_controller import _parser

    arguments = parsed(_parser(), ['--robot', str(file)])
    assert (arguments.robot, arguments.controller) == ('t6_602s', 'remote')
    assert arguments.remote_port == 5001
    arguments = parsed(_parser(), [f'--robot={file}', '--controller=spel', '--remote-port=7'])
    assert (arguments.controller, arguments.remote_port) == ('spel', 7)
    with pytest.raises(SystemExit, match='2'):
        parsed(_parser(), ['--host', str(file.with_name('other.yaml'))])
    assert 'must be a file written by `epson_driver connect`' in capsys.readouterr().err
    arguments = parsed(_parser(), ['--profile-from', str(file)])
    assert (arguments.profile_from, arguments.robot) == (file, None)


@pytest.mark.parametrize(
    ('name', 'text'),
    [
        ('panel', 'start `epson_driver client` with this file'),
        ('fleet', 'fleet simulates its robots'),
        ('report', 'must follow --robot, --host, --address'),
    ],
)
def test_command_that_takes_no_address_refuses_a_robot_file(file, name, text):
    run = command(name, str(file))
    assert run.returncode == 2
    assert f'{file}: ' in run.stderr
    assert text in run.stderr


def test_launch_argument_robot_fills_the_empty_arguments(file):
    values = {item['name']: item['default_value'] for item in launch_arguments(*INTERFACE)}
    values |= {'interface': '', 'robot': str(file)}
    assert client_parameters(values) == T6 | {'remote_port': 5001}
    given = client_parameters(values | {'controller': 'spel', 'remote_port': '6'})
    assert given == T6 | {'controller': 'spel', 'remote_port': 6}
    assert '--remote-port' in controller_arguments(values)


def test_password_variable_reaches_the_client_and_its_simulation(tmp_path):
    path = tmp_path / 'locked.yaml'
    path.write_text(robot_text(T6 | {'password_variable': 'CELL_PASSWORD'}, 'made by a test'))
    values = {item['name']: item['default_value'] for item in launch_arguments(*INTERFACE)}
    values |= {'interface': '', 'robot': str(path)}
    assert client_parameters(values) == T6 | {'password_variable': 'CELL_PASSWORD'}
    arguments = controller_arguments(values)
    assert arguments[arguments.index('--password-variable') + 1] == 'CELL_PASSWORD'


def test_python_arguments_override_the_file(file):
    robot = Robot(str(file), controller='spel')
    assert 'spel, t6_602s' in repr(robot)
    with pytest.raises(ArgumentError, match='no such file; `epson_driver connect` writes'):
        Robot(str(file.with_name('other.yaml')))


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('/**:\n  x: 1\n', 'must have /**, ros__parameters and robot_ip'),
        ('/**:\n  ros__parameters: {robot_ip: 7}\n', 'robot_ip = 7: must be an IP address'),
        (
            '/**:\n  ros__parameters: {robot_ip: a, joint_signs: [1]}\n',
            f'joint_signs = [1]: must be one of {", ".join(KEYS)}',
        ),
        ('/**:\n  ros__parameters: {robot_ip: a, io_port: -1}\n', 'io_port = -1: must be'),
        (
            '/**:\n  ros__parameters: {robot_ip: a, password_variable: open sesame}\n',
            'must be the name of an environment variable, not its value',
        ),
        ('/**: [\n', 'not YAML'),
    ],
)
def test_invalid_robot_file_is_reported_in_one_sentence_with_the_rule(
    tmp_path, capsys, text, message
):
    path = tmp_path / 'robot.yaml'
    path.write_text(text)
    assert is_robot_file(str(path))
    with pytest.raises(InputError) as error:
        robot_settings(str(path))
    assert message in str(error.value)
    assert str(error.value).startswith(str(path))


def test_ctrl_c_during_identification_ends_without_a_traceback(tmp_path):
    program = (
        'import asyncio, os, signal, sys\n'
        'from epson_driver.cli import __main__ as main, connect\n'
        'signal.signal(signal.SIGINT, signal.default_int_handler)\n'  # a shell may ignore it
        'async def look(arguments):\n'
        '    os.kill(os.getpid(), signal.SIGINT)\n'
        '    await asyncio.sleep(60)\n'
        'connect.look = look\n'
        'sys.argv = ["epson_driver", "connect", "127.0.0.1"]\n'
        'sys.exit(main.main())\n'
    )
    run = subprocess.run(
        [sys.executable, '-c', program],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=tmp_path,
    )
    assert (run.returncode, run.stderr) == (130, '')
