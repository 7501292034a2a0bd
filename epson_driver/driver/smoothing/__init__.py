# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Preparing a smooth motion through a plan, in a process of its own."""
