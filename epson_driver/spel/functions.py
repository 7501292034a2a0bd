# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The functions there are, as one table: arguments, result, versions, who works them out.

Arguments: `n` a number, `i` a whole number, `s` a string, `p` a point, `a` an array, `t` a task
(its number or a function's name); `?` may be left out. Results: `i`, `n` (a real), `s`, `p`, and
`=` for the kind of the first argument.
"""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class FunctionRule:
    """One function. `event`: a condition of Wait, Till or Trap may ask for it.

    `by` 'value' is worked out from its arguments alone (library.py), 'task' by the interpreter
    (builtins.py), 'host' by `Host.value(name, arguments)`.
    """

    name: str
    arguments: str
    result: str
    by: Literal['value', 'task', 'host'] = 'value'
    event: bool = False
    since: int = 6


def _task(name: str, arguments: str, result: str, event: bool = False) -> FunctionRule:
    return FunctionRule(name, arguments, result, 'task', event)


def _host(name: str, arguments: str, result: str, event: bool = False) -> FunctionRule:
    return FunctionRule(name, arguments, result, 'host', event)


FUNCTIONS: dict[str, FunctionRule] = {
    rule.name.lower(): rule
    for rule in (
        # Numbers
        FunctionRule('Abs', 'n', '='),
        FunctionRule('Int', 'n', 'i'),
        FunctionRule('Fix', 'n', 'i'),
        FunctionRule('Sgn', 'n', 'i'),
        FunctionRule('Sqr', 'n', 'n'),
        FunctionRule('Sin', 'n', 'n'),
        FunctionRule('Cos', 'n', 'n'),
        FunctionRule('Tan', 'n', 'n'),
        FunctionRule('Asin', 'n', 'n'),
        FunctionRule('Acos', 'n', 'n'),
        FunctionRule('Atan', 'n', 'n'),
        FunctionRule('Atan2', 'n,n', 'n'),
        FunctionRule('DegToRad', 'n', 'n'),
        FunctionRule('RadToDeg', 'n', 'n'),
        FunctionRule('LShift', 'i,i', 'i'),
        FunctionRule('RShift', 'i,i', 'i'),
        FunctionRule('LShift64', 'i,i', 'i', since=7),
        FunctionRule('RShift64', 'i,i', 'i', since=7),
        FunctionRule('BSet', 'i,i', 'i'),
        FunctionRule('BClr', 'i,i', 'i'),
        FunctionRule('BTst', 'i,i', 'i'),
        _task('Rnd', 'n', 'n'),
        # Strings
        FunctionRule('Len', 's', 'i'),
        FunctionRule('Asc', 's', 'i'),
        FunctionRule('Chr$', 'i', 's'),
        FunctionRule('Left$', 's,i', 's'),
        FunctionRule('Mid$', 's,i,i?', 's'),
        FunctionRule('Right$', 's,i', 's'),
        FunctionRule('InStr', 's,s', 'i'),
        FunctionRule('LCase$', 's', 's'),
        FunctionRule('UCase$', 's', 's'),
        FunctionRule('LTrim$', 's', 's'),
        FunctionRule('RTrim$', 's', 's'),
        FunctionRule('Trim$', 's', 's'),
        FunctionRule('Space$', 'i', 's'),
        FunctionRule('Str$', 'n', 's'),
        FunctionRule('Val', 's', 'n'),
        FunctionRule('Hex$', 'i', 's'),
        FunctionRule('FmtStr$', 'n,s', 's'),
        FunctionRule('ParseStr', 's,a,s', 'i'),
        FunctionRule('UBound', 'a,i?', 'i'),
        # Points
        FunctionRule('XY', 'n,n,n,n,n?,n?', 'p'),
        FunctionRule('JA', 'n,n,n?,n?,n?,n?,n?', 'p'),
        FunctionRule('AglToPls', 'n,n,n,n,n?,n?,n?', 'p'),
        FunctionRule('Pulse', 'i,i,i,i,i?,i?,i?', 'p'),
        _task('P', 'i', 'p'),
        _task('PDef', 'i', 'i'),
        _task('Pallet', 'i,i,i?', 'p'),
        # Time
        _task('Tmr', 'i', 'n'),
        FunctionRule('ElapsedTime', '', 'n', 'task', since=7),
        _task('Time', 'i', 'i'),
        _task('Date$', '', 's'),
        _task('Time$', '', 's'),
        # Tasks and errors
        _task('TW', '', 'i'),
        _task('MyTask', '', 'i'),
        _task('TaskState', 't', 'i'),
        _task('TaskInfo', 't,i', 'i'),
        _task('TaskDone', 't', 'i'),
        _task('Err', 't?', 'i'),
        _task('Erl', 't?', 'i'),
        _task('Era', 't?', 'i'),
        _task('Ert', '', 'i'),
        _task('Erf$', 't?', 's'),
        _task('ErrMsg$', 'i,i?', 's'),
        # Network
        _task('ChkNet', 'i', 'i'),
        _task('OpenNet', 'i', 'i'),
        _task('Lof', 'i', 'i', event=True),
        # Inputs, outputs, memory
        _task('Sw', 'i', 'i', event=True),
        _task('In', 'i', 'i', event=True),
        _task('InW', 'i', 'i', event=True),
        _task('Oport', 'i', 'i', event=True),
        _task('Out', 'i', 'i', event=True),
        _task('OutW', 'i', 'i', event=True),
        _task('MemSw', 'i', 'i', event=True),
        _task('MemIn', 'i', 'i', event=True),
        _task('MemInW', 'i', 'i', event=True),
        # The controller
        _host('CtrlInfo', 'i', 'i'),
        _host('Stat', 'i', 'i'),
        _host('SysErr', 'i?', 'i'),
        _host('ErrorOn', '', 'i', event=True),
        _host('EStopOn', '', 'i', event=True),
        _host('SafetyOn', '', 'i', event=True),
        _host('PauseOn', '', 'i', event=True),
        _host('TeachOn', '', 'i', event=True),
        # The robot
        _host('Motor', '', 'i', event=True),
        _host('Power', '', 'i'),
        _host('AtHome', '', 'i', event=True),
        _host('RobotInfo', 'i', 'i'),
        _host('RobotType', '', 'i'),
        _host('InPos', '', 'i'),
        _host('TillOn', '', 'i'),
        _host('Speed', 'i?', 'i'),
        _host('Accel', 'i', 'i'),
        _host('AccelMax', 'i?', 'i'),
        _host('SpeedS', 'i?', 'n'),
        _host('AccelS', 'i?', 'n'),
        FunctionRule('SpeedFactor', '', 'i', 'host', since=7),
        _host('Agl', 'i', 'n'),
        _host('Pls', 'i', 'i'),
        _host('RealPls', 'i', 'i'),
        _host('JRange', 'i,i', 'i'),
        _host('Here', '', 'p'),
        _host('CurPos', '', 'p'),
        _host('RealPos', '', 'p'),
        _host('CX', 'p', 'n'),
        _host('CY', 'p', 'n'),
        _host('CZ', 'p', 'n'),
        _host('CU', 'p', 'n'),
        _host('CV', 'p', 'n'),
        _host('CW', 'p', 'n'),
        _host('PPls', 'p,i', 'i'),
        _host('PAgl', 'p,i', 'n'),
        _host('TargetOK', 'p', 'i'),
        _host('PTPTime', 'p,i,i', 'n'),
    )
}
"""By name in lower case."""

CONSTANTS: dict[str, int | float] = {
    'true': -1,
    'false': 0,
    'on': 1,
    'off': 0,
    'high': 1,
    'low': 0,
    'pi': 3.141592653589793,
    'mb_ok': 0,
    'mb_okcancel': 1,
    'mb_abortretryignore': 2,
    'mb_yesnocancel': 3,
    'mb_yesno': 4,
    'mb_retrycancel': 5,
    'idok': 1,
    'idcancel': 2,
    'idabort': 3,
    'idretry': 4,
    'idignore': 5,
    'idyes': 6,
    'idno': 7,
}

AXES = ('x', 'y', 'z', 'u', 'v', 'w')
POINT_FLAGS = frozenset(
    {'l', 'r', 'a', 'b', 'f', 'nf', 'j4f0', 'j4f1', 'j6f0', 'j6f1', 'j1f0', 'j1f1'}
)

NOT_SIMULATED = frozenset(
    {
        'align', 'avgspeed', 'box', 'brake', 'calib', 'chkcom', 'cnv_quelen', 'ctr', 'curdir$',
        'dist', 'ecp', 'errb', 'fbusio_in', 'fileexists', 'find', 'fine', 'force_getforce',
        'getcurrentuser$', 'hand', 'inbcd', 'inertia', 'inreal', 'insidebox', 'insideplane',
        'j1flag', 'j4flag', 'j6flag', 'joint', 'limz', 'peakspeed', 'plabel$',
        'pnumber', 'ptcltrq', 'ptrq', 'realtorque', 'recovery', 'robot', 'robotmodel$',
        'robotname$', 'tcspeed', 'tlset', 'tool', 'ver', 'weight', 'windowsstatus', 'xy_lim',
    }
)  # fmt: skip
"""SPEL+ functions that are refused by name before a program starts."""


def counts(arguments: str) -> tuple[int, int]:
    """Return how many arguments a function takes at least and at most."""
    kinds = arguments.split(',') if arguments else []
    return sum(not kind.endswith('?') for kind in kinds), len(kinds)
