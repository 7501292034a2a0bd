# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A file descriptor in reserve, for when there is no other left."""

import os


class SpareDescriptor:
    """One file descriptor in reserve, or none: there is none at first."""

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def keep(self) -> None:
        """Reserve one, unless that is done already or none is left."""
        if self._descriptor is None:
            try:
                self._descriptor = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
            except OSError:  # none is left: the next client that goes frees one
                return

    def give(self) -> bool:
        """Free the reserved one for use; return whether there was one."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)
        return descriptor is not None
