# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The condition of the controller as tables: its tasks, error, and SPEL+ settings."""
