# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Compiles functions to flat lists of instructions, so GoTo and EResume can jump anywhere.

An instruction is a Python function. Its argument, the list `v`, contains the task, the parameters,
the function's value, and the local variables. The instruction returns the number of the next
instruction, or WAITING after a call, a wait or an end. In this case the task decides when to
resume, at the following instruction.
"""

import re
from functools import singledispatchmethod

from epson_driver.spel import syntax
from epson_driver.spel.code import WAITING, FunctionCode, Variable
from epson_driver.spel.commands import COMMANDS, TASK_TYPE_WORDS, CommandRule
from epson_driver.spel.conditions import condition, is_condition
from epson_driver.spel.errors import Position, Problem, SyntaxProblem
from epson_driver.spel.expression_code import COMPARE, Expressions, check_depth
from epson_driver.spel.scope import Scope
from epson_driver.spel.values import INT, NUMBERS, POINT, STRING, TYPES, Value

COORDINATES = frozenset({'cx', 'cy', 'cz', 'cu', 'cv', 'cw'})
MOTION_VALUES: dict[str, dict[str, tuple[str, ...]]] = {
    'arc': {
        'pp': (), 'ppn': ('path',), 'pn': ('angle',), 'pnnn': ('radius', 'path', 'direction'),
    },
    'arc3': {'pp': (), 'ppn': ('path',)},
    'jump3': {'ppp': ()},
    'jump3cp': {'ppp': ()},
    'jumptlz': {'pn': ('tlz',)},
}  # fmt: skip
"""Motion → possible argument lists, as points (p) and numbers (n) → names of the numbers. All
other motions take one point."""

_MARK = re.compile('\x01([0-9]+)\x01')
_WAITING = f'return {WAITING}'


class Compiler:
    def __init__(
        self,
        function: syntax.Function,
        scope: Scope,
        codes: dict[str, FunctionCode],
        problems: list[Problem],
        notes: list[Problem],
    ) -> None:
        self._function = function
        self._scope = scope
        self._codes = codes
        self._problems = problems
        self._code = codes[function.name.lower()]
        self._expressions = Expressions(scope, self._user_call)
        self._expressions.notes = notes
        self._at = function.at
        self._start = 0
        self._marks: list[int] = []
        self._jumps: dict[int, int] = {}
        self._labels: dict[str, tuple[int, Position]] = {}
        self._used_labels: list[tuple[str, Position]] = []
        self._leaves: list[tuple[str, int]] = []

    def compile(self) -> None:
        code, function = self._code, self._function
        try:
            for number, parameter in enumerate(function.parameters, 1):
                self._scope.add_local(
                    Variable(
                        parameter.name,
                        parameter.type,
                        'v',
                        number,
                        array=parameter.array,
                        by_reference=parameter.by_reference and not parameter.array,
                        at=parameter.at,
                    )
                )
            code.result_slot = len(function.parameters) + 1
            result = function.result or 'integer'
            code.blanks.append(TYPES[result].blank)
            if function.result or _gives_value(function):
                self._scope.add_local(
                    Variable(function.name, result, 'v', code.result_slot, at=function.at)
                )
        except SyntaxProblem as problem:
            self._problems.append(problem.problem)
        self._collect_labels(function.body)
        self._block(function.body)
        self._at = function.end
        self._begin()
        self._emit(f'v[0].leave()\n{_WAITING}')
        for name, at in self._used_labels:
            if name.lower() not in self._labels:
                text = f'unknown label {name} in function {function.name}'
                self._problems.append(Problem(at, 'label', text))
        code.source = [self._resolved(text) for text in code.source]
        code.following = [self._through(pc + 1) for pc in range(len(code.source))]
        code.passed_over = set(self._jumps)

    def _collect_labels(self, block: syntax.Block) -> None:
        for statement in block:
            if isinstance(statement, syntax.Label):
                key = statement.name.lower()
                if key in self._labels:
                    text = f'label {statement.name} occurs twice in the function'
                    self._problems.append(Problem(statement.at, 'label', text))
                self._labels[key] = (self._mark(), statement.at)
            for inner in syntax.inner_blocks(statement):
                self._collect_labels(inner)

    # Instructions

    def _mark(self) -> int:
        """Return a new mark, a placeholder for the target of a jump until the target is known."""
        self._marks.append(-1)
        return len(self._marks) - 1

    def _set(self, mark: int) -> None:
        self._marks[mark] = len(self._code.source)

    def _to(self, mark: int) -> str:
        return f'\x01{mark}\x01'

    def _resolved(self, text: str) -> str:
        return _MARK.sub(lambda found: str(self._through(self._marks[int(found[1])])), text)

    def _label(self, name: str, at: Position) -> str:
        self._used_labels.append((name, at))
        mark, _ = self._labels.get(name.lower(), (0, at))
        return self._to(mark) if self._labels else '0'

    def _begin(self) -> None:
        """Mark the next instruction as the start of a statement, at which EResume can continue."""
        self._start = len(self._code.source)

    def _emit(self, body: str) -> None:
        check_depth(body, self._at)
        code = self._code
        lines = '\n '.join(body.split('\n'))
        code.source.append(f'def o{code.index}_{len(code.source)}(v):\n {lines}\n')
        code.lines.append(self._at)
        code.starts.append(self._start)

    def _fall_through(self, body: str) -> None:
        self._marks.append(len(self._code.source) + 1)
        self._emit(f'{body}\nreturn {self._to(len(self._marks) - 1)}')

    def _suspend(self, body: str) -> None:
        """Add an instruction that returns WAITING, because the task decides when to continue."""
        self._emit(f'{body}\n{_WAITING}')

    def _jump(self, mark: int) -> None:
        self._emit(f'return {self._to(mark)}')

    def _leave_block(self, body: syntax.Block, end: int) -> None:
        """Add the jump from a branch to the end of its If or Select.

        No jump is added to a branch that already ends with one.
        """
        if body and isinstance(body[-1], syntax.Exit | syntax.Return | syntax.EResume):
            return
        self._begin()
        self._jumps[len(self._code.source)] = end
        self._jump(end)

    def _through(self, pc: int) -> int:
        """Return the final target of instruction `pc` if it is only a jump, else `pc`."""
        while pc in self._jumps:  # they all lead forward
            pc = self._marks[self._jumps[pc]]
        return pc

    def _branch(self, truth: str, yes: int, no: int) -> None:
        self._emit(f'return {self._to(yes)} if {truth} else {self._to(no)}')

    def _slot(self, blank: Value = 0) -> int:
        self._code.blanks.append(blank)
        return self._code.result_slot + len(self._code.blanks) - 1

    def _user_call(self, name: str, arguments: tuple[syntax.Argument, ...], at: Position) -> int:
        code = self._codes[name.lower()]
        passed = self._expressions.parameters(code.name, code.parameters, arguments, at)
        slot = self._slot()
        self._suspend(f'v[0].call(F[{code.index}], [{passed}], {slot})')
        return slot

    # Blocks and statements

    def _block(self, block: syntax.Block) -> None:
        for statement in block:
            self._at = statement.at
            self._begin()
            try:
                self._statement(statement)
            except SyntaxProblem as problem:
                self._problems.append(problem.problem)

    @singledispatchmethod
    def _statement(self, statement: syntax.Statement) -> None:
        raise NotImplementedError(type(statement).__name__)

    @_statement.register
    def _(self, statement: syntax.Declaration) -> None:
        for number, declared in enumerate(statement.variables):
            bounds = self._scope.bounds(statement, number)
            slot = self._slot(TYPES[statement.type].blank)
            variable = Variable(
                declared.name, statement.type, 'v', slot, bounds, bool(bounds), at=declared.at
            )
            self._scope.add_local(variable)
            if bounds:
                self._code.arrays.append(variable)

    @_statement.register
    def _(self, statement: syntax.Assign) -> None:
        target = statement.target
        expressions = self._expressions
        if self._scope.variable(target.name) is None:
            point = (
                expressions.point_number(target.name) if isinstance(target, syntax.Name) else None
            )
            if point is not None:
                number, kind = point, POINT
            elif isinstance(target, syntax.Apply) and target.name.lower() == 'p':
                number, kind = expressions.whole(target.arguments[0].value), POINT
            elif isinstance(target, syntax.Apply) and target.name.lower() == 'plocal':
                number = expressions.which_point(target.arguments[0].value)
                self._fall_through(
                    f's_plocal(v[0], {number}, {expressions.whole(statement.value)})'
                )
                return
            elif isinstance(target, syntax.Apply) and target.name.lower() in COORDINATES:
                number = expressions.which_point(target.arguments[0].value)
                value = expressions.number(statement.value).text
                axis = target.name[-1].lower()
                self._fall_through(f's_coordinate(v[0], {number}, {axis!r}, {value})')
                return
            else:
                kind = ''
            if kind == POINT:
                value = expressions.point(statement.value)
                self._fall_through(f'set_point(v[0], {number}, {value})')
                return
        place, type_name = expressions.place(target)
        self._fall_through(f'{place} = {expressions.as_type(statement.value, type_name)}')

    @_statement.register
    def _(self, statement: syntax.If) -> None:
        end = self._mark()
        for test, body in statement.branches:
            self._at = test.at
            self._begin()
            yes, no = self._mark(), self._mark()
            self._branch(self._expressions.truth(test), yes, no)
            self._set(yes)
            self._block(body)
            self._leave_block(body, end)
            self._set(no)
        self._block(statement.otherwise)
        self._set(end)

    @_statement.register
    def _(self, statement: syntax.Select) -> None:
        expressions = self._expressions
        subject = expressions.value(statement.subject)
        if subject.kind == POINT:
            raise SyntaxProblem(statement.at, 'Select does not take points', 'type')
        slot = self._slot()
        self._fall_through(f'v[{slot}] = {subject.text}')
        end = self._mark()
        for items, body in statement.cases:
            yes, no = self._mark(), self._mark()
            for item in items:
                self._at = item.value.at
                self._begin()
                value = expressions.value(item.value)
                if (value.kind in NUMBERS) != (subject.kind in NUMBERS):
                    raise SyntaxProblem(self._at, 'Case and Select have different types', 'type')
                if value.kind == STRING and item.operator not in ('=', '<>'):
                    text = 'strings can be compared by = and <> only'
                    raise SyntaxProblem(self._at, text, 'type')
                following = self._mark()
                test = f'v[{slot}] {COMPARE[item.operator]} {value.text}'
                self._branch(test, yes, following)
                self._set(following)
            self._jump(no)
            self._set(yes)
            self._block(body)
            self._leave_block(body, end)
            self._set(no)
        self._block(statement.default)
        self._set(end)

    @_statement.register
    def _(self, statement: syntax.Do) -> None:
        top, inside, end = self._mark(), self._mark(), self._mark()
        self._set(top)
        if statement.before is not None:
            truth = self._expressions.truth(statement.before.condition)
            yes, no = (end, inside) if statement.before.until else (inside, end)
            self._branch(truth, yes, no)
        self._set(inside)
        self._leaves.append(('do', end))
        self._block(statement.body)
        self._leaves.pop()
        self._at = statement.at
        self._begin()
        if statement.after is not None:
            self._at = statement.after.condition.at
            truth = self._expressions.truth(statement.after.condition)
            yes, no = (end, top) if statement.after.until else (top, end)
            self._branch(truth, yes, no)
        else:
            self._jump(top)
        self._set(end)

    @_statement.register
    def _(self, statement: syntax.For) -> None:
        expressions = self._expressions
        place, type_name = expressions.place(statement.variable)
        if TYPES[type_name].kind == STRING:
            raise SyntaxProblem(statement.at, 'For needs a variable that is a number', 'type')
        last, step = self._slot(), self._slot()
        first = expressions.as_type(statement.first, type_name)
        limit = expressions.number(statement.last).text
        by = expressions.number(statement.step).text if statement.step is not None else '1'
        self._fall_through(f'{place} = {first}\nv[{last}] = {limit}\nv[{step}] = {by}')
        top, inside, end = self._mark(), self._mark(), self._mark()
        self._set(top)
        self._begin()
        up = f'({place} <= v[{last}])'
        down = f'({place} >= v[{last}])'
        self._branch(f'({up} if v[{step}] >= 0 else {down})', inside, end)
        self._set(inside)
        self._leaves.append(('for', end))
        self._block(statement.body)
        self._leaves.pop()
        self._at = statement.at
        self._begin()
        name = expressions.temporary()
        self._emit(
            f'{name} = store({place} + v[{step}], {type_name!r})\n'
            f'{place} = {name}\nreturn {self._to(top)}'
        )
        self._set(end)

    @_statement.register
    def _(self, statement: syntax.Exit) -> None:
        if statement.what == 'function':
            self._suspend('v[0].leave()')
            return
        for what, end in reversed(self._leaves):
            if what == statement.what:
                self._jump(end)
                return
        word = statement.what.capitalize()
        raise SyntaxProblem(statement.at, f'Exit {word} outside a {word}')

    @_statement.register
    def _(self, statement: syntax.Label) -> None:
        self._set(self._labels[statement.name.lower()][0])

    @_statement.register
    def _(self, statement: syntax.Jump) -> None:
        target = self._label(statement.label, statement.at)
        if statement.kind == 'goto':
            self._emit(f'return {target}')
        else:
            self._emit(f'v[0].gosub({len(self._code.source) + 1})\nreturn {target}')

    @_statement.register
    def _(self, statement: syntax.Return) -> None:
        self._emit('return v[0].gosub_return()')

    @_statement.register
    def _(self, statement: syntax.OnErr) -> None:
        target = '-1'
        if statement.label is not None:
            target = self._label(statement.label, statement.at)
        self._fall_through(f'v[0].on_error({target})')

    @_statement.register
    def _(self, statement: syntax.EResume) -> None:
        if statement.kind == 'label':
            target = self._label(statement.label, statement.at)
            self._emit(f'v[0].resumed()\nreturn {target}')
        else:
            self._emit(f'return v[0].resume({statement.kind == "next"})')

    @_statement.register
    def _(self, statement: syntax.Call) -> None:
        key = statement.name.lower()
        if key in self._codes:
            self._user_call(statement.name, statement.arguments, statement.at)
            return
        if key in self._scope.libraries:
            call = syntax.Apply(statement.name, statement.arguments, statement.at)
            self._fall_through(self._expressions.value(call).text)
            return
        raise SyntaxProblem(statement.at, f'there is no function {statement.name}', 'unknown')

    @_statement.register
    def _(self, statement: syntax.Command) -> None:
        rule = COMMANDS[statement.name.lower()]
        count = len(statement.arguments)
        kinds = {
            '@set_net': 'isin',
            '@open': 'si',
            '@local': 'i' + 'p' * (count - 1),
            '@plist': 'q' * count,
            '@pallet': 'i' + 'p' * (count - 3) + 'ii',
        }.get(rule.form, '')
        codes = []
        for number, argument in enumerate(statement.arguments):
            kind = kinds[number] if kinds else _form_kind(rule.form, number)
            codes.append(
                'None' if argument is None else self._argument(rule, number, argument, kind)
            )
        values = ''.join(f'{code}, ' for code in codes)
        if rule.robot:
            self._suspend(f'v[0].command({rule.name.lower()!r}, ({values}), {statement.words!r})')
        else:
            words = f', words={statement.words!r}' if statement.words else ''
            self._suspend(f's_{rule.name.lower()}(v[0], {values.rstrip(", ")}{words})')

    def _argument(
        self, rule: CommandRule, place: int, argument: syntax.Expression, kind: str
    ) -> str:
        expressions = self._expressions
        if kind == 'v':
            return expressions.taker(argument)[0]
        code = expressions.argument(syntax.Argument(argument), kind).text
        return expressions.ranged(rule.name, rule.name.lower(), place, argument, code)

    @_statement.register
    def _(self, statement: syntax.Print) -> None:
        expressions = self._expressions
        items = []
        for item in statement.items:
            code = expressions.value(item)
            items.append(f'({code.text}, {code.kind!r}), ')
        port = 'None' if statement.port is None else expressions.whole(statement.port)
        self._suspend(f's_print(v[0], {port}, ({"".join(items)}), {statement.line})')

    @_statement.register
    def _(self, statement: syntax.Input) -> None:
        expressions = self._expressions
        targets = []
        for target in statement.targets:
            taker, type_name = expressions.taker(target)
            if statement.whole_line and TYPES[type_name].kind != STRING:
                raise SyntaxProblem(target.at, 'Line Input needs a string', 'type')
            targets.append(f'{taker}, ')
        port = 'None' if statement.port is None else expressions.whole(statement.port)
        self._suspend(f's_input(v[0], {port}, ({"".join(targets)}), {statement.whole_line})')

    @_statement.register
    def _(self, statement: syntax.Transfer) -> None:
        expressions = self._expressions
        name = statement.name.lower()
        value = statement.value.value
        port = expressions.whole(statement.port)
        count = 'None' if statement.count is None else expressions.whole(statement.count)
        variable = self._scope.variable(value.name) if isinstance(value, syntax.Name) else None
        if statement.value.whole_array or (variable is not None and variable.array):
            code, type_name = expressions.array(statement.value)
            if TYPES[type_name].kind != INT or not name.endswith('bin'):
                raise SyntaxProblem(
                    statement.at, f'{statement.name} cannot use this array', 'type'
                )
            if statement.count is None:
                raise SyntaxProblem(statement.at, 'an array needs its number of elements')
        elif name == 'write':
            code = expressions.string(value)
        elif name == 'writebin':
            code = expressions.whole(value)
        else:
            code, type_name = expressions.taker(value)
            kind = STRING if name == 'read' else INT
            if TYPES[type_name].kind != kind:
                what = 'a string' if name == 'read' else 'a whole number or an array of them'
                raise SyntaxProblem(value.at, f'{statement.name} needs {what}', 'type')
        self._suspend(f's_{name}(v[0], {port}, {code}, {count})')

    @_statement.register
    def _(self, statement: syntax.Xqt) -> None:
        code = self._codes.get(statement.function.lower())
        if code is None:
            text = f'there is no function {statement.function}'
            raise SyntaxProblem(statement.at, text, 'unknown')
        for argument in statement.arguments:
            if argument.by_reference and not argument.whole_array:
                text = 'Xqt passes values: no ByRef'
                raise SyntaxProblem(statement.at, text, 'type')
        expressions = self._expressions
        passed = expressions.parameters(
            code.name, code.parameters, statement.arguments, statement.at
        )
        number = '0' if statement.number is None else expressions.whole(statement.number)
        kind = int(TASK_TYPE_WORDS[statement.type])
        self._fall_through(f'v[0].xqt({number}, F[{code.index}], [{passed}], {kind})')

    @_statement.register
    def _(self, statement: syntax.TaskCommand) -> None:
        task = repr(statement.function.lower()) if statement.function else 'None'
        if statement.task is not None:
            expressions, name = self._expressions, statement.name
            code = expressions.whole(statement.task)
            task = expressions.ranged(name, name.lower(), 0, statement.task, code)
        self._suspend(f's_{statement.name.lower()}(v[0], {task})')

    @_statement.register
    def _(self, statement: syntax.Wait) -> None:
        expressions = self._expressions
        what = statement.condition
        if what is None or not is_condition(what, self._scope):
            if what is None or statement.time is not None:
                text = 'Wait needs a time, or a condition with a time'
                raise SyntaxProblem(statement.at, text, 'wait-condition')
            self._suspend(f's_wait(v[0], {self._time(what)})')
            return
        before, test = condition(what, expressions)
        time = 'None' if statement.time is None else self._time(statement.time)
        self._suspend(f'{before}s_waitcondition(v[0], lambda: {test}, {time})')

    def _time(self, time: syntax.Expression) -> str:
        expressions = self._expressions
        return expressions.ranged('Wait', 'wait', 0, time, expressions.number(time).text)

    @_statement.register
    def _(self, statement: syntax.Store) -> None:
        before, test = condition(statement.condition, self._expressions)
        self._fall_through(f'{before}s_store(v[0], {statement.name.lower()!r}, lambda: {test})')

    @_statement.register
    def _(self, statement: syntax.Trap) -> None:
        expressions = self._expressions
        number = 'None' if statement.number is None else expressions.whole(statement.number)
        before, test = '', 'None'
        if statement.condition is not None:
            before, test = condition(statement.condition, expressions)
            test = f'lambda: {test}'
        if statement.action == 'goto':
            target = self._label(statement.target, statement.at)
            self._fall_through(f"{before}s_trap(v[0], '', {number}, {test}, {target}, 'goto')")
            return
        code = self._codes.get(statement.target.lower())
        if statement.target and code is None:  # its Function line could not be read
            text = f'there is no function {statement.target}'
            raise SyntaxProblem(statement.at, text, 'unknown')
        if code is not None:
            maximum = 3 if statement.event == 'error' else 0
            whole = all(TYPES[parameter.type].kind == INT for parameter in code.parameters)
            if (
                len(code.parameters) > maximum
                or not whole
                or any(parameter.by_reference for parameter in code.parameters)
            ):
                text = f'{code.name}: a function of Trap takes no parameters, '
                text += 'a function of Trap Error up to three Integers'
                raise SyntaxProblem(statement.at, text, 'arguments')
        target = 'None' if code is None else f'F[{code.index}]'
        arguments = f'{statement.event!r}, {number}, {test}, {target}, {statement.action!r}'
        self._fall_through(f'{before}s_trap(v[0], {arguments})')

    @_statement.register
    def _(self, statement: syntax.Redim) -> None:
        expressions = self._expressions
        variable = self._scope.variable(statement.name)
        name = syntax.Name(statement.name, statement.at)
        code, _ = expressions.array(syntax.Argument(name, whole_array=True))
        assert variable is not None  # noqa: S101 - array() has refused that
        if not variable.bounds:
            text = f'{statement.name} is ByRef: Redim cannot change it'
            raise SyntaxProblem(statement.at, text, 'type')
        if len(variable.bounds) != len(statement.bounds):
            text = f'Redim cannot change the number of dimensions of {statement.name}'
            raise SyntaxProblem(statement.at, text, 'type')
        bounds = ''.join(f'{expressions.whole(bound)}, ' for bound in statement.bounds)
        shared = variable.place == 'g'
        self._fall_through(f's_redim(v[0], {code}, ({bounds}), {statement.preserve}, {shared})')

    @_statement.register
    def _(self, statement: syntax.Motion) -> None:
        expressions = self._expressions
        name = statement.name.lower()
        points, numbers = self._motion_values(statement)
        for word in {'ecp', 'sync'}.intersection(statement.words):
            expressions.note_stub(f'{statement.name} … {word.upper()}', statement.at)
        before, modifiers = '', f'cp={statement.cp}'
        for name_of in ('till', 'find', 'sense'):
            value = getattr(statement, name_of)
            if value is True:
                modifiers += f', {name_of}=v[0].stored({name_of!r})'
            elif value:
                more, test = condition(value, expressions)
                before += more
                modifiers += f', {name_of}=lambda: {test}'
        for kind, value in statement.numbers:
            code = expressions.ranged(kind.upper(), kind, 0, value, expressions.number(value).text)
            numbers += f'{kind!r}: {code}, '
        beside = self._beside(statement) if statement.parallel else 'None'
        self._suspend(
            f'{before}v[0].move({name!r}, ({points}), {statement.words!r}, {{{numbers}}}, '
            f'{beside}, {modifiers})'
        )

    def _motion_values(self, motion: syntax.Motion) -> tuple[str, str]:
        """Return the Python text of a motion's points, target last, and of its numbers."""
        expressions, name = self._expressions, motion.name.lower()
        if name == 'pulse':
            values = ''.join(f'{expressions.number(item).text}, ' for item in motion.points)
            return f'f_pulse({values}), ', ''
        forms = MOTION_VALUES.get(name, {'p': ()})
        if name == 'pass':
            forms = {'p' * len(motion.points): ()}
        if len(motion.points) == 1 and 'p' in forms:
            return f'{expressions.point(motion.points[0])}, ', ''
        codes = [expressions.point_or_number(item) for item in motion.points]
        shape = ''.join('p' if code.kind == POINT else 'n' for code in codes)
        if shape not in forms:
            text = f'{motion.name} takes {" or ".join(_spelled(form) for form in forms)}'
            raise SyntaxProblem(motion.at, text, 'arguments')
        points = [code.text for code in codes if code.kind == POINT]
        if shape == 'ppn':  # the end, the centre
            points.reverse()
        named = zip(forms[shape], codes[len(points) :], strict=True)
        numbers = ''.join(f'{kind!r}: {code.text}, ' for kind, code in named)
        return ''.join(f'{point}, ' for point in points), numbers

    def _beside(self, motion: syntax.Motion) -> str:
        """Compile the parallel statements (`!…!`) of a motion.

        Adds a jump over the parallel statements, and their instructions. Returns the number of the
        first of these instructions as Python text.
        """
        start, at = self._start, self._at
        inside, behind = self._mark(), self._mark()
        self._jump(behind)
        self._set(inside)
        if motion.name.lower().startswith('jump'):  # after the rise (p57)
            self._suspend('v[0].wait_fraction(0)')
        self._block(motion.parallel)
        self._suspend('v[0].leave()')
        self._set(behind)
        self._start, self._at = start, at
        return self._to(inside)

    @_statement.register
    def _(self, statement: syntax.Share) -> None:
        expressions, percent = self._expressions, statement.percent
        code = expressions.ranged('D', 'd', 0, percent, expressions.number(percent).text)
        self._suspend(f'v[0].wait_fraction({code})')

    @_statement.register
    def _(self, statement: syntax.Stub) -> None:
        expressions = self._expressions
        codes = [self._stub_argument(argument) for argument in statement.arguments]
        codes += [expressions.stub_argument(argument) for argument in statement.indices]
        expressions.note_stub(statement.name, statement.at)
        self._suspend(f'v[0].stub({statement.name!r}, ({"".join(f"{item}, " for item in codes)}))')

    def _stub_argument(self, argument: syntax.Argument) -> str:
        """Compile an argument of a statement that is not simulated.

        A variable is passed by reference.
        """
        expressions, value = self._expressions, argument.value
        variable = (
            self._scope.variable(value.name)
            if isinstance(value, syntax.Name | syntax.Apply)
            else None
        )
        if variable is None:
            return expressions.stub_argument(argument)
        if variable.array and isinstance(value, syntax.Name):
            return expressions.array(argument)[0]
        return expressions.taker(value)[0]


def _spelled(shape: str) -> str:
    return f'({", ".join("point" if item == "p" else "number" for item in shape)})'


def _gives_value(function: syntax.Function) -> bool:
    return any(
        isinstance(node, syntax.Assign) and node.target.name.lower() == function.name.lower()
        for node in function.nodes
    )


def _form_kind(form: str, number: int) -> str:
    if form.startswith('@'):
        return 'n'
    kinds = [kind for kind in form.split(',') if not kind.startswith('w(')] or ['n']
    return kinds[min(number, len(kinds) - 1)][0]
