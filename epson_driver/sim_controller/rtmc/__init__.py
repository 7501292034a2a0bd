# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON's Real-time Motion Control as the simulated controller serves it."""
