# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The command line: one file per executable, which reads its arguments and calls the work."""
