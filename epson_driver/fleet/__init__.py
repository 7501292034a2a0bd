# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Many simulated robots with their drivers: what runs, what is heard of it, and a table."""
