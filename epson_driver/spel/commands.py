# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The statements there are, as one table: argument form, who may not run them, versions.

A form is a list of argument kinds with commas: `n` a number, `s` a string, `x` either, `p` a
point, `q` the number of one (P1, its label), `v` a variable, `a` a whole array, `w(A|B)` one of
these words; `?` after a kind: it may be left out, `*` any number of them. A form that begins with
@ is read by a method of that name in the parser. Task types and versions are those of words.py.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

from epson_driver.spel.words import WORDS, is_a


class TaskType(IntEnum):
    """What a task survives, numbered as TaskInfo(n, 2) does."""

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

VERSIONS = (6, 7, 8)
"""RC620; RC700, RC700-A, RC90, T, VT; RC800."""

ANYWHERE: frozenset[TaskType] = frozenset()
NOT_AFTER_ESTOP = frozenset({TaskType.NO_EMG_ABORT, TaskType.BACKGROUND})
"""Refused in NoEmgAbort and background tasks: what moves, or sets up, a robot."""

_FORBIDDEN = {
    'Xqt': frozenset({TaskType.NO_EMG_ABORT, TaskType.TRAP}),
    'StartMain': frozenset(TaskType) - {TaskType.BACKGROUND},
    **dict.fromkeys(('JumpTLZ', 'PTran'), NOT_AFTER_ESTOP),  # not in that list, but they move
}


@dataclass(frozen=True, slots=True)
class CommandRule:
    """One statement: how it is written, its arguments, who may not run it, since which version.

    `robot` ones are handed to the host as they are: `Host.command(name, arguments)`.
    """

    name: str
    form: str
    forbidden: frozenset[TaskType]
    since: int
    robot: bool

    @property
    def needs_arguments(self) -> bool:
        """Whether it can only display something when it stands alone."""
        first = self.form.split(',')[0]
        return bool(first) and first[0] != '@' and first[-1] not in '?*'


_FORMS = {
    # Structure
    'If': '@if',
    'Select': '@select',
    'Do': '@do',
    'For': '@for',
    'Exit': '@exit',
    'GoTo': '@jump',
    'GoSub': '@jump',
    'Return': '@return',
    'Call': '@call',
    'OnErr': '@on_err',
    'EResume': '@e_resume',
    'Error': 'n,n?',
    'Redim': '@redim',
    # Tasks
    'Xqt': '@xqt',
    'Quit': '@task_command',
    'Halt': '@task_command',
    'Resume': '@task_command',
    'TaskWait': '@task_command',
    'StartMain': '@task_command',
    'Pause': '',
    'Cont': '',
    'Wait': '@wait',
    'TMOut': 'n',
    'Signal': 'n',
    'WaitSig': 'n,n?',
    'SyncLock': 'n,n?',
    'SyncUnlock': 'n',
    'Trap': '@trap',
    'TmReset': 'n',
    'ResetElapsedTime': '',
    'Randomize': 'n?',
    # Terminal, strings
    'Print': '@print',
    'Input': '@input',
    'Line': '@line_input',
    'MsgBox': 's,n?,s?,v?',
    'ParseStr': 's,a,s',
    'FmtStr': 'x,s,v',
    # Network
    'SetNet': '@set_net',
    'OpenNet': '@open_net',
    'CloseNet': '@close_net',
    'WaitNet': '@wait_net',
    'Read': '@transfer',
    'ReadBin': '@transfer',
    'Write': '@transfer',
    'WriteBin': '@transfer',
    # Inputs, outputs, memory
    'On': 'n,n?,n?,w(Forced)?',
    'Off': 'n,n?,n?,w(Forced)?',
    'Out': 'n,n,w(Forced)?',
    'OutW': 'n,n,w(Forced)?',
    'MemOn': 'n',
    'MemOff': 'n',
    'MemOut': 'n,n',
    'MemOutW': 'n,n',
    # Points and motions
    'Pallet': '@pallet',
    'Plane': '@plane',
    'PlaneClr': 'n,n?',
    'PalletClr': 'n',
    'Go': '@motion',
    'Move': '@motion',
    'Arc': '@motion',
    'Jump': '@motion',
    'Jump3': '@motion',
    'Pass': '@motion',
    'Pulse': '@motion',
    'TGo': '@motion',
    'TMove': '@motion',
    'BGo': '@motion',
    'BMove': '@motion',
    'Till': '@store',
    'Sense': '@store',
    'Find': '@store',
    'Jump3CP': '@motion',
    'JumpTLZ': '@motion',
    'Arc3': '@motion',
    'Here': '@here',
    'PDel': 'q,q?',
    'PLabel': 'q,s',
    'PList': 'q?,q?',
    'ClearPoints': '',
    'LoadPoints': 's,w(Merge)?',
    'SavePoints': 's',
    **dict.fromkeys(('Hand', 'Elbow', 'Wrist', 'J1Flag', 'J2Flag', 'J4Flag', 'J6Flag'), 'q?,n?'),
    **dict.fromkeys(('J1Angle', 'J4Angle'), 'q?,n?'),
    'Arch': 'n,n,n',
    'PLocal': 'q,n',
    'Local': '@local',
    'LocalClr': 'n',
    'Box': '@box',
    'BoxClr': 'n,n?',
    'Where': '',
    'Joint': '',
    # Inputs of a dry run, counters
    'SetSw': 'n,n',
    'SetIn': 'n,n',
    'SetInW': 'n,n',
    'OpBCD': 'n,n,w(Forced)?',
    'CTReset': 'n',
    # Files
    **dict.fromkeys(('AOpen', 'BOpen', 'ROpen', 'UOpen', 'WOpen'), '@open'),
    'Close': 'n',
    'Flush': 'n',
    'Seek': 'n,n',
    'Copy': 's,s',
    'Del': 's',
    'Rename': 's,s',
    'RenDir': 's,s',
    'MkDir': 's',
    'RmDir': 's',
    'ChDir': 's',
}

WITHOUT_EFFECT = (
    'ATCLR', 'AutoLJM', 'AvoidSingularity', 'CollisionDetect', 'CP_Offset', 'FineDist', 'Hordr',
    'LimitTorque', 'LimZMargin', 'OLAccel', 'PerformMode', 'PTCLR', 'QPDecelR', 'QPDecelS',
    'SingularityAngle', 'SingularityDist', 'SingularitySpeed', 'SoftCP', 'VSD',
)  # fmt: skip
"""Settings of the robot that no host does anything with."""

_ROBOT_FORMS = {
    'Motor': 'w(On|Off)',
    'Power': 'w(High|Low),w(Forced)?',
    'Speed': 'n,n?,n?',
    'Accel': 'n,n,n?,n?,n?,n?',
    'SpeedS': 'n,n?,n?',
    'AccelS': 'n,n?,n?,n?,n?,n?',
    'SpeedR': 'n',
    'AccelR': 'n,n?',
    'SpeedFactor': 'n',
    'CP': 'w(On|Off)',
    'Fine': 'n,n,n,n,n?,n?',
    'LimZ': 'n',
    'Weight': 'n,n?',
    'Inertia': 'n?,n?',
    'Tool': 'n',
    'TLSet': 'n,p',
    'TLClr': 'n',
    'Arm': 'n',
    'Robot': 'n',
    'JTran': 'n,n',
    'PTran': 'n,n',
    'PTPBoost': 'n,n?,n?',
    'QP': 'w(On|Off)',
    'Home': '',
    'HomeSet': 'n,n,n,n,n?,n?,n?',
    'WaitPos': '',
    'Reset': 'w(Error)?',
    'AbortMotion': '@abort_motion',
    **dict.fromkeys(WITHOUT_EFFECT, 'n*'),
}
"""Those that are handed to the host."""

SHOWN = {
    **dict.fromkeys(('speed', 'speeds'), (1, 2, 3)),
    **dict.fromkeys(('accel', 'accels'), (1, 2, 3, 4, 5, 6)),
    **dict.fromkeys(('arm', 'cp', 'limz', 'motor', 'power', 'robot', 'speedfactor', 'tool'), ()),
}
"""Statements that display a value without an argument: which ones of the function's."""


def _rules() -> Iterator[CommandRule]:
    for name, form in {**_FORMS, **_ROBOT_FORMS}.items():
        word = WORDS[name.lower()]
        forbidden = ANYWHERE if word.background else NOT_AFTER_ESTOP
        forbidden = _FORBIDDEN.get(name, forbidden)
        yield CommandRule(name, form, forbidden, word.since[0], name in _ROBOT_FORMS)


COMMANDS = {rule.name.lower(): rule for rule in _rules()}
"""By name in lower case."""

TYPES = {
    name: WORDS[name].since[0]
    for name in (
        'boolean', 'byte', 'integer', 'short', 'long', 'int32', 'real', 'double', 'string',
        'ubyte', 'ushort', 'uint32', 'int64', 'uint64',
    )
}  # fmt: skip
"""Words that begin a declaration, and the first version that has the type."""

KEYWORDS = frozenset(name for name in WORDS if is_a('keyword', name)) - TYPES.keys()
"""Words that cannot begin a statement of their own."""


def forbidden(rule: CommandRule, words: tuple[str, ...], task: TaskType) -> bool:
    """Return whether a type of task may not run a statement."""
    if rule.name == 'Reset':
        return task in NOT_AFTER_ESTOP and 'error' not in words
    return task in rule.forbidden
