# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A language server for SPEL+: `epson_driver spel server`, over stdin and stdout.

`projects` keeps the texts of each project and answers questions about it. `server` implements the
protocol (pygls, the extra [editor]). The server reads only below the workspace folders. It writes
no files, and sends edits to the client instead.
"""
