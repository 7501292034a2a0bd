# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Stopping the arm and inhibiting motion: STOP, motors, heartbeats and the arm gate."""
