# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The arm: how it goes to its points, how its joints follow, and who plans smooth motion."""
