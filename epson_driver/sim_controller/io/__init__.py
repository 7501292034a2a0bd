# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Inputs and outputs, and their port."""
