# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What all ports have in common: sessions with clients, and the requests that each answers."""
