# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The statements there are, as one table: argument form, who may not run them, versions.

A form is a list of argument kinds with commas: `n` a number, `s` a string, `p` a point, `v` a
variable, `a` a whole array, `w(A|B)` one of these words; `?` after a kind: it may be left out, `*`
any number of them. A form that begins with @ is read by a method of that name in the parser.
Sources: SPEL+ Language Reference, RC+ 8.0 (pages 912-917 for the task types, 952-965 for the
versions).
"""

from dataclasses import dataclass
from enum import IntEnum


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


@dataclass(frozen=True, slots=True)
class CommandRule:
    """One statement: how it is written, its arguments, who may not run it, since which version.

    `robot` ones are handed to the host as they are: `Host.command(name, arguments)`.
    """

    name: str
    form: str
    forbidden: frozenset[TaskType] = ANYWHERE
    since: int = 6
    robot: bool = False


def _robot(name: str, form: str, since: int = 6) -> CommandRule:
    return CommandRule(name, form, NOT_AFTER_ESTOP, since, robot=True)


def _motion(name: str) -> CommandRule:
    return CommandRule(name, '@motion', NOT_AFTER_ESTOP)


COMMANDS: dict[str, CommandRule] = {
    rule.name.lower(): rule
    for rule in (
        # Structure
        CommandRule('If', '@if'),
        CommandRule('Select', '@select'),
        CommandRule('Do', '@do'),
        CommandRule('For', '@for'),
        CommandRule('Exit', '@exit'),
        CommandRule('GoTo', '@jump'),
        CommandRule('GoSub', '@jump'),
        CommandRule('Return', '@return'),
        CommandRule('Call', '@call'),
        CommandRule('OnErr', '@on_err'),
        CommandRule('EResume', '@e_resume'),
        CommandRule('Error', 'n,n?'),
        CommandRule('Redim', '@redim'),
        # Tasks
        CommandRule('Xqt', '@xqt', frozenset({TaskType.NO_EMG_ABORT, TaskType.TRAP})),
        CommandRule('Quit', '@task_command'),
        CommandRule('Halt', '@task_command'),
        CommandRule('Resume', '@task_command'),
        CommandRule('TaskWait', '@task_command'),
        CommandRule(
            'StartMain',
            '@task_command',
            frozenset({TaskType.NORMAL, TaskType.NO_PAUSE, TaskType.NO_EMG_ABORT, TaskType.TRAP}),
        ),
        CommandRule('Pause', ''),
        CommandRule('Cont', ''),
        CommandRule('Wait', '@wait'),
        CommandRule('TMOut', 'n'),
        CommandRule('Signal', 'n'),
        CommandRule('WaitSig', 'n,n?'),
        CommandRule('SyncLock', 'n,n?'),
        CommandRule('SyncUnlock', 'n'),
        CommandRule('Trap', '@trap', NOT_AFTER_ESTOP),
        CommandRule('TmReset', 'n'),
        CommandRule('ResetElapsedTime', '', since=7),
        CommandRule('Randomize', 'n?'),
        # Terminal, strings
        CommandRule('Print', '@print'),
        CommandRule('Input', '@input'),
        CommandRule('Line', '@line_input'),
        CommandRule('MsgBox', 's,n?,s?,v?'),
        CommandRule('ParseStr', 's,a,s'),
        # Network
        CommandRule('SetNet', '@set_net'),
        CommandRule('OpenNet', '@open_net'),
        CommandRule('CloseNet', '@close_net'),
        CommandRule('WaitNet', '@wait_net'),
        CommandRule('Read', '@transfer'),
        CommandRule('ReadBin', '@transfer'),
        CommandRule('Write', '@transfer'),
        CommandRule('WriteBin', '@transfer'),
        # Inputs, outputs, memory
        CommandRule('On', 'n,n?,n?,w(Forced)?'),
        CommandRule('Off', 'n,n?,n?,w(Forced)?'),
        CommandRule('Out', 'n,n,w(Forced)?'),
        CommandRule('OutW', 'n,n,w(Forced)?'),
        CommandRule('MemOn', 'n'),
        CommandRule('MemOff', 'n'),
        CommandRule('MemOut', 'n,n'),
        CommandRule('MemOutW', 'n,n'),
        # The robot
        _robot('Motor', 'w(On|Off)'),
        _robot('Power', 'w(High|Low),w(Forced)?'),
        _robot('Speed', 'n,n?,n?'),
        _robot('Accel', 'n,n,n?,n?,n?,n?'),
        _robot('SpeedS', 'n,n?,n?'),
        _robot('AccelS', 'n,n?,n?,n?,n?,n?'),
        _robot('SpeedR', 'n'),
        _robot('AccelR', 'n,n?'),
        _robot('SpeedFactor', 'n', since=7),
        _robot('CP', 'w(On|Off)'),
        _robot('Fine', 'n,n,n,n,n?,n?'),
        _robot('LimZ', 'n'),
        _robot('Arch', 'n,n,n'),
        CommandRule('Pallet', '@pallet'),
        CommandRule('PalletClr', 'n'),
        _robot('Weight', 'n,n?'),
        _robot('Inertia', 'n?,n?'),
        _robot('Tool', 'n'),
        _robot('TLSet', 'n,p'),
        _robot('Local', 'n,p'),
        _robot('PTPBoost', 'n,n?,n?'),
        _robot('QP', 'w(On|Off)'),
        _robot('SFree', 'n*'),
        _robot('SLock', 'n*'),
        _robot('Brake', 'w(On|Off),n'),
        _robot('Home', ''),
        _robot('WaitPos', ''),
        CommandRule('Reset', 'w(Error)?', robot=True),
        CommandRule('AbortMotion', '@abort_motion', robot=True),
        _motion('Go'),
        _motion('Move'),
        _motion('Arc'),
        _motion('Jump'),
        _motion('Jump3'),
        _motion('Pass'),
        _motion('Pulse'),
        _motion('TGo'),
        _motion('TMove'),
        _motion('BGo'),
        _motion('BMove'),
        CommandRule('Till', '@store', NOT_AFTER_ESTOP),
        CommandRule('Sense', '@store', NOT_AFTER_ESTOP),
        CommandRule('Find', '@store', NOT_AFTER_ESTOP),
    )
}
"""By name in lower case."""

TYPES: dict[str, int] = {
    'boolean': 6,
    'byte': 6,
    'integer': 6,
    'short': 6,
    'long': 6,
    'int32': 6,
    'real': 6,
    'double': 6,
    'string': 6,
    'ubyte': 7,
    'ushort': 7,
    'uint32': 7,
    'int64': 7,
    'uint64': 7,
}
"""Words that begin a declaration, and the first version that has the type."""

STRUCTURE_WORDS = frozenset(
    {
        'then', 'else', 'elseif', 'endif', 'case', 'default', 'send', 'loop', 'next', 'fend',
        'function', 'global', 'preserve', 'to', 'step', 'while', 'until', 'byref', 'byval', 'as',
        'and', 'or', 'xor', 'not', 'mod', 'mask', 'declare',
    }
)  # fmt: skip
"""Words that cannot begin a statement of their own, and cannot be names."""

NOT_SIMULATED = frozenset(
    {
        'aio_trackingstart', 'aopen', 'arc3', 'arm', 'armset', 'base', 'bitoff', 'biton', 'bopen',
        'box', 'boxclr', 'boxdef', 'calib', 'calpls', 'chdir', 'chdrv', 'close', 'closecom',
        'closedb', 'cls', 'cnv_downstream', 'cnv_queadd', 'cnv_queremove', 'cnv_trigger',
        'collisiondetect', 'cooling', 'copy', 'cp_offset', 'curve', 'cvmove', 'date', 'del',
        'deletedb', 'dispdev', 'ecp', 'ecpset', 'errorlog', 'fbusio_out', 'fopen',
        'force_calibrate', 'gclose', 'gget', 'gset', 'gshow', 'gshowdialog', 'here', 'hofs',
        'homeset', 'hordr', 'inputbox', 'jrange', 'jtran', 'jump3cp', 'jumptlz', 'latchenable',
        'loadpoints', 'localclr', 'mcal', 'mcordr', 'mkdir', 'opbcd', 'opencom', 'opendb',
        'outreal', 'pclear', 'pdel', 'performmode', 'pg_scan', 'plabel',
        'plane', 'ptran', 'range', 'recover', 'rename', 'restart', 'robot', 'ropen', 'rundialog',
        'savepoints', 'selectdb', 'setcom', 'setlcd', 'shutdown', 'simset', 'singularity',
        'softcp', 'stop', 'tc', 'tcclr', 'tclim', 'tcspeed', 'time', 'tlclr', 'uopen', 'vcls',
        'ver', 'vget', 'vload', 'vrun', 'vset', 'waitcom', 'wend', 'wopen', 'xylim', 'zeroflg',
    }
)  # fmt: skip
"""SPEL+ statements that are refused by name before a program starts."""


def forbidden(rule: CommandRule, words: tuple[str, ...], task: TaskType) -> bool:
    """Return whether a type of task may not run a statement."""
    if rule.name == 'Reset':
        return task in NOT_AFTER_ESTOP and 'error' not in words
    return task in rule.forbidden
