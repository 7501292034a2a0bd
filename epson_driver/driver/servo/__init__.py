# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Following of setpoint streams (docs/servo.md)."""
