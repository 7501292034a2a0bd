# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Every statement and every function of the tables, executed."""

import math
import re

import pytest
from support.spel_harness import ScriptedHost, printed, run, value

from epson_driver.spel import Machine, Memory, ProgramError, build
from epson_driver.spel.builtins import TASK_FUNCTIONS
from epson_driver.spel.commands import COMMANDS, KEYWORDS, NOT_SIMULATED, WITHOUT_EFFECT
from epson_driver.spel.file_access import FILE_FUNCTIONS
from epson_driver.spel.files import ProgramEnvironment
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.library import VALUE_FUNCTIONS
from epson_driver.spel.lint import check
from epson_driver.spel.machine import all_statements
from epson_driver.spel.parser import Parser
from epson_driver.spel.point_actions import POINT_FUNCTIONS
from epson_driver.spel.words import CONSTANTS, WORDS, is_a

VALUES = {
    'abs': ('Abs(-3) + Abs(-0.5)', '3.5'),
    'int': ('Int(-1.5)', '-2'),
    'fix': ('Fix(-1.5)', '-1'),
    'sgn': ('Sgn(-7) + Sgn(0) * 10', '-1'),
    'sqr': ('Sqr(2.25)', '1.5'),
    'sin': ('Sin(DegToRad(90))', '1'),
    'cos': ('Cos(0)', '1'),
    'tan': ('Tan(0)', '0'),
    'asin': ('Asin(1)', f'{math.pi / 2:.7g}'),
    'acos': ('Acos(1)', '0'),
    'atan': ('Atan(1)', f'{math.pi / 4:.7g}'),
    'atan2': ('Atan2(0, 1)', f'{math.pi / 2:.7g}'),
    'degtorad': ('DegToRad(180)', f'{math.pi:.15g}'),
    'radtodeg': ('RadToDeg(Atan2(-1, 0))', '180'),
    'lshift': ('LShift(1, 31)', '-2147483648'),
    'rshift': ('RShift(256, 8)', '1'),
    'bset': ('BSet(1, 2)', '5'),
    'bclr': ('BClr(5, 0)', '4'),
    'btst': ('BTst(5, 2) + BTst(5, 1)', '1'),
    'rnd': ('Rnd(10) >= 0 And Rnd(10) <= 10', '-1'),
    'len': ('Len("abc")', '3'),
    'asc': ('Asc("A")', '65'),
    'chr$': ('Chr$(34) + Chr$(65)', '"A'),
    'left$': ('Left$("abcdef", 2)', 'ab'),
    'mid$': ('Mid$("abcdef", 2, 3) + Mid$("abc", 3)', 'bcdc'),
    'right$': ('Right$("abcdef", 2) + Right$("a", 0)', 'ef'),
    'instr': ('InStr("abc", "c") * 10 + InStr("abc", "x")', '29'),
    'lcase$': ('LCase$("AbC")', 'abc'),
    'ucase$': ('UCase$("AbC")', 'ABC'),
    'ltrim$': ('LTrim$("  a ") + "|"', 'a |'),
    'rtrim$': ('RTrim$(" a  ") + "|"', ' a|'),
    'trim$': ('Trim$("  a  ") + "|"', 'a|'),
    'space$': ('"a" + Space$(2) + "b"', 'a  b'),
    'str$': ('Str$(1e14) + Str$(5)', '1.000000E+0145'),
    'val': ('Val("12.5abc") + Val("&HFF") + Val("x")', '267.5'),
    'hex$': ('Hex$(255) + Hex$(-1)', 'FFFFFFFFFF'),
    'fmtstr$': ('FmtStr$(3.14159, "000.00") + FmtStr$(-1, "0.##")', '003.14-1.'),
    'xy': ('CX(XY(1, 2, 3, 4))', '1'),
    'ja': ('JA(1, 2, 3, 4, 5, 6)', 'angles(1.000, 2.000, 3.000, 4.000, 5.000, 6.000)'),
    'agltopls': ('AglToPls(1, 2, 3, 4)', 'angles(1.000, 2.000, 3.000, 4.000)'),
    'pulse': ('Pulse(1, 2, 3, 4)', 'pulses(1.000, 2.000, 3.000, 4.000)'),
    'tmr': ('Tmr(0)', '0'),
    'elapsedtime': ('ElapsedTime', '0'),
    'time': ('Time(0) + Time(1) + Time(2)', '0'),
    'date$': ('Date$', '2000/01/01'),
    'time$': ('Time$', '00:00:00'),
    'tw': ('TW', '0'),
    'mytask': ('MyTask', '1'),
    'taskstate': ('TaskState(1) * 10 + TaskState(main) + TaskState(2)', '11'),
    'taskinfo': ('TaskInfo(main, 1) + TaskInfo(1, 2) + TaskInfo(1, 3) * 10', '11'),
    'taskdone': ('TaskDone(1) + TaskDone(2)', '-1'),
    'err': ('Err + Err(1)', '0'),
    'erl': ('Erl', '0'),
    'era': ('Era', '0'),
    'ert': ('Ert', '0'),
    'erf$': ('Erf$ + "|"', '|'),
    'errmsg$': ('ErrMsg$(2260)', 'the task number is out of range'),
    'chknet': ('ChkNet(201)', '-3'),
    'opennet': ('OpenNet(201)', '0'),
    'lof': ('Lof(201)', '0'),
    'sw': ('Sw(3) * 10 + Sw(4)', '10'),
    'in': ('In(0)', '8'),
    'inw': ('InW(0)', '8'),
    'oport': ('Oport(1)', '0'),
    'out': ('Out(0)', '0'),
    'outw': ('OutW(0)', '0'),
    'memsw': ('MemSw(0)', '0'),
    'memin': ('MemIn(0)', '0'),
    'meminw': ('MemInW(0)', '0'),
    'motor': ('Motor = Off', '-1'),
    'power': ('Power', '0'),
    'ctrlinfo': ('CtrlInfo(7)', '12'),
    'stat': ('Stat(0)', '0'),
    'syserr': ('SysErr', '0'),
    'erroron': ('ErrorOn', '0'),
    'estopon': ('EStopOn = False', '-1'),
    'safetyon': ('SafetyOn', '0'),
    'pauseon': ('PauseOn', '0'),
    'teachon': ('TeachOn', '0'),
    'athome': ('AtHome', '0'),
    'robotinfo': ('RobotInfo(0) And &H200', '0'),
    'robottype': ('RobotType', '0'),
    'inpos': ('InPos', '0'),
    'tillon': ('TillOn', '0'),
    'speed': ('Speed', '5'),
    'accel': ('Accel(1)', '5'),
    'accelmax': ('AccelMax', '0'),
    'speeds': ('SpeedS', '50'),
    'accels': ('AccelS', '200'),
    'speedfactor': ('SpeedFactor', '100'),
    'agl': ('Agl(1)', '0'),
    'pls': ('Pls(1)', '0'),
    'realpls': ('RealPls(6)', '0'),
    'jrange': ('JRange(1, 2)', '0'),
    'here': ('CX(Here)', '0'),
    'curpos': ('CY(CurPos)', '0'),
    'realpos': ('CZ(RealPos)', '0'),
    'cx': ('CX(XY(1, 2, 3, 4, 5, 6))', '1'),
    'cy': ('CY(XY(1, 2, 3, 4, 5, 6))', '2'),
    'cz': ('CZ(XY(1, 2, 3, 4, 5, 6) +Z(10))', '13'),
    'cu': ('CU(XY(1, 2, 3, 4, 5, 6) :U(7))', '7'),
    'cv': ('CV(XY(1, 2, 3, 4, 5, 6) -V(1))', '4'),
    'cw': ('CW(XY(1, 2, 3, 4, 5, 6) /L)', '6'),
    'ppls': ('PPls(XY(0, 0, 0, 0), 1)', '0'),
    'pagl': ('PAgl(XY(0, 0, 0, 0), 1)', '0'),
    'targetok': ('TargetOK(XY(0, 0, 0, 0))', '0'),
    'tab$': ('Asc(Tab$(1))', '9'),
    'lset$': ('LSet$("ab", 4) + "|"', 'ab  |'),
    'rset$': ('RSet$("ab", 4)', '  ab'),
    'pnumber': ('PNumber(P7)', '7'),
    'plabel$': ('PLabel$(3) + "|"', '|'),
    'hand': ('Hand(XY(0, 0, 0, 0))', '1'),
    'dist': ('Dist(XY(0, 0, 0, 0), XY(3, 4, 0, 0))', '5'),
    'localdef': ('LocalDef(1)', '0'),
    'freefile': ('FreeFile', '30'),
    'fileexists': ('FileExists("no.txt")', '0'),
    'js': ('JS', '0'),
    'posfound': ('PosFound', '0'),
    'findpos': ('CX(FindPos)', '0'),
    'tool': ('Tool', '0'),
    'tlset': ('CZ(TLSet(1))', '0'),
    'tldef': ('TLDef(1)', '0'),
    'arm': ('Arm', '0'),
    'robot': ('Robot', '1'),
    'robotmodel$': ('RobotModel$ + "|"', '|'),
    'robotname$': ('RobotName$ + "|"', '|'),
    'limz': ('LimZ', '0'),
    'arch': ('Arch(0, 1)', '30'),
    'ljm': ('CX(LJM(XY(1, 2, 3, 4), Here))', '1'),
    'cp': ('CP', '0'),
    'ptptime': ('PTPTime(XY(0, 0, 0, 0), 0, 0)', '0'),
}
"""An expression for each function and its printed value, with input 3 on."""

WITH_VARIABLES = {
    'parsestr', 'ubound', 'p', 'pdef', 'pallet', 'local', 'eof',
    'plocal',
}  # fmt: skip
"""Functions that are tested with a program, below or in test_types.py."""


@pytest.mark.parametrize('name', VALUES)
def test_function_returns_its_value(name: str) -> None:
    expression, expected = VALUES[name]
    assert name.rstrip('$') in expression.lower()
    host = ScriptedHost()
    host.write_bits(Memory.INPUT, 3, 1, 1)
    host.states |= {'ctrlinfo': 12}
    run(f'Function main\n  Print {expression}\nFend', host=host)
    assert host.failures == []
    assert host.text.splitlines() == [expected]


def test_every_function_has_a_test_and_one_implementation() -> None:
    assert VALUES.keys() | WITH_VARIABLES == FUNCTIONS.keys()
    by = {
        kind: {name for name, rule in FUNCTIONS.items() if rule.by == kind}
        for kind in ('value', 'task', 'host')
    }
    assert by['value'] == VALUE_FUNCTIONS.keys()
    own = {**TASK_FUNCTIONS, **POINT_FUNCTIONS, **FILE_FUNCTIONS}
    assert by['task'] == own.keys()
    assert {name for name in FUNCTIONS if not is_a('function', name)} == {'p'}
    assert not FUNCTIONS.keys() & CONSTANTS.keys()


def test_points_are_stored_and_string_functions_count_characters() -> None:
    body = """
    String t$(1), s$
    Integer n
    P1 = XY(1, 2, 3, 4)
    P(n + 2) = P1 +X(10)
    Print CX(P1), CX(P(2)), PDef(1), PDef(3)
    n = ParseStr("a,b;c", t$(), ",;")
    Print n, t$(0), t$(2), UBound(t$)
    ParseStr "x y", t$(), " "
    Print t$(1)
    Print CX(P3)
    """
    source = 'Function main\n' + body + '\nFend'
    host = run(source)
    assert host.text.splitlines() == ['1 11 -1 0', '3 a c 2', 'y']
    assert [failure.number for failure in host.failures] == [7007]


PALLET = 'Pallet 1, XY(0, 0, 5, 9), XY(20, 0, 5, 0), XY(0, 30, 5, 0), 3, 4'
WRITTEN = 'WOpen "a.txt" As #30\nPrint #30, "a"\nPrint #30, "b"\nClose #30\n'
SHOWN = 'String l$\nROpen "a.txt" As #30\nDo Until Eof(30)\nLine Input #30, l$\nPrint l$\nLoop'
STATEMENTS_AT_WORK = {
    'if': ('If True Then Print 1', ['1']),
    'select': ('Select 1\nCase 1\nPrint 1\nSend', ['1']),
    'do': ('Do\nExit Do\nLoop\nPrint 1', ['1']),
    'for': ('Integer i\nFor i = 1 To 2\nPrint i\nNext', ['1', '2']),
    'exit': ('Print 1\nExit Function\nPrint 2', ['1']),
    'goto': ('GoTo a\nPrint 1\na:\nPrint 2', ['2']),
    'gosub': ('GoSub a\nPrint 2\nExit Function\na:\nPrint 1\nReturn', ['1', '2']),
    'return': ('OnErr GoTo a\nReturn\na:\nPrint Err', ['2383']),
    'call': ('Call helper(5)', ['helper 5']),
    'onerr': ('OnErr GoTo a\nError 8001\na:\nPrint Err', ['8001']),
    'eresume': ('OnErr GoTo a\nError 8001\nPrint 2\nExit Function\na:\nEResume Next', ['2']),
    'error': ('OnErr GoTo a\nError 8002\na:\nPrint Err, Erl, Ert', ['8002 4 1']),
    'redim': ('Integer a(1)\nRedim a(5)\nPrint UBound(a)', ['5']),
    'xqt': ('Xqt helper(1)\nXqt 5, helper(2), NoPause\nWait 0.1', ['helper 1', 'helper 2']),
    'quit': ('Xqt 2, forever\nQuit forever\nPrint TaskState(2)\nQuit All\nPrint 1', ['0']),
    'halt': ('Xqt 2, forever\nHalt 2\nPrint TaskState(2)', ['3']),
    'resume': ('Xqt 2, forever\nHalt 2\nResume 2\nWait 0.1\nPrint TaskState(2)', ['2']),
    'taskwait': ('Xqt 2, pausing\nTaskWait 2\nPrint Tmr(0) > 0.49, TaskDone(pausing)', ['-1 -1']),
    'startmain': ('OnErr GoTo a\nStartMain main\na:\nPrint Err', ['9996']),
    'pause': ('Xqt 2, watcher, NoPause\nWait 0.1\nPause\nPrint Tmr(0) > 0.4', ['-1']),
    'cont': ('Xqt 2, watcher, NoPause\nWait 0.1\nPause\nWait 0.1\nPrint 2', ['2']),
    'wait': ('Wait 0.005\nPrint Tmr(0)', ['0.01']),
    'tmout': ('OnErr GoTo a\nTMOut 0.1\nWait Sw(9) = On\na:\nPrint Err', ['2280']),
    'signal': ('Xqt 2, waiter\nWait 0.1\nSignal 3\nWait 0.1', ['signalled 0']),
    'waitsig': ('Signal 3\nWaitSig 3, 0.2\nPrint TW', ['-1']),
    'synclock': ('SyncLock 1\nOnErr GoTo a\nSyncLock 1\na:\nPrint Err', ['9997']),
    'syncunlock': ('SyncLock 1\nSyncUnlock 1\nSyncLock 1, 1\nPrint TW', ['0']),
    'trap': ('Trap 1, MemSw(1) = On Call pausing\nMemOn 1\nWait 0.1\nPrint Tmr(0) > 0.4', ['-1']),
    'tmreset': ('Wait 0.5\nTmReset 1\nWait 0.1\nPrint Tmr(1)', ['0.1']),
    'resetelapsedtime': ('Wait 0.5\nResetElapsedTime\nWait 0.1\nPrint ElapsedTime', ['0.1']),
    'randomize': (
        'Real a\nRandomize 5\na = Rnd(1)\nRandomize 5\nPrint Abs(a - Rnd(1)) < 1e-6\nRandomize',
        ['-1'],
    ),
    'print': ('Print 1, "a",\nPrint 2', ['1 a 2']),
    'input': ('Integer i\nReal r\nInput i, r\nPrint i, r', ['5 2.5']),
    'line': ('String s$\nLine Input s$\nPrint s$', ['5, 2.5']),
    'msgbox': ('Integer i\nMsgBox "go on?", MB_YESNO, "title", i\nPrint i\nMsgBox "x"', ['2']),
    'parsestr': ('String t$(0)\nParseStr "a b", t$(), " "\nPrint t$(1)', ['b']),
    'setnet': ('SetNet #201, "10.0.0.1", 2001, CR, NONE, 5, TCP, 3, 4', None),
    'opennet': ('OpenNet #201 As Server\nPrint ChkNet(201), OpenNet(201)', ['-1 1']),
    'closenet': ('OpenNet #201 As Client\nCloseNet #201\nPrint ChkNet(201)\nCloseNet All', ['-3']),
    'waitnet': ('OpenNet #201 As Server\nWaitNet #201, 0.1\nPrint TW', ['-1']),
    'read': ('String s$\nOnErr GoTo a\nRead #201, s$, 3\na:\nPrint Err', ['2909']),
    'readbin': ('Integer i\nOnErr GoTo a\nReadBin #201, i\na:\nPrint Err', ['2909']),
    'write': ('OnErr GoTo a\nWrite #201, "x"\na:\nPrint Err', ['2909']),
    'writebin': ('OnErr GoTo a\nWriteBin #201, 5\na:\nPrint Err', ['2909']),
    'on': ('On 5\nPrint Oport(5), Out(0)\nOn 6, 0.1, 1, Forced\nPrint Oport(6)', ['1 32', '0']),
    'off': ('On 5\nOff 5\nPrint Oport(5)\nOff 6, 0.1\nPrint Oport(6)', ['0', '1']),
    'out': ('Out 1, 255\nPrint Oport(8), Out(1), OutW(0), Oport(7)', ['1 255 65280 0']),
    'outw': ('OutW 1, &H8001, Forced\nPrint Oport(16), Oport(31), OutW(1)', ['1 1 32769']),
    'memon': ('MemOn 3\nPrint MemSw(3), MemIn(0), MemInW(0)', ['1 8 8']),
    'memoff': ('MemOn 3\nMemOff 3\nPrint MemSw(3)', ['0']),
    'memout': ('MemOut 1, 3\nPrint MemSw(8), MemIn(1)', ['1 3']),
    'memoutw': ('MemOutW 1, -1\nPrint MemInW(1)', ['65535']),
    'pallet': (f'{PALLET}\nP1 = Pallet(1, 5)\nPrint CX(P1), CY(P1), CU(P1)', ['10 10 9']),
    'palletclr': (f'{PALLET}\nPalletClr 1\nOnErr GoTo a\nGo Pallet(1, 1)\na: Print Err', ['7007']),
    'fmtstr': ('String s$\nFmtStr 1.5, "00.00", s$\nPrint s$', ['01.50']),
    'where': ('Where', ['0']),
    'joint': ('Joint', ['0']),
    'motor': ('Motor On\nPrint Motor\nMotor Sw(0)\nPrint Motor', ['1', '0']),
    'power': ('Power High\nPrint Power\nPower Low, Forced\nPrint Power', ['1', '0']),
    'speed': ('Speed 50, 30, 30\nPrint Speed', ['50']),
    'accel': ('Accel 40, 50\nPrint Accel(1)', ['40']),
    'speeds': ('SpeedS 250.5\nPrint SpeedS', ['250.5']),
    'accels': ('AccelS 1000\nPrint AccelS', ['1000']),
    'speedfactor': ('SpeedFactor 80\nPrint SpeedFactor', ['80']),
    'reset': ('Reset Error\nReset', []),
    'abortmotion': ('AbortMotion All\nAbortMotion 1', []),
    'till': ('Till Sw(1) = On\nMotor On\nGo XY(0,0,0,0) Till', []),
    'sense': ('Sense Sw(1) = On\nMotor On\nJump XY(0,0,0,0) Sense', []),
    'find': ('Find Sw(1) = On\nMotor On\nGo XY(0,0,0,0) Find', []),
    'go': ('Motor On\nGo XY(1,2,3,4) CP\nPrint CX(Here)', ['1']),
    'move': ('Motor On\nMove XY(1,2,3,4) ROT\nPrint CX(Here)', ['1']),
    'arc': ('Motor On\nArc XY(1,2,3,4), XY(5,6,7,8)\nPrint CX(Here)', ['5']),
    'jump': ('Motor On\nP1 = XY(1,2,3,4)\nJump P1 :Z(9) C0\nPrint CZ(Here)', ['9']),
    'jump3': ('Motor On\nJump3 XY(1,2,3,4), XY(5,6,7,8), XY(9,9,9,9)\nPrint CX(Here)', ['9']),
    'pass': ('Motor On\nP1 = XY(1,2,3,4)\nPass P1, P1 LJM\nPrint CX(Here)', ['1']),
    'pulse': ('Motor On\nPulse 1, 2, 3, 4, 5, 6', []),
    'tgo': ('Motor On\nTGo XY(1,2,3,4) LJM 1 Till Sw(0) = On CP', []),
    'tmove': ('Motor On\nTMove XY(1,2,3,4)', []),
    'bgo': ('Motor On\nBGo XY(1,2,3,4)', []),
    'bmove': ('Motor On\nBMove XY(1,2,3,4)', []),
    'arc3': ('Motor On\nArc3 XY(1,2,3,4), XY(5,6,7,8) CP\nPrint CX(Here)', ['5']),
    'jumptlz': ('Motor On\nJumpTLZ XY(1,2,3,4), -10, C1, !On 1!\nPrint Oport(1)', ['1']),
    'jump3cp': ('Motor On\nP1 = XY(1,2,3,4)\nJump3CP P1, P1, P1\nPrint CX(Here)', ['1']),
    'here': ('P1 = XY(9,9,9,9)\nHere P1\nPrint CX(P1)', ['0']),
    'pdel': ('P1 = XY(1,2,3,4)\nP2 = P1\nPDel 1, 2\nPrint PDef(1), PDef(P2)', ['0 0']),
    'plabel': ('P1 = XY(1,2,3,4)\nPLabel 1, "Pi"\nPrint PLabel$(1), PNumber("PI")', ['Pi 1']),
    'plist': (
        'P1 = XY(200,0,-20,0) /L\nPList 1',
        ['P1 = XY( 200.000,    0.000,  -20.000,    0.000 ) /L /0'],
    ),
    'clearpoints': ('P1 = XY(1,2,3,4)\nClearPoints\nPrint PDef(1)', ['0']),
    'loadpoints': (
        'P1 = XY(1,2,3,4) /L /2\nPLabel P1, "Pick"\nSavePoints "a.pts"\nClearPoints\n'
        'P5 = XY(5,5,5,5)\nLoadPoints "A.PTS", Merge\n'
        'Print P1, PLabel$(PNumber("pick")), PDef(5)\nLoadPoints "a.pts"\nPrint PDef(5), Hand(P1)',
        [' X:    1.000 Y:    2.000 Z:    3.000 U:    4.000 V:    0.000 W:    0.000 /L /2 Pick -1',
         '0 2'],
    ),
    'savepoints': ('SavePoints "a.pts"\nPrint FileExists("a.pts")', ['-1']),
    'hand': ('P1 = XY(1,2,3,4)\nHand P1, 2\nPrint Hand(P1), Hand(P1 /R)\nHand P1', ['2 1', '2']),
    'local': (
        'Local 1, XY(100, 0, 0, 90)\nMotor On\nGo XY(10, 0, 0, 0) /1\n'
        'Print CX(Here), CY(Here), CU(Here), CX(Here @1), LocalDef(1), CX(Local(1))\n'
        'Local 2, XY(0,0,0,0), XY(0,5,0,0), XY(-5,0,0,0), X\nPrint CU(Local(2))\n'
        'Local 3, (XY(0,0,0,0):XY(7,0,0,0)), (XY(1,0,0,0):XY(7,1,0,0))\nPrint CU(Local(3))',
        ['100 10 90 10 -1 100', '90', '90'],
    ),
    'localclr': ('Local 1, XY(0,0,0,0)\nLocalClr 1\nPrint LocalDef(1)', ['0']),
    'setsw': ('SetSw 5, On\nPrint Sw(5), In(0)', ['1 32']),
    'setin': ('SetIn 1, 3\nPrint Sw(9), InW(0)', ['1 768']),
    'setinw': ('SetInW 1, &H8001\nPrint Sw(31), InW(1)', ['1 32769']),
    'aopen': (f'{WRITTEN}AOpen "a.txt" As #30\nPrint #30, 1\nClose #30\n{SHOWN}', ['a', 'b', '1']),
    'ropen': (f'{WRITTEN}{SHOWN}', ['a', 'b']),
    'wopen': (f'{WRITTEN}WOpen "A.TXT" As #30\nPrint #30, 1\nClose #30\n{SHOWN}', ['1']),
    'close': ('OnErr GoTo a\nClose #30\na: Print Err', ['9993']),
    'flush': (f'WOpen "b" As #31\nPrint #31, 1\nFlush #31\nCopy "b", "a.txt"\n{SHOWN}', ['1']),
    'copy': (f'{WRITTEN}Copy "a.txt", "b"\nDel "a.txt"\nCopy "b", "a.txt"\n{SHOWN}', ['a', 'b']),
    'del': (f'{WRITTEN}Del "a.txt"\nPrint FileExists("a.txt")', ['0']),
    'arch': ('Arch 6, 10, 20\nPrint Arch(6, 1), Arch(6, 2), Arch(5, 2)', ['10 20 80']),
    'plocal': ('P1 = XY(0, 0, 0, 0)\nPLocal P1, 3\nPrint PLocal(P1)', ['3']),
}  # fmt: skip
"""Statements for each command, and the printed text (None: an invalid argument is refused)."""

SETTINGS = {
    'speedr': 'SpeedR 50',
    'accelr': 'AccelR 50, 60',
    'cp': 'CP On',
    'fine': 'Fine 1, 2, 3, 4',
    'limz': 'LimZ -10',
    'weight': 'Weight 2.5',
    'inertia': 'Inertia 0.01, 0',
    'tool': 'Tool 1',
    'tlset': 'TLSet 1, XY(0, 0, 10, 0)',
    'ptpboost': 'PTPBoost 50',
    'qp': 'QP Off',
    'tlclr': 'TLClr 1',
    'arm': 'Arm 0',
    'robot': 'Robot 1',
    **{name.lower(): f'{name} 1, 2' for name in WITHOUT_EFFECT},
    'home': 'Home',
    'homeset': 'HomeSet 0, 0, 0, 0',
    'waitpos': 'WaitPos',
}
"""Statements that only pass a setting to the host."""

HELPERS = """
Function helper(n As Integer)
  Print "helper", n
Fend
Function forever
  Do
    Wait 10
  Loop
Fend
Function pausing
  Wait 0.5
Fend
Function waiter
  WaitSig 3, 5
  Print "signalled", TW
Fend
Function watcher
  Wait 0.5
  Cont
Fend
"""


@pytest.mark.parametrize('name', STATEMENTS_AT_WORK)
def test_statement_prints_its_result(name: str) -> None:
    body, expected = STATEMENTS_AT_WORK[name]
    source = f'Function main\n  TmReset 0\n{body}\nFend\n{HELPERS}'
    if expected is None:
        with pytest.raises(ProgramError, match='expected the end of the statement'):
            run(source)
        return
    host = ScriptedHost()
    host.typed = ['5, 2.5']
    run(source, host=host)
    assert host.failures == [], str(host.failures[0])
    assert host.text.splitlines() == expected


@pytest.mark.parametrize('name', SETTINGS)
def test_setting_statement_reaches_the_host(name: str) -> None:
    host = run(f'Function main\n  {SETTINGS[name]}\nFend')
    assert [command[0] for command in host.commands] == [name]
    assert host.failures == []


def test_every_statement_has_a_test_and_one_implementation() -> None:
    assert STATEMENTS_AT_WORK.keys() | SETTINGS.keys() == COMMANDS.keys()
    own = {name for name, rule in COMMANDS.items() if not rule.robot and rule.form[:1] != '@'}
    assert own <= all_statements().keys()
    for rule in COMMANDS.values():
        if rule.form.startswith('@'):
            assert hasattr(Parser, rule.form.replace('@', 'read_')), rule
    assert all(is_a('statement', name) for name in COMMANDS)
    assert not COMMANDS.keys() & KEYWORDS


SOURCES = {
    **{f'{name}(': f'Print {each}' for name, (each, _) in VALUES.items()},
    **{name: body for name, (body, _) in STATEMENTS_AT_WORK.items()},
    **SETTINGS,
}
A_NUMBER = re.compile(r'(?<![\w.$&"])\d+(?:\.\d+)?(?![\w.])')
HANDLED = re.compile('OnErr|(Till|Sense|Find) Sw')
"""Programs without a run-time error: with a handler, or with an unused motion condition."""
IT_DEPENDS = re.compile(r'^(Local|Redim|Read) |Pallet\(|#0|Asc\(Tab\$\(0')
"""Statements whose validity depends on other numbers or earlier statements."""


@pytest.mark.slow
@pytest.mark.parametrize('name', SOURCES)
def test_check_and_run_refuse_the_same_numbers(name: str) -> None:
    """Each number of each statement and function is replaced by numbers out of range."""
    body = SOURCES[name]
    source = body if 'Function' in body else f'Function main\n{body}\nFend'
    for result in A_NUMBER.finditer(source):
        before = source[: result.start()]
        for number in ('-1', '0', '40000'):
            changed = before + number + source[result.end() :]
            line = changed.splitlines()[before.count('\n')].strip()
            if before.count('"') % 2 or IT_DEPENDS.search(line):
                continue
            errors = {item.rule for item in check({'main.prg': changed}) if not item.warning}
            if errors - {'range'} or (errors and HANDLED.search(changed)):
                continue
            host = ScriptedHost()
            host.typed = ['5, 2.5']
            run(changed, host=host)
            refused = [
                failure.text for failure in host.failures if failure.number in (9991, 9993, 2260)
            ]
            assert bool(refused) == bool(errors), line


OTHER_WORDS = sorted(WORDS[name].name for name in NOT_SIMULATED)


@pytest.mark.parametrize('name', OTHER_WORDS)
def test_unsimulated_word_is_an_error_unless_stubbed(name: str) -> None:
    """`check` gives a warning."""
    text = f'  {name} 1' if is_a('statement', name) else f'  Print {name}(1)'
    source = f'Function main\n{text}\nFend'
    host = run(source)
    (failure,) = host.failures
    assert (failure.number, failure.position.line) == (9999, 2)
    page = f' (SPEL+ manual p{WORDS[name.lower()].page})' if WORDS[name.lower()].page else ''
    assert failure.text == (
        f'{name} is not simulated{page}: add `{name}: RESULT` under `stubs:` in spel.yaml'
    )
    (warning,) = check({'main.prg': source})
    assert (warning.rule, warning.warning) == ('not-simulated', True)
    answered = ScriptedHost()
    around = ProgramEnvironment({name: [1]})
    made = Machine(build({'main.prg': source}), answered, around=around)
    made.start()
    made.advance(1.0)
    assert answered.failures == []


def test_wait_conditions_can_combine_bits_and_variables() -> None:
    host = ScriptedHost()
    source = """
    Global Integer g_n
    Integer m_n
    Function main
      Integer limit
      limit = 3
      Xqt other
      Wait (Sw(1) = On Or g_n >= limit) And Not MemSw(2) = On And m_n <> 7
      Print g_n, TW, Tmr(0)
      Wait In(0) Mask 3 = 2, 0.1
      Print TW
      Wait Sw(1) Xor MemSw(1), 0.1
      Print TW
    Fend
    Function other
      Do While g_n < 10
        g_n = g_n + 1
        Wait 0.1
      Loop
    Fend
    """
    run(source, host=host)
    assert host.failures == []
    first, *rest = host.text.splitlines()
    assert first.startswith('3 0 0.2')
    assert rest == ['-1', '-1']


def test_pallet_positions_are_interpolated() -> None:
    """Positions between and outside the corners, by column and row, and invalid ones."""
    body = """
    P1 = XY(0, 0, 0, 7)
    Pallet Outside, 2, P1, XY(10, 0, 0, 0), XY(0, 10, 0, 0), XY(20, 20, 4, 0), 2, 2
    Print CX(Pallet(2, 4)), CZ(Pallet(2, 2, 2)), CX(Pallet(2, 3, 1)), CU(Pallet(2, 2, 2))
    Print CX(Pallet(2, 2) -X(1)), CY(Pallet(2, 1, 2))
    Pallet 3, P1, XY(8, 0, 0, 0), P1, 5, 1
    Print CX(Pallet(3, 4)), CX(Pallet(3, 5, 1))
    """
    assert printed(body) == ['20 4 20 7', '9 10', '6 8']
    for wrong in ('Pallet(3, 6)', 'Pallet(3, 0)', 'Pallet(3, 1, 2)', 'Pallet(16, 1)'):
        host = run(
            f'Function main\nPallet 3, P1, P1, P1, 5, 1\nP1 = {wrong}\nFend'.replace(
                'main\n', 'main\nP1 = XY(0, 0, 0, 0)\n'
            )
        )
        assert [failure.number for failure in host.failures] == [9993], wrong
    for wrong in ('16, P1, P1, P1, 5, 1', '1, P1, P1, P1, 0, 1', '1, P1, P1, P1, 200, 200'):
        host = run(f'Function main\nP1 = XY(0, 0, 0, 0)\nPallet {wrong}\nFend')
        assert [failure.number for failure in host.failures] == [9993], wrong
    with pytest.raises(ProgramError, match='a number, three or four points, columns and rows'):
        run('Function main\nPallet 1, P1, P2, 3, 4\nFend')


def test_print_formats_strings_numbers_and_booleans() -> None:
    assert printed('Print "a"; Print 1, 2.5, 1 / 3') == ['a', '1 2.5 0.333333333333333']
    assert value('True') == '-1'


@pytest.mark.parametrize('state', ['estopon', 'safetyon'])
@pytest.mark.parametrize('statement', ['On 1', 'Off 1', 'Out 0, 3', 'OutW 0, 3'])
def test_outputs_in_estop_or_open_door_need_forced(statement: str, state: str) -> None:
    """SPEL+ p560, p567."""
    host = ScriptedHost()
    host.states[state] = -1
    run(f'Function main\n  {statement}, Forced\n  MemOn 1\n  {statement}\nFend', host=host)
    (failure,) = host.failures
    assert (failure.number, failure.position.line) == (9996, 4)
    assert 'outputs need the parameter Forced' in failure.text
