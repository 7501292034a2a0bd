# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What stops the arm and keeps it still: STOP, motors and the arm gate."""
