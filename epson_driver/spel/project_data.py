# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The data of a project besides its programs: points, labels of points and I/O, error messages.

A project is a mapping from file name to text, as returned by `read_project`.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from epson_driver.inputs import InputError, printable, rc_files, read_file
from epson_driver.inputs.rc_files import (
    Block,
    RcFileError,
    header_fault,
    parsed,
    quoted,
    sealed,
)
from epson_driver.spel.errors import Position, Problem, bad
from epson_driver.spel.values import Point

LARGEST_FILE = 5_000_000
"""Maximum size of a file, bytes."""

LAST_POINT = 999
PROGRAM, INCLUDE, POINTS, PROJECT = '.prg', '.inc', '.pts', '.sprj'
ERRORS, IO_LABELS = 'usererrors.dat', 'iolabels.dat'
RULE = 'project-file'

_POSTURES = {'nHand': {2: 'l', 1: 'r'}, 'nElbow': {2: 'b'}, 'nWrist': {2: 'f'}}
_J_FLAGS = ('J1', 'J2', 'J4', 'J6')
_J_ANGLES = ('J1', 'J4')


@dataclass(frozen=True, slots=True)
class PointFile:
    """The points of a .pts file by number, and their labels.

    `labels` are in lower case, and `spelling` contains their original spelling.
    """

    points: dict[int, Point]
    labels: dict[str, int]
    spelling: dict[str, str]


@dataclass
class ProjectData:
    """Names that programs can use: errors, I/O and points.

    `points` come from the first point file, which is the robot's default. `point_labels` come from
    all point files.
    """

    labels: dict[str, int] = field(default_factory=dict)
    texts: dict[int, str] = field(default_factory=dict)
    """Error number → message."""
    point_files: dict[str, PointFile] = field(default_factory=dict)
    """File name in lower case → contents of the point file."""
    point_labels: dict[str, int] = field(default_factory=dict)
    spelling: dict[str, str] = field(default_factory=dict)
    """Label of a point in lower case → original spelling."""
    io_labels: dict[tuple[int, int, int], str] = field(default_factory=dict)
    """Kind (input 0, output 1, memory 2), width and number → label in original spelling."""
    unlabelled: set[str] = field(default_factory=set)
    """Labels of I/O that no file assigns to a number, in lower case."""

    @property
    def points(self) -> dict[int, Point]:
        return next((dict(file.points) for file in self.point_files.values()), {})


def read_project(path: Path) -> dict[str, str]:
    """Return the texts of a project by file name.

    `path` is a folder, a .sprj file, or a .prg file. For a folder or a .sprj file, only the files
    that the .sprj file lists are read, and the point files of robot 1, with its default file
    first. If a listed program is missing, all programs and data in the folder are read. For a .prg
    file, the other files in its folder are read, too, except other programs. Raises InputError if
    a file cannot be read, or if no .prg file exists.
    """
    folder = path if path.is_dir() else path.parent
    there = {
        item.name.lower(): item for item in sorted(folder.iterdir() if folder.is_dir() else [])
    }
    projects = [element for name, element in there.items() if name.endswith(PROJECT)]
    if path.name.lower().endswith(PROJECT) and not path.is_dir():
        projects = [path]
    whole = path.is_dir() or projects == [path]
    names: list[str] = []
    if whole and projects:
        text = decoded(read_file(projects[0], LARGEST_FILE))
        with suppress(RcFileError):  # project_data reports it
            names = [*listed_files(parsed(projects[0].name, text)), projects[0].name]
    programs = [name.lower() for name in names if name.lower().endswith(PROGRAM)]
    if not programs or not there.keys() >= set(programs):
        endings = (INCLUDE, POINTS, PROJECT, *([PROGRAM] if whole else []))
        names = [name for name in there if name.endswith(endings)] + [ERRORS, IO_LABELS]
    result = (there[name.lower()] for name in names if name.lower() in there)
    contents = {item.name: read_file(item, LARGEST_FILE) for item in result if item.is_file()}
    if not whole:
        contents[path.name] = read_file(path, LARGEST_FILE)
    files = _decoded_together(contents)
    if not any(name.lower().endswith(PROGRAM) for name in files):
        raise InputError(f'{printable(path)}: has no .prg file')
    return files


def listed_files(project: Block) -> Iterator[str]:
    """Yield the files of a project, with the default point file of robot 1 first.

    Raises RcFileError if the project lists no program.
    """
    for kind in ('ProgramFile', 'IncludeFile'):
        yield from (block.text('sName') for block in project.blocks(kind))
    points = [block for block in project.blocks('PointFile') if block.number('nRobot', 1) == 1]
    for default in (True, False):
        for point in points:
            if (point.text('bDefault', 'True') == 'True') is default:
                yield point.text('sName')
    if not project.number('nProgramFileCount'):
        raise project.fault('nProgramFileCount', 'expected nProgramFileCount=1 or more')
    yield from (ERRORS, IO_LABELS)


def decoded(content: bytes, page: str = '') -> str:
    """Decode a text.

    The text may be in UTF-8, in the code page `page`, or in a code page that is detected from the
    content.
    """
    for name in ('utf-8-sig', page or _code_page(content)):
        with suppress(UnicodeDecodeError):
            return _with_line_feeds(content.decode(name))
    return _with_line_feeds(content.decode(_code_page(content)))


def _decoded_together(contents: Mapping[str, bytes]) -> dict[str, str]:
    """Decode the files of a project with one code page, because one PC has written them.

    The .sprj is decoded separately, because the names of its fonts may use another code page.
    """
    apart = [name for name in contents if name.lower().endswith(PROJECT)]
    page = _code_page(b'\n'.join(item for name, item in contents.items() if name not in apart))
    return {
        name: decoded(item, '' if name in apart or page == 'latin-1' else page)
        for name, item in contents.items()
    }


def _with_line_feeds(text: str) -> str:
    return text.replace('\r\n', '\n').replace('\r', '\n')


def encoded(text: str) -> Iterator[bytes]:
    """Yield each sequence of bytes from which `decoded` may have returned this text."""
    for name in ('utf-8', *_LEADS, 'latin-1'):
        with suppress(UnicodeEncodeError):
            yield text.encode(name)


def resealed(old: str, new: str) -> str:
    """Return the text `new` of an RC+ file with a corrected size and checksum in its header.

    `old`: the previous text, in whose encoding the bytes are counted. If its header is wrong,
    `new` is returned unchanged.
    """
    for name in ('utf-8', *_LEADS, 'latin-1'):
        with suppress(UnicodeEncodeError):
            if not header_fault(old.encode(name)):
                return rc_files.resealed(new.encode(name)).decode(name)
    return new


_LEADS = {
    'shift_jis': range(0x82, 0x98),
    'cp949': range(0xB0, 0xC9),
    'gb18030': range(0xB0, 0xD8),
    'big5': range(0xA4, 0xC7),
}
"""Code page → lead bytes of its common characters. Common characters are the kana, and the first
level of kanji, hanzi or hangul."""

_COMMON_SHARE = 0.6
"""Minimum fraction of common characters among two-byte characters. German text has no such pairs
of bytes."""


def _code_page(content: bytes) -> str:
    """Return the code page with the largest fraction of common characters, or latin-1."""
    best, chosen = _COMMON_SHARE, 'latin-1'
    if content.isascii():
        return chosen
    for name, leads in _LEADS.items():
        try:
            text = content.decode(name)
        except UnicodeDecodeError:
            continue
        wide = [item.encode(name) for item in text if ord(item) > 0x7F]
        common = sum(len(item) == 2 and item[0] in leads for item in wide)
        fraction = common / len(wide) if wide else 0.0
        if fraction > best:
            best, chosen = fraction, name
    return chosen


def project_data(files: Mapping[str, str], problems: list[Problem]) -> ProjectData:
    data = ProjectData()
    for name, text in files.items():
        lower = name.lower()
        if not (lower.endswith((POINTS, PROJECT)) or lower in (ERRORS, IO_LABELS)):
            continue
        try:
            block = parsed(name, text)
            if lower.endswith(PROJECT):
                list(listed_files(block))
            elif lower.endswith(POINTS):
                data.point_files[lower] = points = _points(block)
                data.point_labels |= {**points.labels, **data.point_labels}
                data.spelling |= {**points.spelling, **data.spelling}
            elif lower == IO_LABELS:
                data.io_labels = _io_labels(block)
                data.labels |= {name.lower(): at[2] for at, name in data.io_labels.items()}
            else:
                for item in block.blocks('Label'):
                    number = int(item.number('nError'))
                    data.texts[number] = item.text('sMessage')
                    data.labels[item.text('sLabel').lower()] = number
        except RcFileError as error:
            at = Position(name, error.line)
            problems.append(Problem(at, RULE, f'cannot be read: {error.problem}'))
    data.labels.pop('', None)
    return data


def _points(block: Block) -> PointFile:
    points: dict[int, Point] = {}
    labels: dict[str, int] = {}
    spelling: dict[str, str] = {}
    for item in block.blocks('Point'):
        number = int(item.number('nNumber', -1))
        if not 0 <= number <= LAST_POINT:
            raise item.fault('nNumber', f'point number {number} is not in 0..{LAST_POINT}')
        if label := item.text('sLabel'):
            labels[label.lower()], spelling[label.lower()] = number, label
        if int(item.number('nUndefined')) & 0xF:  # X, Y, Z, U undefined: a label without a place
            continue
        values = tuple(item.number(f'r{axis}') for axis in 'XYZUVW')
        points[number] = Point('xy', values, tuple(_flags(item)))
    return PointFile(points, labels, spelling)


def point_file(name: str, content: bytes) -> PointFile:
    try:
        return _points(parsed(name, decoded(content)))
    except RcFileError as error:
        raise bad('LoadPoints', str(error)) from error


def points_of(points: Mapping[int, Point], labels: Mapping[int, str], when: datetime) -> str:
    body = Block('', [('sVersion', '"2.0.0"'), ('nNumberOfPoints', str(len(points)))])
    for turn, (number, point) in enumerate(sorted(points.items()), 1):
        axes = zip('XYZUVW', (*point.values, *[0.0] * 6), strict=False)
        body.items.append(
            Block(
                f'Point{turn}',
                [
                    ('nNumber', str(number)),
                    ('sLabel', quoted(labels.get(number, ''))),
                    ('sDescription', '""'),
                    ('nUndefined', '0'),
                    *((f'r{axis}', f'{value:.3f}') for axis, value in axes),
                    *((f'r{axis}', '0') for axis in 'RST'),
                    ('nLocal', next((flag for flag in point.flags if flag.isdigit()), '0')),
                    *(
                        (key, str(next((k for k, w in words.items() if w in point.flags), 1)))
                        for key, words in _POSTURES.items()
                    ),
                    *((f'n{joint}Flag', _reported(point, f'{joint}f')) for joint in _J_FLAGS),
                    *((f'r{joint}Angle', _reported(point, f'{joint}a')) for joint in _J_ANGLES),
                    ('bSimVisible', 'True'),
                ],
            )
        )
    return sealed(body, when)


def _reported(point: Point, mark: str) -> str:
    return next((flag[3:] for flag in point.flags if flag.startswith(mark.lower())), '0')


def _flags(block: Block) -> Iterator[str]:
    for key, words in _POSTURES.items():
        if (word := words.get(int(block.number(key)))) is not None:
            yield word
    for joint in _J_FLAGS:
        if value := int(block.number(f'n{joint}Flag')):
            yield f'{joint.lower()}f{value}'
    for joint in _J_ANGLES:
        if angle := block.number(f'r{joint}Angle'):
            yield f'{joint.lower()}a{angle:.3f}'
    if local := int(block.number('nLocal')):
        yield str(local)


IO_BLOCKS = {
    f'{kind}{unit}Labels': (number, width, f'n{unit}')
    for number, kind in enumerate(('Input', 'Output', 'Memory'))
    for unit, width in (('Bit', 1), ('Byte', 8), ('Word', 16))
}
"""Block of IOLabels.dat → kind of I/O, width, and key of the number."""


def _io_labels(block: Block) -> dict[tuple[int, int, int], str]:
    result = {}
    for part in block.items:
        if isinstance(part, Block) and part.name in IO_BLOCKS:
            kind, width, key = IO_BLOCKS[part.name]
            for item in part.blocks('Label'):
                at = item.number(key, item.number('nBit'))  # RC+ writes nBit for some bytes
                if item.text('sLabel'):
                    result[kind, width, int(at)] = item.text('sLabel')
    return result
