# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A person's own program against the simulated controller, once per fault (docs/controller.md).

cases.py says what happens in each; cell.py has controller, driver and the person at the pendant;
runner.py runs the program and judge.py says what it did. pytest_plugin.py brings the same cell as
a fixture to other packages.
"""
