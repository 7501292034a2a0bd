# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""All functions as one table: evaluation, arguments, result, names.

Arguments: `n` a number, `i` a whole number, `s` a string, `x` a number or a string, `p` a point,
`q` the number of a point (such as P1, or its label), `a` an array, `t` a task (its number or a
function's name). `?` marks an optional argument. Results: `i`, `n` (a Double), `f` (a Real), `s`,
`p`, and `=` for the kind of the first argument. A `*` after a name means that a condition of Wait,
Till or Trap may use the function.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from epson_driver.spel.words import FIRST, WORDS


@dataclass(frozen=True, slots=True)
class FunctionRule:
    """The rule for one function. `by` determines how it is evaluated.

    * 'value': from its arguments alone (library.py).
    * 'task': by the interpreter (builtins.py).
    * 'host': by `Host.value(name, arguments)`.
    """

    name: str
    arguments: str
    result: str
    by: str
    event: bool

    @property
    def since(self) -> int:
        word = WORDS.get(self.name.lower())  # P( ) has no word
        return word.since[0] if word is not None else FIRST[0]


_TABLE = """
value n =: Abs
value n i: Int Fix Sgn
value n f: Sqr Sin Cos Tan Asin Acos Atan
value n,n f: Atan2
value n n: DegToRad RadToDeg
value i,i i: LShift RShift BSet BClr BTst
value s i: Len Asc
value i s: Chr$ Space$ Tab$ Hex$
value s,i s: Left$ Right$ LSet$ RSet$
value s,i,i? s: Mid$
value s,s i: InStr
value s s: LCase$ UCase$ LTrim$ RTrim$ Trim$
value n s: Str$
value s n: Val
value x,s s: FmtStr$
value s,a,s i: ParseStr
value a,i? i: UBound
value n,n,n,n,n?,n? p: XY
value n,n,n?,n?,n?,n?,n? p: JA
value n,n,n,n,n?,n?,n? p: AglToPls
value i,i,i,i,i?,i?,i? p: Pulse
task p,p?,i? p: LJM
task i p: P Local
task i,i,i? p: Pallet
task q i: PDef PNumber PLocal
task q s: PLabel$
task p? i: Hand
task p,p f: Dist
task i,i f: Arch
task i i: LocalDef Time ChkNet OpenNet Eof Lof*
task i i: Sw* In* InW* Oport* Out* OutW* MemSw* MemIn* MemInW*
task n n: Rnd
task i n: Tmr
task - n: ElapsedTime
task - s: Date$ Time$
task - i: TW MyTask Ert FreeFile
task t i: TaskState TaskDone
task t,i i: TaskInfo
task t? i: Err Erl Era
task t? s: Erf$
task i,i? s: ErrMsg$
task s i: FileExists
host i i: CtrlInfo Stat RobotInfo TLDef Accel Pls RealPls
host i? i: SysErr Speed AccelMax Motor* Power
host - i: ErrorOn* EStopOn* SafetyOn* PauseOn* TeachOn* AtHome*
host - i: RobotType InPos TillOn JS PosFound Tool Arm Robot CP SpeedFactor
host - p: FindPos Here CurPos RealPos
host i p: TLSet
host - s: RobotModel$ RobotName$
host - f: LimZ
host i? f: SpeedS AccelS
host i f: Agl
host i,i i: JRange
host p f: CX CY CZ CU CV CW
host p,i i: PPls
host p,i f: PAgl
host p i: TargetOK
host p,i,i,p?,i?,i? f: PTPTime
"""


def _rules() -> Iterator[FunctionRule]:
    for line in _TABLE.split('\n')[1:-1]:
        (by, arguments, result), names = (part.split() for part in line.split(':'))
        for name in names:
            event = name.endswith('*')
            yield FunctionRule(name.rstrip('*'), arguments.strip('-'), result, by, event)


FUNCTIONS = {rule.name.lower(): rule for rule in _rules()}
"""Name of the function in lower case → its rule."""

STUB_RESULTS = {
    name: kind
    for kind, names in {
        'p': 'align alignecp armdef cnv_point cnv_queget ecpset findpos latchpos recoverpos '
        'vistrans vxtrans workque_get base diffpoint hofs box plane',
        'n': 'accelr aio_in avgspeed cnv_lpulse cnv_pulse cnv_speed difftoolorientation '
        'finedist healthrbinfo healthctrlinfo inertia inreal olrate outreal peakspeed ptrq atrq '
        'realtorque realaccel singularityangle singularityspeed tcpspeed tcspeed weight',
    }.items()
    for name in names.split()
}
"""Name of a function that is not simulated → kind of its result. Functions that are not listed
return a whole number."""

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
"""Properties of a point's posture, each with its flags. The first flag is the default."""

POINT_FLAGS = frozenset(flag for flags in POSTURES.values() for flag in flags)


def subject(flag: str) -> str:
    """Return the posture property that a flag sets. A point has one flag for each property."""
    if flag.isdigit():
        return 'local'
    return next((name for name, flags in POSTURES.items() if flag in flags), flag[:3])


def counts(arguments: str) -> tuple[int, int]:
    """Return the minimum and maximum number of arguments for an argument form of the table."""
    kinds = arguments.split(',') if arguments else []
    return sum(not kind.endswith('?') for kind in kinds), len(kinds)
