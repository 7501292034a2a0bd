# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver NAME …`, patient: the own time-outs of client and panel are long.

They are there for controllers that do not answer, and for a person who waits. A machine that is
busy with something else must not make the driver say that its controller is slow. Time-outs that
are parameters are long in `cell.Cell`, and so is this, for what no parameter says. Tests of a
time-out itself are on a manual clock (test/client), or say how long it is.
"""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

# what the tests themselves import, not what was installed some time ago
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from epson_driver.cli.__main__ import main
from epson_driver.driver.stopping.heartbeat import Heartbeat

COMMAND = (sys.executable, str(Path(__file__)))

LONG = 45.0

TIMEOUTS = {
    # the end of the process waits so long for what may have failed: not too long, therefore
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
    'epson_driver.panel.ros_discovery': {'GOAL_PATIENCE_S': 8.0},
}


def be_patient(
    assign: Callable[[object, str, object], object] = setattr,
    timeouts: Mapping[str, Mapping[str, object]] = TIMEOUTS,
) -> None:
    """Make the client's own time-outs long, in this process; `assign` is setattr or the like."""
    for name, constants in timeouts.items():
        module = import_module(name)
        for constant, seconds in constants.items():
            assert isinstance(getattr(module, constant), type(seconds))
            assign(module, constant, seconds)
    if timeouts is TIMEOUTS:  # nobody watches whether a process that is not scheduled hangs
        assign(Heartbeat, 'ask', lambda _self: None)


if __name__ == '__main__':
    if sys.argv[1:2] == ['client']:
        be_patient()
    elif sys.argv[1:2] == ['panel']:
        be_patient(timeouts=PANEL_TIMEOUTS)
    sys.exit(main())
