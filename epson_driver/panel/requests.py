# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The requests of windows: a table of the actions by name.

A message is a JSON object with the name of an action, `do`, the name of a `robot`, and the
action's arguments. Every request is checked, even if the page would have disabled its button.
"""

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from epson_driver.motion import Trajectory
from epson_driver.panel.jog import FRAMES
from epson_driver.panel.robot_control import PENDANT, RobotControl
from epson_driver.panel.robot_state import RequestError
from epson_driver.panel.robot_view import INPUT, OUTPUT
from epson_driver.panel.window import BadMessageError

MAX_TEXT = 200  # maximum number of characters of a text in a message

Message = Mapping[str, Any]


def message_of(text: str | bytes) -> dict[str, Any]:
    """Return a window's message.

    Raises BadMessageError if the message is not a JSON object with the key `do`.
    """
    try:
        result = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadMessageError('not JSON') from error
    if not isinstance(result, dict) or not isinstance(result.get('do'), str):
        raise BadMessageError('not a request')
    return result


def text(message: Message, key: str) -> str:
    value = message.get(key)
    if not isinstance(value, str) or len(value) > MAX_TEXT:
        raise BadMessageError(f'{key} must be a short string')
    return value


def number(message: Message, key: str, low: float, high: float) -> float:
    value = message.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise BadMessageError(f'{key} must be a number')
    if not low <= value <= high:
        raise BadMessageError(f'{key} must be from {low:g} to {high:g}')
    return float(value)


class Requests:
    """The actions that a window can request for a robot. `table` contains them by name."""

    def __init__(self, trajectories: Mapping[str, Trajectory]) -> None:
        self._trajectories = trajectories
        self.table: dict[str, Callable[[RobotControl, int, Message], object]] = {
            'stop_one': lambda control, _browser, _message: control.stop(),
            'disable': lambda control, _browser, _message: control.disable(),
            'arm': lambda control, browser, _message: control.arming.arm(browser),
            'disarm': lambda control, browser, _message: control.arming.disarm('by hand', browser),
            'enable': lambda control, browser, _message: control.enable(browser),
            'reset_error': lambda control, browser, _message: control.reset_error(browser),
            'speed': _speed,
            'execute': self._execute,
            'go_to_start': self._go_to_start,
            'go_to': _go_to,
            'jog': _jog,
            'step': _step,
            'output': lambda control, browser, message: _switch(control, browser, message, OUTPUT),
            'input': lambda control, browser, message: _switch(control, browser, message, INPUT),
            'press': _press,
            'fault': lambda control, _browser, message: control.start_fault(text(message, 'text')),
            'clear_faults': lambda control, _browser, _message: control.clear_faults(),
        }

    def _execute(self, control: RobotControl, browser: int, message: Message) -> None:
        name, trajectory = self._trajectory(message)
        with control.arming.held(browser):
            if away := control.away_from_start(trajectory):
                raise RequestError(f'{away} from the start of {name}: move there first')
            control.execute(browser, name, trajectory)

    def _go_to_start(self, control: RobotControl, browser: int, message: Message) -> None:
        control.go_to_start(browser, *self._trajectory(message))

    def _trajectory(self, message: Message) -> tuple[str, Trajectory]:
        name = text(message, 'name')
        if name not in self._trajectories:
            raise RequestError('unknown trajectory')
        return name, self._trajectories[name]


def _speed(control: RobotControl, browser: int, message: Message) -> None:
    control.set_speed(browser, number(message, 'value', 0.0, 1.0))


def _go_to(control: RobotControl, browser: int, message: Message) -> None:
    values = [number(message, axis, -1e5, 1e5) for axis in 'xyzuvw']
    control.go_to(browser, text(message, 'name'), np.array(values))


def _hand(message: Message) -> tuple[str, str]:
    frame = text(message, 'frame')
    if frame not in FRAMES:
        raise BadMessageError('frame must be world or tool')
    return text(message, 'axis'), frame


def _jog(control: RobotControl, browser: int, message: Message) -> None:
    fraction = number(message, 'share', -1.0, 1.0)
    if fraction:
        control.jog(browser, *_hand(message), fraction)
    else:
        control.jog_end()


def _step(control: RobotControl, browser: int, message: Message) -> None:
    size, fraction = number(message, 'size', -10.0, 10.0), number(message, 'share', 0.01, 1.0)
    control.step(browser, *_hand(message), size, fraction)


def _switch(control: RobotControl, browser: int, message: Message, kind: int) -> None:
    index, state = int(number(message, 'index', 0, 1e6)), control.robot.state
    if state.io_reason:
        raise RequestError(f'I/O is unknown: {state.io_reason}')
    for item in state.io:
        if item.type == kind and 0 <= index - item.start < len(item.values):
            value = 0 if item.values[index - item.start] else 1
            if kind == OUTPUT:
                control.write_output(browser, index, value)
            else:
                control.set_input(index, value)
            return
    raise RequestError(f'unknown point {index}')


def _press(control: RobotControl, browser: int, message: Message) -> None:
    what, how = text(message, 'what'), text(message, 'how')
    if how not in PENDANT.get(what, {}):
        raise BadMessageError('unknown pendant action')
    control.press(browser, what, how)
