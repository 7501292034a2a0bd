# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""How a trajectory becomes messages, and how these are sent to each kind of controller."""
