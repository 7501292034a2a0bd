# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of trajectories to messages, and their delivery to each kind of controller."""
