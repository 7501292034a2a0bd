# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The browser panel: the robots in 3D, what they report, and buttons for the driver's services.

It uses the driver as any other program does: topics, services and the action. Its page is served
by viser (`[panel]` extra), behind rules of its own about who is let in (`access.py`).
"""
