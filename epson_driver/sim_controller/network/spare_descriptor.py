# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A file descriptor that is kept for when there is no other left."""

import os


class SpareDescriptor:
    """Keeps one descriptor back, or none: nothing is kept at first."""

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def keep(self) -> None:
        """Keep one, if it is not kept yet and there is one."""
        if self._descriptor is None:
            try:
                self._descriptor = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
            except OSError:  # none is left: the next client that goes frees one
                return

    def give(self) -> bool:
        """Let the one be used that is kept; return whether there was one."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)
        return descriptor is not None
