# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The command line, with one module per executable that parses its arguments."""
