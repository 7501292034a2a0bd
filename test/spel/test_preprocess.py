# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""#define, #ifdef, #include."""

import pytest
from support.spel_harness import files, printed, run

from epson_driver.inputs import InputError
from epson_driver.spel import ProgramError, build, preprocess, with_defines


def test_definition_replaces_its_name_in_any_case() -> None:
    before = """
    #define COUNT 3 ' how many
    #define SUM (Count + 1)
    #define SQUARE(x) ((x) * (x))
    #define PAIR(a, b) a, b
    """
    body = """
    Print COUNT, sum, Square(2 + 1)
    Print Pair(7, Square(2)), "COUNT"
    """
    assert printed(body, before=before) == ['3 4 9', '7 4 COUNT']


def test_recursive_definition_is_not_expanded() -> None:
    before = '#define g_n g_n\n#define a_ b_\n#define b_ a_\nGlobal Integer g_n, a_'
    assert printed('g_n = 4; a_ = 5\nPrint g_n, a_', before=before) == ['4 5']


def test_program_above_the_line_limit_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(preprocess, 'MAX_LINES', 4)
    assert build(files('Function main\n  Print 1\nFend')).by_name.keys() == {'main'}
    with pytest.raises(ProgramError) as caught:
        build(files('#include "a.inc"\nFunction main\nFend', a_inc='\n\n\n\n'))
    assert 'a.inc:4:1: error: the program has more than 4 lines' in str(caught.value)


def test_ifdef_blocks_can_be_nested() -> None:
    before = """
    #define ONE
    #ifdef ONE
    #ifndef TWO
    #define RESULT 12
    #else
    #define RESULT 13
    this is no program
    #endif
    #else
    #nonsense %%
    #ifdef TWO
    #else
    #define RESULT 14
    #endif
    #endif
    #undef ONE
    #ifdef ONE
    #define RESULT 15
    #endif
    """
    assert printed('Print RESULT', before=before) == ['12']


def test_included_files_are_found_in_any_case() -> None:
    shared = 'Global Integer g_x\n#define TEN 10\n'
    others = {
        'config_inc': '#include "Shared.INC"\n#define ELEVEN (TEN + 1)\n',
        'shared_inc': shared,
        'other_prg': '#include "shared.inc"\nFunction add\n  g_x = g_x + TEN\nFend\n',
    }
    source = '#include "CONFIG.inc"\nFunction main\n  g_x = ELEVEN; add\n  Print g_x\nFend\n'
    program = build(files(source, **others))
    assert program.by_name.keys() == {'main', 'add'}
    assert [variable.name for variable in program.variables] == ['g_x']


@pytest.mark.parametrize(
    ('source', 'message'),
    [
        ('#include "no.inc"', 'main.prg:1:1: error: #include: no file no.inc'),
        ('#include no.inc', 'needs a file name in quotes'),
        ('#include "main.prg"', 'include each other endlessly'),
        ('#if X', 'unknown directive #if'),
        ('#ifdef X', 'has no #endif'),
        ('#endif', '#endif without #ifdef'),
        ('#else', '#else without #ifdef'),
        ('#ifdef X\n#else\n#else\n#endif', 'main.prg:3:1: error: a second #else'),
        ('#define', '#define needs a name'),
        ('#define A(b c) b', 'at most 8 names as parameters'),
        ('#define A(b,c,d,e,f,g,h,i,j) b', 'at most 8 names as parameters'),
        ('#define A(b', 'the parameters lack a )'),
        ('#define A(b) b\nGlobal Integer A', 'A needs 1 arguments in ( )'),
        ('#define A(b) b\nGlobal Integer A(1, 2)', 'A needs 1 arguments in ( )'),
        ('#define A(b) b\nGlobal Integer A(1', 'main.prg:2:16: error: A needs 1 arguments in ( )'),
        ('#define A() 1\nGlobal Integer n(A(2))', 'A needs 0 arguments in ( )'),
        ('#ifdef\n#endif', 'main.prg:1:1: error: #ifdef needs a name'),
        ('#ifndef 7\n#endif', 'main.prg:1:1: error: #ifndef needs a name'),
        ('#define DECL Integer\nDECL a', 'main.prg:2:1: error: DECL is a #define: it cannot make'),
        ('#define DECL Integer\nGlobal DECL a', 'it cannot make a declaration (p58)'),
        ('Function f\n#define B Real b\nPrint 1; B\nFend', 'it cannot make a declaration (p58)'),
        ('#define L done\nFunction f\nL:\nFend', 'L is a #define: it cannot make a label (p58)'),
    ],
)
def test_preprocessor_error_has_its_line(source: str, message: str) -> None:
    with pytest.raises(ProgramError) as caught:
        build(files(source + '\nFunction main\nFend\n'))
    assert message in str(caught.value)


@pytest.mark.parametrize('last', ['#define n40 1', '#define n40'])
def test_exponential_definitions_are_refused(last: str) -> None:
    """Forty definitions with two names each would expand to 2 ** 40 tokens."""
    lines = [f'#define n{i} n{i + 1} n{i + 1}' for i in range(40)]
    with pytest.raises(ProgramError, match='the #defines make the line too long'):
        build(files('\n'.join([*lines, last, 'Function main', 'n0', 'Fend'])))


def test_long_chain_of_definitions_is_refused() -> None:
    lines = [f'#define n{i} n{i + 1}' for i in range(3000)]
    with pytest.raises(ProgramError, match='the #defines make the line too long'):
        build(files('\n'.join([*lines, 'Function main', 'Print n0', 'Fend'])))


def test_user_errors_have_labels_and_texts() -> None:
    source = """
    Function main
      OnErr GoTo failed
      Error CORRUPT_MSG
    failed:
      Print Err, ErrMsg$(Err)
    Fend
    """
    given = files(source)
    given['UserErrors.dat'] = (
        'Label1 {\nnError=8000\nsLabel="CORRUPT_MSG"\nsMessage="a bad message"\n}\n'
    )
    program = build(given)
    assert program.data.texts == {8000: 'a bad message'}
    with pytest.raises(ProgramError, match='unknown variable, constant or function CORRUPT_MSG'):
        run(source)


CONFIG = {
    'config.inc': '\' what a person edits\n#define SPEED 10\n\'#define FAST 1\n#define OWN "a b"',
    'main.prg': '#include "config.inc"\nFunction main\nFend',
}


def test_defines_can_be_changed_and_switched() -> None:
    changed = with_defines(CONFIG, {'SPEED': '20', 'FAST': '1', 'OWN': ''})
    assert changed['config.inc'].split('\n')[1:] == [
        '#define SPEED 20',
        '#define FAST 1',
        '\'#define OWN "a b"',
    ]
    assert changed['main.prg'] == CONFIG['main.prg']
    assert with_defines(CONFIG, {}) == CONFIG


@pytest.mark.parametrize(
    ('values', 'words'),
    [({'SPEEED': '1'}, "no line #define 'SPEEED'"), ({'SPEED': '1\n2'}, 'must be printable')],
)
def test_unknown_or_invalid_define_is_refused(values: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words.replace('no line', 'line')):
        with_defines(CONFIG, values)
