# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the pages of the report and the panel share: how an arm is drawn, three.js and uPlot."""

from importlib.resources import files


def asset(name: str) -> str:
    """Return the text of a script or a style: bundle.js, bundle.css or arm.js."""
    return files(__name__).joinpath('assets', name).read_text(encoding='utf-8')
