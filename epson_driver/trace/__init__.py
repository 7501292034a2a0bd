# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Records the traffic on the wire as pcap files, and reads it from them."""

from epson_driver.trace.trace import Trace, TraceError, open_trace

__all__ = ['Trace', 'TraceError', 'open_trace']
