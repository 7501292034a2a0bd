# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fuzzing: messages with the protocol's structure, mutated, against both roles and all ports.

`python -m benchmark.fuzz` (`make fuzz`) runs it. `messages.py` generates the inputs, `targets.py`
lists the targets, and `cases.py` defines cases, their reduction and their files.
"""
