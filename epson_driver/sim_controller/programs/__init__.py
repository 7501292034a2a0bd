# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The built-in programs, which serve the motion port and move the arm."""
