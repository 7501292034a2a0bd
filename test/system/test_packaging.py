# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The package where ROS users find it: built by colcon, and installed by pip."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from epson_driver.cli import processes

ROOT = Path(__file__).parents[2]
EXECUTABLES = ('client', 'demo', 'pendant', 'replay', 'robots', 'sim_controller', 'smooth')


@pytest.fixture(scope='module')
def colcon_install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a copy of the package with colcon over the pip environment; return its prefix."""
    workspace = tmp_path_factory.mktemp('workspace')
    shutil.copytree(
        ROOT,
        workspace / 'src' / 'epson_driver',
        symlinks=True,
        ignore=shutil.ignore_patterns('.*', 'build', 'install', 'log', 'interfaces', 'test'),
    )
    subprocess.run(
        [Path(sys.executable).parent / 'colcon', 'build'],
        cwd=workspace,
        env=os.environ | {'AMENT_PREFIX_PATH': sys.prefix},
        check=True,
        capture_output=True,
        timeout=550,
    )
    return workspace / 'install' / 'epson_driver'


def start(executable: Path, *arguments: str, workspace: Path | None = None) -> subprocess.Popen:
    """Start an executable, after sourcing the workspace's setup file if there is one."""
    environment = processes.ros_environment(processes.free_ros_domain())
    command = [str(executable), *arguments]
    if workspace is not None:
        command = ['bash', '-c', '. "$0" && exec "$@"', str(workspace / 'setup.bash'), *command]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    )


def check_executables(lib: Path, workspace: Path | None) -> None:
    """Run the controller and the node, let them meet, and end both as Ctrl-C does."""
    free = [f'--{name}-port=0' for name in ('motion', 'state', 'io', 'remote')]
    controller = start(lib / 'sim_controller', *free, workspace=workspace)
    assert controller.stdout is not None
    words = controller.stdout.readline().split()
    assert words[0] == 'listening'
    ports = dict(word.split('=') for word in words[1:])
    settings = [f'-p{name}_port:={ports[name]}' for name in ('motion', 'state')]
    arguments = [word for setting in settings for word in ('-p', setting[2:])]
    client = start(lib / 'client', '--ros-args', *arguments, workspace=workspace)
    assert client.stdout is not None
    lines = iter(client.stdout.readline, '')
    assert any('state link connected' in line for line in lines)
    for process in (client, controller):
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 0
        process.stdout.close()


def test_colcon_build_makes_a_ros_package(colcon_install: Path) -> None:
    share = colcon_install / 'share'
    assert (share / 'ament_index' / 'resource_index' / 'packages' / 'epson_driver').is_file()
    assert (share / 'epson_driver' / 'package.xml').is_file()
    assert (share / 'epson_driver' / 'config' / 'robots' / 'c3_a601s.yaml').is_file()
    assert (share / 'epson_driver' / 'config' / 'errors' / 'epson.yaml').is_file()
    lib = colcon_install / 'lib' / 'epson_driver'
    for name in EXECUTABLES:
        assert os.access(lib / name, os.X_OK)
    check_executables(lib, colcon_install.parent)
    check_executables(lib, None)  # also in a shell that has not sourced the workspace


def test_launch_files_work_where_colcon_installs_them(colcon_install: Path) -> None:
    share = colcon_install / 'share' / 'epson_driver'
    (packages,) = colcon_install.glob('lib/python3*/site-packages')
    code = (
        'import sys; from pathlib import Path; from launch_stand_in import launched\n'
        'context = launched(Path(sys.argv[1]))\n'
        'print(*[word for each in context.started for word in each.command])'
    )
    path = share / 'launch' / 'moveit_planning_execution.launch.py'
    folders = [str(packages), str(ROOT / 'test' / 'launch')]
    run = subprocess.run(
        [sys.executable, '-c', code, str(path)],
        cwd=colcon_install,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(folders)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert str(share / 'config' / 'rviz' / 'moveit.rviz') in run.stdout.split()


def test_colcon_finds_the_packages_that_the_readme_names() -> None:
    folders = [ROOT, ROOT / 'interfaces']
    command = [Path(sys.executable).parent / 'colcon', 'list', '--names-only', '--base-paths']
    run = subprocess.run([*command, *folders], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ['epson_driver', 'epson_msgs', 'industrial_msgs']


def test_pip_environment_is_found_by_ros_tools() -> None:
    prefix = Path(sys.prefix)
    index = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / 'epson_driver'
    assert index.is_file(), 'run the tests with `make test`, which installs the package'
    assert {path.name for path in (prefix / 'lib' / 'epson_driver').iterdir()} == set(EXECUTABLES)
    check_executables(prefix / 'lib' / 'epson_driver', None)


def test_pip_puts_one_command_on_the_path() -> None:
    bin_folder = Path(sys.executable).parent
    assert (bin_folder / 'epson_driver').is_file()
    for name in ('client', 'demo', 'sim_controller'):
        assert not (bin_folder / name).exists()
