# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the connection between this machine and a controller (docs/troubleshooting.md).

environment.py checks this machine. listening.py receives a controller's messages, and
state_facts.py derives the controller's behaviour from them. asking.py sends requests that cannot
move anything, and learning.py writes the results as a controller profile.
"""
