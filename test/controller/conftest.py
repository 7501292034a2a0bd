# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Its place puts the benches beside it on the path of the tests in the folders below."""
