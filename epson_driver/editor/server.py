# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The language server: one handler for each request of an editor.

In `projects`, columns count code points. In the protocol they count the client's units, usually
UTF-16. `check` runs in a thread after `DEBOUNCE` seconds without a change, and again after changes
during the check. Requests about names are answered from the index, even during a check.
"""

import asyncio
import logging
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.uris import from_fs_path, to_fs_path

from epson_driver.editor.projects import Project, Projects, RenameError
from epson_driver.spel import Problem
from epson_driver.spel.commands import COMMANDS, VERSIONS
from epson_driver.spel.formatting import formatted
from epson_driver.spel.functions import FUNCTIONS
from epson_driver.spel.lint import RULES
from epson_driver.spel.project_data import INCLUDE, PROGRAM
from epson_driver.spel.symbols import Place, Symbol
from epson_driver.spel.words import CONSTANTS, EXCEPTIONS, FIRST, SPELLING, SYNTAX, WORDS, is_a

DEBOUNCE = 0.3

_KINDS = {
    # in the outline, in completion
    'function': (lsp.SymbolKind.Function, lsp.CompletionItemKind.Function),
    'variable': (lsp.SymbolKind.Variable, lsp.CompletionItemKind.Variable),
    'parameter': (lsp.SymbolKind.Variable, lsp.CompletionItemKind.Variable),
    'label': (lsp.SymbolKind.Key, lsp.CompletionItemKind.Reference),
    'define': (lsp.SymbolKind.Constant, lsp.CompletionItemKind.Constant),
    'point': (lsp.SymbolKind.Object, lsp.CompletionItemKind.Value),
    'io': (lsp.SymbolKind.Interface, lsp.CompletionItemKind.Interface),
    'error': (lsp.SymbolKind.Event, lsp.CompletionItemKind.Event),
}


def _word_kind(word: str) -> lsp.CompletionItemKind:
    if word in CONSTANTS:
        return lsp.CompletionItemKind.Constant
    function = is_a('function', word) and not is_a('statement', word)
    return lsp.CompletionItemKind.Function if function else lsp.CompletionItemKind.Keyword


_WORDS = [lsp.CompletionItem(name, kind=_word_kind(word)) for word, name in SPELLING.items()]

Document = lsp.TextDocumentIdentifier | lsp.VersionedTextDocumentIdentifier | lsp.TextDocumentItem


class SpelServer(LanguageServer):
    def __init__(self) -> None:
        super().__init__('epson_driver', '1', lsp.TextDocumentSyncKind.Incremental)
        self.projects = Projects([])
        self.rc_version: int | None = None
        self._checks: dict[Path, asyncio.Task[None]] = {}
        self._published: dict[Path, set[str]] = {}

    def project(self, document: Document) -> tuple[Project, str] | None:
        """Return the project of a document and the document's name in it.

        Returns None for a document outside of the workspace or missing in the project.
        """
        path = to_fs_path(document.uri)
        project = None if path is None else self.projects.of(Path(path))
        if project is None or path is None:
            return None
        name = Path(path).name
        return (project, name) if name in project.texts else None

    def text_of(self, uri: str) -> str:
        source = self.workspace.get_text_document(uri).source
        return source.replace('\r\n', '\n').replace('\r', '\n')

    def position(self, project: Project, name: str, position: lsp.Position) -> tuple[int, int]:
        """Return the line and column of a client's position. Columns count code points."""
        lines = project.symbols.files[name].lines
        if position.line >= len(lines):
            return len(lines) - 1, len(lines[-1])
        codec = self.workspace.position_codec
        result = codec.position_from_client_units(lines, position)
        return result.line, result.character

    def range_of(self, project: Project, place: Place) -> lsp.Range:
        lines = project.symbols.files[place.file].lines
        start = lsp.Position(place.line, place.start)
        whole = lsp.Range(start, lsp.Position(place.line, place.end))
        return self.workspace.position_codec.range_to_client_units(lines, whole)

    def location(self, project: Project, place: Place) -> lsp.Location:
        return lsp.Location(uri_of(project, place.file), self.range_of(project, place))

    def at(
        self, document: Document, position: lsp.Position
    ) -> tuple[Project, list[Symbol], Place] | None:
        known = self.project(document)
        if known is None:
            return None
        project, name = known
        found = project.symbols.at(name, *self.position(project, name, position))
        return None if found is None else (project, *found)

    def check_soon(self, project: Project) -> None:
        """Check a project as soon as nothing has changed for DEBOUNCE seconds."""
        task = self._checks.get(project.path)
        if task is None or task.done():
            task = asyncio.get_running_loop().create_task(self._check(project))
            task.add_done_callback(self._report)
            self._checks[project.path] = task

    def _report(self, task: asyncio.Task[None]) -> None:
        """Log and display the error that ended a check."""
        if not task.cancelled() and (error := task.exception()) is not None:
            logging.getLogger(__name__).error('the check failed', exc_info=error)
            text = f'spel check: {error}'
            self.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Error, text))

    async def _check(self, project: Project) -> None:
        while True:
            revision = project.revision
            await asyncio.sleep(DEBOUNCE)
            if revision != project.revision:
                continue
            revision, problems = await asyncio.to_thread(project.problems, self.rc_version)
            if revision == project.revision:
                break
        self._publish(project, problems)

    def _publish(self, project: Project, problems: Mapping[str, list[Problem]]) -> None:
        """Send the problems of each file.

        Files without problems are included if they are open or had problems before.
        """
        before = self._published.get(project.path, set())
        now = self._published[project.path] = {name for name in problems if problems[name]}
        for name in {*before, *now, *project.opened}:
            items = [self._diagnostic(project, problem) for problem in problems.get(name, ())]
            params = lsp.PublishDiagnosticsParams(uri_of(project, name), items)
            self.text_document_publish_diagnostics(params)

    def _diagnostic(self, project: Project, problem: Problem) -> lsp.Diagnostic:
        file, line, column = problem.position
        whole = lsp.Range(lsp.Position(line - 1, 0), lsp.Position(line, 0))  # of spel.yaml
        if file in project.symbols.files:
            lines = project.symbols.files[file].lines
            line = min(line, len(lines)) - 1
            start = min(column - 1, len(lines[line]))
            word = project.word_at(file, line, start)
            place = Place(file, line, start, min(start + max(len(word), 1), len(lines[line])))
            whole = self.range_of(project, place)
        severity = lsp.DiagnosticSeverity
        return lsp.Diagnostic(
            whole,
            problem.text,
            severity.Warning if problem.warning else severity.Error,
            problem.rule,
            source='spel check' if problem.rule in RULES else 'spel',
        )


def uri_of(project: Project, name: str) -> str:
    return str(from_fs_path(str(project.folder / name)))


server = SpelServer()


@server.feature(lsp.INITIALIZE)
def initialize(ls: SpelServer, parameters: lsp.InitializeParams) -> None:
    folders = [folder.uri for folder in parameters.workspace_folders or []]
    if not folders and parameters.root_uri:
        folders = [parameters.root_uri]
    ls.projects = Projects([Path(path) for uri in folders if (path := to_fs_path(uri))])
    options = parameters.initialization_options
    version = options.get('version') if isinstance(options, dict) else None
    if version in VERSIONS:
        ls.rc_version = version


@server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
@server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
def changed(
    ls: SpelServer, parameters: lsp.DidOpenTextDocumentParams | lsp.DidChangeTextDocumentParams
) -> None:
    uri = parameters.text_document.uri
    path = to_fs_path(uri)
    project = None if path is None else ls.projects.of(Path(path))
    if project is not None and path is not None:
        project.set(Path(path).name, ls.text_of(uri))
        ls.check_soon(project)


@server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
def closed(ls: SpelServer, parameters: lsp.DidCloseTextDocumentParams) -> None:
    known = ls.project(parameters.text_document)
    if known is not None:
        known[0].close(known[1])
        ls.check_soon(known[0])


@server.feature(lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES)
def files_changed(ls: SpelServer, parameters: lsp.DidChangeWatchedFilesParams) -> None:
    paths = [to_fs_path(change.uri) for change in parameters.changes]
    for project in {item for path in paths if path for item in ls.projects.below(Path(path))}:
        project.read()
        ls.check_soon(project)


@server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
def outline(ls: SpelServer, parameters: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol]:
    known = ls.project(parameters.text_document)
    if known is None:
        return []
    project, name = known
    result: list[lsp.DocumentSymbol] = []
    inside: dict[str, list[lsp.DocumentSymbol]] = {}
    for symbol in project.symbols.files[name].symbols:
        function = symbol.scope[1]
        if function and symbol.kind != 'label':
            continue
        place = ls.range_of(project, symbol.place)
        end = lsp.Position(symbol.last, 0) if symbol.last > symbol.place.line else place.end
        whole, kind = lsp.Range(place.start, end), _KINDS[symbol.kind][0]
        item = lsp.DocumentSymbol(symbol.name, kind, whole, place, symbol.detail)
        if symbol.kind == 'function':
            item.children = inside[symbol.name.lower()] = []
        inside.get(function, result).append(item)
    return result


@server.feature(lsp.TEXT_DOCUMENT_DEFINITION)
def definition(ls: SpelServer, parameters: lsp.DefinitionParams) -> list[lsp.Location]:
    found = ls.at(parameters.text_document, parameters.position)
    return [ls.location(found[0], item.place) for item in found[1]] if found else []


@server.feature(lsp.TEXT_DOCUMENT_REFERENCES)
def references(ls: SpelServer, parameters: lsp.ReferenceParams) -> list[lsp.Location]:
    found = ls.at(parameters.text_document, parameters.position)
    if found is None:
        return []
    project, symbols, _ = found
    places = project.symbols.references(symbols[0])
    if not parameters.context.include_declaration:
        declared = {item.place for item in symbols}
        places = [place for place in places if place not in declared]
    return [ls.location(project, place) for place in places]


@server.feature(lsp.TEXT_DOCUMENT_PREPARE_RENAME)
def prepare_rename(ls: SpelServer, parameters: lsp.PrepareRenameParams) -> lsp.Range | None:
    found = ls.at(parameters.text_document, parameters.position)
    return ls.range_of(found[0], found[2]) if found else None


@server.feature(lsp.TEXT_DOCUMENT_RENAME, lsp.RenameOptions(prepare_provider=True))
def rename(ls: SpelServer, parameters: lsp.RenameParams) -> lsp.WorkspaceEdit:
    found = ls.at(parameters.text_document, parameters.position)
    if found is None:
        raise JsonRpcInvalidParams('there is no name of the project here')
    project, symbols, _ = found
    try:
        changes = project.renamed(symbols[0], parameters.new_name)
    except RenameError as error:
        raise JsonRpcInvalidParams(str(error)) from error
    return lsp.WorkspaceEdit(
        {
            uri_of(project, name): [
                lsp.TextEdit(ls.range_of(project, place), text) for place, text in edits
            ]
            for name, edits in changes.items()
        }
    )


@server.feature(lsp.TEXT_DOCUMENT_HOVER)
def hover(ls: SpelServer, parameters: lsp.HoverParams) -> lsp.Hover | None:
    found = ls.at(parameters.text_document, parameters.position)
    if found is not None:
        project, symbols, place = found
        lines = [f'```spel\n{symbols[0].detail}\n```']
        lines += (f'{item.place.file}:{item.place.line + 1}' for item in symbols)
        return lsp.Hover(_markdown(lines), ls.range_of(project, place))
    known = ls.project(parameters.text_document)
    if known is None:
        return None
    project, name = known
    line, column = ls.position(project, name, parameters.position)
    if (bit := project.bit_at(name, line, column)) is not None:
        return lsp.Hover(_markdown([f'```spel\n{bit.name}: {bit.detail}\n```']))
    text = word_help(project.word_at(name, line, column))
    return lsp.Hover(_markdown([text])) if text else None


def _markdown(lines: Iterable[str]) -> lsp.MarkupContent:
    return lsp.MarkupContent(lsp.MarkupKind.Markdown, '\n\n'.join(lines))


@server.feature(lsp.TEXT_DOCUMENT_COMPLETION)
def completion(ls: SpelServer, parameters: lsp.CompletionParams) -> list[lsp.CompletionItem]:
    known = ls.project(parameters.text_document)
    if known is None:
        return []
    project, name = known
    symbols = {
        symbol.name.lower(): symbol
        for symbol in project.visible(name, *ls.position(project, name, parameters.position))
    }
    items = [
        lsp.CompletionItem(symbol.name, kind=_KINDS[symbol.kind][1], detail=symbol.detail)
        for symbol in symbols.values()
    ]
    labels = symbols and all(symbol.kind == 'label' for symbol in symbols.values())
    return items if labels else [*items, *_WORDS]


@server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
def formatting(ls: SpelServer, parameters: lsp.DocumentFormattingParams) -> list[lsp.TextEdit]:
    known = ls.project(parameters.text_document)
    if known is None or not known[1].lower().endswith((PROGRAM, INCLUDE)):
        return []
    project, name = known
    lines = project.symbols.files[name].lines
    new = formatted('\n'.join(lines)).split('\n')
    return [
        lsp.TextEdit(ls.range_of(project, Place(name, number, 0, len(line))), text)
        for number, (line, text) in enumerate(zip(lines, new, strict=True))
        if line != text
    ]


MANUAL = 'SPEL+ Language Reference, RC+ 8.0'
_ARGUMENTS = {
    kind: name
    for names in (
        'n number, i integer, s text$, x value, p point, q point, v variable, a array()',
        't task, # #port',
    )
    for kind, name in (pair.split() for pair in names.split(', '))
}


def _arguments(form: str) -> str:
    result = ''
    for place, kind in enumerate(form.split(',') if form else []):
        words = re.fullmatch(r'w\((.*)\)(\??)', kind)
        text = words[1] if words else _ARGUMENTS[kind.rstrip('?*')]
        text = f'{", " if place else ""}{text}{", …" if kind.endswith("*") else ""}'
        result += f'[{text}]' if kind[-1] in '?*' else text
    return result


def syntax_of(name: str) -> list[str]:
    key = name.lower()
    lines = []
    rule = COMMANDS.get(key)
    if key in SYNTAX:
        lines.append(SYNTAX[key])
    elif rule is not None and not rule.form.startswith('@'):
        lines.append(f'{rule.name} {_arguments(rule.form)}'.rstrip())
    function = FUNCTIONS.get(key)
    if function is not None:
        arguments = _arguments(function.arguments)
        lines.append(f'{function.name}({arguments})' if arguments else function.name)
    return lines


def word_help(name: str) -> str | None:
    key = name.lower()
    if key not in SPELLING:
        return None
    lines = ['```spel', *(syntax_of(name) or [SPELLING[key]] * (key in WORDS))]
    lines += [f'{SPELLING[key]} = {CONSTANTS[key]!r}'] if key in CONSTANTS else []
    word = WORDS.get(key)
    if word is None:
        return '\n'.join([*lines, '```'])
    notes = [f'{MANUAL}, page {word.page}'] if word.page is not None else []
    if word.since > FIRST:
        notes.append(f'since RC+ {".".join(map(str, word.since))}')
    if not word.background:
        notes.append(EXCEPTIONS.get(word.name, 'not in NoEmgAbort and background tasks'))
    return '\n'.join([*lines, '```', '; '.join(notes)])
