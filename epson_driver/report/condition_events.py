# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Events from the controller's condition: E-stops, errors and motors, with remedies."""

from collections.abc import Iterator, Sequence

from epson_driver.error_texts import ErrorTexts
from epson_driver.report.run import NO, YES, Condition, Event
from epson_driver.simple_message import Mode

CHANGES = {
    ('drives_powered', YES): ('info', 'motors on', ''),
    ('drives_powered', NO): ('warning', 'motors off', 'call ~/enable when the arm may move again'),
    ('e_stopped', YES): (
        'error',
        'E-stop pressed',
        'release it, call ~/reset_error or reset at the controller, then ~/enable',
    ),
    ('e_stopped', NO): ('info', 'E-stop released', ''),
    ('in_error', NO): ('info', 'no error any more', 'call ~/enable when the arm may move again'),
}
"""Events for changes of a flag: level, text, remedy. Motion is shown in the curves."""

OTHERWISE = "look up the number in the controller's manual, reset, then ~/enable"


def condition_events(conditions: Sequence[Condition], texts: ErrorTexts) -> Iterator[Event]:
    """Yield the errors in the first condition, and the changes from each one to the next."""
    before: Condition | None = None
    for now in conditions:
        for flag, value in CHANGES:
            is_new = before is None or before.flag(flag) != value
            told = CHANGES[flag, value]
            if now.flag(flag) == value and is_new and (before is not None or told[0] == 'error'):
                yield Event(now.time, *told)
        known = () if before is None else before.error_codes
        for code in now.error_codes:
            if code not in known:
                phrase = texts.phrase(code)
                yield Event(now.time, 'error', f'error {phrase}', texts.advice(code, OTHERWISE))
        new_error = before is None or before.flag('in_error') != YES
        if now.flag('in_error') == YES and new_error and not now.error_codes:
            yield Event(now.time, 'error', 'error without a number', OTHERWISE)
        if before is not None and now.mode != before.mode and now.mode in (1, 2):
            manual = now.mode == Mode.MANUAL
            yield Event(
                now.time,
                'warning' if manual else 'info',
                'key switch: manual' if manual else 'key switch: automatic',
                'turn it back for motion from ROS' if manual else '',
            )
        before = now
