# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Runs a user's program against the simulated controller, once per fault (docs/controller.md).

cell.py runs controller and driver and acts as the person at the pendant. runner.py runs the
program through its cases, and judge.py evaluates its behaviour. pytest_plugin.py offers the same
cell as a fixture to other packages.
"""
