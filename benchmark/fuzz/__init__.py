# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Fuzzing: messages with the protocol's structure, mutated, against both roles and all ports.

`python -m benchmark.fuzz` (`make fuzz`) runs it; `messages.py` makes the inputs, `targets.py` says
what is tried, `cases.py` what a case is, how it is made smaller and where found ones are kept.
"""
