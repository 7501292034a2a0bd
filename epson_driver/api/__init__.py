# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What the Python API is made of; epson_driver.robot and epson_driver.aio are its two doors."""
