# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""In a process with this folder in PYTHONPATH, and in its children, nothing of ROS is there."""

import sys

ENDINGS = ('_msgs', '_srvs', '_interfaces')
BEGINNINGS = ('rcl', 'ros2', 'rosidl', 'rosbag', 'ament')


class NoRos:
    """Hides the modules of ROS from all other finders."""

    def find_spec(self, name, _path=None, _target=None):
        top = name.partition('.')[0]
        if top.endswith(ENDINGS) or top.startswith(BEGINNINGS):
            raise ModuleNotFoundError(f'{name}: no ROS here', name=name)


sys.meta_path.insert(0, NoRos())
