# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Checks of this machine: Python, ROS, message packages, middleware, discovery.

ROS is checked in a separate process, because an import that hangs or crashes is a finding, too.
"""

import contextlib
import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from epson_driver.doctor.findings import Findings
from epson_driver.processes.command import safe_python
from epson_driver.processes.ros_shell import DISTRIBUTIONS, OTHER_ROS, shell_problems

ASK_TIMEOUT_S = 60.0

MIN_PYTHON = (3, 11)

SAFE_DOMAINS = range(102)
"""ROS domain IDs whose UDP ports are below the ephemeral ports of all common systems."""

SHARED, PROCESSES = Path('/dev/shm'), Path('/proc')  # noqa: S108 - Fast DDS' own place
LOGIND = Path('/etc/systemd/logind.conf')

RANGES = ('SUBNET', 'LOCALHOST', 'OFF', 'SYSTEM_DEFAULT')

BUILD = (
    'source a workspace built with colcon build --base-paths src/epson_driver '
    'src/epson_driver/interfaces, or install requirements/runtime.txt'
)

OTHER_PACKAGE = (
    'another package with that name comes first: remove its folder from PYTHONPATH or '
    'AMENT_PREFIX_PATH'
)

DEFINITIONS = {
    'industrial_msgs.msg.RobotStatus': 'header mode e_stopped drives_powered motion_possible '
    'in_motion in_error error_codes',
    'control_msgs.msg.JointTrajectoryControllerState': 'header joint_names reference feedback '
    'error output speed_scaling_factor',
    'control_msgs.msg.JointTolerance': 'name position velocity acceleration',
    'epson_msgs.msg.IoPoint': 'type index value',
    'sensor_msgs.msg.JointState': 'header name position velocity effort',
    'trajectory_msgs.msg.JointTrajectory': 'header joint_names points',
    'diagnostic_msgs.msg.DiagnosticArray': 'header status',
}
"""Message type → fields that the driver uses. Other packages with the same names lack some of
these fields."""

_ASK = """
import importlib, json, os, sys
found = {}
for name in sys.argv[1:]:
    module, _, kind = name.rpartition('.')
    where = ''
    try:
        package = importlib.import_module(module)
        where = getattr(package, '__file__', '')
        fields = getattr(package, kind).get_fields_and_field_types()
        found[name] = [where, *sorted(fields)]
    except Exception as error:
        found[name] = f'{type(error).__name__}: {error}' + (f' [{where}]' if where else '')
try:
    import rclpy
    from rclpy.utilities import get_rmw_implementation_identifier
    found['rmw'] = get_rmw_implementation_identifier()
except Exception as error:
    found['rclpy'] = f'{type(error).__name__}: {error}'
    found['missing'] = getattr(error, 'name', None) == 'rclpy'
sys.stdout.write('\\n' + json.dumps(found))
"""


def check_environment(findings: Findings, environment: Mapping[str, str] = os.environ) -> bool:
    version = platform.python_version()
    if sys.version_info >= MIN_PYTHON:
        findings.ok('Python', f'{version}, {sys.executable}')
    else:
        findings.wrong('Python', f'{version} is too old', 'Python 3.11 or newer is needed')
    distribution = environment.get('ROS_DISTRO', '')
    result = _ask_ros(findings, environment)
    if not distribution and result is not None and result.get('missing'):
        findings.skipped('ROS', 'not installed. The Python API does not need it')
        return False
    if distribution and distribution not in DISTRIBUTIONS:
        text = f'ROS_DISTRO is {distribution}, this package is for {" or ".join(DISTRIBUTIONS)}'
        findings.wrong('ROS', text, OTHER_ROS)
    elif distribution:
        findings.ok('ROS', f'{distribution} ({environment.get("AMENT_PREFIX_PATH", "")})')
    else:
        findings.ok('ROS', 'installed with pip, because ROS_DISTRO is not set')
    for problem in shell_problems(environment):
        findings.wrong(*problem)
    if result is not None:
        _check_ros(findings, result)
    _check_discovery(findings, environment)
    _check_shared_memory(findings)
    return True


def _ask_ros(findings: Findings, environment: Mapping[str, str]) -> dict[str, Any] | None:
    try:
        process = subprocess.run(  # noqa: S603 - our own words
            [*safe_python(), '-c', _ASK, *DEFINITIONS],
            capture_output=True,
            text=True,
            timeout=ASK_TIMEOUT_S,
            check=False,
            env=dict(environment),
        )
    except subprocess.TimeoutExpired:
        text = f'importing rclpy took more than {ASK_TIMEOUT_S:g} s'
        findings.wrong('ROS', text, 'check RMW_IMPLEMENTATION and the disk')
        return None
    try:
        result: dict[str, Any] = json.loads(process.stdout.rpartition('\n')[2])
    except ValueError:
        last = (process.stderr.strip().splitlines() or ['no output'])[-1]
        text = f'importing ROS ended with {process.returncode}: {last}'
        findings.wrong('ROS', text, 'check RMW_IMPLEMENTATION, source only one ROS distribution')
        return None
    return result


def _check_ros(findings: Findings, result: Mapping[str, Any]) -> None:
    for name, fields in DEFINITIONS.items():
        _check_definition(findings, name, fields.split(), result[name])
    if 'rclpy' in result:
        findings.wrong('rclpy', result['rclpy'], f'{BUILD}, or check RMW_IMPLEMENTATION')
    else:
        findings.ok('middleware', result['rmw'])


def _check_definition(
    findings: Findings, name: str, fields: list[str], definition: str | list[str]
) -> None:
    about = name.replace('.', '/')
    if isinstance(definition, str):
        remedy = BUILD
        if definition.endswith(']'):  # it was imported, but it is another package of that name
            remedy = f'{OTHER_PACKAGE}, or {BUILD}'
        findings.wrong(about, definition, remedy)
    elif lacking := [field for field in fields if field not in definition[1:]]:
        text = f'the definition in {definition[0]} lacks {", ".join(lacking)}'
        findings.wrong(about, text, OTHER_PACKAGE)
    else:
        findings.ok('ROS messages', f'{about} has all {len(fields)} required fields')


def _check_discovery(findings: Findings, environment: Mapping[str, str]) -> None:
    domain = environment.get('ROS_DOMAIN_ID', '')
    if not domain:
        text = '0 (ROS_DOMAIN_ID is not set), the default of all machines on this network'
        findings.note('domain', text, 'set ROS_DOMAIN_ID to an unused number from 1 to 101')
    elif not domain.isdecimal() or int(domain) > 232:
        text = f'ROS_DOMAIN_ID = {domain!r}: must be a number from 0 to 232'
        findings.wrong('domain', text, 'set it to a number from 1 to 101')
    elif int(domain) not in SAFE_DOMAINS:
        text = f'{domain}: other programs may use its ports'
        findings.note('domain', text, 'choose one from 1 to 101')
    else:
        findings.ok('domain', domain)
    reach = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE', '')
    if reach and reach not in RANGES:
        text = f'ROS_AUTOMATIC_DISCOVERY_RANGE = {reach!r} is invalid'
        findings.wrong('discovery range', text, f'must be {" or ".join(RANGES)}')
    elif reach == 'LOCALHOST':
        findings.ok('discovery range', 'LOCALHOST: only this machine')
    elif reach == 'OFF':
        remedy = 'set it to LOCALHOST or SUBNET'
        findings.wrong('discovery range', 'OFF: other nodes cannot be found', remedy)
    else:
        text = f'{reach or "SUBNET (not set)"}: every machine on this network can move the robot'
        findings.note('discovery range', text, 'LOCALHOST, or a closed network (docs/security.md)')
    if environment.get('ROS_LOCALHOST_ONLY', '0') not in ('', '0'):
        text = 'ROS_LOCALHOST_ONLY is set, which overrides the discovery range'
        findings.note('discovery range', text, 'unset it, and set ROS_AUTOMATIC_DISCOVERY_RANGE')


def _mounts(process: Path) -> Path:
    return (process / 'ns/mnt').readlink()


def _check_shared_memory(findings: Findings) -> None:
    """Check for problems with the shared memory of Fast DDS.

    This package uses UDP, but other ROS nodes may use shared memory. A container has a separate
    shared memory.
    """
    about, remedy = 'shared memory', 'restart it with FASTDDS_BUILTIN_TRANSPORTS=UDPv4'
    for process in PROCESSES.glob('[0-9]*'):
        with contextlib.suppress(OSError):  # another user's, or it has ended
            if _mounts(process) != _mounts(PROCESSES / 'self'):
                continue
            maps = (process / 'maps').read_text('utf-8', 'replace')
            if re.search(rf'{SHARED}/fast\S* \(deleted\)', maps):
                text = f'the files of process {process.name} were removed, so messages are lost'
                findings.wrong(about, text, f'{remedy}, and set RemoveIPC=no in {LOGIND}')
    users: set[int] = set()
    for path in SHARED.glob('fast*'):
        with contextlib.suppress(OSError):  # its process has ended
            users.add(path.stat().st_uid)
    if users := users - {os.geteuid()}:
        others = ', '.join(map(str, users))
        text = f'user {others} uses shared memory, too: messages between users are lost'
        findings.note(about, text, f'run programs as one user, or {remedy}')
    settings = ''
    for path in (LOGIND, *LOGIND.parent.glob('logind.conf.d/*.conf')):
        with contextlib.suppress(OSError):  # not for this user
            settings += path.read_text('utf-8', 'replace') + '\n'
    if settings and not re.search(r'^RemoveIPC=(no|false|0)', settings, re.MULTILINE):
        text = f"systemd removes a user's files at logout: RemoveIPC=no is missing in {LOGIND}"
        findings.note(about, text, 'add it, or use UDP like this driver')
