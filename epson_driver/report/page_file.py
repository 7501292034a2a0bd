# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Write a report: the page and its figures as JSON, each as a whole or not at all."""

import json
import os
import tempfile
from pathlib import Path

from epson_driver.report.figures import Figures, as_json
from epson_driver.report.page import page
from epson_driver.report.run import Run
from epson_driver.robots import RobotModel


def write_report(group: list[tuple[Run, Figures]], model: RobotModel, output: Path) -> None:
    """Write a page and its JSON beside it, and say where. Raises OSError."""
    write_whole(output, page(group, model))
    beside = output.with_suffix('.json')
    content = [as_json(run, numbers, run.events, model) for run, numbers in group]
    text = json.dumps(content[0] if len(content) == 1 else content, indent=1, allow_nan=False)
    write_whole(beside, text + '\n')
    print(f'report: {output}\nfigures: {beside}')


def write_whole(path: Path, text: str) -> None:
    """Write a file so that it is there as a whole or not at all. Raises OSError."""
    with tempfile.NamedTemporaryFile(
        'w', encoding='utf-8', dir=path.parent, prefix=f'.{path.name}', delete=False
    ) as file:
        try:
            file.write(text)
            file.flush()
            mask = os.umask(0)
            os.umask(mask)
            Path(file.name).chmod(0o666 & ~mask)
            Path(file.name).replace(path)
        except BaseException:
            Path(file.name).unlink(missing_ok=True)
            raise
