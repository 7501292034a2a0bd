# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The remote port: EPSON's Remote Ethernet, SPEL+ statements, and `$Sim,…`."""
