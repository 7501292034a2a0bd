# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Generators of the files in urdf/ and config/moveit/ from config/robots/, for developers."""
