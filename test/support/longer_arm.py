# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Robot models with more joints: the C3 with copies of its last joint at the flange."""

from copy import deepcopy
from pathlib import Path

import yaml

from epson_driver.robots import RobotModel, load_robot_model
from epson_driver.share import share_path


def arm_file(folder: Path, joints: int) -> Path:
    """Write a model with `joints` joints (≥ 6) to a file in `folder` and return its path."""
    data = yaml.safe_load(share_path('config', 'robots', 'c3.yaml').read_text('utf-8'))
    del data['models'], data['sources']
    data['name'] = f'c3_with_{joints}_joints'
    lists = [data[key] for key in data if key.startswith(('range', 'speed', 'accel', 'pulses'))]
    for values in (*lists, data['origins_mm'], data['axes']):
        for _ in range(6, joints):
            values.append(deepcopy(values[-1]))  # robot files have no aliases
    path = folder / f'{data["name"]}.yaml'
    path.write_text(yaml.safe_dump(data), encoding='utf-8')
    return path


def arm_model(folder: Path, joints: int) -> RobotModel:
    """Return a model with `joints` joints (≥ 6)."""
    return load_robot_model(str(arm_file(folder, joints)))
