# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A SPEL+ program on the simulated controller: its tasks, ports and I/O, and its arm."""
