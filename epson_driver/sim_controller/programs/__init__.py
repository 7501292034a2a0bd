# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The program on the motion port: messages in, points for the arm, replies out."""
