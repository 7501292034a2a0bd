# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 driver for EPSON and other simple-message robot controllers, with a simulated controller.

`from epson_driver import Robot` loads the Python API. `import epson_driver` alone does not.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from epson_driver.robot import (
        ArgumentError,
        EpsonPoint,
        GripperWiring,
        Motion,
        MotionError,
        Pallet,
        PathError,
        Recording,
        Robot,
        RobotError,
        RobotStatus,
        Sample,
        Settings,
        TaughtPoints,
        Waypoint,
    )

__all__ = [
    'ArgumentError',
    'EpsonPoint',
    'GripperWiring',
    'Motion',
    'MotionError',
    'Pallet',
    'PathError',
    'Recording',
    'Robot',
    'RobotError',
    'RobotStatus',
    'Sample',
    'Settings',
    'TaughtPoints',
    'Waypoint',
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from epson_driver import robot

    return getattr(robot, name)
