# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Check that texts read as plain engineering English, as part of `make lint`.

Counts the phrases below in docstrings, comments, texts, names of tests, and pages, and fails if a
room has more than its budget per 1,000 words. It is an alarm: rewrite the sentence from what the
code does (CONTRIBUTING.md) instead of replacing a word. `--list PREFIX` prints the phrases found
in the files whose names start with PREFIX.
"""

import argparse
import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

BUDGETS = {'test/': 10.0, '': 8.0}
"""Maximum phrases per 1,000 words of a room, by the first prefix that matches."""
SMALL_ROOM = 400
"""Rooms with fewer words are counted together with their parent."""
PHRASES = r"""
name the thing           : \bwhat (?:is|was|are|were|has|had|can|may|must|it|they|the|a)\b
client, caller, user     : \b(?:nobody|somebody|everybody|whoever)\b
client, caller, user     : \bwho (?:is|has|comes?|asks?|reads?|sends?|waits?|wants?)\b
log, report, return      : \b(?:tells?|told|telling|says?|said)\b
exists, available        : \b(?:that|which|as|where|if|until) there (?:is|are|was|were)\b
name the quantity        : \bso (?:much|many|far|often|long|few|little|soon|late)\b
continue, resume         : \b(?:go|goes|went|going) on\b
at rest; start           : \b(?:stands?|stood|standing|begins?|began|begun)\b
path, method, pending    : \b(?:on (?:the|its|their) way|(?:the|its|a|this|other|two) ways?)\b
except                   : \b(?:all|none|nothing|anything|everything|rest) but\b
separate, or drop it     : \bof (?:its|their|our|your) own\b
polled, received, stored : \b(?:is|are|was|were|be|been) (?:asked|looked at|heard|let|held|kept)\b
immediately, or drop it  : \b(?:meanwhile|anew|at once|by itself|beside|seldom|for ever|thereby)\b
fix, check, treat as     : \b(?:mend(?:s|ed)?|held against|keeps? to|hands? on|held up)\b
subject first            : (?:^|[.:] )(?:Of|Beyond|Beside|So) [^.:,?]{2,50}? (?:is|are|has|can)\b
repeat the noun          : \b(?:that|those) of\b|\b(?:the )?ones? (?:that|which|of|with)\b
two sentences            : ;(?= )
unchanged, like X        : \bas (?:it|they) (?:is|are|was|were|does|do)\b|\bas ever\b|\bbe it\b
"""
FIRST_LINES = r"""
a noun phrase, or a verb : ^(?:What|How|Of what|Where|Who)\b
name the quantity        : \bso (?:much|many|long)\b
the direct verb          : ^(?:Have|Let) (?:a|an|the|each|every|it|its|all|no)\b
"""
"""Phrases that no docstring of the package has in its first line."""
_QUOTED = re.compile(r'`[^`\n]*`|"[^"\n]*"|“[^”]*”|https?://\S+|\{[^}\n]*\}')


def read_table(table: str) -> list[tuple[str, re.Pattern[str]]]:
    """Return pairs of a hint and its compiled phrase."""
    rows = [row.split(':', 1) for row in table.strip().splitlines()]
    return [(hint.strip(), re.compile(phrase.strip())) for hint, phrase in rows]


def texts_of_python(source: str) -> Iterator[tuple[int, str, bool]]:
    """Yield the line and text of all prose, and whether it is a docstring."""
    docstrings = set()
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) if (
                'test_' in name[:5]
            ):
                yield node.lineno, name.removeprefix('test_').replace('_', ' '), False
            case ast.Expr(value=ast.Constant(value=str(text)) as value):
                docstrings.add(id(value))
                yield value.lineno, text, True
            case ast.Constant(value=str(text)) if id(node) not in docstrings:
                if len(text.split()) >= 4 and re.search('[a-z]{3} [a-z]', text):
                    yield node.lineno, text, False
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string.lstrip('# '), False


def texts_of_page(source: str) -> Iterator[tuple[int, str, bool]]:
    """Yield the lines of a page of Markdown without code and tables."""
    fenced = False
    for number, line in enumerate(source.splitlines(), 1):
        fenced ^= line.lstrip().startswith('```')
        if not fenced and not re.match(r'\s*(```|\||<!--)', line):
            yield number, re.sub(r'\]\([^)]*\)', ']', line), False


def room_of(name: str) -> str:
    """Return the folder that a file is counted in."""
    folders = name.split('/')[:-1]
    return '/'.join(folders[: 2 if folders[:1] in (['epson_driver'], ['test']) else 1])


def main() -> int:
    """Print the rooms that exceed their budget. Returns 1 if there are any."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--list', metavar='PREFIX', help='print the phrases of these files')
    prefix = parser.parse_args().list
    root = Path(__file__).resolve().parents[1]
    names = subprocess.check_output(['git', 'ls-files', '*.py', '*.md'], cwd=root, text=True)
    phrases, first_lines = read_table(PHRASES), read_table(FIRST_LINES)
    words: Counter[str] = Counter()
    found: dict[str, list[str]] = defaultdict(list)
    forbidden = []
    for name in names.split():
        if name.startswith(('test/plain_english', 'interfaces/')) or not (root / name).is_file():
            continue
        source, room = (root / name).read_text(encoding='utf-8'), room_of(name)
        texts = texts_of_python if name.endswith('.py') else texts_of_page
        for line, text, docstring in texts(source):
            plain, first = _QUOTED.sub('X', re.sub(r'\s+', ' ', text)), text.partition('\n')[0]
            words[room] += len(plain.split())
            for hint, phrase in phrases:
                found[room] += [
                    f'{name}:{line}: "{m[0].strip()}" ({hint})' for m in phrase.finditer(plain)
                ]
            if docstring and name.startswith('epson_driver/'):
                forbidden += [
                    f'{name}:{line}: {first} ({hint})'
                    for hint, phrase in first_lines
                    if phrase.search(first)
                ]
    if prefix is not None:
        print(
            *(hit for hits in found.values() for hit in hits if hit.startswith(prefix)), sep='\n'
        )
        return 0
    for room in [room for room in words if words[room] < SMALL_ROOM]:
        words[room.partition('/')[0]] += words.pop(room)
        found[room.partition('/')[0]] += found.pop(room, [])
    over = []
    for room in sorted(words):
        budget = next(most for start, most in BUDGETS.items() if f'{room}/'.startswith(start))
        rate = 1000 * len(found[room]) / words[room]
        if rate > budget:
            over.append(f'{room}: {rate:.1f} phrases per 1,000 words, the budget is {budget:g}')
    print(*forbidden, *over, sep='\n')
    return 1 if over or forbidden else 0


if __name__ == '__main__':
    sys.exit(main())
