# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What tests share: an event loop whose time is virtual, peers, harnesses, processes."""
