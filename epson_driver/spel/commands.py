# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""All statements as one table: argument form, task types that cannot run them, versions.

A form is a list of argument kinds separated by commas: `n` a number, `#` a number after #, `s` a
string, `x` a number or a string, `p` a point, `q` the number of a point (such as P1, or its
label), `v` a variable, `a` a whole array, `w(A|B)` one of these words (or 1 for A, 0 for B, as in
`Power n`). After a kind, `?` marks an optional argument, and `*` any number of arguments. `-` is
the form of a statement without arguments. If a form starts with `@`, the parser's method with that
name parses the statement. Task types and versions come from words.py.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.words import WORDS, is_a


class TaskType(IntEnum):
    """Type of a task, as in `TaskInfo(n, 2)`. It determines which events pause or end the task."""

    NORMAL = 0
    NO_PAUSE = 1
    NO_EMG_ABORT = 2
    TRAP = 3
    BACKGROUND = 4


TASK_TYPE_WORDS = {
    'normal': TaskType.NORMAL,
    'nopause': TaskType.NO_PAUSE,
    'noemgabort': TaskType.NO_EMG_ABORT,
}

TRAP_EVENTS = {
    **dict.fromkeys(('emergency', 'error', 'pause', 'sgopen', 'sgclose'), TaskType.NO_EMG_ABORT),
    **dict.fromkeys(('abort', 'finish'), TaskType.NO_PAUSE),
}
"""Event of `Trap event Xqt f` → type of the task that runs the function f."""

CONTROLLERS = {'rc620': 6, 'rc700a': 7, 'rc90': 7, 't': 7, 'vt': 7, 'rc800': 8}
"""Type of controller → major version of RC+."""

VERSIONS = tuple(sorted({*CONTROLLERS.values()}))

ANYWHERE: frozenset[TaskType] = frozenset()
NOT_AFTER_ESTOP = frozenset({TaskType.NO_EMG_ABORT, TaskType.BACKGROUND})
"""Types of tasks that must not execute statements that move or set up a robot."""

_FORBIDDEN = {
    'Xqt': frozenset({TaskType.NO_EMG_ABORT, TaskType.TRAP}),
    'StartMain': frozenset(TaskType) - {TaskType.BACKGROUND},
    'JumpTLZ': NOT_AFTER_ESTOP,  # unlisted, but it moves
}


@dataclass(frozen=True, slots=True)
class CommandRule:
    """A statement: its argument form, the task types that cannot run it, and its first version.

    If `robot` is set, the host executes the statement: `Host.command(name, arguments, words)`.
    """

    name: str
    form: str
    forbidden: frozenset[TaskType]
    since: int
    robot: bool

    @property
    def choices(self) -> tuple[str, ...]:
        """The two words of a switch such as `Motor On|Off`.

        1 can replace the first word, and 0 the second.
        """
        first = re.match(r'w\((\w+)\|(\w+)\)', self.form)
        return () if first is None else tuple(first.group(1, 2))

    @property
    def needs_arguments(self) -> bool:
        """Whether the form starts with a required argument."""
        first = self.form.split(',')[0]
        return bool(first) and first[0] != '@' and first[-1] not in '?*'


_FORMS = """
@: If Select Do For Exit Return Call OnErr EResume Redim Xqt Wait Trap Print Input SetNet OpenNet
@: CloseNet Here Local Pallet Pass PList
@jump: GoTo GoSub
@task_command: Quit Halt Resume TaskWait StartMain
@line_input: Line
@transfer: Read ReadBin Write WriteBin
@open: AOpen ROpen WOpen
@motion: Go Move Arc Arc3 Jump Jump3 Jump3CP JumpTLZ Pulse TGo TMove BGo BMove
@store: Till Sense Find
-: Pause Cont ResetElapsedTime ClearPoints Joint
n: TMOut Signal SyncUnlock TmReset MemOn MemOff PalletClr LocalClr Close Flush
n?: Randomize Where
n,n: MemOut MemOutW SetSw SetIn SetInW
#,n?: WaitNet
n,n?: Error WaitSig SyncLock
n,n,n: Arch
n,n?,n?,w(Forced)?: On Off
n,n,w(Forced)?: Out OutW
s: SavePoints Del
s,s: Copy
s,w(Merge)?: LoadPoints
s,n?,s?,v?: MsgBox
s,a,s: ParseStr
x,s,v: FmtStr
q,n: PLocal
q,s: PLabel
q,q?: PDel
q?,n?: Hand
"""
"""Statements that the interpreter executes. A bare `@` stands for `@` and the statement's name."""

WITHOUT_EFFECT = (
    'ATCLR', 'AutoLJM', 'AvoidSingularity', 'CollisionDetect', 'CP_Offset', 'FineDist', 'Hordr',
    'LimitTorque', 'LimZMargin', 'OLAccel', 'PerformMode', 'PTCLR', 'QPDecelR', 'QPDecelS',
    'SingularityAngle', 'SingularityDist', 'SingularitySpeed', 'SoftCP', 'VSD',
)  # fmt: skip
"""Settings of the robot that are accepted but have no effect."""

_ROBOT_FORMS = f"""
@: AbortMotion
-: Home WaitPos
n: SpeedR SpeedFactor LimZ Tool TLClr Arm Robot
n,n?: AccelR
n,n?,w(S|T)?: Weight
n?,n?: Inertia
n,n?,n?: Speed SpeedS PTPBoost
n,n,n?,n?,n?,n?: Accel
n,n?,n?,n?,n?,n?: AccelS
n,n,n,n,n?,n?: Fine
n,n,n,n,n?,n?,n?: HomeSet
n,p: TLSet
w(On|Off): Motor CP QP
w(High|Low),w(Forced)?: Power
w(Error)?: Reset
n*: {' '.join(WITHOUT_EFFECT)}
"""
"""Statements that the host executes."""

DISPLAYING = frozenset(
    ['arch', 'find', 'inertia', 'local', 'pallet', 'pulse', 'sense', 'setnet', 'till']
    + [name.lower() for name in WITHOUT_EFFECT if name not in ('ATCLR', 'PTCLR')]
)
"""Statements that display values if they have no argument. This is not simulated."""

DISPLAYING_ONE = frozenset({'arch', 'local', 'tlset'})
"""Statements that display the values of one number if it is the only argument."""

SHOWN = {
    'speed': ((1,), (2,), (3,)),  # p779
    'speeds': ((1, 2, 3),),
    **dict.fromkeys(('accel', 'accels'), ((1, 2), (3, 4), (5, 6))),  # p69
    **dict.fromkeys(('arm', 'cp', 'limz', 'motor', 'power', 'robot', 'speedfactor', 'tool'), ()),
}
"""Statement that prints its values if it has no argument → arguments for each printed line. To
print a line, the function with the statement's name is called with each of these arguments."""

SHOWN_IN_LOW_POWER = {'speed': 'Low Power State: Speed is limited to 5'}
"""Statement of SHOWN → line printed in low power before the statement's values (p779)."""


def _rules() -> Iterator[CommandRule]:
    for table in (_FORMS, _ROBOT_FORMS):
        for line in table.strip().split('\n'):
            form, names = line.split(': ')
            for name in names.split():
                word = WORDS[name.lower()]
                usual = ANYWHERE if word.background else NOT_AFTER_ESTOP
                read = '@' + re.sub('(?<=[a-z])(?=[A-Z])', '_', name).lower()
                form_of = read if form == '@' else form.strip('-')
                forbidden = _FORBIDDEN.get(name, usual)
                yield CommandRule(name, form_of, forbidden, word.since[0], table is _ROBOT_FORMS)


COMMANDS = {rule.name.lower(): rule for rule in _rules()}
"""Name of the statement in lower case → its rule."""

NOT_SIMULATED = frozenset(
    key
    for key, word in WORDS.items()
    if word.uses - {'keyword'} and key not in COMMANDS.keys() | FUNCTIONS.keys()
)
"""Statements and functions whose results can be in spel.yaml."""

TYPES = {
    name: WORDS[name].since[0]
    for name in (
        'boolean', 'byte', 'integer', 'short', 'long', 'int32', 'real', 'double', 'string',
        'ubyte', 'ushort', 'uint32', 'int64', 'uint64',
    )
}  # fmt: skip
"""Words that start a declaration → first version of SPEL+ that has the type."""

KEYWORDS = frozenset(name for name in WORDS if is_a('keyword', name)) - TYPES.keys()
"""Words that cannot start a statement."""


def forbidden(rule: CommandRule, words: tuple[str, ...], task: TaskType) -> bool:
    if rule.name == 'Reset':
        return task in NOT_AFTER_ESTOP and 'error' not in words
    return task in rule.forbidden
