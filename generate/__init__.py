# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Screenshots for the documentation, the page's bundle of scripts, and the editors' grammar."""
