# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""A language server for SPEL+: `epson_driver spel server`, over stdin and stdout.

`projects` has the texts and answers of each project without the protocol, `server` the protocol
(pygls, the extra [editor]). The server reads below the workspace folders only, and writes no
files: edits are sent to the client.
"""
