# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Faults on demand: what there is, and what they do to messages and to the controller."""
