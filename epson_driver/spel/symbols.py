# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Index of the names of a project for editors: declarations, scopes and uses.

The index is made from tokens. It is therefore complete even if a program has errors, and it
includes branches that an #ifdef switches off. It also includes the labels in .pts files,
IOLabels.dat and UserErrors.dat. The result for each line is cached by the text of the line, so
each keystroke only requires the scan of one line. Lines and columns count from 0.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

from epson_driver.inputs.rc_files import Block, RcFileError, parsed
from epson_driver.spel.commands import TYPES
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.functions import AXES, FUNCTIONS, POINT_FLAGS, TURNS
from epson_driver.spel.lexer import NAME, statements_in
from epson_driver.spel.project_data import ERRORS, INCLUDE, IO_BLOCKS, IO_LABELS, POINTS
from epson_driver.spel.values import POINT
from epson_driver.spel.words import reserved

_JUMPS = frozenset({'goto', 'gosub', 'eresume'})
_DECLARING = frozenset({*TYPES, 'global', 'static', 'preserve'})
_POINTS = frozenset(name for name, rule in FUNCTIONS.items() if rule.result == POINT)
_EVERYWHERE = {'function': 'function', 'global': 'variable'}
"""Kind in `_facts` → kind of symbol, for names that are visible in the whole project."""

_IO_KINDS = ('input', 'output', 'memory')
_IO_WIDTHS = {1: 'bit', 8: 'byte', 16: 'word'}


class Place(NamedTuple):
    file: str
    line: int
    start: int
    end: int


@dataclass(slots=True)
class Symbol:
    """A declared name.

    * kind: function, variable, parameter, label, define, point, io or error.
    * scope: the file and the function where the name is visible, in lower case. '' stands for all
      files or all functions.
    * detail: its declaration, coordinates, bit or message.
    * last: the last line of a function.
    """

    kind: str
    name: str
    scope: tuple[str, str]
    place: Place
    detail: str
    last: int

    @property
    def key(self) -> tuple[bool, tuple[str, str], str]:
        """Key that distinguishes this symbol from others, including those with the same name.

        For example, a label and a variable can have the same name.
        """
        return self.kind == 'label', self.scope, self.name.lower()


class Use(NamedTuple):
    """A name in a program, in lower case, and the function around it.

    * label: whether the name is in a GoTo or has the form `name:`.
    * called: whether a bracket follows.
    * divides: the left operand of the / or sign before a name that may be a flag (`P1 /R`) or an
      axis (`P1 +X(5)`), else ''.
    """

    name: str
    function: str
    line: int
    start: int
    label: bool
    called: bool
    divides: str


@dataclass
class FileSymbols:
    symbols: list[Symbol] = field(default_factory=list)
    uses: dict[str, list[Use]] = field(default_factory=lambda: defaultdict(list))
    lines: list[str] = field(default_factory=list)


_Token = tuple[str, str, int]
"""Kind, text in lower case, and column."""


@lru_cache(maxsize=200_000)
def _facts(line: str) -> tuple[tuple[str, str, int, str, bool], ...]:
    """Return the names in a line.

    Each entry contains a kind, the name in lower case, column, detail, and whether a bracket
    follows. The kind is a kind of `Symbol`, 'use', 'jump' (to a label), 'global', or 'fend'.
    """
    code = line.lstrip(' \t\ufeff')
    facts: list[tuple[str, str, int, str, bool]] = []
    if code.startswith('#'):
        tokens = [token for statement in statements_in(line) for token in statement]
        if [token[1] for token in tokens[1:2]] == ['define'] and len(tokens) > 2:
            facts.append(('define', *tokens[2][1:], code.rstrip(), False))
        return (*facts, *_uses(tokens[2:]))
    for statement in statements_in(line):
        words = [token[1] for token in statement[:2]]
        if words == ['fend']:
            facts.append(('fend', '', 0, '', False))
        elif words[0] in ('function', 'declare') and len(words) > 1:
            facts += _function(statement, code.split("'")[0].rstrip())
            continue
        elif words[0] in _DECLARING:
            facts += _declared(statement, line)
        elif words[1:] == [':'] and not is_point_literal(words[0]) and not reserved(words[0]):
            facts.append(('label', *statement[0][1:], f'{words[0]}:', False))
            statement = statement[2:]
        facts += _uses(statement)
    return tuple(facts)


def _function(tokens: list[_Token], detail: str) -> Iterator[tuple[str, str, int, str, bool]]:
    yield 'function', *tokens[1][1:], detail, False
    if tokens[0][1] == 'function':
        for token, after in zip(tokens[2:], [*tokens[3:], ('', '', 0)], strict=False):
            joined = after[1][:2] == 'as' and after[1][2:] in TYPES  # AsInteger
            if token[0] == NAME and (after[1] in ('as', '(') or joined):
                yield 'parameter', *token[1:], detail, after[1] == '('
    yield from _uses(tokens[1:])


def _declared(tokens: list[_Token], line: str) -> Iterator[tuple[str, str, int, str, bool]]:
    words = {token[1] for token in tokens[:3]}
    kind = 'global' if 'global' in words else 'variable'
    first = next((place for place, token in enumerate(tokens) if token[1] in TYPES), len(tokens))
    head = (
        line[tokens[0][2] : tokens[first][2] + len(tokens[first][1])]
        if first < len(tokens)
        else ''
    )
    depth, ahead = 0, True
    for place, (token, name, column) in enumerate(tokens[first + 1 :], first + 1):
        depth += (name == '(') - (name == ')')
        if ahead and token == NAME:
            after = tokens[place + 1][1] if place + 1 < len(tokens) else ''
            close = line.find(')', column) + 1 if after == '(' else column + len(name)
            yield kind, name, column, f'{head} {line[column:close]}', after == '('
        ahead = name == ',' and depth == 0


def _uses(tokens: list[_Token]) -> Iterator[tuple[str, str, int, str, bool]]:
    signs = [token[1] for token in tokens]
    for place, (kind, name, column) in enumerate(tokens):
        before = signs[place - 1] if place else ''
        after = signs[place + 1] if place + 1 < len(signs) else ''
        if kind != NAME or '.' in (before, after):
            continue
        if before == ':' and name in AXES and after == '(':
            continue
        divides = ''
        axis = name in (*AXES, *TURNS) and before in ('+', '-') and after == '('
        if place > 1 and (axis or (before in '/@' and name in POINT_FLAGS)):
            divides = _left(signs, place - 2)
        yield 'jump' if before in _JUMPS else 'use', name, column, divides, after == '('


def _left(signs: list[str], place: int) -> str:
    """Return the name in the operand that ends at the token with the index `place`.

    Brackets, axes and flags after the name are skipped.
    """
    depth = 0
    while place > 0:
        depth += (signs[place] == ')') - (signs[place] == '(')
        if depth == 0 and signs[place] != '(':
            break
        place -= 1
    before = signs[place - 1] if place > 1 else ''
    changed = signs[place] in (*AXES, *TURNS) and before in (':', '+', '-')
    changed = changed or (signs[place] in POINT_FLAGS and before == '/')
    return _left(signs, place - 2) if changed else signs[place]


def symbols_of(name: str, text: str) -> FileSymbols:
    lower = name.lower()
    if lower.endswith(POINTS) or lower in (IO_LABELS, ERRORS):
        return _labels(name, text)
    file = '' if lower.endswith(INCLUDE) else lower
    result = FileSymbols(lines=text.split('\n'))
    function = ''
    opened: Symbol | None = None
    for number, line in enumerate(result.lines):
        if opened is not None:
            opened.last = number
        for kind, word, start, detail, called in _facts(line):
            if kind == 'fend':
                function, opened = '', None
            elif kind in ('use', 'jump'):
                use = Use(word, function, number, start, kind == 'jump', called, detail)
                result.uses[word].append(use)
            else:
                inner = function if kind in ('variable', 'parameter', 'label') else ''
                scope = ('', '') if kind in _EVERYWHERE else (lower if inner else file, inner)
                place = Place(name, number, start, start + len(word))
                spelled = line[start : start + len(word)]
                kind = _EVERYWHERE.get(kind, kind)
                symbol = Symbol(kind, spelled, scope, place, detail, number)
                result.symbols.append(symbol)
                if kind == 'label':
                    result.uses[word].append(Use(word, function, number, start, True, False, ''))
                elif kind == 'function' and not detail.lower().startswith('declare'):
                    function, opened = word, symbol
    return result


def _labels(name: str, text: str) -> FileSymbols:
    """Return the labels of a point file, IOLabels.dat or UserErrors.dat."""
    result = FileSymbols(lines=text.split('\n'))
    try:
        top = parsed(name, text)
        for kind, block, detail in _blocks(name.lower(), top):
            label = block.text('sLabel')
            if kind == 'point':
                line = block.lines.get('nNumber', block.lines['']) - 1
                number = f'P{block.number("nNumber"):g}'
                place = Place(name, line, 0, len(result.lines[line]))
                result.symbols.append(Symbol(kind, number, ('', ''), place, detail, line))
            if not label:
                continue
            line = block.lines['sLabel'] - 1
            start = result.lines[line].index('"') + 1
            place = Place(name, line, start, start + len(label))
            result.symbols.append(Symbol(kind, label, ('', ''), place, detail, line))
            use = Use(label.lower(), '', line, start, False, False, '')
            result.uses[use.name].append(use)
    except RcFileError:
        return result  # `check` reports it
    return result


def _blocks(name: str, top: Block) -> Iterator[tuple[str, Block, str]]:
    if name.endswith(POINTS):
        for block in top.blocks('Point'):
            axes = ', '.join(f'{block.number(f"r{axis}"):.3f}' for axis in 'XYZUVW')
            local = int(block.number('nLocal'))
            yield 'point', block, f'P{block.number("nNumber"):g} = XY({axes}) /{local}'
    elif name == IO_LABELS:
        for part in top.items:
            if isinstance(part, Block) and part.name in IO_BLOCKS:
                kind, width, key = IO_BLOCKS[part.name]
                for block in part.blocks('Label'):
                    number = block.number(key, block.number('nBit'))
                    detail = f'{_IO_KINDS[kind]} {_IO_WIDTHS[width]} {number:g}'
                    about = block.text('sDescription')
                    yield 'io', block, f'{detail}: {about}' if about else detail
    else:
        for block in top.blocks('Label'):
            yield 'error', block, f'error {block.number("nError"):g}: {block.text("sMessage")}'


class ProjectSymbols:
    def __init__(self) -> None:
        self.files: dict[str, FileSymbols] = {}
        self._names: dict[str, list[Symbol]] | None = None

    def update(self, name: str, text: str | None) -> None:
        """Set the text of a file. None removes the file."""
        if text is None:
            self.files.pop(name, None)
        else:
            self.files[name] = symbols_of(name, text)
        self._names = None

    @property
    def names(self) -> dict[str, list[Symbol]]:
        if self._names is None:
            self._names = defaultdict(list)
            for file in self.files.values():
                for symbol in file.symbols:
                    self._names[symbol.name.lower()].append(symbol)
        return self._names

    def function_at(self, file: str, line: int) -> str:
        """Return the function that contains a line, in lower case, or ''."""
        result = ''
        for symbol in self.files[file].symbols:
            if symbol.kind == 'function' and symbol.place.line <= line <= symbol.last:
                result = symbol.name.lower()
        return result

    def visible(self, file: str, function: str) -> Iterator[Symbol]:
        scopes = self._scopes(file, function)
        for symbols in self.names.values():
            yield from (symbol for symbol in symbols if symbol.scope in scopes)

    def _scopes(self, file: str, function: str) -> tuple[tuple[str, str], ...]:
        return (file.lower(), function), (file.lower(), ''), ('', '')

    def declarations(self, file: str, function: str, name: str, label: bool) -> list[Symbol]:
        known = self.names.get(name.lower(), ())
        for scope in self._scopes(file, function)[: 1 if label else 3]:
            if match := [
                item for item in known if item.scope == scope and (item.kind == 'label') is label
            ]:
                return match
        return []

    def _meant(self, file: str, use: Use) -> tuple[list[Symbol], int]:
        """Return the symbols that a used name may denote, and the offset of their name in it.

        The offset is 1 for `Pctr`, which is short for `P(ctr)`.
        """
        found = self.declarations(file, use.function, use.name, use.label)
        shift = 0
        if not found and use.name[:1] == 'p' and not reserved(use.name):
            variables = self.declarations(file, use.function, use.name[1:], False)
            found = [item for item in variables if item.kind in ('variable', 'parameter')]
            shift = 1
        if use.divides and found:
            left = self.declarations(file, use.function, use.divides, False)
            point = (
                is_point_literal(use.divides)
                or use.divides in _POINTS
                or any(item.kind == 'point' for item in left)
            )
            if point or (use.called and '(' not in found[0].detail):
                return [], 0
        return found, shift

    def at(self, file: str, line: int, column: int) -> tuple[list[Symbol], Place] | None:
        for name, uses in self.files[file].uses.items():
            for use in uses:
                if use.line == line and use.start <= column <= use.start + len(name):
                    found, shift = self._meant(file, use)
                    if found:
                        place = Place(file, line, use.start + shift, use.start + len(name))
                        return found, place
        return None

    def references(self, symbol: Symbol) -> list[Place]:
        name = symbol.name.lower()
        places = {}
        for file, content in self.files.items():
            for use in (*content.uses.get(name, ()), *content.uses.get(f'p{name}', ())):
                found, shift = self._meant(file, use)
                if any(item.key == symbol.key for item in found):
                    end = use.start + len(use.name)
                    places[Place(file, use.line, use.start + shift, end)] = use.function
        return sorted(places)
