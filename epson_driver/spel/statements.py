# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Parses the statements of one line according to the argument forms of commands.py."""

import re
from collections.abc import Container, Iterator
from dataclasses import replace

from epson_driver.spel.commands import TASK_TYPE_WORDS, TRAP_EVENTS
from epson_driver.spel.errors import Position, SyntaxProblem
from epson_driver.spel.expressions import Reader
from epson_driver.spel.functions import AXES, POINT_FLAGS
from epson_driver.spel.lexer import END, NAME, Token
from epson_driver.spel.project_data import LAST_POINT
from epson_driver.spel.syntax import (
    Apply,
    Argument,
    Assign,
    Binary,
    Call,
    Command,
    Do,
    EResume,
    Expression,
    For,
    If,
    Input,
    Jump,
    Label,
    Motion,
    Name,
    Number,
    OnErr,
    PointFlag,
    Print,
    Redim,
    Return,
    Select,
    Share,
    Statement,
    Store,
    Stub,
    Target,
    TaskCommand,
    Text,
    Transfer,
    Trap,
    Wait,
    Xqt,
    walk,
)
from epson_driver.spel.words import SYNTAX

_TERMINATORS = ('cr', 'lf', 'crlf')
_PROTOCOLS = ('tcp', 'udp', 'udp_send', 'udp_recv')
_CONDITIONS = ('till', 'find', 'sense')
_NUMBERED = ('c', 'limz', 'ljm', 'performmode')
_PLAIN = ('rot', 'ecp', 'sync')
_SWITCHES = ('on', 'off', 'memon', 'memoff')
_PARALLEL = frozenset(
    {'on', 'off', 'memon', 'memoff', 'out', 'outw', 'opbcd', 'memout', 'memoutw', 'signal'}
    | {'waitsig', 'hand_on', 'hand_off'}
)
"""Statements of the manual's table for `!…!`, except Wait, Print and functions of a DLL."""
_MODIFIERS = (*_CONDITIONS, *_NUMBERED, *_PLAIN, 'cp', '!')


class Statements:
    def __init__(self, functions: set[str], points: Container[str] = frozenset()) -> None:
        self._functions = functions
        self._points = points
        self.marks: list[tuple[str, Position]] = []

    def _mark(self, form: str, at: Position) -> None:
        """Record a form of `lint_rules.UNPROVEN`."""
        self.marks.append((form, at))

    def read_form(self, reader: Reader, first: Token, form: str) -> Command:
        """Parse the arguments of a statement according to a form of commands.py."""
        arguments: list[Expression | None] = []
        words: list[str] = []
        kinds = form.split(',') if form else []
        last = re.match(r'w\((.*)\)', kinds[-1]) if kinds else None
        final = last[1].lower().split('|') if last is not None else []
        for number, kind in enumerate(kinds):
            optional = kind.endswith(('?', '*'))
            early = optional and reader.sees(*final)  # `On 1, Forced`: the others are omitted
            if number and not (early or reader.takes(',') or optional):
                raise reader.wrong('a comma and one more value')
            if optional and reader.sees(*final) and kind is not kinds[-1]:
                arguments.append(None)
                continue
            if kind.endswith('*'):
                while not reader.at_end():
                    arguments.append(reader.expression())
                    if not reader.takes(','):
                        break
                continue
            choice = re.match(r'w\((.*)\)', kind)
            if choice is not None:
                allowed = choice[1].lower().split('|')
                bracket = reader.look(1).lower in allowed and reader.takes('(')  # QP (On)
                if reader.sees(*allowed):
                    words.append(reader.step().lower)
                    if bracket:
                        reader.need(')')
                elif not optional and not reader.at_end():
                    arguments.append(reader.expression())
                    if 'on' in allowed:
                        self._mark('`Motor 1`, `CP 1`, `QP 1`', first.position)
                elif not optional:
                    raise reader.wrong(' or '.join(choice[1].split('|')))
                continue
            if reader.at_end() or reader.sees(','):
                if not optional:
                    raise reader.wrong('a value')
                arguments.append(None)
            else:
                if kind == '#':
                    reader.need('#')
                value = reader.argument().value
                point = kind == 'p' and reader.sees(',')
                arguments.append(coordinates(value, reader) if point else value)
        if first.lower == 'plocal':
            self._mark('`PLocal P1, 2`', first.position)
        return Command(first.text, tuple(arguments), first.position, tuple(words))

    # Structure

    def read_jump(self, reader: Reader, first: Token) -> Jump:
        label = reader.name('a label').text
        return Jump('goto' if first.lower == 'goto' else 'gosub', label, first.position)

    def read_return(self, _reader: Reader, first: Token) -> Return:
        return Return(first.position)

    def read_call(self, reader: Reader, _first: Token) -> Call:
        return self.call_arguments(reader, reader.name('the name of a function'))

    def call_arguments(self, reader: Reader, name: Token) -> Call:
        """Parse the arguments of a function called as a statement, with or without brackets."""
        if reader.sees('(') and reader.look(reader.past_brackets()).kind == END:
            return Call(name.text, reader.arguments(), name.position)
        arguments: list[Argument] = []
        while not reader.at_end():
            arguments.append(reader.argument())
            if not reader.takes(','):
                break
        return Call(name.text, tuple(arguments), name.position)

    def read_on_err(self, reader: Reader, first: Token) -> OnErr:
        if not reader.takes('goto'):
            label = reader.here.text or 'label'
            text = f'GoTo is missing (p569): write OnErr GoTo {label}'
            raise SyntaxProblem(reader.here.position, text)
        if reader.here.text == '0':
            reader.step()
            return OnErr(None, first.position)
        return OnErr(reader.name('a label or 0').text, first.position)

    def read_eresume(self, reader: Reader, first: Token) -> EResume:
        if reader.at_end():
            return EResume('again', '', first.position)
        if reader.takes('next'):
            return EResume('next', '', first.position)
        return EResume('label', reader.name('a label').text, first.position)

    def read_redim(self, reader: Reader, first: Token) -> Redim:
        preserve = reader.takes('preserve')
        name = reader.name('the name of an array').text
        bounds = [argument.value for argument in reader.arguments()]
        if not 1 <= len(bounds) <= 3:
            raise SyntaxProblem(first.position, 'Redim needs one to three bounds')
        return Redim(preserve, name, tuple(bounds), first.position)

    # Tasks

    def read_xqt(self, reader: Reader, first: Token) -> Xqt:
        """Parse `Xqt [n,] f[(…)] [, type]`."""
        number: Expression | None = None
        if reader.sees('!'):
            raise SyntaxProblem(
                reader.here.position, 'Xqt takes no ! before a task (p912): remove it'
            )
        is_name = reader.here.kind == NAME and reader.here.lower in self._functions
        if not is_name:
            missing = reader.here
            number = reader.expression()
            named = missing.kind == NAME and isinstance(number, Name)
            if named and (reader.at_end() or reader.look(1).lower in TASK_TYPE_WORDS):
                text = f'there is no function {missing.text}'
                raise SyntaxProblem(missing.position, text, 'unknown')
            reader.need(',')
        name = reader.name('the name of a function')
        arguments = reader.arguments() if reader.sees('(') else ()
        kind = 'normal'
        if reader.takes(','):
            if not reader.sees(*TASK_TYPE_WORDS):
                raise reader.wrong('Normal, NoPause or NoEmgAbort')
            kind = reader.step().lower
        return Xqt(number, name.text, arguments, kind, first.position)

    def read_task_command(self, reader: Reader, first: Token) -> TaskCommand:
        here = reader.here
        if first.lower in ('quit', 'resume') and reader.takes('all'):
            return TaskCommand(first.text, None, '', first.position)
        if here.kind == NAME and here.lower in self._functions and reader.look(1).kind == END:
            reader.step()
            return TaskCommand(first.text, None, here.text, first.position)
        return TaskCommand(first.text, reader.expression(), '', first.position)

    def read_wait(self, reader: Reader, first: Token) -> Wait:
        """Parse `Wait time` or `Wait condition[, time]`.

        The compiler decides whether the argument is a time or a condition.
        """
        condition = reader.expression()
        time = reader.expression() if reader.takes(',') else None
        return Wait(condition, time, first.position)

    def read_trap(self, reader: Reader, first: Token) -> Trap:
        """Parse `Trap n, condition GoTo|Call|Xqt name` or `Trap event Xqt f`."""
        if reader.sees(*TRAP_EVENTS):
            event = reader.step().lower
            if reader.at_end():
                return Trap(event, None, None, '', '', first.position)
            reader.takes(',')
            reader.need('xqt')
            return Trap(event, None, None, 'xqt', self._function_name(reader), first.position)
        number = reader.expression()
        if reader.at_end():
            return Trap('', number, None, '', '', first.position)
        reader.need(',')
        condition = reader.expression()
        if not reader.sees('goto', 'call', 'xqt'):
            raise reader.wrong('GoTo, Call or Xqt')
        action = reader.step().lower
        goes = action == 'goto'
        target = reader.name('a label').text if goes else self._function_name(reader)
        return Trap('', number, condition, action, target, first.position)

    def _function_name(self, reader: Reader) -> str:
        name = reader.name('the name of a function')
        if name.lower not in self._functions:
            raise SyntaxProblem(name.position, f'there is no function {name.text}', 'unknown')
        if reader.takes('('):
            reader.need(')')
            self._mark('`Trap 1, a Call f()`', name.position)
        return name.text

    # Terminal and network

    def _port(self, reader: Reader) -> Expression | None:
        """Parse `#n` and its comma. Return None if the next token is not #."""
        if not reader.takes('#'):
            return None
        port = reader.expression()
        if not reader.at_end():
            reader.need(',')
        return port

    def read_print(self, reader: Reader, first: Token) -> Print:
        port = self._port(reader)
        items: list[Expression] = []
        line = True
        while not reader.at_end():
            items.append(reader.expression())
            line = not reader.takes(',')
            if line:
                break
        return Print(port, tuple(items), line, first.position)

    def read_input(self, reader: Reader, first: Token) -> Input:
        port = self._port(reader)
        targets: list[Target] = [reader.target()]
        while reader.takes(','):
            targets.append(reader.target())
        return Input(port, False, tuple(targets), first.position)

    def read_line_input(self, reader: Reader, first: Token) -> Input:
        reader.need('input')
        port = self._port(reader)
        return Input(port, True, (reader.target(),), first.position)

    def read_transfer(self, reader: Reader, first: Token) -> Transfer:
        """Parse `Read`, `ReadBin`, `Write` or `WriteBin`.

        The arguments are #n, and a variable or an array[, count].
        """
        reader.need('#')
        port = reader.expression()
        reader.need(',')
        value = reader.argument()
        count = reader.expression() if reader.takes(',') else None
        return Transfer(first.text, port, value, count, first.position)

    def read_set_net(self, reader: Reader, first: Token) -> Command:
        """Parse `SetNet #n, host[, port[, terminator[, flow[, timeout[, protocol[, …]]]]]`."""
        reader.need('#')
        port = reader.expression()
        reader.need(',')
        host = reader.expression()
        number = reader.expression() if reader.takes(',') else None
        words = ['crlf', 'tcp']
        timeout: Expression | None = None
        if reader.takes(','):
            if not reader.sees(*_TERMINATORS):
                raise reader.wrong('CR, LF or CRLF')
            words[0] = reader.step().lower
        if reader.takes(','):
            reader.need('none')
        if reader.takes(','):
            timeout = reader.expression()
        if reader.takes(','):
            if not reader.sees(*_PROTOCOLS):
                raise reader.wrong('TCP')
            if not reader.takes('tcp'):
                text = f'not simulated: {first.text} with {reader.here.text}'
                raise SyntaxProblem(reader.here.position, text, 'not-simulated')
        if reader.takes(','):
            reader.expression()  # of UDP
        arguments = (port, host, number, timeout)
        return Command(first.text, arguments, first.position, tuple(words))

    def read_open_net(self, reader: Reader, first: Token) -> Command:
        reader.need('#')
        port = reader.expression()
        reader.need('as')
        if not reader.sees('server', 'client'):
            raise reader.wrong('Server or Client')
        return Command(first.text, (port,), first.position, (reader.step().lower,))

    def read_close_net(self, reader: Reader, first: Token) -> Command:
        if reader.takes('all'):
            return Command(first.text, (None,), first.position)
        reader.need('#')
        return Command(first.text, (reader.expression(),), first.position)

    # The robot

    def read_store(self, reader: Reader, first: Token) -> Store:
        return Store(first.text, reader.expression(), first.position)

    def read_here(self, reader: Reader, first: Token) -> Assign:
        return Assign(reader.target(), Name(first.text, first.position), first.position)

    def read_local(self, reader: Reader, first: Token) -> Command:
        """Parse `Local n` with one point, three points[, X|Y], or `(P1:P11), (P2:P12)`[, L|R]."""
        given = [reader.expression()]
        words: list[str] = []
        while reader.takes(','):
            if reader.sees('x', 'y', 'l', 'r', 'baseu'):
                words.append(reader.step().lower)
            elif _is_pair(reader):
                reader.need('(')
                given.append(reader.expression())
                reader.need(':')
                given.append(reader.expression())
                reader.need(')')
                words.append('pair')
            else:
                given.append(reader.expression())
        if len(given) > 4 and not words:  # the place as numbers
            values = tuple(Argument(item) for item in given[1:])
            given[1:] = [Apply('XY', values, first.position)]
        return Command(first.text, tuple(given), first.position, tuple(words))

    def read_open(self, reader: Reader, first: Token) -> Command:
        name = reader.expression()
        reader.need('as')
        if not reader.takes('#'):
            self._mark('`WOpen "a" As 30`', reader.here.position)
        return Command(first.text, (name, reader.expression()), first.position)

    def read_plist(self, reader: Reader, first: Token) -> Command:
        """Parse `PList [first[, [last]]]`. With a comma and no `last`, the last point is 999."""
        given = [] if reader.at_end() else [reader.expression()]
        if reader.takes(','):
            last = Number(LAST_POINT, first.position) if reader.at_end() else reader.expression()
            given.append(last)
        return Command(first.text, tuple(given), first.position)

    def read_pallet(self, reader: Reader, first: Token) -> Command:
        """Parse `Pallet [Outside,] n, P1, P2, P3[, P4], columns, rows`."""
        words = ('outside',) if reader.takes('outside') else ()
        if words:
            reader.takes(',')
        given = reader.expressions()
        if len(given) not in (6, 7):
            text = f'{first.text} takes a number, three or four points, columns and rows'
            raise SyntaxProblem(first.position, text, 'arguments')
        return Command(first.text, given, first.position, words)

    def read_abort_motion(self, reader: Reader, first: Token) -> Command:
        if reader.takes('all'):
            return Command(first.text, (None,), first.position, ('all',))
        return Command(first.text, (reader.expression(),), first.position)

    def read_motion(self, reader: Reader, first: Token) -> Motion:
        points: list[Expression] = []
        while not points or (reader.sees(',') and not self._is_modifier(reader.look(1))):
            reader.takes(',')
            points.append(reader.expression())
        return self._modified(reader, first, points)

    def read_pass(self, reader: Reader, first: Token) -> list[Statement]:
        """Parse `Pass P1, On 2, P(3:6)`.

        Statements such as `On` between the points divide it into several motions (SPEL+ manual
        p604).
        """
        points: list[Expression] = []
        read: list[Statement] = []
        while not (points or read) or reader.takes(','):
            if reader.sees(*_SWITCHES):
                read.append(Motion(first.text, tuple(points), first.position))
                read.append(self.read_form(reader, reader.step(), 'n'))
                points = []
            elif reader.sees('p') and reader.look(3).text == ':':
                points += _point_range(reader)
            else:
                points.append(reader.expression())
        last = self._modified(reader, first, points)
        read.append(last)
        result = (
            replace(item, numbers=last.numbers) if isinstance(item, Motion) else item
            for item in read
        )
        return [item for item in result if not isinstance(item, Motion) or item.points]

    def _modified(self, reader: Reader, first: Token, points: list[Expression]) -> Motion:
        cp = False
        conditions: dict[str, Expression | bool] = dict.fromkeys(_CONDITIONS, False)
        words: list[str] = []
        numbers: list[tuple[str, Expression]] = []
        parallel: tuple[Statement, ...] = ()
        used = set()
        while not reader.at_end():
            token = reader.step()
            word = token.lower
            used.add('c0' if self._is_arch(token) else word)
            if word == 'cp':
                cp = True
            elif word in _CONDITIONS:
                conditions[word] = reader.optional(*_MODIFIERS) or True
            elif word in _NUMBERED:
                if reader.sees(',') and not self._is_modifier(reader.look(1)):
                    self._mark_comma(first, reader.step())
                bare = reader.at_end() or reader.sees(',') or self._is_modifier(reader.here)
                value = Number(1, token.position) if bare else reader.expression()
                numbers.append((word, value))
            elif self._is_arch(token):
                numbers.append(('c', Number(int(word[1]), token.position)))
            elif word in _PLAIN:
                words.append(word)
            elif word == '!':
                parallel = self.parallel(reader, points)
            elif word == ',' and not reader.at_end():
                self._mark_comma(first, token)
            else:
                text = f'{first.text} does not take {token.text[:40]}'
                raise SyntaxProblem(token.position, text)
        known = re.findall(r'\w+|!', SYNTAX[first.lower].lower())
        if not used <= {*known, ','} or len(used & {*_CONDITIONS}) > 1:
            self._mark('a parameter of another motion (`Go P1 ROT`)', first.position)
        return Motion(
            first.text,
            tuple(points),
            first.position,
            cp,
            **conditions,
            words=tuple(words),
            numbers=tuple(numbers),
            parallel=parallel,
        )

    def _is_arch(self, token: Token) -> bool:
        word = token.lower
        return len(word) == 2 and word[0] == 'c' and word[1].isdigit() and word not in self._points

    def _is_modifier(self, token: Token) -> bool:
        return token.lower in _MODIFIERS or self._is_arch(token)

    def _mark_comma(self, motion: Token, comma: Token) -> None:
        if motion.lower not in ('jump3', 'jump3cp', 'jumptlz'):  # p476, p481
            self._mark('`Go P1, CP`', comma.position)

    def parallel(self, reader: Reader, points: list[Expression]) -> tuple[Statement, ...]:
        """Parse the statements between `!` and `!` after the points of a motion."""
        here = any(getattr(item, 'name', '').lower() == 'here' for item in walk(points))
        read: list[Statement] = []
        part: list[Token] = []
        while True:
            token = reader.step()
            if token.text in (';', '!') or token.kind == END:
                if part:
                    read += self._beside(part)
                part = []
                if token.text != ';':
                    break
            else:
                part.append(token)
        for item in read:
            known = isinstance(item, Share | Wait | Print | Call)
            if here or not (known or getattr(item, 'name', '').lower() in _PARALLEL):
                self._mark('`Go P1 !Speed 5!`, `Go Here !On 1!`', item.at)
        return tuple(read)

    def _beside(self, part: list[Token]) -> list[Statement]:
        """Parse a parallel statement.

        Allowed are `D50` and statements that do not move the arm.
        """
        first = part[0]
        digits = first.lower[1:]
        if first.lower[:1] == 'd' and (not digits or digits.isdigit()):
            rest = Reader(part[1:], first.position)
            fraction = Number(int(digits), first.position) if digits else rest.expression()
            rest.end()
            return [Share(fraction, first.position)]
        read = self._statement(part)
        for item in read:
            if isinstance(item, Motion | Label | If | Do | For | Select):
                text = f'{first.text} is not allowed in !…!'
                raise SyntaxProblem(first.position, text)
        return read

    def _statement(self, found: list[Token]) -> list[Statement]:
        raise NotImplementedError

    def read_stub(self, reader: Reader, first: Token) -> Stub:
        arguments: list[Argument] = []
        indices: list[Argument] = []
        while not reader.at_end():
            if reader.takes(',', 'as', '#', 'to', '!', ';'):
                continue
            if reader.sees('p') and reader.look(3).text == ':':
                arguments += map(Argument, _point_range(reader))
                continue
            dotted = [reader.here]
            while dotted[0].kind == NAME and reader.look(2 * len(dotted) - 1).text == '.':
                dotted.append(reader.look(2 * len(dotted)))
            if len(dotted) > 1:
                for _ in range(2 * len(dotted) - 1):
                    reader.step()
                text = '.'.join(token.text for token in dotted)
                arguments.append(Argument(Text(text, dotted[0].position)))
                if reader.sees('('):
                    indices += reader.arguments()
            else:
                arguments.append(_without_local(reader.argument()))
        return Stub(first.text, tuple(arguments), tuple(indices), first.position)


def coordinates(first: Expression, reader: Reader) -> Expression:
    """Parse the rest of `P1 = 300, 200, -50 /L`, an old form of `XY( )` (SPEL+ manual p590)."""
    values = [first]
    while reader.takes(','):
        values.append(reader.expression())
    flags: list[PointFlag] = []
    while isinstance(last := values[-1], Binary) and last.operator == '/':
        word = getattr(last.right, 'name', getattr(last.right, 'text', ''))
        if word.lower() not in POINT_FLAGS and not word.isdigit():
            raise SyntaxProblem(last.at, 'expected a posture or a local of the point')
        flags.insert(0, PointFlag(last.left, word.lower(), last.at))
        values[-1] = last.left
    point: Expression = Apply('XY', tuple(Argument(value) for value in values), first.at)
    for flag in flags:
        point = replace(flag, point=point)
    return point


def _without_local(argument: Argument) -> Argument:
    """Return the last limit of `Box` without a local after it, as in `50 /LOCAL1`."""
    value = argument.value
    local = isinstance(value, Binary) and getattr(value.right, 'name', '').lower()[:5] == 'local'
    return Argument(value.left) if isinstance(value, Binary) and local else argument


def _is_pair(reader: Reader) -> bool:
    if not reader.sees('('):
        return False
    depth, ahead = 1, 1
    while depth and (token := reader.look(ahead)).kind != END:
        depth += (token.text == '(') - (token.text == ')')
        if depth == 1 and token.text == ':' and reader.look(ahead + 1).lower not in AXES:
            return True
        ahead += 1
    return False


def _point_range(reader: Reader) -> Iterator[Expression]:
    """Parse `P(1:5)` or `P(5:1)` as a list of points."""
    at = reader.step().position
    reader.need('(')
    first = reader.expression()
    reader.need(':')
    last = reader.expression()
    reader.need(')')
    ends = [item.value if isinstance(item, Number) else -1 for item in (first, last)]
    if not all(end in range(LAST_POINT + 1) for end in ends):
        raise SyntaxProblem(at, f'P( : ) takes the numbers of two points, 0 to {LAST_POINT}')
    low, high = map(int, ends)
    step = 1 if low <= high else -1
    return (Name(f'P{item}', at) for item in range(low, high + step, step))
