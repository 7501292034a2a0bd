# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the controller is in: its condition as tables, its tasks, the error it shows."""
