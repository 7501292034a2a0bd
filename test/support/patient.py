# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Run `epson_driver NAME …` with longer internal timeouts.

On a busy machine, the driver must not report a slow controller. `cell.Cell` sets the timeouts that
are parameters, and this module sets the others. Tests of a timeout use virtual time (test/driver)
or set the duration of the timeout.
"""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

# the sources of the tests, not an installed copy
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from epson_driver.cli.__main__ import main
from epson_driver.driver.stopping.heartbeat import Heartbeat

COMMAND = (sys.executable, str(Path(__file__)))

LONG = 45.0

TIMEOUTS = {
    # the process waits this long at its end, so the time is limited
    'epson_driver.driver.driver': {'STATUS_TIMEOUT_S': LONG, 'SHUT_DOWN_TIMEOUT_S': 8.0},
    'epson_driver.driver.goal.goal_execution': {'SETTLE_TIME_S': LONG},
    'epson_driver.driver.goal.goal': {'CAUSE_TIMEOUT_MARGIN_S': LONG},
    'epson_driver.node.loop_bridge': {'RESULTS_TIMEOUT_S': 8.0, 'RESULTS_LINGER_S': 2.0},
    'epson_driver.node.ros_process': {'LEAVE_TIMEOUT_S': 8.0},
    'epson_driver.driver.arm_commands': {'ANSWER_TIMEOUT_S': LONG},
    'epson_driver.driver.stopping.stopper': {
        'ANSWER_TIMEOUT_S': LONG,
        'BRAKING_TIMEOUT_S': LONG,
        'CAUSE_TIMEOUT_S': LONG,
        'MOTORS_OFF_TIMEOUT_S': LONG,
    },
    'epson_driver.link.link': {'CONNECT_TIMEOUT_S': LONG},
}

PANEL_TIMEOUTS: dict[str, dict[str, object]] = {
    'epson_driver.panel.robot_state': {
        'MAX_AGES_S': dict.fromkeys(('joints', 'status', 'diagnostics', 'simulation'), LONG)
    },
    'epson_driver.panel.arming': {'ALIVE_WITHIN_S': 8.0},
    'epson_driver.panel.robot_control': {'STOP_ANSWER_S': LONG},
    'epson_driver.panel.sim_pendant': {'ANSWER_TIMEOUT_S': LONG},
    'epson_driver.panel.panel': {'GOAL_TIMEOUT_S': 8.0},
}

SMOOTH_GOALS_TIMEOUTS = {
    'epson_driver.node.downstream': {'OWN_TOPIC_S': LONG},
    'epson_driver.node.smooth_goals': {'REST_TIMEOUT_S': LONG},
}

OF_COMMAND: dict[str, Mapping[str, Mapping[str, object]]] = {
    'client': TIMEOUTS,
    'panel': PANEL_TIMEOUTS,
    'smooth_goals': SMOOTH_GOALS_TIMEOUTS,
}


def be_patient(
    assign: Callable[[object, str, object], object] = setattr,
    timeouts: Mapping[str, Mapping[str, object]] = TIMEOUTS,
) -> None:
    """Lengthen the timeouts of this process. `assign` is setattr or a replacement."""
    for name, constants in timeouts.items():
        module = import_module(name)
        for constant, seconds in constants.items():
            assert isinstance(getattr(module, constant), type(seconds))
            assign(module, constant, seconds)
    if timeouts is TIMEOUTS:  # no watchdog for a process that is not scheduled
        assign(Heartbeat, 'request_version', lambda _self: None)


if __name__ == '__main__':
    be_patient(timeouts=OF_COMMAND[sys.argv[1]])
    sys.exit(main())
