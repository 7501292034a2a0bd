# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The projects below the workspace folders: their texts, problems and names, and renaming."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from epson_driver.inputs import InputError
from epson_driver.spel import Position, Problem, Settings, read_project
from epson_driver.spel.commands import CONTROLLERS, VERSIONS
from epson_driver.spel.errors import SETTINGS_FILE
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.lint import LONGEST_FUNCTION_NAME, LONGEST_NAME, check
from epson_driver.spel.project import Parsed
from epson_driver.spel.project_data import resealed
from epson_driver.spel.settings import read_settings
from epson_driver.spel.symbols import Place, ProjectSymbols, Symbol
from epson_driver.spel.words import reserved

LONGEST_POINT_LABEL = 16
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*\$?')
_JUMP = re.compile(r"[^'\"]*\b(goto|gosub|eresume)\s+\w*$", re.IGNORECASE)
_BIT = re.compile(r'\b(on|off|oport|sw|memon|memoff|memsw)\b[ (]*(\d+)\b', re.IGNORECASE)
_START = re.compile(r'main\d*|bgmain', re.IGNORECASE)
_LIMITS = {'function': LONGEST_FUNCTION_NAME, 'point': LONGEST_POINT_LABEL}


class RenameError(Exception):
    """A new name is invalid. The text is the reason."""


class Project:
    """The files of one project.

    `opened`: the texts of the files that are open in an editor.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder = path if path.is_dir() else path.parent
        self.symbols = ProjectSymbols()
        self.texts: dict[str, str] = {}
        self.opened: dict[str, str] = {}
        self._parsed: Parsed = {}
        self.revision = 0
        """Number of changes. It reveals whether the results of a check are outdated."""
        self.read()

    def read(self) -> None:
        """Read all files that are not open in an editor. Symbolic links are skipped.

        A folder that is unreadable or has no .prg file counts as empty.
        """
        try:
            texts = read_project(self.path)
        except (InputError, OSError):
            texts = {}
        texts = {
            name: text for name, text in texts.items() if not (self.folder / name).is_symlink()
        }
        texts |= self.opened
        for name in {*self.texts, *texts}:
            if self.texts.get(name) != texts.get(name):
                self.symbols.update(name, texts.get(name))
        self.texts = texts
        self.revision += 1

    def set(self, name: str, text: str) -> None:
        self.opened[name] = self.texts[name] = text
        self.symbols.update(name, text)
        self.revision += 1

    def close(self, name: str) -> None:
        self.opened.pop(name, None)
        self.read()

    def problems(self, version: int | None) -> tuple[int, Mapping[str, list[Problem]]]:
        """Return the revision and the problems of each file. May be called in another thread.

        If `version` is None, the version of the controller in spel.yaml applies. Without such a
        controller, the newest version applies. An invalid spel.yaml is ignored, and has a problem.
        """
        revision, texts = self.revision, dict(self.texts)
        result: dict[str, list[Problem]] = {name: [] for name in (*texts, SETTINGS_FILE)}
        settings: Settings | None = None
        try:
            settings = read_settings(self.folder)
            version = version or CONTROLLERS.get(settings.controller or '')
        except InputError as error:
            line = re.search(r', line (\d+)', str(error))
            at = Position(SETTINGS_FILE, int(line[1]) if line else 1)
            result[SETTINGS_FILE].append(Problem(at, 'project-file', str(error)))
        version = version or VERSIONS[-1]
        for problem in check(texts, version, settings, self._parsed):
            result.setdefault(problem.position.file, []).append(problem)
        return revision, result

    def visible(self, name: str, line: int, column: int) -> Iterator[Symbol]:
        """Yield the symbols that can be written at a position.

        After GoTo these are the labels, elsewhere all other symbols.
        """
        function = self.symbols.function_at(name, line)
        jump = _JUMP.match(self.symbols.files[name].lines[line][:column]) is not None
        for symbol in self.symbols.visible(name, function):
            if (symbol.kind == 'label') is jump:
                yield symbol

    def word_at(self, name: str, line: int, column: int) -> str:
        for match in re.finditer(r'\w+\$?', self.symbols.files[name].lines[line]):
            if match.start() <= column <= match.end():
                return match.group()
        return ''

    def bit_at(self, name: str, line: int, column: int) -> Symbol | None:
        """Return the label of the I/O bit whose number is at a position, as in `On 5`."""
        for match in _BIT.finditer(self.symbols.files[name].lines[line]):
            if match.start(2) <= column <= match.end(2):
                word = match[1].lower()
                kind = 'memory' if word[:3] == 'mem' else 'input' if word == 'sw' else 'output'
                bit = f'{kind} bit {int(match[2])}'
                labels = (item for item in self.symbols.visible(name, '') if item.kind == 'io')
                return next((item for item in labels if item.detail.split(':')[0] == bit), None)
        return None

    def renamed(self, symbol: Symbol, new: str) -> dict[str, list[tuple[Place, str]]]:
        """Return the changes of each file that rename a symbol.

        Size and checksum in the header of an RC+ file are updated. Raises RenameError if the new
        name is invalid.
        """
        places = self.symbols.references(symbol)
        self._check_name(symbol, new, places)
        changes: dict[str, list[tuple[Place, str]]] = {}
        for place in places:
            changes.setdefault(place.file, []).append((place, new))
        for file, edits in changes.items():
            lines = list(self.symbols.files[file].lines)
            if not lines[0].startswith('ENVT'):
                continue
            for place, text in reversed(edits):
                line = lines[place.line]
                lines[place.line] = line[: place.start] + text + line[place.end :]
            header, _, _ = resealed(self.texts[file], '\n'.join(lines)).partition('\n')
            edits.insert(0, (Place(file, 0, 0, len(lines[0])), header))
        return changes

    def _check_name(self, symbol: Symbol, new: str, places: list[Place]) -> None:
        limit = _LIMITS.get(symbol.kind, LONGEST_NAME)
        for name in (symbol.name, new) if symbol.kind == 'function' else ():
            if _START.fullmatch(name):
                raise RenameError(f'the controller starts {name} by its name')
        if is_point_literal(symbol.name):
            raise RenameError(f'{symbol.name} is the number of a point: only labels have names')
        if not _NAME.fullmatch(new) or is_point_literal(new):
            raise RenameError(f'{new}: a name has letters, digits and _, and starts with a letter')
        if reserved(new):
            raise RenameError(f'{new} is a reserved word of SPEL+')
        if new.endswith('$') is not symbol.name.endswith('$'):
            raise RenameError(f'{new}: only names of strings end in $')
        if len(new) > limit:
            raise RenameError(f'{new}: a {symbol.kind} has at most {limit} characters')
        for place in places:
            function = self.symbols.function_at(place.file, place.line)
            label = symbol.kind == 'label'
            for other in self.symbols.declarations(place.file, function, new, label):
                if other.key != symbol.key:
                    where = f'{other.place.file}:{other.place.line + 1}'
                    raise RenameError(f'{new} is another {other.kind} already: {where}')


class Projects:
    """All projects that have an open file. `roots`: the workspace folders."""

    def __init__(self, roots: list[Path]) -> None:
        self.roots = [root.resolve() for root in roots]
        self._projects: dict[Path, Project] = {}

    def of(self, path: Path) -> Project | None:
        """Return the project of a file, or None if the file is not below a workspace folder.

        The project consists of the files in the file's folder. If this folder's .sprj does not
        list the file, the project contains only the file.
        """
        path = path.resolve()
        if not any(path.is_relative_to(root) for root in self.roots):
            return None
        folder = self._projects.get(path.parent)
        if folder is None:
            folder = self._projects[path.parent] = Project(path.parent)
        listed = any(name.lower().endswith('.sprj') for name in folder.texts)
        if path.name in folder.texts or not listed:
            return folder
        if path not in self._projects:
            self._projects[path] = Project(path)
        return self._projects[path]

    def below(self, path: Path) -> list[Project]:
        return [item for item in self._projects.values() if item.folder == path.resolve().parent]
