# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Settings of the shell that prevent ROS from starting, and their remedies."""

import os
import resource
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

DISTRIBUTIONS = ('jazzy',)

MIN_FILES = 64  # that a process may open: rcl, the middleware and the links need half of them

OTHER_ROS = f'source only ROS 2 {" or ".join(DISTRIBUTIONS)}, in a new terminal'


class Problem(NamedTuple):
    about: str
    text: str
    remedy: str

    def __str__(self) -> str:
        return f'{self.about}: {self.text}: {self.remedy}'


def ros_problem(environment: Mapping[str, str] = os.environ) -> Problem | None:
    """Return the first reason why ROS cannot start, or None. A missing rclpy does not count."""
    try:
        missing = find_spec('rclpy') is None
    except ModuleNotFoundError:  # another finder hides it
        missing = True
    if missing:
        return None
    for problem in shell_problems(environment):
        return problem  # before the import, because rcl ends a process with an unknown middleware
    try:
        import_module('rclpy')
    except ImportError as error:
        return Problem('rclpy', f'{type(error).__name__}: {error}', OTHER_ROS)
    return None


def shell_problems(environment: Mapping[str, str]) -> Iterator[Problem]:
    if (rmw := environment.get('RMW_IMPLEMENTATION', '')) and not _is_installed(rmw, environment):
        yield Problem('RMW_IMPLEMENTATION', f'{rmw} is not installed', 'install or unset it')
    if (
        environment.get('ROS_SECURITY_ENABLE') == 'true'
        and environment.get('ROS_SECURITY_STRATEGY') == 'Enforce'
        and not Path(environment.get('ROS_SECURITY_KEYSTORE') or '/dev/null').is_dir()
    ):
        text = 'security is enforced, but ROS_SECURITY_KEYSTORE is not a folder with keys'
        yield Problem('security', text, 'set it (docs/security.md), or unset ROS_SECURITY_ENABLE')
    remedy = 'set ROS_LOG_DIR to a writable folder'
    if (folder := _log_folder(environment)) is None:
        yield Problem('log', 'HOME is not set', remedy)
    elif not _is_writable(folder):
        yield Problem('log', f'{folder} cannot be written', remedy)
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= files < MIN_FILES:
        yield Problem('open files', f'the limit is {files}', f'ulimit -n {16 * MIN_FILES}')


def _is_installed(package: str, environment: Mapping[str, str]) -> bool:
    index = Path('share', 'ament_index', 'resource_index', 'packages', package)
    prefixes = [sys.prefix, *environment.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
    return any((prefix / index).is_file() for prefix in map(Path, filter(None, prefixes)))


def _log_folder(environment: Mapping[str, str]) -> Path | None:
    if folder := environment.get('ROS_LOG_DIR'):
        return Path(folder).expanduser()
    if home := environment.get('ROS_HOME'):
        return Path(home).expanduser() / 'log'
    return Path(home, '.ros', 'log') if (home := environment.get('HOME')) else None


def _is_writable(folder: Path) -> bool:
    """Return whether files can be created in `folder`. If it is missing, rcl creates it."""
    folders = (folder.absolute(), *folder.absolute().parents)
    existing = next(path for path in folders if os.access(path, os.F_OK))
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
