# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Drive the tool with a Linux joystick until button 0: stream_joystick.py DEVICE ROBOT.YAML."""

import os
import struct
import sys
import time

from epson_driver import Robot

BENT = [0.0, 0.2, 0.2, 0.0, -1.9, 0.0]
EVENT = struct.Struct(
    '<IhBB'
)  # time [ms], value, kind (1 button, 2 axis), number: linux/joystick.h
SPEED = 0.05  # m/s at full deflection

device = os.open(
    sys.argv[1] if len(sys.argv) > 1 else '/dev/input/js0', os.O_RDONLY | os.O_NONBLOCK
)
with Robot(sys.argv[2]) if len(sys.argv) > 2 else Robot.simulated(start=BENT) as robot:
    robot.enable()
    axes, pressed = [0.0, 0.0, 0.0], False
    while not pressed:
        robot.servo_speed([*axes, 0.0, 0.0, 0.0], frame='base_link')
        time.sleep(0.02)
        try:
            events = list(EVENT.iter_unpack(os.read(device, 64 * EVENT.size)))
        except BlockingIOError:  # the stick has not moved
            continue
        for _, value, kind, number in events:
            if kind & 2 and number < 3:
                axes[number] = SPEED * value / 32767
            pressed |= bool(kind & 1) and number == 0 and value == 1
    print(robot.servo_end())
