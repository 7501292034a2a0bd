# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The error for everything that a person may ask for and that cannot be done now."""


class RequestError(RuntimeError):
    """It is not done; the text says why, and what to do. Any other exception ends the panel."""
