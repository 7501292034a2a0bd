# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Reports on recorded runs, from traces and bags (docs/report.md).

trace_run.py and bag_run.py read a `Run` (run.py) from a file. figures.py computes the run's
measured values. page.py writes the run as one self-contained HTML file, and bag_file.py as an MCAP
bag.
"""
