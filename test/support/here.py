# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs a command of this package in the test's process."""

import contextlib
import io
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch


def run_here(
    main: Callable[[], int], *words: str | Path, cwd: Path | None = None
) -> CompletedProcess[str]:
    """Return the output and exit code of `main` for these arguments."""
    out, err = io.StringIO(), io.StringIO()
    arguments = [*map(str, words)]
    with (
        patch.object(sys, 'argv', ['epson_driver', *arguments]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        contextlib.chdir(cwd or Path.cwd()),
    ):
        try:
            code = main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
    return CompletedProcess(arguments, code, out.getvalue(), err.getvalue())
