# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A person's actions at a controller, and its status, over its remote port."""
