# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Taught points: what a teach pendant shows of them, and the files that hold them."""
