# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Long time-outs for the Python API, without ROS (patient.py is for the client)."""

from importlib import import_module

LONG = 45.0

TIMEOUTS = {
    'epson_driver.aio': ('READY_TIMEOUT_S',),
    'epson_driver.api.connection': ('FRESH_POSE_TIMEOUT_S',),
    'epson_driver.driver.arm_commands': ('ANSWER_TIMEOUT_S',),
    'epson_driver.driver.driver': ('STATUS_TIMEOUT_S',),
    'epson_driver.driver.goal.goal_execution': ('SETTLE_TIME_S',),
    'epson_driver.driver.goal.goal_queue': ('FRESH_POSE_TIMEOUT_S',),
    'epson_driver.driver.stopping.stopper': (
        'ANSWER_TIMEOUT_S',
        'BRAKING_TIMEOUT_S',
        'MOTORS_OFF_TIMEOUT_S',
    ),
    'epson_driver.link.link': ('CONNECT_TIMEOUT_S',),
}

DEFAULTS = {'state_timeout': LONG, 'io_timeout': LONG, 'reply_timeout': 2 * LONG}


def be_patient(set_attribute):
    """Extend all time-outs by `setattr` or `monkeypatch.setattr`."""
    for name, constants in TIMEOUTS.items():
        module = import_module(name)
        for constant in constants:
            assert isinstance(getattr(module, constant), float)
            set_attribute(module, constant, LONG)
    heartbeat = import_module('epson_driver.driver.stopping.heartbeat').Heartbeat
    set_attribute(
        heartbeat, 'request_version', lambda _self: None
    )  # a process that is not scheduled is not stalled
    settings = import_module('epson_driver.api.settings').Settings
    set_attribute(settings.__init__, '__kwdefaults__', settings.__init__.__kwdefaults__ | DEFAULTS)
