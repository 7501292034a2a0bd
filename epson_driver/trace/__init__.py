# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Traces: pcap files with the data that network connections send and receive."""

from epson_driver.trace.trace import Trace, TraceError, open_trace

__all__ = ['Trace', 'TraceError', 'open_trace']
