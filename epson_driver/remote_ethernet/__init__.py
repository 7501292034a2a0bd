# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""EPSON's Remote Ethernet: a client, and its error numbers."""
