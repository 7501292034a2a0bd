# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""spel/symbols.py: every name of a project is found where it stands, and nothing else."""

from collections import defaultdict

from epson_driver.share import share_path
from epson_driver.spel import read_project
from epson_driver.spel.expressions import is_point_literal
from epson_driver.spel.lint import check
from epson_driver.spel.project_data import resealed
from epson_driver.spel.symbols import ProjectSymbols


def index(**files: str) -> ProjectSymbols:
    """Return the symbols of files, whose names are written main_prg for main.prg."""
    project = ProjectSymbols()
    for name, text in files.items():
        project.update(name.replace('_', '.'), text)
    return project


def with_name(project: ProjectSymbols, mark: str, new: str) -> str:
    """Return main.prg with another name for what stands behind the mark |, without the mark."""
    lines = list(project.files['main.prg'].lines)
    line = next(number for number, text in enumerate(lines) if mark in text)
    column = lines[line].index(mark) + mark.index('|')
    lines[line] = lines[line].replace(mark, mark.replace('|', ''))
    project.update('main.prg', '\n'.join(lines))
    found = project.at('main.prg', line, column)
    assert found is not None
    for _, number, start, end in reversed(project.references(found[0][0])):
        lines[number] = lines[number][:start] + new + lines[number][end:]
    return '\n'.join(lines)


POINTS = """\
Function f
  Real |x, r, z(3), y
  P1 = Here :X(x) +Z(z(1)) /R
  y = x / r - Z(2)
  Go P(x) /R ' x
  Print "x", x; x = P1 +X(x)
  VGet x.y.x, x
Fend
"""


def test_axes_flags_texts_and_vision_names_are_no_variables() -> None:
    assert with_name(index(main_prg=POINTS), '|x', 'NEW') == (
        POINTS.replace('|x', 'NEW')
        .replace(':X(x)', ':X(NEW)')
        .replace('y = x /', 'y = NEW /')
        .replace('P(x)', 'P(NEW)')
        .replace('"x", x; x = P1 +X(x)', '"x", NEW; NEW = P1 +X(NEW)')
        .replace('x.y.x, x', 'x.y.x, NEW')
    )
    flags = POINTS.replace('|x', 'x').replace('x, r', 'x, |r')
    assert with_name(index(main_prg=flags), '|r', 'NEW') == (
        POINTS.replace('|x, r', 'x, NEW').replace('x / r', 'x / NEW')
    )
    arrays = POINTS.replace('|x', 'x').replace('z(3)', '|z(3)')
    assert with_name(index(main_prg=arrays), '|z', 'NEW') == (
        POINTS.replace('|x', 'x')
        .replace('z(3)', 'NEW(3)')
        .replace('+Z(z(1))', '+Z(NEW(1))')
        .replace('- Z(2)', '- NEW(2)')
    )


SCOPES = """\
#define SIZE 3
Integer count
Function f(n As Integer)
  Integer i
  For |i = 0 To SIZE
    count = i + n
i:
    If i = 3 Then GoTo i
  Next i
  Go Pi
Fend
Function g
  Integer i
  i = count
Fend
"""


def test_a_local_variable_is_renamed_in_its_function_only() -> None:
    first, second = SCOPES.split('Function g')
    changed = first.replace('Integer i\n', 'Integer n2\n').replace('For |i', 'For n2')
    changed = changed.replace('= i +', '= n2 +').replace('If i', 'If n2')
    changed = changed.replace('Next i', 'Next n2').replace('Pi', 'Pn2')
    assert with_name(index(main_prg=SCOPES), '|i', 'n2') == f'{changed}Function g{second}'


def test_module_variables_belong_to_their_file_and_globals_to_all() -> None:
    project = index(
        main_prg='Integer count\nGlobal Real speed_\nFunction main\n  count = speed_\nFend',
        other_prg='Integer count\nFunction other\n  count = speed_\nFend',
    )
    module, shared = (
        project.declarations('main.prg', 'main', name, False)[0] for name in ('count', 'speed_')
    )
    assert {place.file for place in project.references(module)} == {'main.prg'}
    assert {place.file for place in project.references(shared)} == {'main.prg', 'other.prg'}
    assert (module.detail, shared.detail) == ('Integer count', 'Global Real speed_')


def test_programs_with_errors_and_inactive_branches_are_indexed() -> None:
    text = '#ifdef NEVER\nFunction f\n#endif\n  x = = "\n  Call g(\nFunction g'
    project = index(main_prg=text)
    (symbol,) = project.declarations('main.prg', '', 'g', False)
    assert [place.line for place in project.references(symbol)] == [4, 5]


def test_our_controller_program_builds_after_all_of_its_names_have_changed() -> None:
    texts = read_project(share_path('controller_program'))
    project = ProjectSymbols()
    for name, text in texts.items():
        project.update(name, text)
    changes = defaultdict(dict)
    for number, symbols in enumerate(project.names.values()):
        for symbol in symbols:
            if symbol.name.lower() not in ('main', 'bgmain') and not is_point_literal(symbol.name):
                for place in project.references(symbol):
                    scope = abs(hash(symbol.key)) % 10**9
                    changes[place.file][place] = f'n{number}_{scope}' + '$' * symbol.name.endswith(
                        '$'
                    )
    assert sum(map(len, changes.values())) > 2_000
    for name, edits in changes.items():
        lines = texts[name].split('\n')
        for place, new in sorted(edits.items(), reverse=True):
            line = lines[place.line]
            lines[place.line] = line[: place.start] + new + line[place.end :]
        texts[name] = resealed(texts[name], '\n'.join(lines))
    assert check(texts) == []
