# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The cache of robot descriptions, keyed by content. Its failures only cost time."""

import threading
from pathlib import Path

import pytest

from epson_driver.robots.urdf import cached


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    return tmp_path / 'epson_driver'


def test_cached_urdf_is_generated_once_for_equal_content(folder: Path) -> None:
    made = []

    def make() -> str:
        made.append('')
        return f'text {len(made)}\n'

    assert [cached([b'a', b'b'], make) for _ in range(3)] == ['text 1\n'] * 3
    assert cached([b'ab', b''], make) == 'text 2\n'
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize('damage', [b'', b'text', b'\xff\xfe', b'0' * 64 + b'\nother'])
def test_damaged_cache_file_is_generated_again(folder: Path, damage: bytes) -> None:
    assert cached([b'a'], lambda: 'first') == 'first'
    (file,) = folder.iterdir()
    file.write_bytes(damage)
    assert cached([b'a'], lambda: 'second') == 'second'
    assert cached([b'a'], lambda: 'third') == 'second'


def test_unwritable_home_is_tolerated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'file').write_text('')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'file'))
    assert cached([b'a'], lambda: 'made') == 'made'
    monkeypatch.setenv('XDG_CACHE_HOME', 'relative')
    monkeypatch.setenv('HOME', str(tmp_path / 'file'))
    assert cached([b'a'], lambda: 'made') == 'made'


def test_concurrent_writers_leave_one_complete_file(folder: Path) -> None:
    text = 'x' * 1_000_000
    result: list[str] = []
    threads = [
        threading.Thread(target=lambda: result.append(cached([b'a'], lambda: text)))
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert result == [text] * 8
    assert len(list(folder.iterdir())) == 1
