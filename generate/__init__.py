# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""What writes the files of urdf/ and config/moveit/ from config/robots/. Run by developers."""
