# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Remedies for an arm that does not move. Each interface can replace the default texts."""

from collections.abc import Mapping
from enum import Enum


class Remedy(Enum):
    """An action that makes motion possible again. The value is the default text."""

    NONE = ''
    CONNECT = 'start the controller, or check its address and ports'
    END_CLIENT = 'end the other client, or start the program'
    FIX_LOGIN = 'set password_variable to the name of a variable with the password of RC+'
    CHECK_STATE_SERVER = 'check whether the state server of the controller is running'
    KEEP_AWAY = 'keep away, press the E-stop, and find the cause'
    RELEASE_ESTOP = 'release it, reset, then enable the arm'
    RESET = 'reset, then enable the arm'
    BOOT = 'switch the controller off and on again, then enable the arm'
    CLOSE_SAFEGUARD = 'close it, continue at the controller if paused, then enable the arm'
    CHOOSE_CONTROL_DEVICE = 'select Remote Ethernet as the control device in RC+'
    START_MAIN = 'start main, or enable the arm'
    RENAME = 'end one, or give each its own name or namespace (after a kill, wait 20 s)'
    LOOK_AT_CONTROLLER = 'check the controller'
    TURN_TO_AUTO = 'turn it to AUTO, then enable the arm'
    ENABLE = 'enable the arm'
    CONTINUE = 'continue at the controller, or start main'
    END_STREAM = 'end it, let it hold still for a second, or stop the arm'
    ALLOW_END_VELOCITY = 'end the trajectory with velocity 0'
    ALLOW_OTHER_SPEED = 'or allow another speed than planned'


Words = Mapping[Remedy, str]
"""Texts of remedies for one user interface. A missing entry means the default text."""


def with_remedy(text: str, remedy: Remedy, words: Words) -> str:
    """Return `text`, followed by the remedy in the words of a user interface."""
    return '; '.join(filter(None, (text, words.get(remedy, remedy.value))))
