# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What a person does at a controller and what is read there, over its remote port."""
