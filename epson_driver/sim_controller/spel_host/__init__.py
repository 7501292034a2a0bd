# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A SPEL+ program on the simulated controller: its tasks, ports, bits, and the arm it moves."""
