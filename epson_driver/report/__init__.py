# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Report of a run, from a trace or a bag, as a page that opens anywhere (docs/report.md).

trace_run.py and bag_run.py read a `Run` (run.py). figures.py computes its figures, page.py writes
it as one HTML file, and bag_file.py as an MCAP bag.
"""
