# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Remedies in the names of the ROS interface."""

from epson_driver.driver.arm_commands import CommandError
from epson_driver.driver.outcome import Outcome
from epson_driver.driver.remedy import Remedy, with_remedy

WORDS = {
    Remedy.CONNECT: 'start the controller, or check robot_ip and the ports',
    Remedy.RELEASE_ESTOP: 'release it, call ~/reset_error (or reset at the controller), '
    'then ~/enable',
    Remedy.RESET: 'call ~/reset_error, then ~/enable',
    Remedy.TURN_TO_AUTO: 'turn it to AUTO, then call ~/enable',
    Remedy.ENABLE: 'call ~/enable',
    Remedy.END_STREAM: 'end that, or call ~/stop',
    Remedy.ALLOW_OTHER_SPEED: 'or set require_planned_speed to false',
    Remedy.ALLOW_END_VELOCITY: 'or set allow_nonzero_velocity_at_trajectory_end',
}


def outcome_text(outcome: Outcome) -> str:
    """Return the reason for a goal's end, and the remedy."""
    return with_remedy(outcome.text, outcome.remedy, WORDS)


def error_text(error: CommandError) -> str:
    """Return why a command failed, and the remedy."""
    return with_remedy(str(error), error.remedy, WORDS)
