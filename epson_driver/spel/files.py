# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The files of a program: the files in its folder, and the files that it has written.

Written files stay in memory. With `keep`, written files are also stored in the folder, and paths
outside the folder are refused. Existing point files are changed in memory only, so that points of
a simulated robot never replace taught ones. `ProgramEnvironment` adds the rest of a program's
environment: stub answers and ports.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from epson_driver.inputs import printable, read_file, write_file
from epson_driver.spel.errors import ErrorNumber, SpelError, to_add
from epson_driver.spel.host import NetSettings
from epson_driver.spel.words import not_simulated

MAX_BYTES = 20_000_000
"""Maximum number of bytes that a program may write in total."""

_PROJECT = ('.prg', '.inc', '.sprj', 'iolabels.dat', 'usererrors.dat', 'macros.dat')
"""Endings, in lower case, of names of project files. A program cannot write these files."""


def _bad(text: str) -> SpelError:
    return SpelError(ErrorNumber.ARGUMENT, printable(text))


def no_file(name: str) -> SpelError:
    """Return the error for a file that does not exist (SPEL+ manual p282)."""
    return SpelError(ErrorNumber.NO_SUCH_FILE, printable(f'there is no file {name}'))


@contextmanager
def _reported(name: str) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        raise _bad(f'{name}: {getattr(error, "strerror", None) or error}') from error


class Files:
    """The files of a program, stored in the project's `folder` if `keep` is set."""

    most_bytes = MAX_BYTES

    def __init__(self, folder: Path | None = None, keep: bool = False) -> None:
        self._folder = folder
        there = _inside(folder) if folder is not None and keep else []
        self._taught = {name for item in there if (name := item.name.lower()).endswith('.pts')}
        self._keep = keep
        self._written: dict[str, bytes | None] = {}

    def fresh(self) -> 'Files':
        """Return a copy without the written files. The copy stores new files only in memory."""
        return Files(self._folder)

    def path(self, name: str) -> str:
        """Return a path as a dictionary key: in lower case, with `/`."""
        return '/'.join(self._parts(name)).lower()

    def _parts(self, name: str) -> list[str]:
        parts: list[str] = []
        for part in PurePosixPath(name.replace('\\', '/')).parts:
            if part == '..' and parts:
                parts.pop()
            elif part not in ('..', '/', '.'):
                parts.append(part)
        return parts

    def read(self, name: str) -> bytes | None:
        key = self.path(name)
        if key in self._written:
            return self._written[key]
        there = self._there(key)
        if there is None or not there.is_file():
            return None
        with _reported(name):
            return read_file(there, MAX_BYTES)

    def write(self, name: str, content: bytes) -> None:
        """Write a file. Raises SpelError if this fails, is not allowed, or exceeds MAX_BYTES."""
        key = self.path(name)
        others = sum(len(item) for path, item in self._written.items() if item and path != key)
        if others + len(content) > MAX_BYTES:
            raise _bad(f'{name}: more than {MAX_BYTES} bytes')
        if self._keep and key not in self._taught:
            with _reported(name):
                write_file(self._target(name, key), content)
        self._written[key] = content

    def delete(self, name: str) -> None:
        if self.read(name) is None:
            raise no_file(name)
        key = self.path(name)
        if self._keep and key not in self._taught:
            with _reported(name):
                self._target(name, key).unlink(missing_ok=True)
        self._written[key] = None

    def _there(self, key: str) -> Path | None:
        """Return the path of the file `key` in the program's folder, or None.

        The case is ignored.
        """
        if self._folder is None or not self._folder.is_dir():
            return None
        place = self._folder
        for part in key.split('/') if key else []:
            result = [item for item in _inside(place) if item.name.lower() == part]
            if not result or result[0].is_symlink():
                return None
            place = result[0]
        return place

    def _target(self, name: str, key: str) -> Path:
        text = name.replace('\\', '/')
        if key.endswith(_PROJECT):
            raise _bad(f'{name}: files of the project are read-only')
        if self._folder is None or '..' in text or text[1:2] == ':' or text.startswith('/'):
            raise _bad(f'{name}: files can be written only in the folder of the project')
        there = self._there(key)
        if there is not None:
            return there
        above = self._there(key.rpartition('/')[0])
        target = None if above is None else above / self._parts(name)[-1]
        if target is None or not target.parent.is_dir() or target.is_symlink():
            raise _bad(f'{name}: no such folder')
        return target


def _inside(place: Path) -> list[Path]:
    return sorted(place.iterdir()) if place.is_dir() else []


Answer = int | float | str | None | list[int | float | str]
"""The result of a statement or function that is replaced by a stub. An answer is the value of a
function, a list of values for a statement's variables, or None for no values."""


def without_answer(name: str) -> str:
    return f'{not_simulated(name)}: {to_add("stubs", f"{name}: RESULT")}'


class Stubs:
    """Results that replace statements and functions that are not simulated, such as vision.

    The key of results is a name, or a name and its first argument (`VGet find.Geom01.RobotXYU`).
    The results of a key are used one after the other. The last result is then repeated.
    """

    def __init__(self, answers: Mapping[str, Sequence[Answer]]) -> None:
        self._answers = {' '.join(key.lower().split()): item for key, item in answers.items()}
        self._given: dict[str, int] = {}

    def answer(self, name: str, arguments: Sequence[object]) -> Answer:
        keys = [name.lower()]
        if arguments:
            keys.insert(0, f'{keys[0]} {arguments[0]}'.lower())
        for key in keys:
            if answers := self._answers.get(key):
                turn = self._given.get(key, 0)
                self._given[key] = turn + 1
                return answers[min(turn, len(answers) - 1)]
        raise SpelError(ErrorNumber.NOT_SIMULATED, without_answer(name))

    @property
    def words(self) -> set[str]:
        return {key.split()[0] for key in self._answers}


@dataclass
class ProgramEnvironment:
    """The environment of a program: its files, and two kinds of settings.

    * answers: the results of statements and functions that are not simulated (`Stubs`).
    * ports: settings of ports 201 to 216 in RC+'s system configuration. SetNet replaces them.
    """

    answers: Mapping[str, Sequence[Answer]] = field(default_factory=dict)
    ports: Mapping[int, NetSettings] = field(default_factory=dict)
    files: Files = field(default_factory=Files)

    def fresh(self) -> 'ProgramEnvironment':
        """Return a copy without the files that the program has written."""
        return replace(self, files=self.files.fresh())
