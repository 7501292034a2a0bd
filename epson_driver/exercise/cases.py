# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Faults while a user's program moves the arm, and the user's reactions."""

from dataclasses import dataclass

from epson_driver.sim_controller.faults.fault_kinds import FAULTS

Words = str
"""An action in the syntax of `pendant`: `estop press`, `fault cut 2`."""


@dataclass(frozen=True, slots=True)
class Case:
    """One fault: how it is triggered, and a person's reaction a few seconds later.

    The cell never enables the arm again: that is up to the program, or to a person who has checked
    the arm. `stops`: the fault ends with an E-stop, after which nothing may move without a new
    enable. `early`: the fault is triggered before the program starts, because it affects a moment
    that would have passed once the arm moves.
    """

    name: str
    what: str
    begin: tuple[Words, ...]
    person: tuple[Words, ...] = ()
    stops: bool = False
    early: bool = False


NO_FAULT = Case('no fault', 'nothing goes wrong', ())

_FAULT_WORDS = {
    'cut': 'cut 1',
    'half_open': 'half_open for=3',
    'delay': 'delay seconds=0.2 for=5',
    'jitter': 'jitter seconds=0.1 for=5',
    'coalesce': 'coalesce seconds=0.1 for=5',
    'one_byte': 'one_byte for=5',
    'bit_errors': 'bit_errors rate=0.2 for=3',
    'wrong_length': 'wrong_length',
    'lost_reply': 'lost_reply skip=1',  # to the second point
    'late_reply': 'late_reply seconds=2 skip=1',
    'wrong_byte_order': 'wrong_byte_order for=2',
    'frozen_encoder': 'frozen_encoder for=3',
    'servo_error': 'servo_error',
    'estop_at_point': 'estop_at_point 2',  # the first one is at the arm's current position
    'reboot': 'reboot for=3',
}

_AFTERWARDS = {
    'servo_error': ('reset',),
    'estop_at_point': ('estop release', 'reset'),
}

STOPPED_FIRST = ('motors off', 'reset')
"""Actions refused while a SPEL+ program runs. The person stops the program first."""

CASES: dict[str, Case] = {
    each.name: each
    for each in (
        Case(
            'estop',
            'somebody presses the E-stop, releases it and resets',
            ('estop press',),
            ('estop release', 'reset'),
            stops=True,
        ),
        Case(
            'door',
            'somebody opens the safeguard door and closes it',
            ('door open',),
            ('door close', 'reset'),
        ),
        Case('pause', 'somebody pauses and continues', ('pause',), ('continue',)),
        Case('motors_off', 'somebody switches the motors off', ('motors off',)),
        Case(
            'manual',
            'somebody turns the key switch to manual and back',
            ('mode manual',),
            ('mode auto',),
        ),
        *(
            Case(
                name,
                kind.text,
                (f'fault {_FAULT_WORDS[name]}',),
                _AFTERWARDS.get(name, ()),
                stops=name == 'estop_at_point',
                early=name in ('lost_reply', 'late_reply', 'estop_at_point'),
            )
            for name, kind in FAULTS.items()
        ),
    )
}
"""All cases: a person's interventions, then every fault of the simulated controller."""


def said(actions: tuple[Words, ...], *, spel: bool) -> tuple[Words, ...]:
    """Return the pendant's words for these actions. `spel`: for a SPEL+ program."""
    if not spel:
        return actions
    return tuple(
        words
        for action in actions
        for words in (('stop', action) if action in STOPPED_FIRST else (action,))
    )
