# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Tasks of the event loop that are watched, and waiting for changes."""
