# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""SPEL+ programs on the simulated controller: their tasks, ports, I/O and motions."""
