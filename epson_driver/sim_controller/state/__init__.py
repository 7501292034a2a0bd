# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The state port: joints and STATUS as messages, sent by the clock and on request."""
