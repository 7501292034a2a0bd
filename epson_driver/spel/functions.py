# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The functions there are, as one table: arguments, result, who works them out.

Arguments: `n` a number, `i` a whole number, `s` a string, `x` either, `p` a point,
`q` the number of one (P1, its label), `a` an array,
`t` a task (its number or a function's name); `?` may be left out. Results: `i`, `n` (a Double),
`f` (a Real), `s`, `p`, and `=` for the kind of the first argument.
"""

from dataclasses import dataclass
from typing import Literal

from epson_driver.spel.words import FIRST, WORDS


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

    @property
    def since(self) -> int:
        """The first version that has it."""
        word = WORDS.get(self.name.lower())  # there is none for P( )
        return word.since[0] if word is not None else FIRST[0]


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
        FunctionRule('Sqr', 'n', 'f'),
        FunctionRule('Sin', 'n', 'f'),
        FunctionRule('Cos', 'n', 'f'),
        FunctionRule('Tan', 'n', 'f'),
        FunctionRule('Asin', 'n', 'f'),
        FunctionRule('Acos', 'n', 'f'),
        FunctionRule('Atan', 'n', 'f'),
        FunctionRule('Atan2', 'n,n', 'f'),
        FunctionRule('DegToRad', 'n', 'n'),
        FunctionRule('RadToDeg', 'n', 'n'),
        FunctionRule('LShift', 'i,i', 'i'),
        FunctionRule('RShift', 'i,i', 'i'),
        FunctionRule('LShift64', 'i,i', 'i'),
        FunctionRule('RShift64', 'i,i', 'i'),
        FunctionRule('BSet', 'i,i', 'i'),
        FunctionRule('BClr', 'i,i', 'i'),
        FunctionRule('BTst', 'i,i', 'i'),
        FunctionRule('BSet64', 'i,i', 'i'),
        FunctionRule('BClr64', 'i,i', 'i'),
        FunctionRule('BTst64', 'i,i', 'i'),
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
        FunctionRule('Tab$', 'i', 's'),
        FunctionRule('LSet$', 's,i', 's'),
        FunctionRule('RSet$', 's,i', 's'),
        FunctionRule('Str$', 'n', 's'),
        FunctionRule('Val', 's', 'n'),
        FunctionRule('Hex$', 'i', 's'),
        FunctionRule('FmtStr$', 'x,s', 's'),
        FunctionRule('ParseStr', 's,a,s', 'i'),
        FunctionRule('UBound', 'a,i?', 'i'),
        # Points
        FunctionRule('XY', 'n,n,n,n,n?,n?', 'p'),
        FunctionRule('JA', 'n,n,n?,n?,n?,n?,n?', 'p'),
        FunctionRule('AglToPls', 'n,n,n,n,n?,n?,n?', 'p'),
        FunctionRule('Pulse', 'i,i,i,i,i?,i?,i?', 'p'),
        FunctionRule('LJM', 'p,p?,i?', 'p'),
        _task('P', 'i', 'p'),
        _task('PDef', 'q', 'i'),
        _task('PNumber', 'q', 'i'),
        _task('PLabel$', 'q', 's'),
        *(_task(name, 'p?', 'i') for name in ('Hand', 'Elbow', 'Wrist')),
        *(_task(f'J{joint}Flag', 'p?', 'i') for joint in (1, 2, 4, 6)),
        _task('Dist', 'p,p', 'f'),
        _task('Box', 'i,i,i?', 'p'),
        _task('BoxDef', 'i,i?', 'i'),
        _task('InsideBox', 'i,i?', 'i'),
        _task('GetRobotInsideBox', 'i', 'i', event=True),
        _task('Arch', 'i,i', 'f'),
        _task('PLocal', 'p', 'i'),
        _task('Local', 'i', 'p'),
        _task('LocalDef', 'i', 'i'),
        _task('Pallet', 'i,i,i?', 'p'),
        # Time
        _task('Tmr', 'i', 'n'),
        _task('ElapsedTime', '', 'n'),
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
        # Files
        _task('FreeFile', '', 'i'),
        _task('Eof', 'i', 'i'),
        _task('FileExists', 's', 'i'),
        _task('FileLen', 's', 'i'),
        _task('FileDateTime$', 's', 's'),
        _task('FolderExists', 's', 'i'),
        _task('CurDir$', '', 's'),
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
        _task('InBCD', 'i', 'i', event=True),
        _task('Ctr', 'i', 'i', event=True),
        _task('IONumber', 's', 'i'),
        _task('IODef', 'x,i?,i?', 'i'),
        _task('IOLabel$', 'i,i,i', 's'),
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
        _host('JS', '', 'i'),
        _host('PosFound', '', 'i'),
        _host('FindPos', '', 'p'),
        _host('Tool', '', 'i'),
        _host('TLSet', 'i', 'p'),
        _host('TLDef', 'i', 'i'),
        _host('Arm', '', 'i'),
        _host('Robot', '', 'i'),
        _host('RobotModel$', '', 's'),
        _host('RobotName$', '', 's'),
        _host('LimZ', '', 'f'),
        _host('CP', '', 'i'),
        _host('Speed', 'i?', 'i'),
        _host('Accel', 'i', 'i'),
        _host('AccelMax', 'i?', 'i'),
        _host('SpeedS', 'i?', 'f'),
        _host('AccelS', 'i?', 'f'),
        _host('SpeedFactor', '', 'i'),
        _host('Agl', 'i', 'f'),
        _host('Pls', 'i', 'i'),
        _host('RealPls', 'i', 'i'),
        _host('JRange', 'i,i', 'i'),
        _host('Here', '', 'p'),
        _host('CurPos', '', 'p'),
        _host('RealPos', '', 'p'),
        _host('CX', 'p', 'f'),
        _host('CY', 'p', 'f'),
        _host('CZ', 'p', 'f'),
        _host('CU', 'p', 'f'),
        _host('CV', 'p', 'f'),
        _host('CW', 'p', 'f'),
        _host('PPls', 'p,i', 'i'),
        _host('PAgl', 'p,i', 'f'),
        _host('TargetOK', 'p', 'i'),
        _host('PTPTime', 'p,i,i', 'f'),
    )
}
"""By name in lower case."""

STUB_RESULTS = {
    name: kind
    for kind, names in {
        'p': 'align alignecp armdef cnv_point cnv_queget ecpset findpos latchpos recoverpos '
        'vistrans vxtrans workque_get base diffpoint hofs',
        'n': 'accelr aio_in avgspeed cnv_lpulse cnv_pulse cnv_speed difftoolorientation '
        'finedist healthrbinfo healthctrlinfo inertia inreal olrate outreal peakspeed ptrq atrq '
        'realtorque realaccel singularityangle singularityspeed tcpspeed tcspeed weight',
    }.items()
    for name in names.split()
}
"""What functions return that only a test can answer: most of them a whole number."""

AXES = ('x', 'y', 'z', 'u', 'v', 'w', 'r', 's', 't', 'st')
TURNS = ('rx', 'ry', 'rz')
POSTURES = {
    'hand': ('r', 'l'),
    'elbow': ('a', 'b'),
    'wrist': ('nf', 'f'),
    'j1flag': ('j1f0', 'j1f1'),
    'j2flag': tuple(f'j2f{turn}' for turn in range(128)),
    'j4flag': ('j4f0', 'j4f1'),
    'j6flag': tuple(f'j6f{turn}' for turn in range(128)),
}
"""Functions and statements of a point's posture, with its flags: the first one is the usual."""

POINT_FLAGS = frozenset(flag for flags in POSTURES.values() for flag in flags)


def counts(arguments: str) -> tuple[int, int]:
    """Return how many arguments a function takes at least and at most."""
    kinds = arguments.split(',') if arguments else []
    return sum(not kind.endswith('?') for kind in kinds), len(kinds)
