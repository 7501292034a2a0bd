# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Implementation of the Python API. Users import epson_driver.robot or epson_driver.aio."""
