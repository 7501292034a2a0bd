# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The parts of the Python API, which users reach as epson_driver.robot and epson_driver.aio."""
