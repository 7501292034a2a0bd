# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reports why the arm cannot move, from the reports of the controller and the drivers."""

from collections.abc import Mapping, Sequence

from epson_driver.doctor.findings import Findings
from epson_driver.driver.inhibit import Cause, Inhibit
from epson_driver.driver.remedy import Remedy

ARM = 'the arm'

ABOUT = {
    Cause.SECOND_DRIVER: 'second driver',
    Cause.ESTOP: 'E-stop',
    Cause.ERROR: 'error',
    Cause.SAFEGUARD: 'safeguard',
    Cause.MANUAL_MODE: 'key switch',
    Cause.CONTROL_DEVICE: 'control device',
    Cause.MOTORS_OFF: 'motors',
    Cause.MAIN_ENDED: 'main',
    Cause.PAUSED: 'pause',
}
"""Subjects of the causes. Any other cause: the arm."""

WORDS = {
    Remedy.RELEASE_ESTOP: 'release it, ~/reset_error (or reset at the controller), then ~/enable',
    Remedy.RESET: '~/reset_error, then ~/enable',
    Remedy.TURN_TO_AUTO: 'turn it to AUTO, then ~/enable',
    Remedy.ENABLE: '~/enable (where it can, the driver switches the motors on); if they stay off, '
    'close the safeguard',
    Remedy.CLOSE_SAFEGUARD: 'close it, reset or continue at the controller, then ~/enable',
    Remedy.START_MAIN: 'start main at the controller, or ~/enable',
    Remedy.LOOK_AT_CONTROLLER: 'close the safeguard, continue or start main there; with --ask the '
    'remote port, if there is one, tells which',
}


def tell_inhibit(found: Inhibit, findings: Findings, who: str = '') -> None:
    """Report a reason why the arm cannot move, from the driver `who`, or from the controller."""
    remedy = WORDS.get(found.remedy, found.remedy.value)
    about = who or ABOUT.get(found.cause, ARM)
    findings.held(about, found.text, ', '.join(filter(None, (found.advice, remedy))))


def tell_drivers(drivers: Sequence[Mapping[str, str]], findings: Findings) -> None:
    """Report the /diagnostics of the drivers running in this ROS domain.

    Each has `name`, `host`, `text` and the other diagnostic values of its arm.
    """
    for each in drivers:
        who = f'driver {each["name"]} ({each["host"]})'
        if (cause := each.get('cause', 'NONE')) == 'NONE':
            findings.ok(who, each['text'])
            continue
        found = Inhibit(
            Cause.__members__.get(cause, Cause.NOT_ENABLED),
            Remedy.__members__.get(each.get('remedy', ''), Remedy.NONE),
            each['text'],
            each.get('advice', ''),
        )
        tell_inhibit(found, findings, who)
    if not drivers:
        findings.skipped(
            'driver', 'none runs in this ROS domain: nothing is known of its arm gate'
        )
