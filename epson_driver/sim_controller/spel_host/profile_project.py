# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The SPEL+ project of a controller profile, set up for a robot."""

import re
from collections.abc import Mapping

from epson_driver.inputs import InputError
from epson_driver.profiles.profile import SpelProfile
from epson_driver.robots import RobotModel
from epson_driver.share import share_folder
from epson_driver.spel import read_project, with_defines

_NAMES = re.compile(r"^'?#define\s+(\w+)\s", re.MULTILINE)
_MS = 1000.0


def profile_project(profile: SpelProfile, model: RobotModel) -> dict[str, str]:
    """Return the files of a profile's project, with the profile's changes.

    The robot model supplies the values that a user takes from the robot's manual or measures, if
    the files have lines for them: `#define J1_SPEED` and so on, degrees/s (mm/s), the number of
    joints, and the acceleration times T100_MS and RAMP_MS. Raises InputError, OSError.
    """
    files = read_project(share_folder(profile.project))
    return with_defines(files, {**robot_defines(files, model), **profile.config})


def robot_defines(files: Mapping[str, str], model: RobotModel) -> dict[str, str]:
    """Return a project's #define lines for a robot. Raises InputError for unknown ones."""
    text = '\n'.join(files.values())
    limits, joints, scara = model.limits, len(model.joint_names), 'm' in model.limits.units
    if f'{joints} {scara}' not in ('6 False', '4 True') and 'JOINT_COUNT' in text:
        text = f'{model.name} has {joints} joints: the project is for six axes, or a SCARA'
        raise InputError(text)
    speeds = abs(limits.velocity * model.shown_per_unit)
    found = {f'J{number + 1}_SPEED': f'{speed:.6g}' for number, speed in enumerate(speeds)}
    found['T100_MS'] = f'{max(limits.velocity / limits.acceleration) * _MS:.0f}'
    found['RAMP_MS'] = f'{max(limits.acceleration / limits.jerk) * _MS:.0f}'
    found |= {'JOINT_COUNT': str(joints), 'SCARA': '1' if scara else ''}
    there = set(_NAMES.findall(text))
    return {name: value for name, value in found.items() if name in there}
