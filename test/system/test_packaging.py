# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The package built by colcon and installed by pip."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from epson_driver.processes import processes
from epson_driver.processes.command import EXECUTABLES

ROOT = Path(__file__).parents[2]
UNDECLARED = (
    'PIL',
    'mcap',
    'mcap_ros2',
    'pinocchio',
    'playwright',
    'rosbags',
    'rosdep2',
    'toppra',
    'websockets',
)
"""Modules of some tests that package.xml does not name, because rosdep has no matching key."""


BIN = Path(sys.executable).parent


def colcon(
    workspace: Path, *words: str, prefix: str = sys.prefix
) -> subprocess.CompletedProcess[str]:
    """Run colcon in a workspace over the ROS packages of a prefix, and assert its success."""
    run = subprocess.run(
        [BIN / 'colcon', *words],
        cwd=workspace,
        env=os.environ | {'AMENT_PREFIX_PATH': prefix},
        capture_output=True,
        text=True,
        timeout=550,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run


def copied(workspace: Path) -> Path:
    """Return a workspace with a clean copy of the repository."""
    shutil.copytree(
        ROOT,
        workspace / 'src' / 'epson_driver',
        symlinks=True,
        ignore=shutil.ignore_patterns('.*', 'build', 'install', 'log', '__pycache__'),
    )
    return workspace


@pytest.fixture(scope='module')
def colcon_install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the package with colcon over the pip environment, and return its prefix."""
    workspace = copied(tmp_path_factory.mktemp('workspace'))
    assert 'epson_driver needs' not in colcon(workspace, 'build').stderr
    return workspace / 'install' / 'epson_driver'


def start(executable: Path, *arguments: str, workspace: Path | None = None) -> subprocess.Popen:
    """Start an executable, after sourcing the workspace's setup file if given."""
    environment = processes.ros_environment(processes.free_ros_domain())
    command = [str(executable), *arguments]
    if workspace is not None:
        command = ['bash', '-c', '. "$0" && exec "$@"', str(workspace / 'setup.bash'), *command]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    )


def check_executables(lib: Path, workspace: Path | None) -> None:
    """Run controller and node until they connect, and end both by SIGINT."""
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


def test_colcon_build_installs_a_ros_package(colcon_install: Path) -> None:
    fraction = colcon_install / 'share'
    assert (fraction / 'ament_index' / 'resource_index' / 'packages' / 'epson_driver').is_file()
    assert (fraction / 'epson_driver' / 'package.xml').is_file()
    assert (fraction / 'epson_driver' / 'config' / 'robots' / 'c3.yaml').is_file()
    assert (fraction / 'epson_driver' / 'config' / 'rviz' / 'moveit.rviz').is_file()
    assert (fraction / 'epson_driver' / 'launch' / 'robot_interface.launch.py').is_file()
    assert (fraction / 'epson_driver' / 'config' / 'errors' / 'epson.yaml').is_file()
    lib = colcon_install / 'lib' / 'epson_driver'
    for name in EXECUTABLES:
        assert os.access(lib / name, os.X_OK)
    check_executables(lib, colcon_install.parent)
    check_executables(lib, None)  # also without sourcing the workspace


def listed(*folders: Path) -> list[str]:
    """Return the packages that colcon finds in folders, in topological order."""
    command: list[str | Path] = [
        BIN / 'colcon',
        'list',
        '--names-only',
        '--topological-order',
        '--base-paths',
    ]
    run = subprocess.run([*command, *folders], capture_output=True, text=True, check=True)
    return run.stdout.split()


def test_colcon_finds_the_packages_of_the_readme() -> None:
    names = ['epson_msgs', 'epson_rtmc', 'industrial_msgs', 'epson_driver']
    assert listed(ROOT, ROOT / 'interfaces') == names
    variants = ['epson_driver_moveit', 'epson_driver_ros2_control', 'epson_driver_desktop']
    assert listed(ROOT, ROOT / 'interfaces', ROOT / 'variants') == [*names, *variants]


def test_colcon_test_runs_pytest(colcon_install: Path) -> None:
    workspace = colcon_install.parents[1]
    colcon(workspace, 'test', '--pytest-args', 'test/inputs/test_rules.py', 'test/test_share.py')
    results = ElementTree.parse(workspace / 'build' / 'epson_driver' / 'pytest.xml')
    cases = results.findall('.//testcase')
    assert {str(case.get('classname')) for case in cases} == {
        'epson_driver.test.inputs.test_rules',
        'epson_driver.test.test_share',
    }
    assert not results.findall('.//failure')


def test_tests_are_collected_with_the_declared_libraries_only() -> None:
    """rosdep installs no Pinocchio, for example, so tests that need it are skipped."""
    code = (
        'import sys, pytest\n'
        'class Missing:\n'
        '    def find_spec(self, name, path=None, target=None):\n'
        '        if name.partition(".")[0] in sys.argv[1].split(","):\n'
        '            raise ModuleNotFoundError(f"No module named {name!r}", name=name)\n'
        'sys.meta_path.insert(0, Missing())\n'
        'sys.exit(pytest.main(["--collect-only", "--quiet", "-p", "no:cacheprovider"]))'
    )
    run = subprocess.run(
        [sys.executable, '-c', code, ','.join(UNDECLARED)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr


def test_plain_colcon_build_explains_how_to_build_the_messages(tmp_path: Path) -> None:
    workspace = copied(tmp_path)
    run = colcon(workspace, 'build', prefix='')
    output = run.stdout + run.stderr
    assert 'epson_driver needs control_msgs, tf2_msgs, epson_msgs, industrial_msgs: ' in output
    assert 'control_msgs and tf2_msgs come with ROS 2' in output
    source = workspace / 'src' / 'epson_driver'
    assert f'colcon build --base-paths {source} {source / "interfaces"}' in output


def test_ros_tools_find_the_pip_environment() -> None:
    prefix = Path(sys.prefix)
    index = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / 'epson_driver'
    assert index.is_file(), 'run the tests with `make test`, which installs the package'
    assert {path.name for path in (prefix / 'lib' / 'epson_driver').iterdir()} == {
        'first-run',
        *EXECUTABLES,
    }
    check_executables(prefix / 'lib' / 'epson_driver', None)


def test_pip_installs_one_command() -> None:
    bin_folder = Path(sys.executable).parent
    assert (bin_folder / 'epson_driver').is_file()
    for name in ('client', 'demo', 'sim_controller'):
        assert not (bin_folder / name).exists()
