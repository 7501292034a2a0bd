# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""`epson_driver spel server`: what it answers to pygls' own client, and to Neovim."""

import asyncio
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException
from pygls.lsp.client import LanguageClient
from support.here import run_here

from epson_driver.cli import __main__ as cli
from generate.grammar import TARGET, grammar

COMMAND = [sys.executable, '-m', 'epson_driver.cli', 'spel', 'server']
MAIN = """\
Function main
Integer count, lost
again:
  Print "😀", count; Go pick
  On Gripper
  If Sw(1) = On Then GoTo again
  Help count; Off 9  ' not by Xqt
Fend
"""
HELP = """\
Function Help(n As Integer)
  Go pick :Z(-20)
  Off Gripper
Fend
"""


class Editor:
    """A client that has opened main.prg, and the problems that the server has sent."""

    def __init__(self, client: LanguageClient, folder: Path) -> None:
        self.client = client
        self.folder = folder
        self.text = MAIN
        self.problems: asyncio.Queue[lsp.PublishDiagnosticsParams] = asyncio.Queue()
        self.document = lsp.TextDocumentIdentifier((folder / 'main.prg').as_uri())

    def place(self, text: str) -> dict[str, Any]:
        """Return document and position of a text in main.prg, in UTF-16 units."""
        before = self.text[: self.text.index(text)]
        line = before.count('\n')
        column = len(before.rpartition('\n')[2].encode('utf-16-le')) // 2
        return {'text_document': self.document, 'position': lsp.Position(line, column)}


def with_editor(folder: Path, play: Callable[[Editor], Awaitable[None]]) -> None:
    """Play a session with a server for the project in a folder, and end it."""

    async def session() -> None:
        client = LanguageClient('test', '1')
        editor = Editor(client, folder)

        @client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def _(problems: lsp.PublishDiagnosticsParams) -> None:
            editor.problems.put_nowait(problems)

        await client.start_io(*COMMAND)
        await client.initialize_async(
            lsp.InitializeParams(lsp.ClientCapabilities(), root_uri=folder.as_uri())
        )
        client.initialized(lsp.InitializedParams())
        client.text_document_did_open(
            lsp.DidOpenTextDocumentParams(
                lsp.TextDocumentItem(editor.document.uri, 'spel', 1, editor.text)
            )
        )
        await play(editor)
        await client.shutdown_async(None)
        client.exit(None)
        await client.stop()
        assert client._server.returncode == 0

    asyncio.run(asyncio.wait_for(session(), 500))


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Write a project with a point and an I/O label."""
    from test_projects import written

    written(tmp_path)
    (tmp_path / 'main.prg').write_text(MAIN)
    (tmp_path / 'help.prg').write_text(HELP)
    return tmp_path


def test_client_uses_every_request_of_the_server(project: Path) -> None:
    async def play(editor: Editor) -> None:
        client, place = editor.client, editor.place
        shown = await editor.problems.get()
        assert [(item.range.start.line, item.code) for item in shown.diagnostics] == [
            (1, 'unused')
        ]
        assert shown.diagnostics[0].range == lsp.Range(lsp.Position(1, 15), lsp.Position(1, 19))

        symbols = await client.text_document_document_symbol_async(
            lsp.DocumentSymbolParams(editor.document)
        )
        assert [(item.name, [child.name for child in item.children]) for item in symbols] == [
            ('main', ['again'])
        ]
        found = await client.text_document_definition_async(lsp.DefinitionParams(**place('Help')))
        assert [(item.uri.rpartition('/')[2], item.range.start) for item in found] == [
            ('help.prg', lsp.Position(0, 9))
        ]
        ask = partial(lsp.ReferenceParams, lsp.ReferenceContext(False))
        found = await client.text_document_references_async(ask(**place('count; Go')))
        assert [item.range.start for item in found] == [lsp.Position(3, 14), lsp.Position(6, 7)]

        for text, part in (
            ('pick', 'P3 = XY(1.000, 2.000, 3.000, 4.000, 5.000, 6.000) /0'),
            ('Gripper', 'output bit 9: グリッパー'),
            ('count', 'Integer count'),
            ('On Gripper', 'On number[, number]'),
            ('GoTo', 'SPEL+ Language Reference, RC+ 8.0, page 359'),
            ("9  '", 'Gripper: output bit 9: グリッパー'),
            ('Xqt', 'page 912; not in NoEmgAbort tasks'),
        ):
            hover = await client.text_document_hover_async(lsp.HoverParams(**place(text)))
            assert part in hover.contents.value
        complete = client.text_document_completion_async
        names = {item.label for item in await complete(lsp.CompletionParams(**place('count; Go')))}
        assert names >= {'count', 'lost', 'Help', 'pick', 'P3', 'Gripper', 'LimZ', 'MB_OK'}
        assert not names & {'n', 'again'}
        items = await complete(lsp.CompletionParams(**place('ain\n  Help')))
        assert [item.label for item in items] == ['again']
        edits = await client.text_document_formatting_async(
            lsp.DocumentFormattingParams(editor.document, lsp.FormattingOptions(8, True))
        )
        assert [edit.new_text for edit in edits] == ['  Integer count, lost']

        renaming = lsp.RenameParams(**place('pick'), new_name='grasp')
        changes = (await client.text_document_rename_async(renaming)).changes
        sizes = {uri.rpartition('/')[2]: len(edits) for uri, edits in changes.items()}
        assert sizes == {'main.prg': 1, 'help.prg': 1, 'robot1.pts': 2}
        renaming = lsp.RenameParams(**place('pick'), new_name='help')
        with pytest.raises(JsonRpcException, match='help is another function already'):
            await client.text_document_rename_async(renaming)
        assert (
            await client.text_document_prepare_rename_async(
                lsp.PrepareRenameParams(**place('Print'))
            )
            is None
        )

    with_editor(project, play)
    assert (project / 'main.prg').read_text() == MAIN


def test_problems_follow_typing_changed_files_and_deleted_files(project: Path) -> None:
    async def play(editor: Editor) -> None:
        assert len((await editor.problems.get()).diagnostics) == 1
        place = editor.place(', lost')['position']
        change = lsp.TextDocumentContentChangePartial(
            lsp.Range(place, lsp.Position(place.line, place.character + 6)), ''
        )
        document = lsp.VersionedTextDocumentIdentifier(2, editor.document.uri)
        editor.client.text_document_did_change(lsp.DidChangeTextDocumentParams(document, [change]))
        assert not (await editor.problems.get()).diagnostics
        helper = project / 'help.prg'
        helper.write_text(HELP.replace('Off', 'Of'))
        event = lsp.FileEvent(helper.as_uri(), lsp.FileChangeType.Changed)
        editor.client.workspace_did_change_watched_files(lsp.DidChangeWatchedFilesParams([event]))
        while (params := await editor.problems.get()).uri != helper.as_uri():
            pass
        assert [item.code for item in params.diagnostics] == ['unknown']
        helper.unlink()
        editor.client.workspace_did_change_watched_files(lsp.DidChangeWatchedFilesParams([event]))
        while (params := await editor.problems.get()).uri != helper.as_uri():
            pass
        assert not params.diagnostics
        settings = project / 'spel.yaml'
        settings.write_text('robot: t6_602s\nport: 5\n')
        event = lsp.FileEvent(settings.as_uri(), lsp.FileChangeType.Created)
        editor.client.workspace_did_change_watched_files(lsp.DidChangeWatchedFilesParams([event]))
        while (params := await editor.problems.get()).uri != settings.as_uri():
            pass
        (problem,) = params.diagnostics
        assert (problem.range.start.line, 'did you mean ports?' in problem.message) == (1, True)

    with_editor(project, play)


@pytest.mark.skipif(shutil.which('nvim') is None, reason='needs Neovim: apt install neovim')
def test_neovim_uses_the_server(project: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    out = tmp_path_factory.mktemp('neovim') / 'out.json'
    environment = os.environ | {
        'SERVER': ' '.join(COMMAND),
        'OUT': str(out),
        **dict.fromkeys(('XDG_STATE_HOME', 'XDG_CACHE_HOME', 'XDG_DATA_HOME'), str(out.parent)),
    }
    script = Path(__file__).with_name('session.lua')
    command = ['nvim', '--headless', '--clean', '-n', '-S', str(script)]
    result = subprocess.run(
        command, cwd=project, env=environment, capture_output=True, text=True, timeout=500
    )
    said = json.loads(out.read_text())
    assert (said['error'], result.returncode) == ('', 0), result.stderr
    assert said['diagnostics'] == [[1, 15, 'lost is never used', 'unused']]
    assert said['outline'] == ['main']
    assert said['definition'] == ['help.prg', 1, 10]
    changed = MAIN.replace('pick', 'grasp').replace('Gripper', 'Vacuum')
    assert (project / 'main.prg').read_text() == changed.replace('\nInteger', '\n  Integer')
    assert 'Go grasp :Z(-20)\n  Off Vacuum' in (project / 'help.prg').read_text()
    assert 'sLabel="grasp"' in (project / 'robot1.pts').read_text()


@pytest.mark.parametrize('module', ['lsprotocol', 'pygls'])
def test_without_the_extra_one_sentence_says_how_to_install_it(module: str) -> None:
    with patch.dict(sys.modules, {module: None}):
        sys.modules.pop('epson_driver.editor.server', None)
        result = run_here(cli.main, 'spel', 'server')
    text = f"the Python module {module} is missing: pip install 'epson_driver[editor]'"
    assert (result.returncode, result.stderr) == (1, f'epson_driver spel: {text}\n')


def test_vs_code_grammar_has_every_word_of_the_table() -> None:
    assert TARGET.read_text() == grammar(), 'python -m generate.grammar'
