# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Streams of setpoints, which the arm follows (docs/servo.md): their messages and the session."""
